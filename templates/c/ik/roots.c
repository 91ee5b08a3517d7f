/* Equations of the closed forms: square roots, a cos x + b sin x = k, quadratic and quartic equations; scaling to unit
 * length, and the angle nearest to a reference for which an inequality holds. Needs angles.c. */
#include "kernel.h"
#if NOMINAL_FIRST
/* The slack of a discriminant of size `size` that is the difference of two squares of lengths, each in error by parts of
 * `unit`. */
LOCAL REAL ik_wide(REAL slack, REAL size, REAL unit)
{
    return slack * ((REAL)1 + (unit / (SQRT(size) + (IK_TOL_EPS * unit))));
}
#endif
#if NEEDS_ROOT || NEEDS_LINEAR || NEEDS_COSINE || NEEDS_QUADRATIC

#if BANDED
/* Solves w^2 = w2 for w >= 0 and returns the number of real roots: 2, 1 for a double root (-slack size <= w2 <= 0), or 0.
 * A double root is split into two by the band, because on the true arm there may be two distinct roots. */
#else
/* Solves w^2 = w2 for w >= 0 and returns the number of real roots: 2, 1 for a double root (-slack size <= w2 <= 0), or 0. */
#endif
LOCAL int ik_root(REAL w2, REAL size, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags)
{
#if BANDED
    if (w2 <= (IK_TOL_BAND * size)) {
        *flags |= (unsigned)IK_NEAR;
        w2 = ((w2 >= (-slack * size)) && (w2 < (band * size))) ? (band * size) : w2;
    }
#endif
    if (w2 > (REAL)0) {
        *w = SQRT(w2);
        if (w2 <= (IK_TOL_MERGE * size)) { /* a conditional value would be computed for every root */
            *flags |= (unsigned)IK_NEAR;
        }
        return 2;
    }
    *w = (REAL)0;
    *flags |= (unsigned)IK_MULTIPLE;
    return (w2 >= (-slack * size)) ? 1 : 0;
}
#endif
#if NEEDS_COSINE

/* Solves cos(e) = k for w = sin(e) >= 0, where w^2 = w2. Returns the number of roots; for a double root k becomes -1 or 1. */
LOCAL int ik_cosine(REAL *k, REAL w2, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags)
{
    const int n = ik_root(w2, (REAL)1, slack BAND, w, flags);
    *k = (n == 1) ? COPYSIGN((REAL)1, *k) : *k;
    return n;
}
#endif
#if NEEDS_LINEAR

/* Solves a cos(x) + b sin(x) = k and returns the number of roots. On return cos(x) = a k -+ b w and sin(x) = b k +- a w with
 * w >= 0. A w2 >= 0 is a more accurate value of a^2 + b^2 - k^2; a negative one is ignored. Where a, b and k vanish, every x
 * is a solution and x = ref is returned; the flag `none` is set then. The flag `open` is set where a and b are so small that they
 * may be zero but for the error of the target. `unit` is the natural size of a, b and k. */
