"""Friction laws in the identification of a robot: fit of their nonlinear parameters ("shapes"), choice of the laws.

A shape is a parameter in which a law is not linear, such as the Stribeck speed. All other parameters are estimated with
those of the links.
"""
