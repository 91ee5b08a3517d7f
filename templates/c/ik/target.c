/* Checks of the target: finite numbers, a valid rotation, and a distance at which the arm's size is not lost in rounding. */
#include "kernel.h"
#if !POSITION
/* Measures how far the rotation of a target is from orthonormal and right-handed. With x, y, z its columns: *xx = x.x - 1,
 * *yy = y.y - 1, *xy = x.y. Returns the sum of their magnitudes and of those of the entries of x cross y - z. */
LOCAL_INLINE REAL ik_defect(const REAL *T, REAL *xx, REAL *yy, REAL *xy)
{
    const REAL zx = (T[4] * T[9]) - (T[8] * T[5]) - T[2];
    const REAL zy = (T[8] * T[1]) - (T[0] * T[9]) - T[6];
    const REAL zz = (T[0] * T[5]) - (T[4] * T[1]) - T[10];
    *xx = (T[0] * T[0]) + (T[4] * T[4]) + (T[8] * T[8]) - (REAL)1;
    *yy = (T[1] * T[1]) + (T[5] * T[5]) + (T[9] * T[9]) - (REAL)1;
    *xy = (T[0] * T[1]) + (T[4] * T[5]) + (T[8] * T[9]);
    return FABS(*xx) + FABS(*yy) + FABS(*xy) + FABS(zx) + FABS(zy) + FABS(zz);
}

#endif
#if OPENED
/* Estimates the accuracy of the numbers of a target: the defect of its rotation, but at least a few rounding errors. Called
 * only where a joint may be free, so that other targets do not pay for it. */
LOCAL REAL ik_accuracy(const REAL *target)
{
    const REAL rounding = (REAL)ROUNDING_UNITS * IK_TOL_EPS;
#if POSITION
    (void)target;
    return rounding;
#else
    REAL xx;
    REAL yy;
    REAL xy;
    const REAL defect = ik_defect(target, &xx, &yy, &xy);
    return (defect > rounding) ? defect : rounding;
#endif
}

#endif
/* Checks the numbers of a target and copies it to T, with its rotation made orthonormal. Returns the status of the check. */
LOCAL ik_status ik_check(const REAL *target, const REAL *q_ref LOCK_PARAMETER, REAL T[TARGET])
{
#if REDUNDANT
    REAL sum = (lock * lock) * (REAL)0;
#else
    REAL sum = (REAL)0;
#endif
    int i;
    for (i = 0; i < TARGET_READ; ++i) {
        T[i] = target[i];
        sum += target[i] * (REAL)0;
    }
    if (q_ref != NULL) {
        for (i = 0; i < JOINTS; ++i) {
            sum += (q_ref[i] * q_ref[i]) * (REAL)0; /* sums and distances of huge numbers would overflow */
        }
    }
    if (!(sum <= (REAL)0)) {
        return IK_NOT_FINITE;
    }
#if !POSITION
    {
        REAL xx;
        REAL yy;
        REAL xy;
        const REAL defect = ik_defect(T, &xx, &yy, &xy);
        if (!(defect <= IK_TOL_ORTHONORMAL)) {
            return IK_NOT_A_ROTATION;
        }
        if (defect > ((REAL)ROUNDINGS * IK_TOL_EPS)) { /* the nearest rotation, to first order */
            for (i = 0; i < 3; ++i) {
                const REAL x = T[4 * i];
                const REAL y = T[(4 * i) + 1];
                T[4 * i] = (x * ((REAL)1 - ((REAL)0.5 * xx))) - ((REAL)0.5 * xy * y);
                T[(4 * i) + 1] = (y * ((REAL)1 - ((REAL)0.5 * yy))) - ((REAL)0.5 * xy * x);
            }
            T[2] = (T[4] * T[9]) - (T[8] * T[5]);
            T[6] = (T[8] * T[1]) - (T[0] * T[9]);
            T[10] = (T[0] * T[5]) - (T[4] * T[1]);
        }
    }
#endif
    return IK_OK;
}

#if TOOL
/* Whether the target is so far away, or the tool so long, that the size of the arm is lost in rounding errors. */
#else
/* Whether the target is so far away that, in its coordinates, the size of the arm is lost in rounding errors. */
#endif
LOCAL int ik_far(const REAL *T)
{
    const REAL bound = (REAL)FAR_AWAY;
#if TOOL
    const REAL longest = (REAL)TOOL_AWAY;
    if (!((FABS(T[3]) < longest) && (FABS(T[4]) < longest) && (FABS(T[5]) < longest))) {
        return 1;
    }
#endif
    return (int)(!((FABS(T[AT_X]) < bound) && (FABS(T[AT_Y]) < bound) && (FABS(T[AT_Z]) < bound)));
}
