"""The virtual robot: simulated dynamics with friction, drives, encoders and flexible modes, under sampled control.

Equation numbers in this package are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for
Robot Motion Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""
