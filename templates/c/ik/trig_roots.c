/* Roots of a real trigonometric polynomial of degree 8, isolated by Descartes' rule of signs and refined by Newton steps. */
#include "kernel.h"
/* Roots of p(x) = a[0] + sum_k a[k] cos(k x) + b[k] sin(k x), k = 1 .. 8, on the unit circle.
 * The circle is divided into four arcs. On each, with u = tan((x - centre) / 2), p (1 + u^2)^8 is a polynomial in u of degree 16.
 * Its Bernstein coefficients bound its values, and the number of their sign changes bounds the number of its roots (Descartes'
 * rule), so that bisection isolates every root and every cluster of roots. */
#define IK_TRIG8_DEPTH 40
#define IK_TRIG8_SPLITS 384
#define IK_TRIG8_ROWS 24
#define IK_TRIG8_ARC 0.41421356237309503 /* tan(pi/8) */
#define IK_TRIG8_EPS (ik_6r_real)VALUE_6R_EPS

/* Bernstein coefficients on an arc of cos(k x)(1 + u^2)^8 (symmetric) and sin(k x)(1 + u^2)^8 (antisymmetric). */
static const ik_6r_real ik_trig8_even[9][9] = {
    {3.549396079493484, 2.509802036926789, 1.8930112423965249, 1.5058812221560733, 1.2559401512053867, 1.094016272506549, 0.9928380641939816, 0.937226774628605, 0.9194783627840929},
    {2.509802036926789, 1.996535294715085, 1.6313713240024128, 1.375390980803725, 1.19698250991893, 1.0750574663850456, 0.996022836332834, 0.9515732321509193, 0.937226774628605},
    {0.0, 0.6274505092316972, 0.887349019873371, 0.9859936573640956, 1.014113165569567, 1.0135738995281263, 1.0043620774390902, 0.996022836332834, 0.9928380641939816},
    {-2.509802036926789, -1.1091862748417138, -0.20915016974389905, 0.34860140066453865, 0.6895060541007662, 0.8946623359712285, 1.0135738995281263, 1.0750574663850456, 1.094016272506549},
    {-3.549396079493484, -2.509802036926789, -1.4197584317973937, -0.5019604073853577, 0.1950217626095321, 0.6895060541007662, 1.014113165569567, 1.19698250991893, 1.2559401512053867},
    {-2.509802036926789, -2.883884314588456, -2.3843119350804494, -1.4768022973606818, -0.5019604073853577, 0.34860140066453865, 0.9859936573640956, 1.375390980803725, 1.5058812221560733},
    {0.0, -1.8823515276950915, -2.662047059620113, -2.3843119350804494, -1.4197584317973937, -0.20915016974389905, 0.887349019873371, 1.6313713240024128, 1.8930112423965249},
    {2.509802036926789, 0.22183725496834275, -1.8823515276950915, -2.883884314588456, -2.509802036926789, -1.1091862748417138, 0.6274505092316972, 1.996535294715085, 2.509802036926789},
    {3.549396079493484, 2.509802036926789, 0.0, -2.509802036926789, -3.549396079493484, -2.509802036926789, 0.0, 2.509802036926789, 3.549396079493484}
};
static const ik_6r_real ik_trig8_odd[8][9] = {
    {-2.509802036926789, -1.5528607847783993, -1.0039208147707155, -0.6655117649050283, -0.4440418988408934, -0.290094871881679, -0.1755106319529223, -0.08283992598118534, 0.0},
    {-3.549396079493484, -2.509802036926789, -1.774698039746742, -1.2549010184633944, -0.8775979317428945, -0.5929752065266589, -0.3669954987288468, -0.1755106319529223, 0.0},
    {-2.509802036926789, -2.4402098046517704, -2.0915016974389906, -1.6796249304745952, -1.282481260627425, -0.9206652376524994, -0.5929752065266589, -0.290094871881679, 0.0},
    {0.0, -1.2549010184633944, -1.774698039746742, -1.8285700554752318, -1.622581064911307, -1.282481260627425, -0.8775979317428945, -0.4440418988408934, 0.0},
    {2.509802036926789, 0.6655117649050283, -0.7529406110780367, -1.565537199348019, -1.8285700554752318, -1.6796249304745952, -1.2549010184633944, -0.6655117649050283, 0.0},
    {3.549396079493484, 2.509802036926789, 0.8281924185484797, -0.7529406110780367, -1.774698039746742, -2.0915016974389906, -1.774698039746742, -1.0039208147707155, 0.0},
    {2.509802036926789, 3.3275588245251413, 2.509802036926789, 0.6655117649050283, -1.2549010184633944, -2.4402098046517704, -2.509802036926789, -1.5528607847783993, 0.0},
    {0.0, 2.509802036926789, 3.549396079493484, 2.509802036926789, 0.0, -2.509802036926789, -3.549396079493484, -2.509802036926789, 0.0}
};

