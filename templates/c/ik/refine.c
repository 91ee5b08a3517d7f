/* Refinement of a solution by damped Gauss-Newton steps. Needs error.c. */
#include "kernel.h"
/* Damped Gauss-Newton step: the d that minimizes |J d - e|^2 + damping^2 |d|^2, by Householder reflections. */
LOCAL void ik_step(REAL J[ERRORS][JOINTS], const REAL e[ERRORS], REAL damping, REAL d[JOINTS])
{
    REAL A[STACKED][JOINTS];
    REAL b[STACKED];
    int i;
    int j;
    int k;
    for (i = 0; i < STACKED; ++i) {
        b[i] = (i < ERRORS) ? e[i] : (REAL)0;
        for (j = 0; j < JOINTS; ++j) {
            A[i][j] = (i < ERRORS) ? J[i][j] : (((i - ERRORS) == j) ? damping : (REAL)0);
        }
    }
    for (k = 0; k < JOINTS; ++k) {
        REAL h2 = (REAL)0;
        REAL h;
        REAL f;
        for (i = k; i <= (ERRORS + k); ++i) { /* rows below are still zero in this column */
            h2 += A[i][k] * A[i][k];
        }
        h = (A[k][k] > (REAL)0) ? -SQRT(h2) : SQRT(h2);
        f = h * (A[k][k] - h);
        A[k][k] -= h;
        for (j = k + 1; j <= JOINTS; ++j) {
            REAL t = (REAL)0;
            for (i = k; i <= (ERRORS + k); ++i) {
                t += A[i][k] * ((j < JOINTS) ? A[i][j] : b[i]);
            }
            t /= f;
            for (i = k; i <= (ERRORS + k); ++i) {
                if (j < JOINTS) {
                    A[i][j] += t * A[i][k];
                } else {
                    b[i] += t * A[i][k];
                }
            }
        }
        A[k][k] = h;
    }
    for (k = LAST_JOINT; k >= 0; --k) {
        REAL t = b[k];
        for (j = k + 1; j < JOINTS; ++j) {
            t -= A[k][j] * d[j];
        }
        d[k] = t / A[k][k];
    }
#if LOCKED && !LOCKED_LAST
    d[LOCKED_JOINT] = (REAL)0; /* the prescribed joint stays exactly; its computed step may be a rounding error */
#endif
}

#if OPENED
/* At most `steps` Levenberg-Marquardt steps on the task error. The damping is proportional to the error, which keeps the
 * convergence fast at singular configurations. Up to three steps in a row may increase the error, because the bottom of a
 * curved valley is followed by leaving it and coming back. Joints in `held` (bits) do not move. On return q is the best
 * configuration found; returns its squared error. */
#else
/* At most `steps` Levenberg-Marquardt steps on the task error. The damping is proportional to the error, which keeps the
 * convergence fast at singular configurations. Up to three steps in a row may increase the error, because the bottom of a
 * curved valley is followed by leaving it and coming back. On return q is the best configuration found; returns its
 * squared error. */
#endif
LOCAL REAL ik_refine(const REAL *T, REAL *q, int steps, REAL damping HELD_PARAMETER)
{
    REAL x[JOINTS];
    REAL e[ERRORS];
    REAL J[ERRORS][JOINTS];
    REAL best;
    REAL cost;
    int i;
    int step;
    bool going;
    int worse = 0;
    for (i = 0; i < JOINTS; ++i) {
        x[i] = q[i];
    }
    cost = ik_error(T, x, e, J HELD);
    best = cost;
    going = (best > IK_TOL_DONE) && (damping < (REAL)VALUE_MOST_DAMPING);
    for (step = 0; (step < steps) && going; ++step) {
        REAL d[JOINTS] = {0};
        REAL most = (REAL)1;
        ik_step(J, e, (damping * SQRT(cost)) + IK_TOL_EPS, d);
        for (i = 0; i < JOINTS; ++i) {
            most = (FABS(d[i]) > most) ? FABS(d[i]) : most;
        }
        for (i = 0; i < JOINTS; ++i) { /* limit the step to one radian or one reach */
#if SLIDES
            x[i] += d[i] / most * ((((SLIDING >> (unsigned)i) & 1u) != 0u) ? IK_TOL_REACH : (REAL)1);
#else
            x[i] += d[i] / most;
#endif
        }
        cost = ik_error(T, x, e, J HELD);
        if (cost < best) {
            const bool stuck = (cost > ((REAL)VALUE_STUCK * best)) && (damping > (REAL)1); /* at the minimum, which is not zero */
            for (i = 0; i < JOINTS; ++i) {
                q[i] = x[i];
            }
            best = cost;
            worse = 0;
            damping = (damping > (REAL)VALUE_DAMPING) ? ((REAL)VALUE_LESS_DAMPING * damping) : damping;
            if (stuck) {
                break;
            }
        } else if ((++worse > VALUE_WORSE_STEPS) || !(cost < (REAL)VALUE_DIVERGED)) {
            for (i = 0; i < JOINTS; ++i) {
                x[i] = q[i];
            }
            cost = ik_error(T, x, e, J HELD);
            worse = 0;
            damping *= (REAL)VALUE_MORE_DAMPING;
        } else { /* a step to the worse, of which some in a row are allowed */
        }
        going = (best > IK_TOL_DONE) && (damping < (REAL)VALUE_MOST_DAMPING);
    }
    return best;
}
