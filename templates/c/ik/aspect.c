/* The branch label of a general arm: the sign of the determinant of its Jacobian. Needs refine.c and general6r.c. */
#include "kernel.h"
/* 0 where the determinant of the Jacobian is positive, 1 where it is negative. Where the Jacobian is singular, solutions meet, and
 * the flag of a multiple solution is set in *flags. */
LOCAL unsigned ik_aspect(const REAL *T, const REAL *q, unsigned *flags)
{
    REAL e[6];
    REAL J[6][JOINTS];
    ik_6r_real a[6][10];
    ik_6r_real det;
    int i;
    int j;
    (void)ik_error(T, q, e, J NONE_HELD);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 10; ++j) {
            a[i][j] = 0.0;
        }
        for (j = 0; j < 6; ++j) {
#if LOCKED_FIRST
            a[i][j] = (ik_6r_real)J[i][j + 1];
#else
            a[i][j] = (ik_6r_real)J[i][j];
#endif
        }
    }
    det = ik_6r_lu(a, 6);
    for (i = 0; i < 6; ++i) {
        *flags |= (fabs(a[i][i]) < VALUE_6R_SINGULAR) ? (unsigned)IK_MULTIPLE : 0u;
    }
    return (det > 0.0) ? 0u : 1u;
}
