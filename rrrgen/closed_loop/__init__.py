"""Closed-loop output error: the loop of a known controller and the robot, simulated and fitted to a recording."""
