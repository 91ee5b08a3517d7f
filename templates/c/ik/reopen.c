/* Joints that the target leaves undetermined (free), part 2: of the continuum of solutions the one with the free joint at its
 * reference is returned. This file is emitted once for each list of candidates (ik_branches, ik_nearby), whose function is called
 * ik_candidates here. Needs open.c and rows.c. */
#include "kernel.h"

/* Bits of the branch number that have no meaning while the joints `held` are free, because those branches coincide. */
LOCAL unsigned ik_merged(unsigned held)
{
    unsigned bits = 0u;
#if MERGES
    MERGED_BITS
#endif
    (void)held;
    return bits;
}
#if LIMITED

/* Computes the solution q of one branch in which the free joint j has the value x; the other free joints are moved inside their
 * limits where possible. Returns the largest violation of the limits (rad or m), or 10 if the branch has no such solution. */
LOCAL REAL ik_with(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL least, unsigned held, unsigned branch, int j, REAL x, REAL *q)
{
    ik_solutions trial;
    REAL at[JOINTS];
    int stage = 0;
    int i;
    int k;
    int rows;
    for (i = 0; i < JOINTS; ++i) {
        at[i] = (i == j) ? x : ref[i];
    }
    rows = ik_candidates(T, at LOCK, IK_TOL_SLACK, least NO_BAND, &trial, &stage);
    for (i = 0; i < rows; ++i) {
        if ((IK_HELD(trial.flags[i]) == held) && (((trial.branch[i] ^ branch) & ~ik_merged(held)) == 0u)) {
            for (k = 0; k < JOINTS; ++k) {
                q[k] = trial.q[i][k];
            }
            for (k = 0; k < JOINTS; ++k) {
                if ((k != j) && (((held >> (unsigned)k) & 1u) != 0u)) {
                    (void)ik_shift(T, q, k, ref);
                }
            }
            return ik_outside(q, (REAL)0.5 * IK_TOL_LIMIT); /* half the margin: the final refinement may still change q by rounding */
        }
    }
    return (REAL)10;
}

/* Finds the value of the free joint j nearest to its reference for which all joints are inside their limits; used where several
 * joints move together with j. It steps away from the reference in both directions until the limits hold, then bisects the last
 * step. Where the violation has a minimum between steps, ternary search looks for a value inside. Returns 0 if none is found. */
LOCAL int ik_search(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL least, unsigned held, unsigned branch, int j, REAL *q)
{
    const REAL start = ik_clamped(ref[j], j);
    const REAL h = (REAL)VALUE_LIMIT_STEP;
    REAL best = (REAL)-1;
    REAL x[JOINTS] = {0}; /* written before it is read, which no analysis sees */
    int side;
    int k;
    int i;
    for (side = -1; side <= 1; side += 2) {
        REAL back = start;
        REAL middle = start;
        REAL g1 = ik_with(T, ref LOCK, least, held, branch, j, start, x);
        REAL g0 = g1;
        int dips = 0;
        for (k = 1; k <= VALUE_LIMIT_STEPS; ++k) {
            const REAL front = ik_clamped(start + ((REAL)side * (REAL)k * h), j);
            const REAL g = ik_with(T, ref LOCK, least, held, branch, j, front, x);
            REAL bad = middle;
            REAL good = front;
            REAL deep = g;
            const bool dip = (g > (REAL)0) && (k > 1) && (g1 <= g0) && (g1 <= g);
            if (dip && (dips < VALUE_LIMIT_DIPS)) {
                REAL a = back;
                REAL b = front;
                bool above = deep > (REAL)0;
                ++dips;
                for (i = 0; (i < VALUE_DIP_STEPS) && above; ++i) {
                    const REAL u = a + ((b - a) / (REAL)3);
                    const REAL v = b - ((b - a) / (REAL)3);
                    const REAL gu = ik_with(T, ref LOCK, least, held, branch, j, u, x);
                    const REAL gv = ik_with(T, ref LOCK, least, held, branch, j, v, x);
                    good = (gu <= gv) ? u : v;
                    deep = (gu <= gv) ? gu : gv;
                    a = (gu <= gv) ? a : u;
                    b = (gu <= gv) ? v : b;
                    above = deep > (REAL)0;
                }
                bad = back;
            }
            if (!(deep > (REAL)0)) {
                for (i = 0; i < VALUE_BORDER_STEPS; ++i) {
                    const REAL half = (REAL)0.5 * (bad + good);
                    if (ik_with(T, ref LOCK, least, held, branch, j, half, x) > (REAL)0) {
                        bad = half;
                    } else {
                        good = half;
                    }
                }
                (void)ik_with(T, ref LOCK, least, held, branch, j, good, x);
                if (!(best >= (REAL)0) || (FABS(good - start) < best)) {
                    best = FABS(good - start);
                    for (i = 0; i < JOINTS; ++i) {
                        q[i] = x[i];
                    }
                }
                break;
            }
            back = middle;
            g0 = g1;
            middle = front;
            g1 = g;
        }
    }
    return (int)(best >= (REAL)0);
}

