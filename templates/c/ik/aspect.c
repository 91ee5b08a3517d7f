/* The branch label of a general arm: the sign of the determinant of its Jacobian. Needs refine.c and general6r.c. */
#include "kernel.h"
/* 0 where the determinant of the Jacobian is positive, 1 where it is negative. */
LOCAL unsigned ik_aspect(const REAL *T, const REAL *q)
{
    REAL e[6], J[6][JOINTS], a[6][10] = { {(REAL)0} };
    int i, j;
    (void)ik_error(T, q, e, J NONE_HELD);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 6; ++j) {
#if LOCKED_FIRST
            a[i][j] = J[i][j + 1];
#else
            a[i][j] = J[i][j];
#endif
        }
    }
    return ik_6r_lu(a, 6) > (REAL)0 ? 0u : 1u;
}
