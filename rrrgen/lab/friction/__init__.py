"""Estimation of the friction of one joint from a recording of its motion.

Several friction laws are fitted, by an extended Kalman filter and then by output error, and one is chosen. The bristle
stiffness of presliding is estimated from frequency responses below break-away.
"""