/* Moves the free joints of solution w to the values nearest to the reference for which every joint is inside its limits. */
LOCAL void ik_fit(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL least, REAL tolerance, ik_solutions *wide, int w)
{
    const unsigned held = IK_HELD(wide->flags[w]);
    REAL q[JOINTS];
    REAL error;
    int j;
    int k;
    for (k = 0; k < JOINTS; ++k) {
        q[k] = wide->q[w][k];
    }
    for (j = 0; (j < JOINTS) && (ik_outside(q, IK_TOL_LIMIT) > (REAL)0); ++j) {
        if (((held >> (unsigned)j) & 1u) != 0u) {
            (void)ik_shift(T, q, j, ref);
        }
    }
    for (j = 0; (j < JOINTS) && (ik_outside(q, IK_TOL_LIMIT) > (REAL)0); ++j) {
        if (((held >> (unsigned)j) & 1u) != 0u) {
            (void)ik_search(T, ref LOCK, least, held, wide->branch[w], j, q);
        }
    }
    error = ik_refine(T, q, VALUE_STEPS, (REAL)VALUE_DAMPING, held);
    if ((error <= tolerance) && !(ik_outside(q, IK_TOL_LIMIT) > (REAL)0)) {
        for (k = 0; k < JOINTS; ++k) {
            wide->q[w][k] = q[k];
        }
        wide->residual[w] = error;
    }
}
#endif

/* Replaces candidates in which the target leaves a joint free, but whose equations have computed its value from the direction of a
 * very short vector, mostly from rounding errors. The replacement is the solution with that joint at its reference (with limits: at
 * the nearest value for which all joints are inside), if it meets the target. It is computed by the same equations, with the
 * length `least` below which a vector counts as zero raised tenfold at a time until they treat exactly those joints as free.
 * Beside two singular configurations at once, a candidate may be no part of the replacement's continuum: it stays, and stands for
 * its own one. */
LOCAL void ik_reopen(const REAL *T, const REAL *at LOCK_PARAMETER, unsigned options, REAL accuracy, ik_solutions *found, int rows)
{
    const REAL own = (REAL)VALUE_REOPENED * accuracy * accuracy;
    const REAL tolerance = (own > IK_TOL_ACCEPT) ? own : IK_TOL_ACCEPT;
    REAL least = IK_TOL_FREE;
    int pending = 0;
    int round;
    int i;
    int w;
    for (i = 0; i < rows; ++i) {
        pending += (int)(((found->flags[i] & IK_OPEN) != 0u) && (ik_loose(T, accuracy, found, i) != 0u));
    }
    bool wider = least < ((REAL)2 * IK_TOL_DOUBT);
    for (round = 0; (round < 64) && (pending > 0) && wider; ++round) { /* far fewer decades lie between the two */
        ik_solutions wide;
        int stage = 0;
        int count;
        (void)memset(&wide, 0, sizeof(wide));
        count = ik_candidates(T, at LOCK, IK_TOL_SLACK, least NO_BAND, &wide, &stage);
        for (w = 0; w < count; ++w) {
            const unsigned held = IK_HELD(wide.flags[w]);
            const unsigned other = ~ik_merged(held);
            int first = -1;
            int aside = -1;
            int fits = -1;
            for (i = 0; i < rows; ++i) {
                if ((held != 0u) && (IK_HELD(found->flags[i]) == held) && (((found->branch[i] ^ wide.branch[w]) & other) == 0u)) {
                    if (fits < 0) {
                        wide.residual[w] = ik_refine(T, wide.q[w], VALUE_STEPS, (REAL)VALUE_DAMPING, held);
                        fits = (int)(wide.residual[w] <= tolerance);
                    }
                    if (fits > 0) {
                        --pending;
                        if (ik_joined(T, found->q[i], wide.q[w], held, tolerance) != 0) {
                            found->flags[i] = IK_GONE;
                            first = (first < 0) ? i : first;
                        } else if ((aside >= 0) && (ik_joined(T, found->q[i], found->q[aside], held, tolerance) != 0)) {
                            found->flags[i] = IK_GONE;
                        } else { /* another continuum, which this replacement does not stand for */
                            found->flags[i] &= 0xffffu; /* looked at: no longer among those with these free joints */
                            aside = i;
                        }
                    }
                }
            }
            if (first >= 0) {
#if LIMITED
                if (((options & IK_LIMITS) != 0u) && (ik_outside(wide.q[w], IK_TOL_LIMIT) > (REAL)0)) {
                    ik_fit(T, at LOCK, least, tolerance, &wide, w);
                }
#endif
                wide.flags[w] = (wide.flags[w] & (unsigned)IK_MULTIPLE) | (unsigned)IK_FREE | IK_FIXED;
                ik_take(&wide, w, found, first);
            }
        }
        least *= (REAL)10;
        wider = least < ((REAL)2 * IK_TOL_DOUBT);
    }
#if !LIMITED
    (void)options;
#endif
}
