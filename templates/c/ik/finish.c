/* The final form of solutions, with their full turns and joint limits. Needs order.c. */
#include "kernel.h"
/* Final form of the solutions: multiples of 2 pi chosen, limits checked, residuals as square roots, branch numbers. Returns 0
 * if a solution lies outside the limits. */
LOCAL_INLINE int ik_finish(TARGET_PARAMETER const REAL *ref, unsigned options, ik_solutions *out)
{
#if LIMITED
    int inside = 1;
    int kept = 0;
    int i;
    for (i = 0; i < out->count; ++i) {
        const int fits = ik_place(out->q[i], ref);
        out->flags[i] |= (fits != 0) ? 0u : (unsigned)IK_OUTSIDE;
        inside &= fits;
        if ((fits != 0) || ((options & IK_LIMITS) == 0u)) {
            ik_move(out, i, out, kept++);
        }
    }
    out->count = kept;
#else
    int i;
    (void)options;
    if (ref != NULL) {
        for (i = 0; i < out->count; ++i) {
            (void)ik_place(out->q[i], ref);
        }
    }
#endif
    for (i = 0; i < out->count; ++i) {
        out->residual[i] = SQRT(out->residual[i]);
#if ASPECTS
#if NOMINAL_FIRST
        out->branch[i] = ((out->branch[i] & 2u) != 0u) ? (out->branch[i] & 1u) : ik_aspect(T, out->q[i], &out->flags[i]);
#else
        out->branch[i] = ik_aspect(T, out->q[i], &out->flags[i]);
#endif
#endif
    }
#if LIMITED
    return inside;
#else
    return 1;
#endif
}
