"""Frequency responses with their uncertainty, and linear models fitted to them: dynamics beyond the rigid body."""
