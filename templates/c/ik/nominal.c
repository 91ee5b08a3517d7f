/* The solutions of a special arm nearby, refined on this arm, where nothing puts in doubt that they are all of them. */
#include "kernel.h"
/* Refines the solutions of the special arm on this arm by Newton steps. Returns their number, or 0 where one of them may be lost
 * or another one may be there: an equation of the special arm is near a double root or leaves a joint free, within margins that
 * the deviation of the two arms decides, a Jacobian is nearly singular, or the solutions do not converge to different ones. */
LOCAL int ik_nominal_first(const REAL *T, const REAL *ref LOCK_PARAMETER, ik_solutions *found, ik_solutions *out)
{
    REAL x[JOINTS][LANES];
    REAL error[LANES];
    REAL moved[LANES];
    REAL inverse[LANES];
    REAL det[LANES];
    int stage = 0;
    int doubt = 0;
    int step;
    int i;
    int j;
    int k;
    unsigned flags = 0u;
    const int rows = ik_nearby(T, ref LOCK, (REAL)VALUE_MARGIN_SLACK, (REAL)VALUE_MARGIN_LEAST NO_BAND, found, &stage);
    for (i = 0; i < rows; ++i) {
        flags |= found->flags[i];
    }
    if ((rows == 0) || ((rows % 2) != 0) || (flags != 0u)) {
        return 0;
    }
    for (j = 0; j < JOINTS; ++j) {
        for (i = 0; i < LANES; ++i) {
            x[j][i] = found->q[(i < rows) ? i : 0][j];
        }
    }
    for (step = 0; step < VALUE_NEWTON_STEPS; ++step) {
        REAL worst = (REAL)0;
        int met = 1;
        ik_newton(T, x, error, moved, inverse, det);
        for (i = 0; i < rows; ++i) {
            doubt |= (int)(!((inverse[i] * moved[i]) <= (REAL)VALUE_NEWTON_TURN) || !(inverse[i] <= (REAL)VALUE_MARGIN_INVERSE));
            worst = (error[i] > worst) ? error[i] : worst;
        }
        if (doubt != 0) {
            return 0;
        }
        if (worst <= IK_TOL_TIGHT) {
            break;
        }
        if (worst <= (REAL)VALUE_NEWTON_NEAR) { /* the step may have been the last one */
            ik_missed(T, x, error);
            for (i = 0; i < rows; ++i) {
                met &= (int)(error[i] <= (REAL)VALUE_NEWTON_MET);
            }
            if (met != 0) {
                break;
            }
        }
    }
    if (step == VALUE_NEWTON_STEPS) {
        return 0;
    }
    for (i = 0; i < rows; ++i) {
        for (j = 0; j < JOINTS; ++j) {
#if SLIDES
            out->q[i][j] = (((SLIDING >> (unsigned)j) & 1u) != 0u) ? x[j][i] : ik_wrap(x[j][i]);
#else
            out->q[i][j] = ik_wrap(x[j][i]);
#endif
        }
        out->flags[i] = 0u;
        out->branch[i] = (det[i] > (REAL)0) ? 2u : 3u; /* bit 1: the label is known */
        out->residual[i] = error[i];
        for (k = 0; k < i; ++k) {
            int same = 1;
            for (j = 0; (j < JOINTS) && (same != 0); ++j) {
                const REAL apart = FABS(out->q[i][j] - out->q[k][j]);
                same = (int)((apart < (REAL)VALUE_DISTINCT) || (apart > (REAL)(6.283185307179586 - VALUE_DISTINCT)));
            }
            doubt |= same;
        }
    }
    return (doubt != 0) ? 0 : rows;
}
