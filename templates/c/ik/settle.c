/* Conversion of candidates to solutions: refinement where necessary, removal of duplicates. Needs refine.c and order.c. */
#include "kernel.h"
#if SOUND
/* Whether all candidates can be returned without refinement: none is inexact, near a double root, or has a free joint. */
LOCAL int ik_sound(const ik_solutions *found, int rows)
{
    unsigned flags = 0u;
    int tight = 1;
    int i;
    for (i = 0; i < rows; ++i) {
        flags |= found->flags[i];
        tight &= (int)(found->residual[i] <= IK_TOL_TIGHT);
    }
    return (int)((tight != 0) && (flags == 0u));
}
#endif

/* Refines solution i where its residual requires it. Returns 0 if it misses the target or repeats an earlier solution. */
LOCAL int ik_settle(const REAL *T, unsigned options, ik_solutions *out, int i)
{
    const REAL error = out->residual[i];
#if OPENED
    if ((out->flags[i] & IK_GONE) != 0u) {
        return 0;
    }
    if ((out->flags[i] & IK_FIXED) != 0u) {
        out->flags[i] &= IK_PUBLIC;
        return (int)((ik_repeated(out, i) == 0));
    }
#endif
    if (!((error <= IK_TOL_TIGHT) && (error >= (REAL)0))) {
#if VIRTUAL
        if ((error > IK_TOL_LOOSE) && ((options & IK_RESIDUAL) == 0u)) { /* too far from the target to be worth refining */
            return 0;
        }
#endif
        out->residual[i] = ik_refine(T, out->q[i], STEPS, (REAL)VALUE_DAMPING NONE_HELD);
        if (!(out->residual[i] <= IK_TOL_ACCEPT)) {
            if (((options & IK_RESIDUAL) == 0u) || !(out->residual[i] <= (REAL)VALUE_BEYOND)) {
                return 0;
            }
            out->flags[i] |= (unsigned)IK_INEXACT;
        }
    }
    out->flags[i] &= IK_PUBLIC;
    return (int)((ik_repeated(out, i) == 0));
}

/* Appends candidate i to the solutions if it meets the target. */
LOCAL void ik_keep(const REAL *T, unsigned options, const ik_solutions *found, int i, ik_solutions *out)
{
    const int to = out->count;
#if !SINGLE
    if (to >= ROWS) {
        return;
    }
#endif
    ik_move(found, i, out, to);
    out->count += ik_settle(T, options, out, to);
}

#if SOUND
/* Appends the candidates that meet the target, with values chosen for the joints that it leaves free. */
#if defined(__GNUC__)
__attribute__((noinline)) /* rarely called; inlined, it would take registers from the usual way */
#endif
LOCAL void ik_keep_all(
    const REAL *T, const REAL *target, const REAL *ref LOCK_PARAMETER, unsigned options, ik_solutions *found, int rows,
    ik_solutions *out)
{
    int i;
#if BRANCHES_OPEN
    ik_reopen_branches(T, ref LOCK, options, ik_accuracy(target), found, rows);
#else
    (void)target;
    (void)ref;
#if REDUNDANT
    (void)lock;
#endif
#endif
    for (i = 0; i < rows; ++i) {
        ik_keep(T, options, found, i, out);
    }
}

#endif
#if BANDED
/* Appends those candidates of a further search that are new. A solution that is found again keeps its flags: it is not a multiple
 * root for being found twice. */
LOCAL void ik_add(const REAL *T, unsigned options, const ik_solutions *found, int rows, ik_solutions *out)
{
    unsigned flags[ROWS] = {0};
    const int known = out->count;
    int i;
    for (i = 0; i < known; ++i) {
        flags[i] = out->flags[i];
    }
    for (i = 0; i < rows; ++i) {
        ik_keep(T, options, found, i, out);
    }
    for (i = 0; i < known; ++i) {
        out->flags[i] = flags[i];
    }
}

#endif