/* Values of p and dp/dx at u = tan(x/2), where x counts from the centre of the arc, by Horner's rule in z = exp(i x). */
LOCAL void ik_trig8_value(const ik_6r_real a[9], const ik_6r_real b[9], ik_6r_real u, ik_6r_real out[2])
{
    const ik_6r_real w = 1.0 / (1.0 + (u * u));
    const ik_6r_real c = (1.0 - (u * u)) * w;
    const ik_6r_real s = 2.0 * u * w;
    ik_6r_real hr = a[8];
    ik_6r_real hi = -b[8];
    ik_6r_real dr = 0.0;
    ik_6r_real di = 0.0;
    int k;
    for (k = 7; k >= 0; --k) {
        const ik_6r_real er = (dr * c) - (di * s) + hr;
        const ik_6r_real gr = (hr * c) - (hi * s) + a[k];
        di = (dr * s) + (di * c) + hi;
        hi = (hr * s) + (hi * c) - b[k];
        dr = er;
        hr = gr;
    }
    out[0] = hr;
    out[1] = -((dr * s) + (di * c));
}

/* The root of p between u0 and u1 near u, where p changes its sign: Newton steps kept inside the bracket. */
LOCAL ik_6r_real ik_trig8_refine(const ik_6r_real a[9], const ik_6r_real b[9], ik_6r_real u0, ik_6r_real u1, ik_6r_real u, int rising)
{
    int it;
    for (it = 0; it < 50; ++it) {
        ik_6r_real v[2];
        ik_6r_real step;
        if (!((u > u0) && (u < u1))) {
            u = 0.5 * (u0 + u1);
        }
        ik_trig8_value(a, b, u, v);
        if ((v[0] > 0.0) == rising) {
            u1 = u;
        } else {
            u0 = u;
        }
        step = 0.5 * v[0] * (1.0 + (u * u));
        if (fabs(step) < fabs(v[1])) {
            step /= v[1];
            u -= step;
        } else { /* the step would leave the arc: bisect */
            step = u1 - u0;
            u = 0.5 * (u0 + u1);
        }
        if (fabs(step) < (ik_6r_real)VALUE_6R_TRIG_DONE) { /* the error is now of the order of step^2 */
            break;
        }
    }
    return (u < u0) ? u0 : ((u > u1) ? u1 : u);
}

/* Finds the roots of p, whose values are known to +- noise. root: cos x, sin x, and half the width (rad) of the interval in
 * which the root could not be resolved. mult: 1 for a simple root; 2 for a double root or for several roots between which p
 * does not exceed the noise, reported once. The coefficients a and b are changed during the computation and have their old values
 * at its end; b[0] is not used. Returns the number of entries written, at most 24. */
