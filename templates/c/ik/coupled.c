/* The solutions of a mechanism: those of its chain that keep the coupling y = S q. Needs coupling.c, order.c and refine.c. */
#include "kernel.h"
/* Rows of S that are a regular matrix, and its inverse. */
static const int ik_pivot[JOINTS] = PIVOTS;
static const REAL ik_inverse[JOINTS][JOINTS] = INVERSE;
#if GEARED
/* By how many full turns each of those joints of the chain is moved: more would repeat. */
static const int ik_turns[JOINTS] = TURNS;
#endif

/* The joint positions q with y = S q in the rows of the pivots; `turn` numbers the full turns that are added to them. */
LOCAL void ik_lead(const REAL *y, int turn, REAL q[JOINTS])
{
    REAL x[JOINTS];
    int i;
    int j;
#if !GEARED
    (void)turn;
#endif
    for (i = 0; i < JOINTS; ++i) {
        x[i] = y[ik_pivot[i]];
#if GEARED
        x[i] += (REAL)6.283185307179586 * (REAL)(turn % ik_turns[i]);
        turn /= ik_turns[i];
#endif
    }
    for (i = 0; i < JOINTS; ++i) {
        q[i] = (REAL)0;
        for (j = 0; j < JOINTS; ++j) {
            q[i] += ik_inverse[i][j] * x[j];
        }
    }
}

/* How far a configuration y of the chain is off the coupling with q: rad, displacements in units of the reach. */
LOCAL REAL ik_off(const REAL *y, const REAL *q)
{
    REAL x[CHAIN_JOINTS];
    REAL most = (REAL)0;
    int i;
    ik_follow(q, x);
    for (i = 0; i < CHAIN_JOINTS; ++i) {
#if CHAIN_SLIDES
        const REAL d = FABS((((CHAIN_SLIDING >> (unsigned)i) & 1u) != 0u) ? ((x[i] - y[i]) / IK_TOL_REACH) : chain_wrap(x[i] - y[i]));
#else
        const REAL d = FABS(chain_wrap(x[i] - y[i]));
#endif
        most = (d > most) ? d : most;
    }
    return most;
}

/* Appends the joint positions of solution i of the chain, one for each way in which the drives can stand. A solution with a
 * joint that the target leaves free may be off the coupling and is moved onto it. */
LOCAL void ik_couple(const REAL *T, unsigned options, const chain_solutions *found, int i, ik_solutions *out)
{
    int turn;
    int j;
    for (turn = 0; (turn < COMBINATIONS) && (out->count < ROWS); ++turn) {
        REAL *const q = out->q[out->count];
        REAL e[ERRORS];
        REAL J[ERRORS][JOINTS];
        REAL cost;
        unsigned flags = found->flags[i];
        ik_lead(found->q[i], turn, q);
        if ((ik_off(found->q[i], q) > (REAL)VALUE_COUPLED) && ((flags & IK_FREE) == 0u) && ((options & IK_RESIDUAL) == 0u)) {
            continue;
        }
        cost = ik_error(T, q, e, J);
        if (!(cost <= IK_TOL_TIGHT)) {
            cost = ik_refine(T, q, VALUE_STEPS, (REAL)VALUE_DAMPING);
        }
        if (!(cost <= IK_TOL_ACCEPT)) {
            if (((options & IK_RESIDUAL) == 0u) || !(cost <= (REAL)VALUE_BEYOND)) {
                continue;
            }
            flags |= (unsigned)IK_INEXACT;
        }
        for (j = 0; (j < out->count) && !(ik_apart(q, out->q[j]) < IK_TOL_SAME); ++j) {
        }
        if (j == out->count) {
            out->flags[j] = flags & IK_PUBLIC;
            out->branch[j] = found->branch[i];
            out->residual[j] = cost;
            ++out->count;
        }
    }
}
