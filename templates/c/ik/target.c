/* The numbers of a target: what is wrong with them, and whether it is absurdly far away. Needs tolerances.c. */
#include "kernel.h"
#if OPENED
/* What is wrong with the numbers of a target, and a copy of it with an exact rotation in T. Its numbers are taken to be as
 * accurate as its rotation is orthonormal, and never better than some units of rounding. */
#else
/* What is wrong with the numbers of a target, and a copy of it with an exact rotation in T. */
#endif
LOCAL ik_status ik_check(const REAL *target, const REAL *q_ref LOCK_PARAMETER, REAL T[TARGET] ACCURACY_PARAMETER)
{
#if REDUNDANT
    REAL sum = lock * (REAL)0;
#else
    REAL sum = (REAL)0;
#endif
    int i;
    for (i = 0; i < TARGET_READ; ++i) {
        T[i] = target[i];
        sum += target[i] * (REAL)0;
    }
    for (i = 0; q_ref && i < JOINTS; ++i) {
        sum += q_ref[i] * (REAL)0;
    }
    if (!(sum <= (REAL)0)) {
        return IK_NOT_FINITE;
    }
#if OPENED
    *accuracy = (REAL)ROUNDING_UNITS * IK_TOL_EPS;
#endif
#if !POSITION
    {
        const REAL xx = T[0] * T[0] + T[4] * T[4] + T[8] * T[8] - (REAL)1;
        const REAL yy = T[1] * T[1] + T[5] * T[5] + T[9] * T[9] - (REAL)1;
        const REAL xy = T[0] * T[1] + T[4] * T[5] + T[8] * T[9];
        const REAL zx = T[4] * T[9] - T[8] * T[5] - T[2];
        const REAL zy = T[8] * T[1] - T[0] * T[9] - T[6];
        const REAL zz = T[0] * T[5] - T[4] * T[1] - T[10];
        const REAL defect = FABS(xx) + FABS(yy) + FABS(xy) + FABS(zx) + FABS(zy) + FABS(zz);
        if (!(defect <= IK_TOL_ORTHONORMAL)) {
            return IK_NOT_A_ROTATION;
        }
#if OPENED
        *accuracy = defect > *accuracy ? defect : *accuracy;
#endif
        if (defect > (REAL)64 * IK_TOL_EPS) { /* the nearest rotation, to first order */
            for (i = 0; i < 3; ++i) {
                const REAL x = T[4 * i], y = T[4 * i + 1];
                T[4 * i] = x * ((REAL)1 - (REAL)0.5 * xx) - (REAL)0.5 * xy * y;
                T[4 * i + 1] = y * ((REAL)1 - (REAL)0.5 * yy) - (REAL)0.5 * xy * x;
            }
            T[2] = T[4] * T[9] - T[8] * T[5];
            T[6] = T[8] * T[1] - T[0] * T[9];
            T[10] = T[0] * T[5] - T[4] * T[1];
        }
    }
#endif
    return IK_OK;
}

/* Whether the target is so far away that its coordinates drown the arm. */
LOCAL int ik_far(const REAL *T)
{
    const REAL bound = (REAL)FAR_AWAY;
    return !(FABS(T[AT_X]) < bound && FABS(T[AT_Y]) < bound && FABS(T[AT_Z]) < bound);
}
