/* Joints that the target leaves undetermined (free), part 1: finding them, and moving them to their reference inside the joint
 * limits. Needs refine.c and rows.c. */
#include "kernel.h"
#if LIMITED

/* Reduces an angle (rad) to [0, 2 pi). */
LOCAL REAL ik_part(REAL x)
{
    return x - ((REAL)6.283185307179586 * FLOOR(x * (REAL)0.15915494309189535));
}

/* Largest violation (rad or m) of the joint limits, which are widened by margin on both sides; 0 if every joint is inside after
 * adding some multiple of 2 pi. */
LOCAL REAL ik_outside(const REAL *q, REAL margin)
{
    REAL worst = (REAL)0;
    int i;
    for (i = 0; i < JOINTS; ++i) {
        const REAL low = ik_lower[i] - margin;
        const REAL width = ik_upper[i] + margin - low;
        REAL out = (REAL)0;
#if SLIDES
        if (((SLIDING >> (unsigned)i) & 1u) != 0u) {
            out = (q[i] < low) ? (low - q[i]) : (q[i] - low - width);
        } else
#endif
        if (width < (REAL)6.283185307179586) {
            const REAL over = ik_part(q[i] - low);
            const REAL above = over - width;
            const REAL below = (REAL)6.283185307179586 - over;
            out = (above < below) ? above : below;
            out = (over <= width) ? (REAL)0 : out;
        } else { /* the limits leave room for a whole turn */
        }
        worst = (out > worst) ? out : worst;
    }
    return worst;
}

/* The value nearest to x inside the limits of joint j. */
LOCAL REAL ik_clamped(REAL x, int j)
{
    x = (x < ik_lower[j]) ? ik_lower[j] : x;
    return (x > ik_upper[j]) ? ik_upper[j] : x;
}

/* Moves the free joint j to the value nearest to its reference inside its limits. Where a second joint has the same axis, so
 * that the target determines only the sum or difference of the two, both are moved and kept inside their limits. Returns 0 if
 * no such value exists or if more than two joints would have to move. */
LOCAL int ik_shift(const REAL *T, REAL *q, int j, const REAL *ref)
{
    const REAL near = (REAL)4 * IK_TOL_DOUBT;
    REAL e[ERRORS];
    REAL J[ERRORS][JOINTS];
    REAL alone = (REAL)0;
    REAL x = ik_clamped(ref[j], j);
#if !POSITION
    REAL sense = (REAL)0;
    int partner = -1;
    int k;
#endif
    int i;
    (void)ik_error(T, q, e, J, 0u);
    for (i = 0; i < ERRORS; ++i) {
        alone += FABS(J[i][j]);
    }
    if (alone < near) { /* joint j does not move the tip: no other joint has to follow */
        q[j] = x;
        return 1;
    }
#if POSITION
    return 0;
#else
    for (k = 0; k < JOINTS; ++k) {
        REAL same = (REAL)0;
        REAL opposite = (REAL)0;
        for (i = 0; i < ERRORS; ++i) {
            same += FABS(J[i][j] - J[i][k]);
            opposite += FABS(J[i][j] + J[i][k]);
        }
        if ((k != j) && ((same < near) || (opposite < near))) {
            partner = k;
            sense = (same < near) ? (REAL)-1 : (REAL)1;
        }
    }
    if (partner < 0) {
        return 0;
    }
    {
        const REAL low = ik_lower[partner];
        const REAL width = ik_upper[partner] - low;
        const REAL other = q[partner] + (sense * (x - q[j]));
        if ((width < (REAL)6.283185307179586) && (ik_part(other - low) > width)) { /* the partner is outside: move it to either of its limits */
            const REAL up = x + (sense * ik_part(low - other));
            const REAL down = x - (sense * ik_part(other - low - width));
            const REAL near_up = ik_clamped(up, j);
            const REAL near_down = ik_clamped(down, j); /* equal inside the limits of joint j */
            const bool above = (up <= near_up) && (up >= near_up);
            const bool below = (down <= near_down) && (down >= near_down);
            if (!above && !below) {
                return 0;
            }
            x = (above && (!below || (FABS(up - x) <= FABS(down - x)))) ? up : down;
        }
        q[partner] += sense * (x - q[j]);
        q[j] = x;
        return 1;
    }
#endif
}
#endif

/* Copies solution i of one list to place `to` of another. */
LOCAL void ik_take(const ik_solutions *from, int i, ik_solutions *out, int to)
{
    int k;
    for (k = 0; k < JOINTS; ++k) {
        out->q[to][k] = from->q[i][k];
    }
    out->flags[to] = from->flags[i];
    out->branch[to] = from->branch[i];
    out->residual[to] = from->residual[i];
}

/* Moves x to a configuration with the joints `held` (bits) where they are that meets the target up to the squared error `goal`, by
 * at most `steps` damped Gauss-Newton steps. Gives up where two steps do not halve the error, and returns 0. */