LOCAL int ik_trig_roots_8(ik_6r_real a[9], ik_6r_real b[9], ik_6r_real noise, ik_6r_real root[IK_TRIG8_ROWS][3], int mult[IK_TRIG8_ROWS])
{
    ik_6r_real stack[IK_TRIG8_DEPTH + 2][17];
    ik_6r_real from[IK_TRIG8_DEPTH + 2];
    ik_6r_real width[IK_TRIG8_DEPTH + 2];
    ik_6r_real first = 0.0;
    int arc;
    int count = 0;
    int splits = 0;
    int left;
    int k;
    int j;
    stack[0][16] = 0.0;
    for (arc = 0; arc < 4; ++arc) {
        ik_6r_real *const whole = stack[0];
        const ik_6r_real last = whole[16];
        int top = 1;
        for (j = 0; j <= 8; ++j) {
            ik_6r_real even = a[0] * ik_trig8_even[0][j];
            ik_6r_real odd = 0.0;
            for (k = 1; k <= 8; ++k) {
                even += a[k] * ik_trig8_even[k][j];
                odd += b[k] * ik_trig8_odd[k - 1][j];
            }
            whole[j] = even + odd;
            whole[16 - j] = even - odd;
        }
        /* neighbouring arcs share the value at their seam, so that no root falls between them */
        first = (arc == 0) ? whole[0] : first;
        whole[0] = (arc == 0) ? first : last;
        whole[16] = (arc == 3) ? first : whole[16];
        from[0] = -IK_TRIG8_ARC;
        width[0] = 2.0 * IK_TRIG8_ARC;
        for (left = 1 + (2 * (IK_TRIG8_SPLITS - splits)); (top > 0) && (left > 0); --left) { /* an interval leaves the stack, or is split */
            ik_6r_real *const c = stack[top - 1];
            const ik_6r_real u0 = from[top - 1];
            const ik_6r_real du = width[top - 1];
            ik_6r_real u = u0 + (0.5 * du);
            ik_6r_real blur = 0.5 * du;
            ik_6r_real cross = 0.0;
            ik_6r_real at = 0.5;
            int changes = 0;
            int doubtful = (int)(fabs(c[0]) <= noise);
            int rising = 1;
            int falling = 1;
            int order = 2;
            for (j = 1; j <= 16; ++j) {
                const ik_6r_real rise = c[j] - c[j - 1];
                if ((c[j] < 0.0) != (c[j - 1] < 0.0)) {
                    ++changes;
                    cross += (ik_6r_real)j - (c[j] / rise);
                }
                doubtful += (int)(fabs(c[j]) <= noise);
                rising &= (int)(rise >= 0.0);
                falling &= (int)(rise <= 0.0);
            }
            --top;
            if ((doubtful == 0) && (changes == 0)) {
                continue;
            }
            if ((doubtful <= 16) && ((rising != 0) || (falling != 0) || ((doubtful == 0) && (changes == 1)))) {
                if (changes == 1) {
                    u = ik_trig8_refine(a, b, u0, u0 + du, u0 + (0.0625 * du * cross), c[0] < 0.0);
                    order = 1 + (int)(doubtful > 2);
                    blur = (doubtful > 2) ? (0.03125 * (ik_6r_real)doubtful * du) : 0.0;
                } else if (doubtful > 1) { /* flat where it touches zero, at an end of the interval */
                    u = ((c[0] < 0.0) == (rising != 0)) ? du : 0.0;
                    u += u0;
                    blur = 0.0;
                } else {
                    continue;
                }
            } else if ((doubtful <= 16) && (du > (IK_TRIG8_ARC * (ik_6r_real)VALUE_6R_TRIG_NARROWEST)) && (splits < IK_TRIG8_SPLITS) && (top < IK_TRIG8_DEPTH)) {
                ++splits; /* de Casteljau: the right part stays in place, the left part goes on top of it */
                if ((changes == 2) && (cross > 4.0) && (cross < 28.0)) {
                    at = 0.03125 * cross; /* between two roots, where the polygon crosses zero twice */
                }
                for (k = 0; k < 16; ++k) {
                    stack[top + 1][k] = c[0];
                    for (j = 0; j < (16 - k); ++j) {
                        c[j] += at * (c[j + 1] - c[j]);
                    }
                }
                stack[top + 1][16] = c[0];
                from[top] = u0 + (at * du);
                width[top] = du - (at * du);
                from[top + 1] = u0;
                width[top + 1] = at * du;
                top += 2;
                continue;
            } else { /* one root of uncertain place in a narrow interval */
            }
            if (count < IK_TRIG8_ROWS) {
                const ik_6r_real w = 1.0 / (1.0 + (u * u));
                ik_6r_real *const x = root[count];
                int known = 0;
                x[0] = (1.0 - (u * u)) * w;
                x[1] = 2.0 * u * w;
                x[2] = 2.0 * blur * w;
                for (j = arc; j > 0; --j) {
                    const ik_6r_real v = x[0];
                    x[0] = -x[1];
                    x[1] = v;
                }
                for (j = 0; (order == 2) && (j < count); ++j) { /* double roots that touch count once */
                    known |= (int)((mult[j] == 2) && (((root[j][0] * x[0]) + (root[j][1] * x[1])) > (1.0 - (128.0 * IK_TRIG8_EPS))));
                }
                mult[count] = order;
                count += (int)((known == 0));
            }
        }
        for (k = 1; k <= 8; ++k) { /* turn the next arc's centre to zero */
            for (j = k & 3; j > 0; --j) {
                const ik_6r_real v = a[k];
                a[k] = b[k];
                b[k] = -v;
            }
        }
    }
    return count;
}
