/* The nearest configuration to a target out of reach, by Gauss-Newton descent from many starts. Needs refine.c and rows.c; for a
 * mechanism also coupled.c. */
#include "kernel.h"
#if COUPLED
/* The same as of the chain, over the joint positions: from what is nearest on the chain without the coupling, from the reference
 * and from a few fixed configurations. */
#else
/* Minimizes the task error from every branch (with negative discriminants set to zero), from the reference and from a few
 * fixed configurations. Returns the number of solutions that meet the target. If it is 0, solution 0 is the nearest
 * configuration and out->distance its error: the root of the squared position (m) and rotation (rad times reach) errors. */
#endif
LOCAL int ik_descend(const REAL *T, const REAL *ref LOCK_PARAMETER, ik_solutions *out)
{
#if COUPLED
    chain_solutions found;
    REAL best = (REAL)1e30;
    REAL y[CHAIN_JOINTS]; /* no start has been tried */
    int start;
    int i;
    int rows;
    int kept = 0;
    (void)memset(&found, 0, sizeof(found));
    ik_follow(ref, y);
    rows = chain_descend(T, y LOCK, &found);
    rows = (rows > 0) ? rows : 1;
#else
    ik_solutions found;
    REAL best = (REAL)1e30; /* no start has been tried */
    int stage = 0;
    int start;
    int i;
    int kept = 0;
    int rows;
    (void)memset(&found, 0, sizeof(found)); /* rows that are not written are not read, but no analysis sees that */
    rows = ik_last_candidates(T, ref LOCK, (REAL)1e30, IK_TOL_FREE NO_BAND, &found, &stage);
#endif
    for (start = 0; (start < (rows + VALUE_STARTS)) && (kept < ROWS); ++start) {
        REAL x[JOINTS];
        REAL cost;
        if ((start == rows) && (kept > 0)) {
            break;
        }
#if COUPLED
        if (start < rows) {
            ik_lead(found.q[start], 0, x);
        } else {
            for (i = 0; i < JOINTS; ++i) {
                x[i] = ref[i] + ((start > rows) ? ((REAL)VALUE_SPREAD * SIN((REAL)start * ((REAL)i + (REAL)1))) : (REAL)0);
            }
        }
#else
        for (i = 0; i < JOINTS; ++i) {
            x[i] = (start < rows) ? found.q[start][i] : (ref[i] + ((start > rows) ? ((REAL)VALUE_SPREAD * SIN((REAL)start * ((REAL)i + (REAL)1))) : (REAL)0));
        }
#endif
#if LOCKED
#if COUPLED
        x[LOCKED_JOINT] = lock / (REAL)LOCKED_FACTOR;
#else
        x[LOCKED_JOINT] = lock;
#endif
#endif
        cost = ik_refine(T, x, VALUE_DESCENT_STEPS, (REAL)VALUE_DESCENT_DAMPING NONE_HELD);
        if ((cost < best) || ((cost <= IK_TOL_ACCEPT) && (kept > 0))) {
            best = (cost < best) ? cost : best;
            for (i = 0; i < JOINTS; ++i) {
                out->q[kept][i] = x[i];
            }
            out->branch[kept] = (start < rows) ? found.branch[start] : 0u;
            out->flags[kept] = (cost > IK_TOL_ACCEPT) ? (unsigned)IK_INEXACT : (unsigned)IK_MULTIPLE;
            out->residual[kept] = cost;
            if ((cost <= IK_TOL_ACCEPT) && (ik_repeated(out, kept) == 0)) {
                ++kept;
            }
        }
    }
    out->distance = (kept > 0) ? (REAL)0 : (SQRT(best) * IK_TOL_REACH);
    return kept;
}
