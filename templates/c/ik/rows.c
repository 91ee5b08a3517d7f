/* Multiples of 2 pi and joint limits, and how far solutions are apart. Needs angles.c. */
#include "kernel.h"
#if LIMITED
/* Rounds x >= 0 up to an integer. Adding and subtracting a number whose last binary digit is 1 rounds to an integer and can be
 * vectorized; it fails where the compiler may reorder arithmetic (-ffast-math) or computes in a higher precision. */
LOCAL REAL ik_whole(REAL x)
{
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
    return CEIL(x);
#elif defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 16
    return CEIL(x);
#else
    const REAL big = (REAL)VALUE_ROUNDING;
    return ((x + (REAL)0.5) + big) - big;
#endif
}

/* Joint limits (rad or m); very large values for a joint without limits. */
LOCAL const REAL ik_lower[JOINTS] = LOWER;
LOCAL const REAL ik_upper[JOINTS] = UPPER;
#endif

/* Adds multiples of 2 pi to the angles to come nearest to the reference and inside the limits, if there are any. Returns 0 if
 * a joint is outside its limits for every multiple. */
LOCAL int ik_place(REAL q[JOINTS], const REAL *ref)
{
#if LIMITED
    REAL fits[JOINTS];
#endif
    int inside = 1;
    int i;
    if (ref != NULL) {
        for (i = 0; i < JOINTS; ++i) {
#if SLIDES
            q[i] = (((SLIDING >> (unsigned)i) & 1u) != 0u) ? q[i] : (ref[i] + ik_wrap(q[i] - ref[i]));
#else
            q[i] = ref[i] + ik_wrap(q[i] - ref[i]);
#endif
        }
    }
#if LIMITED
    for (i = 0; i < JOINTS; ++i) { /* no branches, which would be mispredicted: most solutions violate some limit */
        const REAL low = ik_lower[i] - IK_TOL_LIMIT;
        const REAL high = ik_upper[i] + IK_TOL_LIMIT;
#if SLIDES
        const REAL turn = (((SLIDING >> (unsigned)i) & 1u) != 0u) ? (REAL)0 : (REAL)6.283185307179586;
#else
        const REAL turn = (REAL)6.283185307179586;
#endif
        const REAL below = low - q[i];
        const REAL above = q[i] - high;
        const REAL turns = ik_whole((below + FABS(below)) * (REAL)0.07957747154594767) - ik_whole((above + FABS(above)) * (REAL)0.07957747154594767);
        const REAL x = q[i] + (turn * turns);
        fits[i] = ((REAL)0.5 + COPYSIGN((REAL)0.5, x - low)) * ((REAL)0.5 + COPYSIGN((REAL)0.5, high - x)); /* 0 or 1 */
        q[i] += turn * turns * fits[i];
    }
    for (i = 0; i < JOINTS; ++i) {
        inside &= (int)(fits[i] > (REAL)0);
    }
#endif
    return inside;
}

/* Largest difference of a joint between two configurations: rad, displacements in units of the reach. */
LOCAL REAL ik_apart(const REAL *a, const REAL *b)
{
    REAL most = (REAL)0;
    int i;
    for (i = 0; i < JOINTS; ++i) {
#if SLIDES
        const REAL d = FABS((((SLIDING >> (unsigned)i) & 1u) != 0u) ? ((a[i] - b[i]) / IK_TOL_REACH) : ik_wrap(a[i] - b[i]));
#else
        const REAL d = FABS(ik_wrap(a[i] - b[i]));
#endif
        most = (d > most) ? d : most;
    }
    return most;
}
