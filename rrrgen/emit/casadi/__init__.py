"""The CasADi backend: SX functions, a Python module that rebuilds them, and C for CasADi's external interface.

Matrices are two-dimensional in CasADi, (rows, columns); a stack of matrices of shape (k, m, n) becomes the (k*m, n)
matrix of the blocks one below the other. CasADi itself is needed by :func:`function` and :func:`serialize` only;
everything else is text and is the same whichever version of CasADi is installed, or none.
"""
