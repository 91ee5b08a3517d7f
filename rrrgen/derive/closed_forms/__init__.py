"""Closed forms: formulas of the functions of a robot, with intermediate results expanded and angles collected."""
