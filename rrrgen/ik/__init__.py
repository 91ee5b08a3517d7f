"""Inverse kinematics: a chain is classified, its closed form derived, and self-contained C, CasADi or text printed."""
