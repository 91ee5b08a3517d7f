"""The CasADi backend: SX functions, a Python module that rebuilds them, and C for CasADi's external interface.

Matrices are two-dimensional in CasADi, (rows, columns); a stack of matrices of shape (k, m, n) becomes the (k*m, n)
matrix of the blocks one below the other. CasADi itself is needed by :func:`function` and :func:`serialized` only;
everything else is text and is the same whichever version of CasADi is installed, or none.
"""

from rrrgen.emit.casadi.derivatives import Matrix, Routine, forward, jacobian, reverse, routine
from rrrgen.emit.casadi.external import definitions, external_files, external_sources
from rrrgen.emit.casadi.files import (
    derivative_functions,
    external_functions,
    is_reproducible,
    module_file,
    serialized,
    sources,
)
from rrrgen.emit.casadi.function import function, smooth_sign
from rrrgen.emit.casadi.inverse_kinematics import branch_function, branch_labels, branch_signs
from rrrgen.emit.casadi.module import rebuild_module
from rrrgen.emit.casadi.own_derivatives import with_own_derivatives

__all__ = [
    "Matrix",
    "Routine",
    "branch_function",
    "branch_labels",
    "branch_signs",
    "definitions",
    "derivative_functions",
    "external_files",
    "external_functions",
    "external_sources",
    "forward",
    "function",
    "is_reproducible",
    "jacobian",
    "module_file",
    "rebuild_module",
    "reverse",
    "routine",
    "serialized",
    "smooth_sign",
    "sources",
    "with_own_derivatives",
]