LOCAL int ik_linear(REAL *a, REAL *b, REAL *k, REAL w2, REAL unit, REAL ref, REAL least, unsigned open, unsigned none, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags)
{
    const REAL h2 = (*a * *a) + (*b * *b);
#if NOMINAL_FIRST
    const REAL doubt = (least > IK_TOL_DOUBT) ? least : IK_TOL_DOUBT;
    if (h2 <= (doubt * unit * (doubt * unit))) {
#else
    if (h2 <= (IK_TOL_DOUBT * unit * (IK_TOL_DOUBT * unit))) {
#endif
        *flags |= open;
        if (h2 <= (least * unit * (least * unit))) {
            *w = (REAL)0;
            *flags |= none;
            if (!((*k * *k) <= (slack * unit * unit))) {
                return 0;
            }
            *a = COS(ref);
            *b = SIN(ref);
            *k = (REAL)1;
            return 1;
        }
    }
    { /* square root and quotient are independent, so that the processor can overlap them */
        const REAL i = (REAL)1 / h2;
#if NOMINAL_FIRST
        const REAL wide = (least > IK_TOL_FREE) ? ik_wide(slack, h2, unit) : slack;
        const int n = ik_root((w2 >= (REAL)0) ? w2 : (h2 - (*k * *k)), h2, wide BAND, w, flags);
#else
        const int n = ik_root((w2 >= (REAL)0) ? w2 : (h2 - (*k * *k)), h2, slack BAND, w, flags);
#endif
        *w *= i;
        *k = ((n == 1) ? COPYSIGN(SQRT(h2), *k) : *k) * i;
        return n;
    }
}
#endif
#if NEEDS_UNIT

/* Scales (c, s) to length 1; returns flags: `open` where the vector is so short that it may have no direction,
 * `none` where it has none. */
LOCAL unsigned ik_unit(REAL *c, REAL *s, REAL least, unsigned open, unsigned none)
{
    const REAL h2 = (*c * *c) + (*s * *s);
    unsigned flags = 0u;
    if (h2 <= (IK_TOL_DOUBT * IK_TOL_DOUBT)) {
        if (h2 <= (least * least)) {
            return none;
        }
        flags = open;
    }
#if NOMINAL_FIRST
    if (h2 <= (least * least)) {
        return none;
    }
#endif
    {
        const REAL i = (REAL)1 / SQRT(h2);
        *c *= i;
        *s *= i;
    }
    return flags;
}
#endif
#if NEEDS_QUARTIC || NEEDS_POWER4

/* Finds the four complex roots z of sum k_j z^j (real parts r, imaginary parts i) by at most 40 Aberth iterations. */
LOCAL void ik_aberth(const REAL kr[5], const REAL ki[5], REAL zr[4], REAL zi[4])
{
    int it;
    int j;
    int m;
    for (it = 0; it < 40; ++it) {
        REAL moved = (REAL)0;
        for (j = 0; j < 4; ++j) {
            REAL fr = kr[4];
            REAL fi = ki[4];
            REAL gr = (REAL)0;
            REAL gi = (REAL)0;
            REAL sr = (REAL)0;
            REAL si = (REAL)0;
            REAL dr;
            REAL di;
            REAL nr;
            REAL ni;
            REAL h;
            for (m = 3; m >= 0; --m) {
                const REAL tr = (gr * zr[j]) - (gi * zi[j]) + fr;
                const REAL hr = (fr * zr[j]) - (fi * zi[j]) + kr[m];
                gi = (gr * zi[j]) + (gi * zr[j]) + fi;
                fi = (fr * zi[j]) + (fi * zr[j]) + ki[m];
                gr = tr;
                fr = hr;
            }
            for (m = 0; m < 4; ++m) {
                const REAL xr = zr[j] - zr[m];
                const REAL xi = zi[j] - zi[m];
                h = (xr * xr) + (xi * xi);
                if ((m != j) && (h > (REAL)0)) {
                    sr += xr / h;
                    si -= xi / h;
                }
            }
            /* step = f / (g - f s) */
            dr = gr - ((fr * sr) - (fi * si));
            di = gi - ((fr * si) + (fi * sr));
            h = (dr * dr) + (di * di);
            if (!(h > (REAL)0)) {
                continue;
            }
            nr = ((fr * dr) + (fi * di)) / h;
            ni = ((fi * dr) - (fr * di)) / h;
            zr[j] -= nr;
            zi[j] -= ni;
            h = ((nr * nr) + (ni * ni)) / ((zr[j] * zr[j]) + (zi[j] * zi[j]) + IK_TOL_EPS);
            moved = (h > moved) ? h : moved;
        }
        if (!(moved > (IK_TOL_EPS * IK_TOL_EPS))) {
            break;
        }
    }
}
#endif
#if NEEDS_QUARTIC

/* Solves k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0 and returns the number of roots, at most four: angles x in
 * ascending order with cosines c, sines s and branch numbers g (bit 0: the slope is negative, bit 1: the second root of that
 * slope). The roots are the z = exp(ix) of a complex quartic; two that miss the unit circle by less than the slack count as a
 * double root. */
LOCAL int ik_quartic(REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL slack, REAL *c, REAL *s, REAL *x, unsigned *g)
{
    const REAL size = FABS(k0) + FABS(k1) + FABS(k2) + FABS(k3) + FABS(k4);
    REAL kr[5];
    REAL ki[5];
    REAL zr[4];
    REAL zi[4];
    int i;
    int j;
    int n = 0;
    unsigned rising = 0u;
    unsigned falling = 0u;
    if (!(size > (REAL)0)) {
        return 0;
    }
    k0 /= size;
    k1 /= size;
    k2 /= size;
    k3 /= size;
    k4 /= size;
    kr[0] = kr[4] = (REAL)0.5 * k3;
    ki[0] = (REAL)0.5 * k4;
    ki[4] = -ki[0];
    kr[1] = kr[3] = (REAL)0.5 * k1;
    ki[1] = (REAL)0.5 * k2;
    ki[3] = -ki[1];
    kr[2] = k0;
    ki[2] = (REAL)0;
    for (i = 0; i < 4; ++i) { /* starting points in four directions, inside and outside the unit circle */
        static const REAL start[4][2] = {
            {(REAL)0.79, (REAL)0.57}, {(REAL)-0.63, (REAL)0.81}, {(REAL)-0.91, (REAL)-0.48}, {(REAL)0.55, (REAL)-0.89}};
        zr[i] = start[i][0];
        zi[i] = start[i][1];
    }
    ik_aberth(kr, ki, zr, zi);
    for (i = 0; i < 4; ++i) {
        const REAL m2 = (zr[i] * zr[i]) + (zi[i] * zi[i]);
        const REAL off = m2 - (REAL)1;
        REAL cosine;
        REAL sine;
        REAL f;
        REAL d;
        if (!(m2 > (REAL)0) || !((off * off) <= (IK_TOL_CIRCLE + (slack * slack)))) {
            continue;
        }
        cosine = zr[i] / SQRT(m2);
        sine = zi[i] / SQRT(m2);
        for (j = 0; j < 2; ++j) { /* Newton steps along the unit circle */
            REAL step;
            f = k0 + (cosine * (k1 + ((REAL)2 * k3 * cosine))) + (sine * (k2 + ((REAL)2 * k4 * cosine))) - k3;
            d = (-k1 * sine) + (k2 * cosine) + ((REAL)2 * k4 * ((cosine * cosine) - (sine * sine))) - ((REAL)4 * k3 * cosine * sine);
            step = -f * d / ((d * d) + IK_TOL_EPS);
            step = (step > (REAL)VALUE_NEWTON) ? (REAL)VALUE_NEWTON : (step < (REAL)-VALUE_NEWTON) ? (REAL)-VALUE_NEWTON : step;
            f = cosine - (step * sine);
            sine += step * cosine;
            cosine = f;
            f = (REAL)1 / SQRT((cosine * cosine) + (sine * sine));
            cosine *= f;
            sine *= f;
        }
        f = ik_atan2(sine, cosine);
        for (j = n; (j > 0) && (x[j - 1] > f); --j) {
            x[j] = x[j - 1];
            c[j] = c[j - 1];
            s[j] = s[j - 1];
        }
        x[j] = f;
        c[j] = cosine;
        s[j] = sine;
        ++n;
    }
    for (i = 0; i < n; ++i) {
        const REAL d = (-k1 * s[i]) + (k2 * c[i]) + ((REAL)2 * k4 * ((c[i] * c[i]) - (s[i] * s[i]))) - ((REAL)4 * k3 * c[i] * s[i]);
        g[i] = (d > (REAL)0) ? (2u * (rising++ & 1u)) : ((2u * (falling++ & 1u)) + 1u);
    }
    return n;
}
#endif
#if NEEDS_POWER4

/* Solves k0 + k1 x + k2 x^2 + k3 x^3 + k4 x^4 = 0 and returns the number of real roots x, ascending, with their branch numbers
 * g (bit 0: the slope is negative, bit 1: the second root of that slope). unit (m) is the natural size of x. */
LOCAL int ik_power4(
    REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL unit, REAL slack, REAL *x, unsigned *g, unsigned *flags)
{
    const REAL k[5] = {k0, k1 * unit, k2 * unit * unit, k3 * unit * unit * unit, k4 * (unit * unit) * (unit * unit)};
    REAL size = (REAL)0;
    REAL kr[5];
    REAL ki[5] = {0};
    REAL zr[4];
    REAL zi[4];
    int i;
    int j;
    int n = 0;
    unsigned rising = 0u;
    unsigned falling = 0u;
    for (i = 0; i < 5; ++i) {
        size += FABS(k[i]);
    }
    if (!(size > (REAL)0)) {
        return 0;
    }
    for (i = 0; i < 5; ++i) {
        kr[i] = k[i] / size;
    }
    for (i = 0; i < 4; ++i) {
        static const REAL start[4][2] = {
            {(REAL)0.79, (REAL)0.57}, {(REAL)-0.63, (REAL)0.81}, {(REAL)-0.91, (REAL)-0.48}, {(REAL)0.55, (REAL)-0.89}};
        zr[i] = start[i][0];
        zi[i] = start[i][1];
    }
    ik_aberth(kr, ki, zr, zi);
    for (i = 0; i < 4; ++i) {
        const REAL m2 = (zr[i] * zr[i]) + (zi[i] * zi[i]);
        REAL y = zr[i];
        if (!((zi[i] * zi[i]) <= ((IK_TOL_CIRCLE + (slack * slack)) * ((REAL)1 + m2)))) {
            continue;
        }
        for (j = 0; j < 2; ++j) {
            const REAL f = kr[0] + (y * (kr[1] + (y * (kr[2] + (y * (kr[3] + (y * kr[4])))))));
            const REAL d = kr[1] + (y * (((REAL)2 * kr[2]) + (y * (((REAL)3 * kr[3]) + (y * (REAL)4 * kr[4])))));
            const REAL step = -f * d / ((d * d) + IK_TOL_EPS);
            y += (step > (REAL)VALUE_NEWTON) ? (REAL)VALUE_NEWTON : (step < (REAL)-VALUE_NEWTON) ? (REAL)-VALUE_NEWTON : step;
        }
        for (j = n; (j > 0) && (x[j - 1] > (y * unit)); --j) {
            x[j] = x[j - 1];
        }
        x[j] = y * unit;
        ++n;
    }
    for (i = 0; i < n; ++i) {
        const REAL y = x[i] / unit;
        const REAL d = kr[1] + (y * (((REAL)2 * kr[2]) + (y * (((REAL)3 * kr[3]) + (y * (REAL)4 * kr[4])))));
        g[i] = (d > (REAL)0) ? (2u * (rising++ & 1u)) : ((2u * (falling++ & 1u)) + 1u);
    }
    *flags |= (unsigned)IK_NEAR;
    return n;
}
#endif
#if NEEDS_QUADRATIC

/* Solves k0 + k1 x + k2 x^2 = 0 and returns the number of real roots x; g = 0 for the larger one. unit (m): natural size of x. */
LOCAL int ik_quadratic(REAL k0, REAL k1, REAL k2, REAL unit, REAL slack BAND_PARAMETER, REAL *x, unsigned *g, unsigned *flags)
{
    const REAL size = (k1 * k1) + FABS((REAL)4 * k0 * k2);
    const REAL w2 = (k1 * k1) - ((REAL)4 * k0 * k2);
    REAL w;
    int n;
    if ((FABS(k2) * unit) <= (IK_TOL_EPS * FABS(k1))) { /* at this pose the equation is linear */
        if (!(FABS(k1) > (REAL)0)) {
            return 0;
        }
        x[0] = -k0 / k1;
        g[0] = (k1 > (REAL)0) ? 0u : 1u;
        return 1;
    }
    n = ik_root(w2, size, slack BAND, &w, flags);
    if (n == 1) {
        x[0] = (REAL)-0.5 * k1 / k2;
        g[0] = 0u;
    } else if (n == 2) {
        const REAL sum = (REAL)-0.5 * (k1 + ((k1 < (REAL)0) ? -w : w));
        const REAL one = sum / k2;
        const REAL other = k0 / sum;
        x[0] = (one > other) ? one : other;
        x[1] = (one > other) ? other : one;
        g[0] = 0u;
        g[1] = 1u;
    }
    return n;
}
#endif
#if NEEDS_FEASIBLE

/* The angle x nearest to ref with lower <= mean + a cos(x) + b sin(x) <= upper; ref itself if there is none. */
LOCAL REAL ik_feasible(REAL ref, REAL mean, REAL a, REAL b, REAL lower, REAL upper)
{
    const REAL h = SQRT((a * a) + (b * b));
    const REAL now = mean + (a * COS(ref)) + (b * SIN(ref));
    REAL best = ref;
    REAL away = (REAL)10;
    int i;
    if (((now >= lower) && (now <= upper)) || !(h > (REAL)0)) {
        return ref;
    }
    for (i = 0; i < 4; ++i) {
        const REAL k = (((i < 2) ? lower : upper) - mean) / h;
        const REAL w = ((k * k) < (REAL)1) ? SQRT(((REAL)1 - k) * ((REAL)1 + k)) : (REAL)0;
        const REAL e = ik_atan2(w, k);
        const REAL x = ik_wrap(ik_atan2(b, a) + (((i % 2) == 0) ? e : -e) - ref);
        if (((k * k) <= (REAL)1) && (FABS(x) < away)) {
            away = FABS(x);
            best = ref + x;
        }
    }
    return best;
}
#endif
