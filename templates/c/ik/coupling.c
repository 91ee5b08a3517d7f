/* Joint positions q of a mechanism beside the displacements y = S q of its chain from base to tip: turns, limits, task error. */
#include "kernel.h"
static const REAL ik_matrix[CHAIN_JOINTS][JOINTS] = MATRIX;
#if MIXED
/* The matrix with prismatic joints, of q and of the chain, in units of the reach. */
static const REAL ik_rates[CHAIN_JOINTS][JOINTS] = RATES;
#endif
/* By how much each joint may change (rad or m) so that every angle of the chain makes full turns; 0 if by nothing. */
static const REAL ik_period[JOINTS] = PERIODS;
/* Joint limits (rad or m); very large values for a joint without limits. */
LOCAL const REAL ik_lower[JOINTS] = LOWER;
LOCAL const REAL ik_upper[JOINTS] = UPPER;
#if FOLLOWERS_LIMITED
/* Joints that follow others and have limits: their factors of q, and their limits. */
static const REAL ik_followers[FOLLOWERS][JOINTS] = FOLLOWER_FACTORS;
static const REAL ik_least[FOLLOWERS] = FOLLOWER_LOWER;
static const REAL ik_most[FOLLOWERS] = FOLLOWER_UPPER;
#endif

/* y = S q */
LOCAL void ik_follow(const REAL *q, REAL y[CHAIN_JOINTS])
{
    int i;
    int j;
    for (i = 0; i < CHAIN_JOINTS; ++i) {
        y[i] = (REAL)0;
        for (j = 0; j < JOINTS; ++j) {
            y[i] += ik_matrix[i][j] * q[j];
        }
    }
}

/* Checks the numbers of a target and copies it to T, with its rotation made orthonormal. Returns the status of the check. */
LOCAL ik_status ik_check(const REAL *target, const REAL *q_ref LOCK_PARAMETER, REAL T[TARGET])
{
    REAL y[CHAIN_JOINTS] = {0};
    if (q_ref != NULL) {
        ik_follow(q_ref, y);
    }
    return chain_check(target, y LOCK, T);
}

/* Moves the joints by their periods to come nearest to the reference and inside the limits, if there are any. Returns 0 if a
 * joint, or one that follows, is outside its limits. */
LOCAL int ik_place(REAL q[JOINTS], const REAL *ref)
{
    int inside = 1;
    int i;
#if FOLLOWERS_LIMITED
    int j;
#endif
    for (i = 0; i < JOINTS; ++i) {
        const REAL period = ik_period[i];
        const REAL low = ik_lower[i] - IK_TOL_LIMIT;
        const REAL high = ik_upper[i] + IK_TOL_LIMIT;
        if (period > (REAL)0) {
            const REAL middle = (ref != NULL) ? ref[i] : (REAL)0;
            const REAL near = q[i] - (period * CEIL(((q[i] - middle) / period) - (REAL)0.5));
            const REAL under = low - near;
            const REAL over = near - high;
            const REAL below = (near < low) ? under : (REAL)0;
            const REAL above = (near > high) ? over : (REAL)0;
            const REAL x = near + (period * (CEIL(below / period) - CEIL(above / period)));
            q[i] = ((low <= x) && (x <= high)) ? x : near;
        }
        inside &= (int)((low <= q[i]) && (q[i] <= high));
    }
#if FOLLOWERS_LIMITED
    for (i = 0; i < FOLLOWERS; ++i) {
        REAL x = (REAL)0;
        for (j = 0; j < JOINTS; ++j) {
            x += ik_followers[i][j] * q[j];
        }
        inside &= (int)(((ik_least[i] - IK_TOL_LIMIT) <= x) && (x <= (ik_most[i] + IK_TOL_LIMIT)));
    }
#endif
    return inside;
}

/* Largest difference of a joint of the chain between two configurations, over the periods of q: rad, displacements in units of
 * the reach. */
LOCAL REAL ik_apart(const REAL *a, const REAL *b)
{
    REAL d[JOINTS];
    REAL y[CHAIN_JOINTS];
    REAL most = (REAL)0;
    int i;
    for (i = 0; i < JOINTS; ++i) {
        const REAL period = ik_period[i];
        d[i] = a[i] - b[i];
        d[i] -= (period > (REAL)0) ? (period * CEIL((d[i] / period) - (REAL)0.5)) : (REAL)0;
    }
    ik_follow(d, y);
    for (i = 0; i < CHAIN_JOINTS; ++i) {
#if CHAIN_SLIDES
        const REAL far = FABS((((CHAIN_SLIDING >> (unsigned)i) & 1u) != 0u) ? (y[i] / IK_TOL_REACH) : y[i]);
#else
        const REAL far = FABS(y[i]);
#endif
        most = (far > most) ? far : most;
    }
    return most;
}

/* Task error e = target - forward kinematics (position over the reach, rotation in rad) and its Jacobian J, that of the chain
 * times S. Returns the squared error |e|^2. */
LOCAL REAL ik_error(const REAL *T, const REAL *q, REAL e[ERRORS], REAL J[ERRORS][JOINTS])
{
    REAL y[CHAIN_JOINTS];
    REAL D[ERRORS][CHAIN_JOINTS];
    REAL cost;
    int i;
    int j;
    int k;
    ik_follow(q, y);
    cost = chain_error(T, y, e, D CHAIN_NONE_HELD);
    for (i = 0; i < ERRORS; ++i) {
        for (j = 0; j < JOINTS; ++j) {
            J[i][j] = (REAL)0;
            for (k = 0; k < CHAIN_JOINTS; ++k) {
#if MIXED
                J[i][j] += D[i][k] * ik_rates[k][j];
#else
                J[i][j] += D[i][k] * ik_matrix[k][j];
#endif
            }
        }
#if LOCKED
        J[i][LOCKED_JOINT] = (REAL)0; /* the prescribed joint stays */
#endif
    }
    return cost;
}
