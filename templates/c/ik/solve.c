/* All solutions for one target. Needs all other kernels. */
#include "kernel.h"
#if NOMINAL_FIRST && !COUPLED
/* The answer with solutions that are known to be all. */
LOCAL ik_status ik_answer(TARGET_PARAMETER const REAL *q_ref, unsigned options, ik_solutions *out)
{
    (void)ik_finish(TARGET_FIRST q_ref, options, out);
    if ((options & IK_NEAREST) != 0u) {
        ik_sort(q_ref, out);
    }
    return (out->count > 0) ? IK_OK : IK_OUTSIDE_LIMITS;
}

#endif
SHARED ik_status robot_inverse_kinematics(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    ik_solutions *RESTRICT out)
{
    static const REAL zero[JOINTS] = {0};
    const REAL *const ref = (q_ref != NULL) ? q_ref : zero;
#if COUPLED
    chain_solutions found;
    REAL T[TARGET];
    REAL y[CHAIN_JOINTS];
#else
    REAL T[TARGET];
#if SINGLE
    ik_solutions *const found = out;
#else
    ik_solutions candidates;
    ik_solutions *const found = &candidates;
#endif
#endif
    const ik_status status = ik_check(target, q_ref REDUNDANCY, T);
    int rows;
    int outside;
#if COUPLED || !SOUND
    int i;
#endif
#if GENERAL
    int doubt = 0; /* solutions may be missing */
#if COMPANION && !COUPLED
    int known;
#endif
#endif
#if BANDED && !COUPLED
    unsigned near = 0u;
#endif
    out->count = 0;
    out->stage = 0;
    out->distance = (REAL)0;
    if (status != IK_OK) {
        return status;
    }
    if (ik_far(T) != 0) {
        out->stage = FAR_STAGE;
        out->distance = (REAL)-1;
        return IK_UNREACHABLE;
    }
#if COUPLED
    ik_follow(ref, y);
#if GENERAL
    doubt = (int)(chain_solve(target, y REDUNDANCY, options & (unsigned)IK_RESIDUAL, &found) == IK_INCOMPLETE);
#else
    (void)chain_solve(target, y REDUNDANCY, options & (unsigned)IK_RESIDUAL, &found);
#endif
    rows = found.count;
    for (i = 0; i < rows; ++i) {
        ik_couple(T, options, &found, i, out);
    }
#else
#if NOMINAL_FIRST
    rows = ik_nominal_first(T, ref REDUNDANCY, found, out);
    if (rows > 0) {
        out->count = rows;
        return ik_answer(TARGET_FIRST q_ref, options, out);
    }
#endif
    rows = ik_branches(T, ref REDUNDANCY, IK_TOL_SLACK, IK_TOL_FREE NO_BAND, found, &out->stage);
#if GENERAL
    doubt = (int)((out->stage & IK_DOUBT) != 0);
    out->stage &= ~IK_DOUBT;
#endif
#if SOUND
    if (ik_sound(found, rows) != 0) {
        out->count = rows;
    } else {
        ik_keep_all(T, target, ref REDUNDANCY, options, found, rows, out);
    }
#else
#if BRANCHES_OPEN
    ik_reopen_branches(T, ref REDUNDANCY, options, ik_accuracy(target), found, rows);
#endif
    for (i = 0; i < rows; ++i) {
#if BANDED
        near |= found->flags[i] & IK_NEAR;
#endif
#if GENERAL
        {
            const int kept = out->count;
            ik_keep(T, options, found, i, out);
            doubt |= (int)((out->count == kept) && !(out->residual[kept] <= IK_TOL_ACCEPT)); /* a solution was not refined */
        }
#else
        ik_keep(T, options, found, i, out);
#endif
    }
#endif
#if GENERAL && COMPANION
    known = out->count;
#endif
#if COMPANION
    rows = ik_nearby(T, ref REDUNDANCY, IK_TOL_SLACK, IK_TOL_FREE NO_BAND, found, &out->stage);
#if NEARBY_OPEN
    ik_reopen_nearby(T, ref REDUNDANCY, options, ik_accuracy(target), found, rows);
#endif
    for (i = 0; i < rows; ++i) {
        near |= found->flags[i] & IK_NEAR;
    }
    ik_add(T, options, found, rows, out);
#endif
#if BANDED
    if ((near != 0u) || (out->count == 0)) { /* near a double root: search for two distinct solutions of the true arm */
        static const REAL bands[3] = {(REAL)1, (REAL)VALUE_BAND_2, (REAL)VALUE_BAND_3};
        int k;
        for (k = 0; k < 3; ++k) {
            rows = ik_last_candidates(T, ref REDUNDANCY, IK_TOL_SLACK, IK_TOL_FREE, IK_TOL_BAND * bands[k], found, &out->stage);
            ik_add(T, options, found, rows, out);
        }
    }
#endif
#if GENERAL && COMPANION
    for (; known < out->count; ++known) { /* the elimination lacks a solution of the arm nearby, and not because it is singular */
        unsigned singular = 0u;
        (void)ik_aspect(T, out->q[known], &singular);
        doubt |= (int)(singular == 0u);
    }
#endif
#endif
    outside = (int)((ik_finish(TARGET_FIRST q_ref, options, out) == 0));
    if ((out->count == 0) && (outside == 0)) {
#if COUPLED
        out->stage = (rows > 0) ? UNFIT_STAGE : found.stage;
#else
        if (rows > 0) { /* candidates may stem from slightly negative discriminants: find the stage that failed */
            out->stage = 0;
            rows = ik_branches(T, ref REDUNDANCY, (REAL)0, IK_TOL_FREE NO_BAND, found, &out->stage);
#if GENERAL
            out->stage &= ~IK_DOUBT;
#endif
            out->stage = (rows > 0) ? CHECK_STAGE : out->stage;
        }
#endif
        out->count = rows = ik_descend(T, ref REDUNDANCY, out);
        (void)ik_finish(TARGET_FIRST ref, options, out);
        outside = (int)(rows > 0);
#if GENERAL
        doubt |= (int)(rows > 0); /* the descents have found what the elimination lacks */
#endif
    }
    if (out->count == 0) {
#if INCOMPLETE
        out->stage = (outside != 0) ? OUTSIDE_STAGE : out->stage;
        return IK_INCOMPLETE;
#else
#if GENERAL
        if (doubt != 0) {
            out->stage = OUTSIDE_STAGE;
            return IK_INCOMPLETE;
        }
#endif
        out->stage = (outside != 0) ? 0 : out->stage;
        return (outside != 0) ? IK_OUTSIDE_LIMITS : IK_UNREACHABLE;
#endif
    }
    out->stage = 0;
    if ((options & IK_NEAREST) != 0u) {
        ik_sort(q_ref, out);
    }
#if INCOMPLETE
    return IK_INCOMPLETE;
#else
#if GENERAL
    return (doubt != 0) ? IK_INCOMPLETE : IK_OK;
#else
    return IK_OK;
#endif
#endif
}