LOCAL int ik_reaches(const REAL *T, REAL *x, REAL goal, int steps, unsigned held)
{
    REAL e[ERRORS];
    REAL J[ERRORS][JOINTS];
    REAL d[JOINTS];
    REAL cost = (REAL)0;
    REAL before = (REAL)0;
    int i;
    for (;;) {
        const REAL earlier = before;
        REAL most = (REAL)1;
        before = cost;
        cost = ik_error(T, x, e, J, held);
        if (cost <= goal) {
            return 1;
        }
        if ((steps == 0) || ((earlier > (REAL)0) && !(((REAL)4 * cost) < earlier))) {
            return 0;
        }
        ik_step(J, e, ((REAL)VALUE_DAMPING * SQRT(cost)) + IK_TOL_EPS, d);
        for (i = 0; i < JOINTS; ++i) {
            most = (FABS(d[i]) > most) ? FABS(d[i]) : most;
        }
        for (i = 0; i < JOINTS; ++i) {
#if SLIDES
            x[i] += d[i] / most * ((((SLIDING >> (unsigned)i) & 1u) != 0u) ? IK_TOL_REACH : (REAL)1);
#else
            x[i] += d[i] / most;
#endif
        }
        --steps;
    }
}

#if REDUNDANT && !LOCKED
/* Whether two configurations differ only in joint j and at most one other joint, up to the sum `most` of all further differences.
 * If more joints differ, the arm meets the target with another value of the redundancy parameter (such as the arm angle), which
 * must stay as prescribed. */
LOCAL int ik_stands(const REAL *from, const REAL *to, int j, REAL most)
{
    REAL sum = (REAL)0;
    REAL largest = (REAL)0;
    int k;
    for (k = 0; k < JOINTS; ++k) {
        const REAL moved = (k == j) ? (REAL)0 : FABS(to[k] - from[k]);
        sum += moved;
        largest = (moved > largest) ? moved : largest;
    }
    return (int)((sum - largest) <= most);
}

#endif
/* Finds the joints of solution i that the target leaves free; returns them as a bit mask. A joint is free if, after it is turned
 * by a small angle and held there, the other joints still meet the target to within `accuracy` (the error of its numbers). */
LOCAL unsigned ik_loose(const REAL *T, REAL accuracy, ik_solutions *found, int i)
{
    unsigned held = IK_HELD(found->flags[i]);
    int j;
    int k;
    int side;
    if ((held == 0u) && !((found->residual[i] <= IK_TOL_TIGHT) && (found->residual[i] >= (REAL)0))) {
        found->residual[i] = ik_refine(T, found->q[i], STEPS, (REAL)VALUE_DAMPING, 0u);
    }
    for (j = 0; j < JOINTS; ++j) {
        for (side = -1; (side <= 1) && (((found->flags[i] >> (8u + (unsigned)j)) & ~(held >> (unsigned)j) & 1u) != 0u); side += 2) {
            REAL q[JOINTS];
            for (k = 0; k < JOINTS; ++k) {
                q[k] = found->q[i][k] + ((k == j) ? ((REAL)side * (REAL)VALUE_TURN) : (REAL)0);
            }
            if (ik_reaches(T, q, accuracy * accuracy, VALUE_STEPS, 1u << (unsigned)j) != 0) {
#if REDUNDANT && !LOCKED
                held |= (ik_stands(found->q[i], q, j, (REAL)VALUE_STANDING * accuracy) != 0) ? (1u << (unsigned)j) : 0u;
#else
                held |= 1u << (unsigned)j;
#endif
            }
        }
    }
    found->flags[i] |= (held != 0u) ? ((held << 16) | (unsigned)IK_FREE) : 0u;
    return held;
}

/* x = from + part (to - from), angles by at most pi. */
LOCAL void ik_between(const REAL *from, const REAL *to, REAL part, REAL *x)
{
    int i;
    for (i = 0; i < JOINTS; ++i) {
#if SLIDES
        x[i] = from[i] + (part * ((((SLIDING >> (unsigned)i) & 1u) != 0u) ? (to[i] - from[i]) : ik_wrap(to[i] - from[i])));
#else
        x[i] = from[i] + (part * ik_wrap(to[i] - from[i]));
#endif
    }
}

/* Whether the configurations `from` and `to` lie on one path of configurations that meet the target up to the squared error
 * `goal`. If all configurations straight between them do not, the free joints `held` (bits) go straight to their values in `to`, and
 * the other joints follow. For a prescribed arm angle all joints go straight, because joints that follow might change it. */
LOCAL int ik_joined(const REAL *T, const REAL *from, const REAL *to, unsigned held, REAL goal)
{
    REAL x[JOINTS];
#if !REDUNDANT || LOCKED
    REAL last[JOINTS];
#endif
    int straight = 1;
#if !REDUNDANT || LOCKED
    int left;
#endif
    int i;
    if (ik_apart(from, to) < IK_TOL_SAME) {
        return 1;
    }
    for (i = 1; (i < 4) && (straight != 0); ++i) {
        ik_between(from, to, (REAL)0.25 * (REAL)i, x);
        straight = ik_reaches(T, x, goal, 0, held);
    }
#if REDUNDANT && !LOCKED
    return straight;
#else
    for (i = 0; i < JOINTS; ++i) {
        last[i] = from[i];
    }
    for (left = straight ? 0 : VALUE_PATH_STEPS; left > 0; --left) {
        ik_between(last, to, (REAL)1 / (REAL)left, x);
        if ((ik_reaches(T, x, goal, VALUE_PATH_CORRECTIONS, held) == 0) || (ik_apart(x, last) > (REAL)VALUE_PATH_MOVE)) {
            return 0;
        }
        for (i = 0; i < JOINTS; ++i) {
            last[i] = x[i];
        }
    }
    return 1;
#endif
}
