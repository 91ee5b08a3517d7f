/* The list of solutions: moving, sorting by distance, removal of duplicates. Needs rows.c. */
#include "kernel.h"
LOCAL void ik_exchange(ik_solutions *out, int i, int j)
{
    const unsigned flags = out->flags[i];
    const unsigned branch = out->branch[i];
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
    if ((from != out) || (to != i)) {
        int k;
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
    int i;
    int j;
    int k;
    for (i = 0; i < out->count; ++i) {
        away[i] = (REAL)0;
        for (k = 0; k < JOINTS; ++k) {
#if SLIDES
            const REAL d = (out->q[i][k] - ((ref != NULL) ? ref[k] : (REAL)0)) / ((((SLIDING >> (unsigned)k) & 1u) != 0u) ? IK_TOL_REACH : (REAL)1);
#else
            const REAL d = (out->q[i][k] - ((ref != NULL) ? ref[k] : (REAL)0));
#endif
            away[i] += d * d;
        }
        for (j = i; (j > 0) && (away[j] < away[j - 1]); --j) {
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
