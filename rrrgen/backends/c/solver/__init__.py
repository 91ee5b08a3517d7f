"""C of the inverse kinematics: a recorded solver as loops over roots, around the kernels of templates/c/ik."""
