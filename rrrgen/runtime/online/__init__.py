"""Online parameter estimators and differential inverse kinematics in Python: the emitted C, or the same in NumPy."""
