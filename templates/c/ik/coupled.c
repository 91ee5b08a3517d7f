/* The solutions of a mechanism: those of its chain that keep the coupling y = S q. Needs coupling.c, refine.c and finish.c. */
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
    int i, j;
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
    REAL x[CHAIN_JOINTS], most = (REAL)0;
    int i;
    ik_follow(q, x);
    for (i = 0; i < CHAIN_JOINTS; ++i) {
#if CHAIN_SLIDES
        const REAL d = FABS((((CHAIN_SLIDING >> i) & 1u) != 0u) ? (x[i] - y[i]) / IK_TOL_REACH : chain_wrap(x[i] - y[i]));
#else
        const REAL d = FABS(chain_wrap(x[i] - y[i]));
#endif
        most = d > most ? d : most;
    }
    return most;
}

/* Appends the joint positions of solution i of the chain, one for each way in which the drives can stand. A solution with a
 * joint that the target leaves free may be off the coupling and is moved onto it. */
LOCAL void ik_couple(const REAL *T, unsigned options, const chain_solutions *found, int i, ik_solutions *out)
{
    int turn, j;
    for (turn = 0; turn < COMBINATIONS && out->count < ROWS; ++turn) {
        REAL *const q = out->q[out->count];
        REAL e[ERRORS], J[ERRORS][JOINTS], cost;
        unsigned flags = found->flags[i];
        ik_lead(found->q[i], turn, q);
        if (ik_off(found->q[i], q) > (REAL)VALUE_COUPLED && (flags & IK_FREE) == 0u && (options & IK_RESIDUAL) == 0u) {
            continue;
        }
        cost = ik_error(T, q, e, J);
        if (!(cost <= IK_TOL_TIGHT)) {
            cost = ik_refine(T, q, VALUE_STEPS, (REAL)VALUE_DAMPING);
        }
        if (!(cost <= IK_TOL_ACCEPT)) {
            if (!(options & IK_RESIDUAL) || !(cost <= (REAL)VALUE_BEYOND)) {
                continue;
            }
            flags |= (unsigned)IK_INEXACT;
        }
        for (j = 0; j < out->count && !(ik_apart(q, out->q[j]) < IK_TOL_SAME); ++j) {
        }
        if (j == out->count) {
            out->flags[j] = flags & IK_PUBLIC;
            out->branch[j] = found->branch[i];
            out->residual[j] = cost;
            ++out->count;
        }
    }
}

/* Minimizes the task error over the joint positions, from what is nearest on the chain without the coupling, from the reference
 * and from a few fixed configurations. Returns the number of solutions that meet the target. If it is 0, solution 0 is the
 * nearest configuration and out->distance its error: the root of the squared position (m) and rotation (rad times reach) errors. */
LOCAL int ik_descend(const REAL *T, const REAL *ref LOCK_PARAMETER, ik_solutions *out)
{
    chain_solutions found;
    REAL best = (REAL)1e30, y[CHAIN_JOINTS]; /* no start has been tried */
    int start, i, rows, kept = 0;
    ik_follow(ref, y);
    rows = chain_descend(T, y LOCK, &found);
    rows = rows > 0 ? rows : 1;
    for (start = 0; start < rows + VALUE_STARTS && kept < ROWS; ++start) {
        REAL x[JOINTS], cost;
        if (start == rows && kept > 0) {
            break;
        }
        if (start < rows) {
            ik_lead(found.q[start], 0, x);
        } else {
            for (i = 0; i < JOINTS; ++i) {
                x[i] = ref[i] + (start > rows ? (REAL)VALUE_SPREAD * SIN((REAL)(start * (i + 1))) : (REAL)0);
            }
        }
#if LOCKED
        x[LOCKED_JOINT] = lock / (REAL)LOCKED_FACTOR;
#endif
        cost = ik_refine(T, x, VALUE_DESCENT_STEPS, (REAL)VALUE_DESCENT_DAMPING);
        if (cost < best || (cost <= IK_TOL_ACCEPT && kept > 0)) {
            best = cost < best ? cost : best;
            for (i = 0; i < JOINTS; ++i) {
                out->q[kept][i] = x[i];
            }
            out->branch[kept] = start < rows ? found.branch[start] : 0u;
            out->flags[kept] = cost > IK_TOL_ACCEPT ? (unsigned)IK_INEXACT : (unsigned)IK_MULTIPLE;
            out->residual[kept] = cost;
            if (cost <= IK_TOL_ACCEPT && !ik_repeated(out, kept)) {
                ++kept;
            }
        }
    }
    out->distance = kept > 0 ? (REAL)0 : SQRT(best) * IK_TOL_REACH;
    return kept;
}

ik_status robot_inverse_kinematics(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    ik_solutions *RESTRICT out)
{
    static const REAL zero[JOINTS] = {(REAL)0};
    const REAL *const ref = q_ref ? q_ref : zero;
    chain_solutions found;
    REAL T[TARGET], y[CHAIN_JOINTS];
    const ik_status status = ik_check(target, q_ref REDUNDANCY, T);
    int i, outside;
    out->count = 0;
    out->stage = 0;
    out->distance = (REAL)0;
    if (status != IK_OK) {
        return status;
    }
    if (chain_far(T)) {
        out->stage = FAR_STAGE;
        out->distance = (REAL)-1;
        return IK_UNREACHABLE;
    }
    ik_follow(ref, y);
    (void)chain_solve(target, y REDUNDANCY, options & (unsigned)IK_RESIDUAL, &found);
    for (i = 0; i < found.count; ++i) {
        ik_couple(T, options, &found, i, out);
    }
    outside = !ik_finish(q_ref, options, out);
    if (out->count == 0 && !outside) {
        out->stage = found.count > 0 ? UNFIT_STAGE : found.stage;
        out->count = ik_descend(T, ref REDUNDANCY, out);
        outside = out->count > 0;
        (void)ik_finish(ref, options, out);
    }
    if (out->count == 0) {
#if INCOMPLETE
        out->stage = outside ? OUTSIDE_STAGE : out->stage;
        return IK_INCOMPLETE;
#else
        out->stage = outside ? 0 : out->stage;
        return outside ? IK_OUTSIDE_LIMITS : IK_UNREACHABLE;
#endif
    }
    out->stage = 0;
    if (options & IK_NEAREST) {
        ik_sort(q_ref, out);
    }
#if INCOMPLETE
    return IK_INCOMPLETE;
#else
    return IK_OK;
#endif
}
