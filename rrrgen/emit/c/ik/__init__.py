"""The emitted C of the inverse kinematics: loops over the roots of each equation, which call the kernels (numerical C
functions) of ``templates/c/ik``."""
