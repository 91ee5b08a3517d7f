"""Estimators of frequency responses, and checks of what they were given."""
