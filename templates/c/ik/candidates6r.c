/* Candidate solutions of a general six-joint chain, or of a seven-joint chain whose first or last joint is prescribed.
 * Needs refine.c and general6r.c. */
#include "kernel.h"
/* Lists the candidate solutions of all branches in `found` and returns their number; *stage is set to 1 if there are none.
 * residual holds -1, which means that the caller has to compute it. Where solutions may be missing, IK_DOUBT is added to *stage. slack
 * and least have no effect in this solver: it has no discriminants. */
LOCAL int ik_branches(
    const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage)
{
    int rows = 0;
    /* inverses of the constant transforms before the first joint and after the last one, 3 x 4 row by row */
    static const REAL before[12] = DH_BEFORE;
    static const REAL after[12] = DH_AFTER;
#if LOCKED
    static const REAL link[12] = LOCKED_LINK; /* inverse of the transform between the prescribed joint and the others */
#endif
#if DH_SHIFTED
    static const REAL shift[6] = DH_SHIFTS;
#endif
    REAL pose[16] = {0};
    REAL at[6];
    REAL x[16][6];
    int certain;
    int i;
    int k;
#if LOCKED
    const REAL raw = lock LOCKED_OFFSET;
#if LOCKED_SLIDES
    const REAL back[12] = {(REAL)1, (REAL)0, (REAL)0, (REAL)0, (REAL)0, (REAL)1, (REAL)0, (REAL)0, (REAL)0, (REAL)0, (REAL)1, -raw};
#else
    const REAL c = COS(raw);
    const REAL s = SIN(raw);
    const REAL back[12] = {c, s, (REAL)0, (REAL)0, -s, c, (REAL)0, (REAL)0, (REAL)0, (REAL)0, (REAL)1, (REAL)0};
#endif
#endif
    for (i = 0; i < 12; ++i) {
#if LOCKED_FIRST
        pose[i] = link[i];
#else
        pose[i] = before[i];
#endif
    }
#if LOCKED_FIRST
    ik_advance(pose, back);
    ik_advance(pose, before);
#endif
    ik_advance(pose, T);
    ik_advance(pose, after);
#if LOCKED_LAST
    ik_advance(pose, back);
    ik_advance(pose, link);
#endif
    for (k = 0; k < 6; ++k) {
#if DH_SHIFTED
        at[k] = ref[FREE_K] - shift[k];
#else
        at[k] = ref[FREE_K];
#endif
#if DH_SLIDES
        at[k] *= (k == DH_SLIDE) ? (REAL)PER_LENGTH : (REAL)1;
#endif
    }
    rows = ik_solve6r(pose, at, x, found->flags, &certain);
    if (rows == 0) {
        *stage = (*stage < 1) ? 1 : *stage;
    }
    *stage |= (certain != 0) ? 0 : IK_DOUBT;
    for (i = 0; i < rows; ++i) {
        for (k = 0; k < 6; ++k) {
#if DH_SHIFTED && DH_SLIDES
            found->q[i][FREE_K] = (k == DH_SLIDE) ? (x[i][k] + shift[k]) : ik_wrap(x[i][k] + shift[k]);
#else
#if DH_SHIFTED
            found->q[i][FREE_K] = ik_wrap(x[i][k] + shift[k]);
#else
            found->q[i][FREE_K] = x[i][k];
#endif
#endif
        }
#if LOCKED
        found->q[i][LOCKED_JOINT] = lock;
#endif
        found->branch[i] = 0u;
        found->residual[i] = (REAL)-1; /* checked and refined by the caller */
    }

    (void)T;
    (void)slack;
    (void)least;
    (void)stage;
#if BANDED
    (void)band;
#endif
    return rows;
}
