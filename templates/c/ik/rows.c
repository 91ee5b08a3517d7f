/* The list of solutions: multiples of 2 pi and joint limits, sorting by distance, removal of duplicates. Needs angles.c. */
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
    int inside = 1, i;
    for (i = 0; ref && i < JOINTS; ++i) {
#if SLIDES
        q[i] = ((SLIDING >> i) & 1u) != 0u ? q[i] : ref[i] + ik_wrap(q[i] - ref[i]);
#else
        q[i] = ref[i] + ik_wrap(q[i] - ref[i]);
#endif
    }
#if LIMITED
    for (i = 0; i < JOINTS; ++i) { /* no branches, which would be mispredicted: most solutions violate some limit */
        const REAL low = ik_lower[i] - IK_TOL_LIMIT, high = ik_upper[i] + IK_TOL_LIMIT;
#if SLIDES
        const REAL turn = (((SLIDING >> i) & 1u) != 0u) ? (REAL)0 : (REAL)6.283185307179586;
#else
        const REAL turn = (REAL)6.283185307179586;
#endif
        const REAL below = low - q[i], above = q[i] - high;
        const REAL turns = ik_whole((below + FABS(below)) * (REAL)0.07957747154594767) - ik_whole((above + FABS(above)) * (REAL)0.07957747154594767);
        const REAL x = q[i] + turn * turns;
        fits[i] = ((REAL)0.5 + COPYSIGN((REAL)0.5, x - low)) * ((REAL)0.5 + COPYSIGN((REAL)0.5, high - x)); /* 0 or 1 */
        q[i] += turn * turns * fits[i];
    }
    for (i = 0; i < JOINTS; ++i) {
        inside = inside & (fits[i] > (REAL)0);
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
        const REAL d = FABS((((SLIDING >> i) & 1u) != 0u) ? (a[i] - b[i]) / IK_TOL_REACH : ik_wrap(a[i] - b[i]));
#else
        const REAL d = FABS(ik_wrap(a[i] - b[i]));
#endif
        most = d > most ? d : most;
    }
    return most;
}

LOCAL void ik_exchange(ik_solutions *out, int i, int j)
{
    const unsigned flags = out->flags[i], branch = out->branch[i];
    const REAL residual = out->residual[i];
    int k;
    out->flags[i] = out->flags[j];
    out->branch[i] = out->branch[j];
    out->residual[i] = out->residual[j];
    out->flags[j] = flags;
    out->branch[j] = branch;
    out->residual[j] = residual;
    for (k = 0; k < JOINTS; ++k) {
        const REAL x = out->q[i][k];
        out->q[i][k] = out->q[j][k];
        out->q[j][k] = x;
    }
}

LOCAL void ik_move(const ik_solutions *from, int i, ik_solutions *out, int to)
{
#if ONE_ROW
    (void)from; /* the only solution is in its place already */
    (void)i;
    (void)out;
    (void)to;
#else
    int k;
    if (from != out || to != i) {
        for (k = 0; k < JOINTS; ++k) {
            out->q[to][k] = from->q[i][k];
        }
        out->flags[to] = from->flags[i];
        out->branch[to] = from->branch[i];
        out->residual[to] = from->residual[i];
    }
#endif
}

/* Sorts the solutions by their squared distance from the reference, nearest first (insertion sort). */
LOCAL void ik_sort(const REAL *ref, ik_solutions *out)
{
    REAL away[ROWS];
    int i, j, k;
    for (i = 0; i < out->count; ++i) {
        away[i] = (REAL)0;
        for (k = 0; k < JOINTS; ++k) {
#if SLIDES
            const REAL d = (out->q[i][k] - (ref ? ref[k] : (REAL)0)) / (((SLIDING >> k) & 1u) != 0u ? IK_TOL_REACH : (REAL)1);
#else
            const REAL d = (out->q[i][k] - (ref ? ref[k] : (REAL)0));
#endif
            away[i] += d * d;
        }
        for (j = i; j > 0 && away[j] < away[j - 1]; --j) {
            const REAL d = away[j];
            away[j] = away[j - 1];
            away[j - 1] = d;
            ik_exchange(out, j, j - 1);
        }
    }
}

/* Whether solution i repeats an earlier one, which is then flagged as a multiple root. */
LOCAL int ik_repeated(ik_solutions *out, int i)
{
    int j;
    for (j = 0; j < i; ++j) {
        if (ik_apart(out->q[i], out->q[j]) < IK_TOL_SAME) {
            out->flags[j] |= (unsigned)IK_MULTIPLE;
            return 1;
        }
    }
    return 0;
}
