"""Identification of a robot's parameters: exciting trajectories, estimation from recordings, diagnosis, validation.

Equation and figure numbers in this package are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and
Identification for Robot Motion Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""
