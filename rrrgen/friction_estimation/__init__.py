"""Friction of one joint from a recording of its motion: Kalman filter, output error, choice of the law, presliding."""
