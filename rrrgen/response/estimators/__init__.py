"""Estimators of frequency responses, and checks of the recordings that they use."""
