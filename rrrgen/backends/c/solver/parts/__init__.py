"""Functions of a solver that are printed from programs, beside the kernels of ``templates/c/ik``."""
