/* Inverse kinematics of a general six-joint chain, at most one joint prismatic, after M. Raghavan and B. Roth (1990). Variables
 * are eliminated until a trigonometric polynomial of degree 8 in one angle is left; the solutions that belong to its up to 16
 * roots are refined on the target pose. Needs trig_roots.c and angles.c.
 *
 * Method. The loop of the arm is Z1 E1 Z2 E2 .. Z6 E6 = 1: Zi is the rotation by joint i, the Ei do not depend on the joints.
 * The axis of joint 6 is a line with 15 features, listed above ik_6r_carry. Computed through joints 5, 4, 3 they equal those
 * computed from the other side, through joints 1 and 2. Six linear combinations of these equations do not contain joints 1
 * and 2 (ik_6r_cancel) and are linear in (1, cos, sin) of joints 3, 4 and 5 (ik_6r_pencil). Of these three joints one angle is
 * kept as the unknown. The other two are called shifted and other: they are eliminated through the tangents of their half
 * angles, by a 12 x 12 matrix that is singular at a solution (ik_6r_reduce). Its determinant is the polynomial
 * (ik_6r_scan), and its null vector at a root gives the two eliminated angles (ik_6r_pairs). */
#include "kernel.h"
#define IK_6R_MAX 16
#define IK_6R_WIDE 8 /* most solutions that share a root of the kept angle */
#define IK_6R_STEPS VALUE_6R_STEPS /* most Newton steps for a solution; six times as many in a patient search, which is used near a singular pose */
#define IK_6R_ZONES VALUE_6R_ZONES /* most zones: the whole circle, and arcs of it that are magnified to separate close roots */
#define IK_6R_PATIENCE VALUE_6R_PATIENCE /* most Newton steps of all patient searches of one elimination together */
#define IK_6R_EDGE (-0.3847) /* cosine of the angle x at the edge of what a zone resolves: tan(x/2) = 1.5 */
#define IK_6R_EPS (ik_6r_real)VALUE_6R_EPS
#define IK_6R_TINY (ik_6r_real)VALUE_6R_TINY
#define IK_6R_DONE (ik_6r_real)VALUE_6R_DONE /* error of an entry of the pose below which a solution is not refined further */
#define IK_6R_ACCEPT (ik_6r_real)VALUE_6R_ACCEPT /* error above which a solution is rejected */
#define IK_6R_SAME (ik_6r_real)VALUE_6R_SAME /* solutions nearer than this are the same one: forward kinematics cannot tell them apart */

/* DH table: cos alpha, sin alpha, a, d of each joint, lengths in units of the length that the solver is scaled by. */
static const ik_6r_real ik_6r_dh[6][4] = DH;
#if DH_SLIDES
/* Cosine and sine of the constant angle theta of the prismatic joint. In arrays of joint cosines and sines the prismatic joint
 * has its displacement and 0. */
static const ik_6r_real ik_6r_fixed[2] = DH_TURN;
#else
/* Two points, on axis 1 of the base and on axis 6 of the target, by their coordinates along these axes, and the longest distance
 * between them that the arm can span. */
static const ik_6r_real ik_6r_span[3] = DH_SPAN;
#endif
/* Eliminations to try, best first. The entries are: the joint at which the numbering of the loop begins, and its direction; which
 * of the joints 3, 4, 5 of that numbering (0, 1, 2) are kept, shifted and other; and an index of ik_6r_nudge, the small motion of
 * the target at which the elimination is done, because coinciding roots separate at a pose nearby. */
static const signed char ik_6r_pass[PASSES][6] = PASS;
/* Rounding noise of the polynomial of each elimination, relative to the sum of the magnitudes of its coefficients. */
static const ik_6r_real ik_6r_noise[PASSES] = PASS_NOISE;
/* No motion, a small motion in no special direction, and its inverse. */
static const ik_6r_real ik_6r_nudge[3][12] = {
    {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0},
    {0.9999996152000963, -0.0006401438399640401, -0.0005998462500384375, 0.00063985584003604, 0.99999968000008, -0.00048019187995203, 0.0006001534499616375, 0.00047980788004803, 0.9999997048000738, 0.0006, 0.00064, -0.00048},
    {0.9999996152000963, 0.00063985584003604, 0.0006001534499616375, -0.0006401438399640401, 0.99999968000008, 0.00047980788004803, -0.0005998462500384375, -0.00048019187995203, 0.9999997048000738, -0.0006001212032016992, -0.0006393854011136498, 0.0004806670888572278}
};
/* A rotation about z by an angle that is not a simple fraction of pi; its cosine and sine are entries 0 and 3. */
static const ik_6r_real ik_6r_odd[12] = {0.28, -0.96, 0.0, 0.96, 0.28, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0};
/* Features that a rotation about z does not change, and the x components of the pairs that it rotates. */
static const signed char ik_6r_axial[7] = {3, 4, 7, 10, 11, 14, 0};
static const signed char ik_6r_planar[4] = {1, 5, 8, 12};
/* Bilinear product of the features of two lines that rigid transforms of both preserve (the second line is marked by '):
 * p.p' - (1 (p.p)' + (p.p) 1') / 2 + l.w' + w.l' - 2 m.m' + 2 (p.l) (p.l)'. Each feature is multiplied by the feature dual[i] of
 * the other line and by the factor form[i]. */
static const signed char ik_6r_dual[15] = {4, 1, 2, 3, 0, 12, 13, 14, 8, 9, 10, 11, 5, 6, 7};
static const ik_6r_real ik_6r_form[15] = {-0.5, 1.0, 1.0, 1.0, -0.5, 1.0, 1.0, 1.0, -2.0, -2.0, -2.0, 2.0, 1.0, 1.0, 1.0};
/* cos(2 pi k / 17), sin(2 pi k / 17) */
static const ik_6r_real ik_6r_wave[17][2] = {
    {1.0, 0.0},
    {0.9324722294043558, 0.3612416661871529},
    {0.7390089172206591, 0.6736956436465572},
    {0.44573835577653825, 0.8951632913550623},
    {0.092268359463302, 0.9957341762950345},
    {-0.2736629900720829, 0.961825643172819},
    {-0.6026346363792564, 0.7980172272802395},
    {-0.8502171357296141, 0.5264321628773558},
    {-0.9829730996839018, 0.18374951781657034},
    {-0.9829730996839018, -0.18374951781657034},
    {-0.8502171357296141, -0.5264321628773558},
    {-0.6026346363792564, -0.7980172272802395},
    {-0.2736629900720829, -0.961825643172819},
    {0.092268359463302, -0.9957341762950345},
    {0.44573835577653825, -0.8951632913550623},
    {0.7390089172206591, -0.6736956436465572},
    {0.9324722294043558, -0.3612416661871529}
};

/* Normalizes n pairs to cosine and sine; a pair without a direction becomes the angle zero. */
LOCAL void ik_6r_unit(int n, ik_6r_real cs[][2])
{
    int i;
    for (i = 0; i < n; ++i) {
        ik_6r_real scale;
        cs[i][0] += IK_6R_EPS * IK_6R_EPS;
        scale = 1.0 / sqrt((cs[i][0] * cs[i][0]) + (cs[i][1] * cs[i][1]));
        cs[i][0] *= scale;
        cs[i][1] *= scale;
    }
}

/* Rigid transforms are 12 numbers: the rotation row-major, then the translation. z = x y; z may be x. */
LOCAL void ik_6r_product(const ik_6r_real x[12], const ik_6r_real y[12], ik_6r_real z[12])
{
    int i;
    int j;
    for (i = 0; i < 3; ++i) {
        const ik_6r_real u = x[3 * i];
        const ik_6r_real v = x[(3 * i) + 1];
        const ik_6r_real w = x[(3 * i) + 2];
        for (j = 0; j < 3; ++j) {
            z[(3 * i) + j] = (u * y[j]) + (v * y[3 + j]) + (w * y[6 + j]);
        }
        z[9 + i] = (u * y[9]) + (v * y[10]) + (w * y[11]) + x[9 + i];
    }
}

LOCAL void ik_6r_inverse(const ik_6r_real x[12], ik_6r_real z[12])
{
    int i;
    int j;
    for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j) {
            z[(3 * i) + j] = x[(3 * j) + i];
        }
        z[9 + i] = -((x[i] * x[9]) + (x[3 + i] * x[10]) + (x[6 + i] * x[11]));
    }
}

LOCAL void ik_6r_identity(ik_6r_real x[12])
{
    int i;
    for (i = 0; i < 12; ++i) {
        x[i] = (((i & 3) == 0) && (i < 9)) ? 1.0 : 0.0;
    }
}

/* x Rz with the cosine and sine cs. */
LOCAL void ik_6r_turn(ik_6r_real x[12], const ik_6r_real cs[2])
{
    int i;
    for (i = 0; i < 9; i += 3) {
        const ik_6r_real u = x[i];
        const ik_6r_real v = x[i + 1];
        x[i] = (u * cs[0]) + (v * cs[1]);
        x[i + 1] = (v * cs[0]) - (u * cs[1]);
    }
}

#if DH_SLIDES
/* x Tz: a displacement along z. */
LOCAL void ik_6r_slide(ik_6r_real x[12], ik_6r_real by)
{
    int i;
    for (i = 0; i < 3; ++i) {
        x[9 + i] += by * x[(3 * i) + 2];
    }
}

#endif
#if DH_SLIDES
/* Computes E1 .. E6 of the loop Z1 E1 Z2 E2 .. Z6 E6 = 1, numbered from joint `start` in either direction; one of them contains
 * the target pose. Every angle is counted from a direction that is no simple fraction of pi, so that the tangent of its half is
 * not infinite at round values such as pi. The displacement of the prismatic joint is followed by its constant rotation. */
#else
/* Computes E1 .. E6 of the loop Z1 E1 Z2 E2 .. Z6 E6 = 1, numbered from joint `start` in either direction; one of them contains
 * the target pose. Every angle is counted from a direction that is no simple fraction of pi, so that the tangent of its half is
 * not infinite at round values such as pi. */
#endif
LOCAL void ik_6r_loop(const ik_6r_real pose[12], int start, int direction, ik_6r_real e[6][12])
{
    int k;
    for (k = 0; k < 6; ++k) {
        const int link = (start + 12 + (direction * k) + ((direction - 1) / 2)) % 6;
        const ik_6r_real *const row = ik_6r_dh[link];
        ik_6r_real x[12];
        ik_6r_real y[12];
        ik_6r_identity(x);
        x[4] = row[0];
        x[5] = -row[1];
        x[7] = row[1];
        x[8] = row[0];
        x[9] = row[2];
        x[11] = row[3];
        if (link == 5) {
            ik_6r_inverse(pose, y);
            ik_6r_product(x, y, x);
        }
        if (direction < 0) {
            ik_6r_inverse(x, y);
        }
#if DH_SLIDES
        if (((start + 12 + (direction * k)) % 6) == DH_SLIDE) {
            const ik_6r_real turn[2] = {ik_6r_fixed[0], ik_6r_fixed[1] * (ik_6r_real)direction};
            ik_6r_identity(e[k]);
            ik_6r_turn(e[k], turn);
            ik_6r_product(e[k], (direction < 0) ? y : x, e[k]);
            continue;
        }
#endif
        ik_6r_product(ik_6r_odd, (direction < 0) ? y : x, e[k]);
    }
}

LOCAL void ik_6r_cross(const ik_6r_real a[3], const ik_6r_real b[3], ik_6r_real c[3])
{
    int i;
    for (i = 0; i < 3; ++i) {
        const int y = (i + 1) % 3;
        const int z = (i + 2) % 3;
        c[i] = (a[y] * b[z]) - (a[z] * b[y]);
    }
}

/* Transforms n columns of line features in place by the rigid transform e. The features of the line through the point p with the
 * direction l are 0: 1, 1..3: p, 4: p.p, 5..7: l, 8..10: m = p x l, 11: p.l, 12..14: w = (p.p) l - 2 (p.l) p; a rigid transform
 * acts on them linearly. */
LOCAL void ik_6r_carry(const ik_6r_real e[12], int n, ik_6r_real f[15][18])
{
    const ik_6r_real *const t = e + 9;
    const ik_6r_real tt = (t[0] * t[0]) + (t[1] * t[1]) + (t[2] * t[2]);
    int i;
    int j;
    for (j = 0; j < n; ++j) {
        ik_6r_real v[4][3];
        ik_6r_real tl[3];
        ik_6r_real tm[3];
        ik_6r_real along = 0.0;
        for (i = 0; i < 4; ++i) {
            const int at = ik_6r_planar[i];
            const ik_6r_real a = f[at][j];
            const ik_6r_real b = f[at + 1][j];
            const ik_6r_real c = f[at + 2][j];
            v[i][0] = (e[0] * a) + (e[1] * b) + (e[2] * c);
            v[i][1] = (e[3] * a) + (e[4] * b) + (e[5] * c);
            v[i][2] = (e[6] * a) + (e[7] * b) + (e[8] * c);
        }
        ik_6r_cross(t, v[1], tl);
        ik_6r_cross(t, v[2], tm);
        f[4][j] += tt * f[0][j];
        for (i = 0; i < 3; ++i) {
            along += t[i] * v[1][i];
            f[4][j] += 2.0 * t[i] * v[0][i];
        }
        along += f[11][j];
        for (i = 0; i < 3; ++i) {
            f[1 + i][j] = v[0][i] + (t[i] * f[0][j]);
            f[5 + i][j] = v[1][i];
            f[8 + i][j] = v[2][i] + tl[i];
            f[12 + i][j] = v[3][i] + (tt * v[1][i]) - (2.0 * (tm[i] + (along * t[i])));
        }
        f[11][j] = along;
    }
}

/* Replaces each of n columns of features by three: the coefficients of 1, cos x and sin x of the features rotated by x about z
 * (sense -1: about -z). */
LOCAL void ik_6r_split(int n, ik_6r_real sense, ik_6r_real f[15][18])
{
    int i;
    int j;
    for (j = n - 1; j >= 0; --j) {
        for (i = 0; i < 7; ++i) {
            ik_6r_real *const x = f[ik_6r_axial[i]];
            x[3 * j] = x[j];
            x[(3 * j) + 1] = 0.0;
            x[(3 * j) + 2] = 0.0;
        }
        for (i = 0; i < 4; ++i) {
            ik_6r_real *const x = f[ik_6r_planar[i]];
            ik_6r_real *const y = f[ik_6r_planar[i] + 1];
            const ik_6r_real u = x[j];
            const ik_6r_real v = y[j];
            x[3 * j] = 0.0;
            y[3 * j] = 0.0;
            x[(3 * j) + 1] = u;
            y[(3 * j) + 1] = v;
            x[(3 * j) + 2] = -sense * v;
            y[(3 * j) + 2] = sense * u;
        }
    }
}

#if DH_SLIDES
/* Replaces each of n columns of features by three: the coefficients of 1, x and x^2 of the features displaced by x along z
 * (sense -1: along -z). */
LOCAL void ik_6r_stretch(int n, ik_6r_real sense, ik_6r_real f[15][18])
{
    int i;
    int j;
    for (j = n - 1; j >= 0; --j) {
        ik_6r_real v[15];
        for (i = 0; i < 15; ++i) {
            v[i] = f[i][j];
            f[i][3 * j] = v[i];
            f[i][(3 * j) + 1] = 0.0;
            f[i][(3 * j) + 2] = 0.0;
        }
        f[3][(3 * j) + 1] = sense * v[0];
        f[4][(3 * j) + 1] = 2.0 * sense * v[3];
        f[4][(3 * j) + 2] = v[0];
        f[8][(3 * j) + 1] = -sense * v[6];
        f[9][(3 * j) + 1] = sense * v[5];
        f[11][(3 * j) + 1] = sense * v[7];
        f[12][(3 * j) + 1] = 2.0 * sense * v[9];
        f[13][(3 * j) + 1] = -2.0 * sense * v[8];
        f[14][(3 * j) + 1] = -2.0 * sense * v[11];
        f[12][(3 * j) + 2] = v[5];
        f[13][(3 * j) + 2] = v[6];
        f[14][(3 * j) + 2] = -v[7];
    }
}

/* Replaces each of n columns of features by three coefficients of the motion of joint `place` of the loop, a rotation about z or
 * a displacement along z. */
LOCAL void ik_6r_part(const signed char pass[6], int place, int n, ik_6r_real sense, ik_6r_real f[15][18])
{
    if (place == (2 + pass[4])) {
        ik_6r_stretch(n, sense, f);
    } else {
        ik_6r_split(n, sense, f);
    }
}

#endif
/* Writes to column j the features of the z axis of the frame e, which is the axis of joint 6. */
LOCAL void ik_6r_line(const ik_6r_real e[12], int j, ik_6r_real f[15][18])
{
    const ik_6r_real *const point = e + 9;
    const ik_6r_real axis[3] = {e[2], e[5], e[8]};
    ik_6r_real moment[3];
    ik_6r_real pp = 0.0;
    ik_6r_real pl = 0.0;
    int i;
    for (i = 0; i < 3; ++i) {
        pp += point[i] * point[i];
        pl += point[i] * axis[i];
    }
    ik_6r_cross(point, axis, moment);
    f[0][j] = 1.0;
    f[4][j] = pp;
    f[11][j] = pl;
    for (i = 0; i < 3; ++i) {
        f[1 + i][j] = point[i];
        f[5 + i][j] = axis[i];
        f[8 + i][j] = moment[i];
        f[12 + i][j] = (pp * axis[i]) - (2.0 * pl * point[i]);
    }
}

/* x -= scale (v.x) v on 8 entries */
LOCAL void ik_6r_reflect(const ik_6r_real v[8], ik_6r_real scale, ik_6r_real x[8])
{
    ik_6r_real dot = 0.0;
    int i;
    for (i = 0; i < 8; ++i) {
        dot += v[i] * x[i];
    }
    dot *= scale;
    for (i = 0; i < 8; ++i) {
        x[i] -= dot * v[i];
    }
}

/* Finds m - n orthonormal vectors y that are perpendicular to the n vectors a, all of m entries (filled up with zeros to 8), by
 * Householder reflections. a is overwritten. */
LOCAL void ik_6r_complement(int m, int n, ik_6r_real a[6][8], ik_6r_real y[4][8])
{
    ik_6r_real scale[6];
    int i;
    int j;
    int k;
    for (j = 0; j < (m - n); ++j) {
        for (i = 0; i < 8; ++i) {
            y[j][i] = (i == (n + j)) ? 1.0 : 0.0;
        }
    }
    for (k = 0; k < n; ++k) {
        ik_6r_real norm = 0.0;
        ik_6r_real length;
        for (i = 0; i < 8; ++i) {
            a[k][i] = (i < k) ? 0.0 : a[k][i];
            norm += a[k][i] * a[k][i];
        }
        length = sqrt(norm);
        scale[k] = 1.0 / (norm + (fabs(a[k][k]) * length) + IK_6R_TINY);
        a[k][k] += (a[k][k] < 0.0) ? -length : length;
        for (j = k + 1; j < n; ++j) {
            ik_6r_reflect(a[k], scale[k], a[j]);
        }
    }
    for (k = k - 1; k >= 0; --k) {
        for (j = 0; j < (m - n); ++j) {
            ik_6r_reflect(a[k], scale[k], y[j]);
        }
    }
}

/* Finds six combinations of the line features of joint axis 6 that do not depend on joints 1 and 2, as columns of `row` to be
 * multiplied by the product that rigid transforms preserve. The columns of f are the coefficients of 1, cos and sin of joint 1 in
 * the features of that axis. Four of the combinations are of the axial features, which joint 2 does not change. The other two are
 * the real and the imaginary part of one combination of the planar pairs (x + i y), which joint 2 multiplies by exp(i q2). */
LOCAL void ik_6r_cancel(ik_6r_real f[15][18], ik_6r_real row[15][18])
{
    ik_6r_real a[6][8];
    ik_6r_real y[4][8];
    int i;
    int j;
    int k;
    for (i = 0; i < 15; ++i) {
        for (j = 0; j < 6; ++j) {
            row[i][j] = 0.0;
        }
    }
    for (i = 0; i < 8; ++i) {
        a[0][i] = (i < 6) ? f[ik_6r_axial[i]][1] : 0.0;
        a[1][i] = (i < 6) ? f[ik_6r_axial[i]][2] : 0.0;
    }
    ik_6r_complement(6, 2, a, y);
    for (i = 0; i < 6; ++i) {
        const int at = ik_6r_axial[i];
        for (j = 0; j < 4; ++j) {
            row[ik_6r_dual[at]][j] += y[j][i] / ik_6r_form[at];
            row[4][j] += 2.0 * y[j][i] * f[at][0];
        }
    }
    for (i = 0; i < 8; ++i) {
        const int at = ik_6r_planar[i / 2];
        for (k = 0; k < 3; ++k) {
            a[2 * k][i] = f[at + (i % 2)][k];
            a[(2 * k) + 1][i] = ((i % 2) == 0) ? -f[at + 1][k] : f[at][k];
        }
    }
    ik_6r_complement(8, 6, a, y);
    for (i = 0; i < 8; ++i) {
        const int at = ik_6r_planar[i / 2] + (i % 2);
        for (j = 0; j < 2; ++j) {
            row[ik_6r_dual[at]][4 + j] = y[j][i] / ik_6r_form[at];
        }
    }
}

/* Computes the coefficients h[k][row][3 a + b] of the six equations in joints 3, 4 and 5: k is 0, 1, 2 for the factors 1, cos, sin
 * of the kept angle, a the power of the shifted half angle's tangent, b that of the other one's or of the displacement. They are
 * the combinations of ik_6r_cancel, applied to the features of axis 6 as computed through joints 5, 4 and 3. */
LOCAL void ik_6r_pencil(ik_6r_real e[6][12], const signed char pass[6], ik_6r_real h[3][6][10])
{
    static const signed char stride[3] = {60, 1, 3}; /* distance in g between the coefficients of joint 3, 4 and 5 */
    const int kept = stride[pass[2]];
    const int outer = stride[pass[3]];
    const int inner = stride[pass[4]];
    ik_6r_real f[15][18];
    ik_6r_real row[15][18];
    ik_6r_real g[180];
    ik_6r_real back[12];
    int i;
    int j;
    int k;
    int x;
    ik_6r_inverse(e[5], back);
    ik_6r_line(back, 0, f);
    ik_6r_split(1, -1.0, f);
    ik_6r_inverse(e[0], back);
    ik_6r_carry(back, 3, f);
    ik_6r_cancel(f, row);
    ik_6r_inverse(e[1], back);
    ik_6r_carry(back, 6, row);
#if DH_SLIDES
    ik_6r_part(pass, 2, 6, -1.0, row);
#else
    ik_6r_split(6, -1.0, row);
#endif
    ik_6r_line(e[4], 0, f);
#if DH_SLIDES
    ik_6r_part(pass, 4, 1, 1.0, f);
    ik_6r_carry(e[3], 3, f);
    ik_6r_part(pass, 3, 3, 1.0, f);
#else
    ik_6r_split(1, 1.0, f);
    ik_6r_carry(e[3], 3, f);
    ik_6r_split(3, 1.0, f);
#endif
    ik_6r_carry(e[2], 9, f);
    for (i = 0; i < 15; ++i) {
        f[i][9] = 0.0;
    }
    for (j = 0; j < 18; ++j) {
        ik_6r_real *const sum = g + (60 * (j % 3)) + (10 * (j / 3));
        for (x = 0; x < 10; ++x) {
            sum[x] = 0.0;
        }
        for (i = 0; i < 15; ++i) {
            const ik_6r_real z = ik_6r_form[i] * row[ik_6r_dual[i]][j];
            for (x = 0; x < 10; ++x) {
                sum[x] += z * f[i][x];
            }
        }
    }
    for (x = 0; x < 6; ++x) {
        ik_6r_real norm = IK_6R_TINY;
        for (k = 0; k < 3; ++k) {
            ik_6r_real m[3][3];
            for (i = 0; i < 3; ++i) { /* 1, cos, sin -> powers of tan(x/2) */
                const ik_6r_real *const s = g + (10 * x) + (kept * k) + (outer * i);
#if DH_SLIDES
                m[i][0] = s[0];
                m[i][1] = s[inner];
                m[i][2] = s[2 * inner];
#else
                m[i][0] = s[0] + s[inner];
                m[i][1] = 2.0 * s[2 * inner];
                m[i][2] = s[0] - s[inner];
#endif
            }
            for (j = 0; j < 3; ++j) {
                h[k][x][j] = m[0][j] + m[1][j];
                h[k][x][3 + j] = 2.0 * m[2][j];
                h[k][x][6 + j] = m[0][j] - m[1][j];
            }
            h[k][x][9] = 0.0;
            for (j = 0; j < 9; ++j) {
                const ik_6r_real size = fabs(h[k][x][j]);
                norm = (size > norm) ? size : norm;
            }
        }
        for (k = 0; k < 3; ++k) {
            for (j = 0; j < 10; ++j) {
                h[k][x][j] /= norm;
            }
        }
    }
}

/* Gaussian elimination of the first n columns with partial pivoting. Returns the product of the pivots, with the sign of the row
 * exchanges. */
LOCAL ik_6r_real ik_6r_lu(ik_6r_real a[6][10], int n)
{
    ik_6r_real det = 1.0;
    int i;
    int j;
    int k;
    for (k = 0; k < n; ++k) {
        ik_6r_real best = fabs(a[k][k]);
        ik_6r_real top[10];
        ik_6r_real scale;
        int pivot = k;
        for (i = k + 1; i < 6; ++i) {
            const ik_6r_real size = fabs(a[i][k]);
            pivot = (size > best) ? i : pivot;
            best = (size > best) ? size : best;
        }
        for (j = 0; j < 10; ++j) {
            top[j] = a[pivot][j];
            a[pivot][j] = a[k][j];
        }
        for (j = 0; j < 10; ++j) {
            a[k][j] = top[j];
        }
        det *= (pivot == k) ? top[k] : -top[k];
        scale = 1.0 / ((best > IK_6R_TINY) ? top[k] : IK_6R_TINY);
        for (i = k + 1; i < 6; ++i) {
            const ik_6r_real factor = a[i][k] * scale;
            for (j = 0; j < 10; ++j) {
                a[i][j] -= factor * top[j];
            }
        }
    }
    return det;
}

/* Evaluates the 12 x 12 matrix of the elimination at the kept angle cs and reduces it to 6 x 6. The matrix holds the six equations
 * times 1 and times the tangent t of the shifted half angle, in blocks [M0 M1 M2 0; 0 M0 M1 M2] for the powers t^0 .. t^3. t^0 and
 * t^3 occur in one block row each and are eliminated: work[0] = [M0 | M1 M2], work[1] = [M2 | M0 M1]. work[2] is the 6 x 6 rest for
 * t^1 and t^2. Returns the product of the pivots, which times the determinant of the rest is that of the matrix, up to its sign. */
LOCAL ik_6r_real ik_6r_reduce(ik_6r_real h[3][6][10], const ik_6r_real cs[2], ik_6r_real work[3][6][10])
{
    ik_6r_real det;
    int i;
    int j;
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 10; ++j) {
            work[0][i][j] = h[0][i][j] + (cs[0] * h[1][i][j]) + (cs[1] * h[2][i][j]);
        }
        for (j = 0; j < 6; ++j) {
            work[1][i][3 + j] = work[0][i][j];
        }
        for (j = 0; j < 3; ++j) {
            work[1][i][j] = work[0][i][6 + j];
        }
        work[1][i][9] = 0.0;
    }
    det = ik_6r_lu(work[0], 3) * ik_6r_lu(work[1], 3);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 6; ++j) {
            work[2][i][j] = work[i / 3][3 + (i % 3)][3 + j];
        }
        for (j = 6; j < 10; ++j) {
            work[2][i][j] = 0.0;
        }
    }
    return det;
}

/* Maps an angle y of the magnified circle to the angle x of the true circle, given as cosine and sine cs. A zone is an arc: its
 * centre (cosine zone[0], sine zone[1]) and its scale zone[2], with tan(x/2) = zone[2] tan(y/2) for x counted from the centre.
 * Returns cos(y/2)^2 + zone[2]^2 sin(y/2)^2. */
LOCAL ik_6r_real ik_6r_magnify(const ik_6r_real zone[3], const ik_6r_real y[2], ik_6r_real cs[2])
{
    const ik_6r_real a = 0.5 * (1.0 + y[0]);
    const ik_6r_real b = 0.5 * (1.0 - y[0]) * zone[2] * zone[2];
    const ik_6r_real weight = a + b;
    const ik_6r_real c = (a - b) / weight;
    const ik_6r_real s = zone[2] * y[1] / weight;
    cs[0] = (c * zone[0]) - (s * zone[1]);
    cs[1] = (c * zone[1]) + (s * zone[0]);
    return weight;
}

/* Tangent of half the angle from x to y. */
LOCAL ik_6r_real ik_6r_tangent(const ik_6r_real x[2], const ik_6r_real y[2])
{
    return ((x[0] * y[1]) - (x[1] * y[0])) / (1.0 + (x[0] * y[0]) + (x[1] * y[1]) + (IK_6R_EPS * IK_6R_EPS));
}

/* Finds the roots y of the 12 x 12 determinant on the magnified circle of a zone. The determinant is a trigonometric polynomial of
 * degree 8 in x; times the 8th power of the value that ik_6r_magnify returns it is one of degree 8 in y, p[0] (cosines) and p[1]
 * (sines), which is interpolated from 17 samples. Its noise, *level, is measured: it is the largest of the usual relative noise, of
 * four times the difference between polynomial and determinant at three angles between the samples, and of the rounding errors of
 * the samples, which grow as the smallest pivot shrinks. order: 1 for a simple root, 2 for an unresolved one. */
LOCAL int ik_6r_scan(ik_6r_real h[3][6][10], const ik_6r_real zone[3], ik_6r_real noise, ik_6r_real p[2][9], ik_6r_real *level, ik_6r_real root[24][3], int order[24])
{
    ik_6r_real value[20];
    ik_6r_real size = 0.0;
    ik_6r_real rounding = 0.0;
    int j;
    int k;
    for (j = 0; j < 20; ++j) { /* 17 .. 19: the angles opposite to samples 4, 9 and 15 lie in the middle between two samples */
        ik_6r_real work[3][6][10];
        ik_6r_real cs[2];
        ik_6r_real weight;
        ik_6r_real least = 1.0;
        const ik_6r_real *const wave = ik_6r_wave[(j < 17) ? j : (((11 * j) + 4) % 17)];
        const ik_6r_real y[2] = {(j < 17) ? wave[0] : -wave[0], (j < 17) ? wave[1] : -wave[1]};
        weight = ik_6r_magnify(zone, y, cs);
        weight *= weight;
        weight *= weight;
        value[j] = weight * weight * ik_6r_reduce(h, cs, work);
        value[j] *= ik_6r_lu(work[2], 6);
        for (k = 0; k < 6; ++k) {
            const ik_6r_real inner = fabs(work[2][k][k]);
            const ik_6r_real outer = fabs(work[k / 3][k % 3][k % 3]);
            least = (inner < least) ? inner : least;
            least = (outer < least) ? outer : least;
        }
        rounding += (ik_6r_real)VALUE_6R_ROUNDING * IK_6R_EPS * fabs(value[j]) / (least + IK_6R_TINY);
    }
    for (k = 0; k <= 8; ++k) {
        int at = 0;
        p[0][k] = 0.0;
        p[1][k] = 0.0;
        for (j = 0; j < 17; ++j) {
            p[0][k] += value[j] * ik_6r_wave[at][0];
            p[1][k] += value[j] * ik_6r_wave[at][1];
            at += ((at + k) < 17) ? k : (k - 17);
        }
        p[0][k] *= (2.0 / 17.0);
        p[1][k] *= (2.0 / 17.0);
        size += fabs(p[0][k]) + fabs(p[1][k]);
    }
    p[0][0] *= 0.5;
    *level = size * noise;
    *level = (*level > rounding) ? *level : rounding;
    for (j = 17; j < 20; ++j) {
        const ik_6r_real *const y = ik_6r_wave[((11 * j) + 4) % 17];
        ik_6r_real v[2];
        ik_6r_real off;
        ik_trig8_value(p[0], p[1], -y[1] / (1.0 - y[0]), v);
        off = (ik_6r_real)VALUE_6R_MISMATCH * fabs(v[0] - value[j]);
        *level = (off > *level) ? off : *level;
    }
    return ik_trig_roots_8(p[0], p[1], *level, root, order);
}

/* Inner products of parts of two null vectors. Their entries belong to powers of the two tangents; the low part omits the highest
 * power of one tangent and the high part the lowest one. by = 3 selects the tangent of the shifted angle, 1 that of the other. */
LOCAL void ik_6r_shift(const ik_6r_real u[12], const ik_6r_real v[12], int by, ik_6r_real s[4])
{
    int i;
    for (i = 0; i < 4; ++i) {
        s[i] = 0.0;
    }
    for (i = 0; i < (12 - by); ++i) {
        if ((by == 3) || ((i % 3) < 2)) {
            s[0] += u[i] * v[i];
            s[1] += u[i] * v[i + by];
            s[2] += u[i + by] * v[i];
            s[3] += u[i + by] * v[i + by];
        }
    }
}

/* Computes the shifted and the other angle from a null vector whose entries are the products of (1, x, x^2, x^3) and (1, y, y^2),
 * with x and y the tangents of the half angles. Returns how far the vector is from that form: 0 for an exact one. */
LOCAL ik_6r_real ik_6r_factor(const ik_6r_real w[12], ik_6r_real angle[2][2])
{
    ik_6r_real far = 0.0;
    int k;
    for (k = 0; k < 2; ++k) { /* low and high part are the cosine and sine of the half angle times the same vector */
        ik_6r_real s[4];
        ik_6r_real sum;
        ik_6r_real off;
        ik_6r_shift(w, w, 3 - (2 * k), s);
        sum = 1.0 / (s[0] + s[3] + IK_6R_TINY);
        angle[k][0] = (s[0] - s[3]) * sum;
        angle[k][1] = 2.0 * s[1] * sum;
        off = 1.0 - (angle[k][0] * angle[k][0]) - (angle[k][1] * angle[k][1]);
        far = (off > far) ? off : far;
    }
    return far;
}

/* Computes the null vector v of the 12 x 12 matrix at a kept angle if its null space has dimension one. */
LOCAL void ik_6r_null(ik_6r_real h[3][6][10], const ik_6r_real cs[2], ik_6r_real v[12])
{
    ik_6r_real work[3][6][10];
    ik_6r_real (*const low)[10] = work[0];
    ik_6r_real (*const high)[10] = work[1];
    ik_6r_real (*const s)[10] = work[2];
    int i;
    int j;
    (void)ik_6r_reduce(h, cs, work);
    (void)ik_6r_lu(s, 5);
    v[8] = s[4][4];
    v[7] = -s[4][5];
    for (i = 3; i >= 0; --i) {
        v[3 + i] = 0.0;
        for (j = i + 1; j < 6; ++j) {
            v[3 + i] -= s[i][j] * v[3 + j];
        }
        v[3 + i] /= s[i][i] + IK_6R_TINY;
    }
    for (i = 2; i >= 0; --i) {
        v[i] = 0.0;
        v[9 + i] = 0.0;
        for (j = i + 1; j < 9; ++j) {
            v[i] -= low[i][j] * v[j];
            v[9 + i] -= high[i][j] * v[j + ((j < 3) ? 9 : 0)];
        }
        v[i] /= low[i][i] + IK_6R_TINY;
        v[9 + i] /= high[i][i] + IK_6R_TINY;
    }
}

/* Computes a basis of the null space of the n x n matrix a by Gaussian elimination with complete pivoting: pivots below the first
 * one times VALUE_6R_RANK count as zero, and so do the last `least` ones. Returns the dimension, or 0 if it exceeds IK_6R_WIDE. */
LOCAL int ik_6r_kernel(ik_6r_real a[12][12], int n, int least, ik_6r_real basis[IK_6R_WIDE][12])
{
    int column[12];
    int i;
    int j;
    int k;
    int m;
    ik_6r_real first = 0.0;
    for (j = 0; j < n; ++j) {
        column[j] = j;
    }
    for (k = 0; k < (n - least); ++k) {
        ik_6r_real best = -1.0;
        int row = k;
        int at = k;
        for (i = k; i < n; ++i) {
            for (j = k; j < n; ++j) {
                if (fabs(a[i][j]) > best) {
                    best = fabs(a[i][j]);
                    row = i;
                    at = j;
                }
            }
        }
        first = (k == 0) ? best : first;
        if (!(best > ((ik_6r_real)VALUE_6R_RANK * first))) {
            break;
        }
        for (i = 0; i < n; ++i) {
            const ik_6r_real x = a[i][at];
            a[i][at] = a[i][k];
            a[i][k] = x;
        }
        j = column[at];
        column[at] = column[k];
        column[k] = j;
        for (j = 0; j < n; ++j) {
            const ik_6r_real x = a[row][j];
            a[row][j] = a[k][j];
            a[k][j] = x;
        }
        for (i = k + 1; i < n; ++i) {
            const ik_6r_real factor = a[i][k] / a[k][k];
            for (j = k; j < n; ++j) {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    if ((n - k) > IK_6R_WIDE) {
        return 0;
    }
    for (m = 0; m < (n - k); ++m) {
        ik_6r_real x[12];
        for (i = n - 1; i >= 0; --i) {
            x[i] = (i == (k + m)) ? 1.0 : 0.0;
            for (j = i + 1; (i < k) && (j < n); ++j) {
                x[i] -= a[i][j] / a[i][i] * x[j];
            }
            basis[m][column[i]] = x[i];
        }
    }
    return m;
}

/* Makes m vectors orthonormal. */
LOCAL void ik_6r_orthonormalize(int m, ik_6r_real v[IK_6R_WIDE][12])
{
    int pass;
    int i;
    int j;
    int k;
    for (k = 0; k < m; ++k) {
        for (pass = 0; pass < 2; ++pass) { /* the second time against rounding errors of the first */
            ik_6r_real norm = IK_6R_TINY;
            for (j = 0; j < k; ++j) {
                ik_6r_real dot = 0.0;
                for (i = 0; i < 12; ++i) {
                    dot += v[j][i] * v[k][i];
                }
                for (i = 0; i < 12; ++i) {
                    v[k][i] -= dot * v[j][i];
                }
            }
            for (i = 0; i < 12; ++i) {
                norm += v[k][i] * v[k][i];
            }
            norm = 1.0 / sqrt(norm);
            for (i = 0; i < 12; ++i) {
                v[k][i] *= norm;
            }
        }
    }
}

/* Adds `weight` times the matrix by which, in the span of m null vectors, the tangent of an eliminated half angle (by = 3: of the
 * shifted angle, 1: of the other one) multiplies them: the least-squares solution of L X = H, where L and H are the parts of the
 * vectors without the highest and without the lowest power of the tangent. The half angle is turned first, by an
 * angle with the cosine 5/13: L is singular where a turned angle is pi, which must not be a round value of the joint. Returns the squared error:
 * the span is not mapped into itself where the solutions that share the root are a continuum. */
LOCAL ik_6r_real ik_6r_multiply(int m, ik_6r_real v[IK_6R_WIDE][12], int by, ik_6r_real weight, ik_6r_real sum[12][12])
{
    ik_6r_real g[IK_6R_WIDE][16];
    ik_6r_real part[IK_6R_WIDE][IK_6R_WIDE];
    ik_6r_real error = 0.0; /* g: 2 IK_6R_WIDE */
    int i;
    int j;
    int k;
    for (i = 0; i < m; ++i) {
        for (j = 0; j < m; ++j) {
            ik_6r_real s[4];
            ik_6r_shift(v[i], v[j], by, s);
            g[i][j] = ((25.0 / 169.0) * s[0]) + ((60.0 / 169.0) * (s[1] + s[2])) + ((144.0 / 169.0) * s[3]);
            g[i][m + j] = ((60.0 / 169.0) * (s[3] - s[0])) + ((25.0 / 169.0) * s[1]) - ((144.0 / 169.0) * s[2]);
            part[i][j] = g[i][m + j];
            error += (i == j) ? (((144.0 / 169.0) * s[0]) - ((120.0 / 169.0) * s[1]) + ((25.0 / 169.0) * s[3])) : 0.0;
        }
    }
    for (k = 0; k < m; ++k) { /* L'L is positive definite: no pivoting */
        const ik_6r_real pivot = 1.0 / (g[k][k] + IK_6R_TINY);
        for (j = k; j < (2 * m); ++j) {
            g[k][j] *= pivot;
        }
        for (i = 0; i < m; ++i) {
            const ik_6r_real factor = g[i][k];
            for (j = k; (j < (2 * m)) && (i != k); ++j) {
                g[i][j] -= factor * g[k][j];
            }
        }
    }
    for (i = 0; i < m; ++i) {
        for (j = 0; j < m; ++j) {
            sum[i][j] += weight * g[i][m + j];
            error -= part[i][j] * g[i][m + j];
        }
    }
    return error;
}

/* Computes the m eigenvalues (real and imaginary part) of a matrix: the roots, by Aberth's iteration, of its characteristic
 * polynomial, by the recursion of Faddeev and LeVerrier. */
LOCAL void ik_6r_eigenvalues(int m, ik_6r_real a[12][12], ik_6r_real z[IK_6R_WIDE][2])
{
    ik_6r_real c[IK_6R_WIDE + 1];
    ik_6r_real b[IK_6R_WIDE][IK_6R_WIDE];
    ik_6r_real size = 0.0;
    int i;
    int j;
    int k;
    int it;
    for (i = 0; i < m; ++i) {
        for (j = 0; j < m; ++j) {
            b[i][j] = (ik_6r_real)(i == j);
        }
    }
    c[0] = 1.0;
    for (k = 1; k <= m; ++k) {
        ik_6r_real ab[IK_6R_WIDE][IK_6R_WIDE];
        ik_6r_real trace = 0.0;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                ik_6r_real sum = 0.0;
                for (it = 0; it < m; ++it) {
                    sum += a[i][it] * b[it][j];
                }
                ab[i][j] = sum;
                size += (k == 1) ? fabs(sum) : 0.0;
            }
            trace += ab[i][i];
        }
        c[k] = -trace / (ik_6r_real)k;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                b[i][j] = ab[i][j] + ((i == j) ? c[k] : 0.0);
            }
        }
    }
    for (i = 0; i < m; ++i) {
        const ik_6r_real *const start = ik_6r_wave[(1 + (17 * i / m)) % 17];
        z[i][0] = 0.5 * size * start[0];
        z[i][1] = 0.5 * size * start[1];
    }
    for (it = 0; it < VALUE_6R_ABERTH; ++it) {
        for (i = 0; i < m; ++i) {
            const ik_6r_real x = z[i][0];
            const ik_6r_real y = z[i][1];
            ik_6r_real p = 1.0;
            ik_6r_real q = 0.0;
            ik_6r_real dp = 0.0;
            ik_6r_real dq = 0.0;
            ik_6r_real u;
            ik_6r_real v;
            ik_6r_real w;
            for (k = 1; k <= m; ++k) { /* Horner: p + i q, and its derivative */
                w = (dp * x) - (dq * y) + p;
                dq = (dp * y) + (dq * x) + q;
                dp = w;
                w = (p * x) - (q * y) + c[k];
                q = (p * y) + (q * x);
                p = w;
            }
            u = dp; /* p' / p - sum 1 / (z - z_j), times p */
            v = dq;
            for (j = 0; j < m; ++j) {
                const ik_6r_real dx = x - z[j][0];
                const ik_6r_real dy = y - z[j][1];
                const ik_6r_real d = 1.0 / ((dx * dx) + (dy * dy) + IK_6R_TINY);
                if (j != i) {
                    u -= ((p * dx) + (q * dy)) * d;
                    v -= ((q * dx) - (p * dy)) * d;
                }
            }
            w = 1.0 / ((u * u) + (v * v) + IK_6R_TINY);
            z[i][0] -= ((p * u) + (q * v)) * w;
            z[i][1] -= ((q * u) - (p * v)) * w;
        }
    }
}

/* Computes the pairs (shifted, other) of eliminated angles of all solutions that share an unresolved root: in the null space they are
 * the vectors that both tangents multiply by a number, the eigenvectors of a weighted sum of the two multiplications. Returns their
 * number; *unreal counts the solutions with complex angles, as far as two different weights agree on them. */
LOCAL int ik_6r_shared(ik_6r_real h[3][6][10], const ik_6r_real cs[2], ik_6r_real pair[IK_6R_WIDE + 1][2][2], int *unreal)
{
    static const ik_6r_real weight[2][2] = {{0.8, -0.6}, {0.47, 0.88}};
    ik_6r_real a[12][12];
    ik_6r_real v[IK_6R_WIDE][12];
    ik_6r_real z[IK_6R_WIDE][2];
    ik_6r_real error = 0.0;
    int i;
    int j;
    int k;
    int m;
    int way;
    int count = 0;
    for (i = 0; i < 12; ++i) {
        for (j = 0; j < 12; ++j) {
            const int row = i % 6;
            const int at = (i < 6) ? j : (j - 3);
            a[i][j] = ((at < 0) || (at > 8)) ? 0.0 : (h[0][row][at] + (cs[0] * h[1][row][at]) + (cs[1] * h[2][row][at]));
        }
    }
    m = ik_6r_kernel(a, 12, 2, v);
    ik_6r_orthonormalize(m, v);
    *unreal = m;
    for (way = 1; way >= 0; --way) {
        int unlike = 0;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                a[i][j] = 0.0;
            }
        }
        error += ik_6r_multiply(m, v, 3, weight[way][0], a);
        error += ik_6r_multiply(m, v, 1, weight[way][1], a);
        ik_6r_eigenvalues(m, a, z);
        for (k = 0; k < m; ++k) {
            unlike += (int)(fabs(z[k][1]) > ((ik_6r_real)VALUE_6R_UNREAL * (1.0 + fabs(z[k][0]))));
        }
        *unreal = (unlike < *unreal) ? unlike : *unreal;
        *unreal = (error < (ik_6r_real)VALUE_6R_MAPPED) ? *unreal : 0;
    }
    for (k = 0; k < m; ++k) {
        ik_6r_real less[12][12];
        ik_6r_real mix[IK_6R_WIDE][12];
        ik_6r_real w[12];
        if (fabs(z[k][1]) > ((ik_6r_real)VALUE_6R_UNREAL * (1.0 + fabs(z[k][0])))) {
            continue;
        }
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                less[i][j] = a[i][j] - ((i == j) ? z[k][0] : 0.0);
            }
        }
        if (ik_6r_kernel(less, m, 1, mix) == 0) {
            continue;
        }
        for (i = 0; i < 12; ++i) {
            w[i] = 0.0;
            for (j = 0; j < m; ++j) {
                w[i] += mix[0][j] * v[j][i];
            }
        }
        (void)ik_6r_factor(w, pair[count]);
        ++count;
    }
    return count;
}

/* Computes joints 1, 2 and 6 of the loop from joints 3, 4 and 5 (t: cosines and sines): joint 2 by least squares over the
 * features that joint 1 does not change, joint 1 from those that it rotates, joint 6 from the remaining rotation. */
#if DH_SLIDES
LOCAL void ik_6r_complete(ik_6r_real e[6][12], int slide, ik_6r_real t[6][2])
#else
LOCAL void ik_6r_complete(ik_6r_real e[6][12], ik_6r_real t[6][2])
#endif
{
    ik_6r_real x[12];
    ik_6r_real y[12];
    ik_6r_real goal[12];
    ik_6r_real f[15][18];
    ik_6r_real aa = 0.0;
    ik_6r_real ab = 0.0;
    ik_6r_real bb = 0.0;
    ik_6r_real ar = 0.0;
    ik_6r_real br = 0.0;
    int i;
    ik_6r_identity(x);
    ik_6r_identity(y);
    t[1][0] = 1.0;
    t[0][0] = t[0][1] = t[1][1] = t[5][0] = t[5][1] = 0.0;
    ik_6r_inverse(e[5], goal);
    for (i = 1; i < 5; ++i) {
#if DH_SLIDES
        if (i == slide) {
            ik_6r_slide(y, t[i][0]);
        } else {
            ik_6r_turn(y, t[i]);
        }
#else
        ik_6r_turn(y, t[i]);
#endif
        ik_6r_product(y, e[i], y);
    }
    ik_6r_line(y, 0, f);
    ik_6r_split(1, 1.0, f);
    ik_6r_carry(e[0], 3, f);
    ik_6r_line(goal, 3, f);
    for (i = 0; i < 6; ++i) {
        const ik_6r_real *const v = f[ik_6r_axial[i]];
        aa += v[1] * v[1];
        ab += v[1] * v[2];
        bb += v[2] * v[2];
        ar += v[1] * (v[3] - v[0]);
        br += v[2] * (v[3] - v[0]);
    }
    t[1][0] = (bb * ar) - (ab * br);
    t[1][1] = (aa * br) - (ab * ar);
    ik_6r_unit(1, t + 1);
    for (i = 0; i < 4; ++i) {
        const ik_6r_real *const v = f[ik_6r_planar[i]];
        const ik_6r_real *const w = f[ik_6r_planar[i] + 1];
        const ik_6r_real vx = v[0] + (v[1] * t[1][0]) + (v[2] * t[1][1]);
        const ik_6r_real vy = w[0] + (w[1] * t[1][0]) + (w[2] * t[1][1]);
        t[0][0] += (vx * v[3]) + (vy * w[3]);
        t[0][1] += (vx * w[3]) - (vy * v[3]);
    }
    ik_6r_unit(1, t);
    ik_6r_turn(x, t[0]);
    ik_6r_product(x, e[0], x);
    ik_6r_turn(x, t[1]);
    ik_6r_product(x, y, x);
    for (i = 0; i < 9; i += 3) {
        t[5][0] += (x[i] * goal[i]) + (x[i + 1] * goal[i + 1]);
        t[5][1] += (x[i + 1] * goal[i]) - (x[i] * goal[i + 1]);
    }
}

/* Computes the pose error r (linear, then angular) from the forward kinematics to the target pose, and the Jacobian; jac[k] is the
 * column of joint k. cs holds the cosine and sine of each joint, or a displacement and 0. Returns the largest difference between an
 * entry of the pose and of the forward kinematics. */
LOCAL ik_6r_real ik_6r_residual(const ik_6r_real pose[12], ik_6r_real cs[6][2], ik_6r_real r[6], ik_6r_real jac[6][6])
{
    ik_6r_real x[12];
    ik_6r_real err = 0.0;
    int i;
    int k;
    ik_6r_identity(x);
    for (k = 0; k < 6; ++k) {
        const ik_6r_real *const row = ik_6r_dh[k];
        for (i = 0; i < 3; ++i) {
            jac[k][i] = x[9 + i];
            jac[k][3 + i] = x[(3 * i) + 2];
        }
#if DH_SLIDES
        if (k == DH_SLIDE) {
            ik_6r_slide(x, cs[k][0]);
            ik_6r_turn(x, ik_6r_fixed);
        } else {
            ik_6r_turn(x, cs[k]);
        }
#else
        ik_6r_turn(x, cs[k]);
#endif
        for (i = 0; i < 3; ++i) {
            const ik_6r_real v = x[(3 * i) + 1];
            const ik_6r_real w = x[(3 * i) + 2];
            x[9 + i] += (row[3] * w) + (row[2] * x[3 * i]);
            x[(3 * i) + 1] = (row[0] * v) + (row[1] * w);
            x[(3 * i) + 2] = (row[0] * w) - (row[1] * v);
        }
    }
    for (i = 0; i < 12; ++i) {
        const ik_6r_real off = fabs(pose[i] - x[i]);
        err = ((off > err) || !(off >= 0.0)) ? off : err;
    }
    for (k = 0; k < 6; ++k) {
        ik_6r_real arm[3];
        for (i = 0; i < 3; ++i) {
            arm[i] = x[9 + i] - jac[k][i];
        }
        ik_6r_cross(jac[k] + 3, arm, jac[k]);
    }
#if DH_SLIDES
    for (i = 0; i < 3; ++i) {
        jac[DH_SLIDE][i] = jac[DH_SLIDE][3 + i];
        jac[DH_SLIDE][3 + i] = 0.0;
    }
#endif
    for (i = 0; i < 3; ++i) {
        const int y = (i < 2) ? ((3 * i) + 3) : 0;
        const int z = (i > 0) ? ((3 * i) - 3) : 6;
        r[i] = pose[9 + i] - x[9 + i];
        r[3 + i] = 0.0;
        for (k = 0; k < 3; ++k) {
            r[3 + i] += 0.5 * ((x[y + k] * pose[z + k]) - (x[z + k] * pose[y + k]));
        }
    }
    return err;
}

/* (J'J + damping) step = J' r by the LDL' decomposition. Returns the smallest pivot: the square of the smallest singular value of J, or
 * more. */
LOCAL ik_6r_real ik_6r_step(ik_6r_real jac[6][6], const ik_6r_real r[6], ik_6r_real damping, ik_6r_real step[6])
{
    ik_6r_real l[6][6];
    ik_6r_real d[6];
    ik_6r_real least = 1.0;
    int i;
    int j;
    int k;
    for (i = 0; i < 6; ++i) {
        ik_6r_real pivot = damping + (IK_6R_EPS * IK_6R_EPS);
        step[i] = 0.0;
        for (k = 0; k < 6; ++k) {
            step[i] += jac[i][k] * r[k];
            pivot += jac[i][k] * jac[i][k];
        }
        for (j = 0; j < i; ++j) {
            ik_6r_real v = 0.0;
            for (k = 0; k < 6; ++k) {
                v += jac[i][k] * jac[j][k];
            }
            for (k = 0; k < j; ++k) {
                v -= l[i][k] * l[j][k] * d[k];
            }
            l[i][j] = v / d[j];
            pivot -= l[i][j] * v;
            step[i] -= l[i][j] * step[j];
        }
        d[i] = (pivot > (IK_6R_EPS * IK_6R_EPS)) ? pivot : (IK_6R_EPS * IK_6R_EPS);
        least = (d[i] < least) ? d[i] : least;
    }
    for (i = 5; i >= 0; --i) {
        step[i] /= d[i];
        for (k = i + 1; k < 6; ++k) {
            step[i] -= l[k][i] * step[k];
        }
    }
    return least;
}

/* Moves the joints by a step, scaled down where a joint would move by more than half. Angles turn by 2 atan(step / 2), which is the step
 * up to third order and needs no sine and cosine. */
LOCAL void ik_6r_move(ik_6r_real cs[6][2], const ik_6r_real step[6])
{
    ik_6r_real largest = 1.0;
    int i;
    for (i = 0; i < 6; ++i) {
        largest = ((2.0 * fabs(step[i])) > largest) ? (2.0 * fabs(step[i])) : largest;
    }
    for (i = 0; i < 6; ++i) {
        const ik_6r_real t = 0.5 * step[i] / largest;
        const ik_6r_real c = cs[i][0];
        const ik_6r_real s = cs[i][1];
        const ik_6r_real w = 1.0 / (1.0 + (t * t));
        cs[i][0] = ((c * (1.0 - (t * t))) - (2.0 * s * t)) * w;
        cs[i][1] = ((s * (1.0 - (t * t))) + (2.0 * c * t)) * w;
#if DH_SLIDES
        if (i == DH_SLIDE) {
            cs[i][0] = c + (step[i] / largest);
            cs[i][1] = 0.0;
        }
#endif
    }
}

/* Refines a trial solution on the pose by Newton steps damped by the squared residual; the result is cs. A patient search, near
 * a singular pose, takes up to *left more steps; where it stalls it restarts at a distance of the square root of the error from
 * the best solution so far, which is the order of the distance to the solution where the Jacobian is singular. *firm is lowered to the
 * smallest pivot of the last step, or of one that is not needed. Returns 0 if the pose is not met, 1 if it is met far from the start, 2 if it is met close to the
 * start. */
LOCAL int ik_6r_polish(const ik_6r_real pose[12], int patient, int *left, ik_6r_real *firm, ik_6r_real trial[6][2], ik_6r_real cs[6][2])
{
    ik_6r_real best = 10.0;
    ik_6r_real pivot = 0.0;
    ik_6r_real begin = 0.0;
    ik_6r_real before = 10.0;
    int it;
    int i;
    for (it = 0; (it <= IK_6R_STEPS) || ((patient != 0) && (*left > 0) && (it <= (6 * IK_6R_STEPS))); ++it) {
        ik_6r_real r[6];
        ik_6r_real jac[6][6];
        ik_6r_real step[6];
        ik_6r_real damping = 0.0;
        ik_6r_real (*from)[2] = trial;
        const ik_6r_real err = ik_6r_residual(pose, trial, r, jac);
        const bool better = err < best;
        const bool stalled = !((patient != 0) ? (fabs(err - before) > (0.01 * err)) : (err < (0.5 * before)));
        *left -= patient;
        begin = (it == 0) ? err : begin;
        if (better) {
            best = err;
            for (i = 0; i < 6; ++i) {
                cs[i][0] = trial[i][0];
                cs[i][1] = trial[i][1];
            }
        }
        if ((best < IK_6R_DONE) || ((it >= 3) && (best > (ik_6r_real)VALUE_6R_HOPELESS)) || ((best < IK_6R_ACCEPT) && !(err < (0.5 * before))) || !((patient != 0) || better)) {
            pivot = (it == 0) ? ik_6r_step(jac, r, 0.0, step) : pivot;
            break;
        }
        before = err;
        for (i = 0; i < 6; ++i) {
            damping += r[i] * r[i];
        }
        pivot = ik_6r_step(jac, r, damping, step);
        if (stalled && (patient != 0)) {
            const ik_6r_real kick = 2.0 * sqrt(best);
            from = cs;
            for (i = 0; i < 6; ++i) {
                step[i] = kick * ik_6r_wave[((5 * i) + (3 * it)) % 17][0];
            }
            before = 10.0;
        }
        for (i = 0; i < 6; ++i) {
            trial[i][0] = from[i][0];
            trial[i][1] = from[i][1];
        }
        ik_6r_move(trial, step);
    }
    *firm = ((best < IK_6R_ACCEPT) && (pivot < *firm)) ? pivot : *firm;
    return (best < IK_6R_ACCEPT) ? (1 + (int)(begin < (ik_6r_real)VALUE_6R_CLOSE)) : 0;
}

/* Sum of the differences of the cosines and sines (or displacements) of two solutions. */
LOCAL ik_6r_real ik_6r_apart(ik_6r_real a[6][2], ik_6r_real b[6][2])
{
    ik_6r_real apart = 0.0;
    int i;
    for (i = 0; i < 12; ++i) {
        apart += fabs(a[i / 2][i % 2] - b[i / 2][i % 2]);
    }
    return apart;
}

/* Index of the earlier solution that equals solution number count; count itself if it is new. */
LOCAL int ik_6r_place(ik_6r_real rows[IK_6R_MAX + 1][6][2], int count)
{
    int k;
    for (k = 0; (k < count) && (ik_6r_apart(rows[k], rows[count]) >= IK_6R_SAME); ++k) {
    }
    return k;
}

/* Adds the solutions of one root of the kept angle. A simple root has one of its own: where its null vector leads to none, or to one
 * that is among `taken` (bits) by other roots, the solutions that share it are sought as for an unresolved root. Returns the number
 * of complex solutions at the root. */
LOCAL int ik_6r_rows(const ik_6r_real pose[12], const signed char pass[6], ik_6r_real e[6][12], ik_6r_real h[3][6][10],
    const ik_6r_real root[2], int order, int *left, ik_6r_real *firm, unsigned *taken, ik_6r_real rows[IK_6R_MAX + 1][6][2], int *count)
{
    int unreal = 0;
    int attempt;
    int met = 0;
    for (attempt = order; (attempt <= 2) && (met == 0) && (*left > 0); ++attempt) {
        ik_6r_real pair[IK_6R_WIDE + 1][2][2];
        ik_6r_real w[12];
        int i;
        int j;
        int pairs = 0;
        ik_6r_null(h, root, w);
        pairs = (int)(ik_6r_factor(w, pair[0]) < (ik_6r_real)VALUE_6R_SHAPE);
        if (attempt == 2) {
            pairs += ik_6r_shared(h, root, pair + pairs, &unreal);
        }
        for (j = 0; (j < pairs) && (*count < IK_6R_MAX); ++j) {
            ik_6r_real t[6][2];
            ik_6r_real cs[6][2];
            int near;
            int joint;
            for (i = 0; i < 2; ++i) {
                t[2 + pass[2]][i] = root[i];
                t[2 + pass[3]][i] = pair[j][0][i];
                t[2 + pass[4]][i] = pair[j][1][i];
            }
#if DH_SLIDES
            t[2 + pass[4]][0] = pair[j][1][1] / (1.0 + pair[j][1][0] + IK_6R_EPS);
            t[2 + pass[4]][1] = 0.0;
#endif
#if DH_SLIDES
            ik_6r_complete(e, 2 + pass[4], t);
#else
            ik_6r_complete(e, t);
#endif
            joint = pass[0];
            for (i = 0; i < 6; ++i) {
                ik_6r_real *const to = cs[joint];
                joint += pass[1];
                joint += (joint < 0) ? 6 : (joint > 5) ? -6 : 0;
                to[0] = (ik_6r_odd[0] * t[i][0]) - (ik_6r_odd[3] * t[i][1]);
                to[1] = ((ik_6r_odd[0] * t[i][1]) + (ik_6r_odd[3] * t[i][0])) * (ik_6r_real)pass[1];
            }
            ik_6r_unit(6, cs);
#if DH_SLIDES
            cs[DH_SLIDE][0] = t[2 + pass[4]][0] * (ik_6r_real)pass[1];
            cs[DH_SLIDE][1] = 0.0;
#endif
            near = ik_6r_polish(pose, (pass[5] != 0) || (attempt == 2), left, firm, cs, rows[*count]);
            if (near > 0) {
                const int place = ik_6r_place(rows, *count);
                met |= (int)((order == 1) && ((near + (int)(pass[5] != 0)) >= 2) && (((*taken >> (unsigned)place) & 1u) == 0u));
                *taken |= (order == 1) ? (1u << (unsigned)place) : 0u;
                *count += (int)(place == *count);
            }
        }
    }
    return unreal;
}

/* Defines a zone (an arc to be magnified) around n unresolved roots of the zone `outer`. Returns 1, or 0 if it would not be much
 * narrower than `outer`. */
LOCAL int ik_6r_zone(const ik_6r_real outer[3], ik_6r_real root[24][3], int n, ik_6r_real zone[3])
{
    int i;
    (void)ik_6r_magnify(outer, root[n / 2], zone);
    zone[2] = 0.0;
    for (i = 0; i < n; ++i) { /* both ends of the interval in which each root lies, widened by 0.02 rad */
        ik_6r_real turn = root[i][2] + (ik_6r_real)VALUE_6R_WIDER;
        int k;
        for (k = 0; k < 2; ++k) {
            const ik_6r_real end[2] = {root[i][0] - (turn * root[i][1]), root[i][1] + (turn * root[i][0])};
            ik_6r_real cs[2];
            ik_6r_real reach;
            (void)ik_6r_magnify(outer, end, cs);
            reach = fabs(ik_6r_tangent(zone, cs));
            zone[2] = (reach > zone[2]) ? reach : zone[2];
            turn = -turn;
        }
    }
    return (int)(zone[2] < ((ik_6r_real)VALUE_6R_NARROWER * outer[2]));
}

/* Counts the roots of a polynomial (see ik_6r_scan) in a circle of the complex plane around the point z = exp(i y) of the unit circle,
 * by the integral of its logarithmic derivative. The radius is doubled until the polynomial exceeds its noise on all of the circle.
 * Returns -1 if it does not. Of the roots inside, middle is the mean: it is accurate even where noise scatters a multiple root. */
LOCAL int ik_6r_wind(ik_6r_real p[2][9], ik_6r_real noise, const ik_6r_real at[2], ik_6r_real *radius, ik_6r_real middle[2])
{
    for (; *radius < (ik_6r_real)VALUE_6R_WIDEST; *radius *= 2.0) {
        ik_6r_real c = 1.0;
        ik_6r_real s = 0.0;
        ik_6r_real turns[2] = {0.0, 0.0};
        ik_6r_real first[2] = {0.0, 0.0};
        int clear = 1;
        int count;
        int i;
        int k;
        for (i = 0; (i < 48) && (clear != 0); ++i) {
            const ik_6r_real dx = *radius * c;
            const ik_6r_real dy = *radius * s;
            const ik_6r_real x = at[0] + dx;
            const ik_6r_real y = at[1] + dy;
            const ik_6r_real next = c;
            ik_6r_real re = p[0][8];
            ik_6r_real im = -p[1][8];
            ik_6r_real dr = 0.0;
            ik_6r_real di = 0.0;
            ik_6r_real size = (x * x) + (y * y);
            ik_6r_real u;
            ik_6r_real v;
            ik_6r_real least = 2.0 * (ik_6r_real)VALUE_6R_CLEAR * noise;
            for (k = 7; k >= -8; --k) { /* f = 2 z^8 p and its derivative by Horner's rule */
                u = (dr * x) - (di * y) + re;
                di = (dr * y) + (di * x) + im;
                dr = u;
                u = (re * x) - (im * y) + (((k == 0) ? 2.0 : 1.0) * p[0][(k < 0) ? -k : k]);
                im = (re * y) + (im * x) + ((k < 0) ? p[1][-k] : 0.0) - ((k > 0) ? p[1][k] : 0.0);
                re = u;
            }
            size *= size;
            size *= size;
            const ik_6r_real larger = (size > 1.0) ? size : 1.0;
            least *= larger * larger;
            size = (re * re) + (im * im);
            clear = (int)(size > (least * least));
            size = (1.0 / 48.0) / (size + IK_6R_TINY);
            u = ((dr * re) + (di * im)) * size; /* f' / f */
            v = ((di * re) - (dr * im)) * size;
            re = (u * dx) - (v * dy); /* times z - at, which is dz / (i dy) */
            im = (u * dy) + (v * dx);
            turns[0] += re;
            turns[1] += im;
            first[0] += (re * dx) - (im * dy);
            first[1] += (re * dy) + (im * dx);
            c = (0.9914448613738104 * c) - (0.13052619222005157 * s);
            s = (0.9914448613738104 * s) + (0.13052619222005157 * next);
        }
        count = (int)(turns[0] + 0.5);
        if ((clear != 0) && ((fabs(turns[0] - (ik_6r_real)count) + fabs(turns[1])) < (ik_6r_real)VALUE_6R_WHOLE)) {
            const ik_6r_real share = 1.0 / (ik_6r_real)((count > 0) ? count : 1);
            ik_6r_real scale;
            middle[0] = at[0] + (first[0] * share);
            middle[1] = at[1] + (first[1] * share);
            scale = 1.0 / sqrt((middle[0] * middle[0]) + (middle[1] * middle[1]));
            middle[0] *= scale;
            middle[1] *= scale;
            return count;
        }
    }
    return -1;
}

/* One elimination: adds its solutions. Returns how many solutions there are by its roots, a double one counting twice; -1 if that is
 * not known. The count is exact for simple roots. Unresolved ones are counted together by the winding number of the polynomial around
 * them, from which the complex solutions that share them are subtracted. */
LOCAL int ik_6r_eliminate(const ik_6r_real pose[12], const signed char pass[6], ik_6r_real noise,
    ik_6r_real rows[IK_6R_MAX + 1][6][2], int *count, int *plain, ik_6r_real *firm)
{
    ik_6r_real e[6][12];
    ik_6r_real h[3][6][10];
    ik_6r_real zone[IK_6R_ZONES][3];
    ik_6r_real seen[12];
    ik_6r_real simple[24][2];
    ik_6r_real circle[24][3];
    int zones = 1;
    int singles = 0;
    int circles = 0;
    int total = 0;
    int known = 1;
    int at;
    int k;
    int left = IK_6R_PATIENCE;
    int of[24];
    unsigned taken = 0u;
    zone[0][0] = 1.0;
    zone[0][1] = 0.0;
    zone[0][2] = 1.0;
    ik_6r_product(pose, ik_6r_nudge[pass[5]], seen);
    ik_6r_loop(seen, pass[0], pass[1], e);
    ik_6r_pencil(e, pass, h);
    for (at = 0; at < zones; ++at) {
        ik_6r_real root[25][3];
        ik_6r_real p[2][9];
        ik_6r_real level;
        int order[25];
        int begin = -1;
        int empty = 1;
        int roots = ik_6r_scan(h, zone[at], noise, p, &level, root, order);
        known &= (int)(roots < 24); /* otherwise some may have been left out */
        for (k = 0; (k < roots) && (root[k][2] > 0.8); ++k) {
        }
        *plain = ((at == 0) && (roots > 0) && (k == roots) && (pass[5] == 0)) ? -1 : *plain; /* zero all round: a continuum */
        for (k = 0; k < roots; ++k) { /* clusters of unresolved roots become zones, magnified and solved again */
            int joined = 0;
            const ik_6r_real blur = root[k][2];
            const ik_6r_real reaches = root[k][0] + (fabs(root[k][1]) * blur) + (0.5 * blur * blur);
            if ((order[k] == 1) || ((at > 0) && (reaches < IK_6R_EDGE)) || (zone[at][2] < (ik_6r_real)VALUE_6R_NARROWEST) || (zones == IK_6R_ZONES)) {
                continue; /* simple; beyond the edge of this zone; or as narrow as can be */
            }
            begin = (begin < 0) ? k : begin;
            if (((k + 1) < roots) && (order[k + 1] == 2)) {
                const ik_6r_real reach = root[k][2] + root[k + 1][2] + (ik_6r_real)VALUE_6R_JOINED;
                joined = (int)((1.0 - (root[k][0] * root[k + 1][0]) - (root[k][1] * root[k + 1][1])) < (0.5 * reach * reach));
            }
            if (joined == 0) {
                zones += ik_6r_zone(zone[at], root + begin, k - begin + 1, zone[zones]);
                begin = -1;
            }
        }
        root[roots][0] = 1.0; /* in a zone without a real root try its centre: its roots may be complex only by rounding */
        root[roots][1] = 0.0;
        root[roots][2] = 0.0;
        order[roots] = 2;
        for (k = 0; k <= roots; ++k) {
            const bool middle = k == roots;
            const int before = *count;
            int m;
            int inside;
            int here = (int)(middle ? ((at > 0) && (empty != 0)) : ((at == 0) || (root[k][0] > IK_6R_EDGE)));
            ik_6r_real cs[2];
            (void)ik_6r_magnify(zone[at], root[k], cs);
            for (m = 1; m < zones; ++m) { /* a root inside a narrower zone is left to that zone, which resolves it better */
                here &= (int)(!(((zone[m][2] < zone[at][2]) || ((m > at) && (zone[m][2] <= zone[at][2]))) && (fabs(ik_6r_tangent(zone[m], cs)) <= ((ik_6r_real)VALUE_6R_INSIDE * zone[m][2]))));
            }
            if (here == 0) {
                continue;
            }
            empty = 0;
            if (order[k] == 1) {
                (void)ik_6r_rows(pose, pass, e, h, cs, 1, &left, firm, &taken, rows, count);
                known &= (int)(singles < 24);
                simple[singles % 24][0] = cs[0];
                simple[singles % 24][1] = cs[1];
                ++singles;
                continue;
            }
            *plain = -(int)(*plain < 0);
            inside = 0;
            for (m = 0; m < circles; ++m) { /* counted with an earlier one? */
                const ik_6r_real x = root[k][0] - circle[m][0];
                const ik_6r_real y = root[k][1] - circle[m][1];
                const ik_6r_real r = circle[m][2] - root[k][2];
                inside |= (int)((of[m] == at) && (r > 0.0) && (((x * x) + (y * y)) < (r * r)));
            }
            (void)ik_6r_rows(pose, pass, e, h, cs, 2, &left, firm, &taken, rows, count);
            if ((inside == 0) && (!middle || (*count > before))) {
                ik_6r_real mean[2];
                ik_6r_real *const radius = circle[circles % 24] + 2;
                int turns;
                *radius = ((1.5 * root[k][2]) > (ik_6r_real)VALUE_6R_CIRCLE) ? (1.5 * root[k][2]) : (ik_6r_real)VALUE_6R_CIRCLE;
                turns = (circles < 24) ? ik_6r_wind(p, level, root[k], radius, mean) : -1;
                if (turns > 0) {
                    circle[circles][0] = root[k][0];
                    circle[circles][1] = root[k][1];
                    of[circles] = at;
                    (void)ik_6r_magnify(zone[at], mean, mean);
                    total += turns - ik_6r_rows(pose, pass, e, h, mean, 2, &left, firm, &taken, rows, count);
                    ++circles;
                }
                known &= (int)(turns >= 0);
            }
        }
    }
    for (k = 0; (k < singles) && (known != 0); ++k) {
        int inside = 0;
        int m;
        for (m = 0; m < circles; ++m) {
            const ik_6r_real t = ik_6r_tangent(zone[of[m]], simple[k]) / zone[of[m]][2];
            const ik_6r_real w = 1.0 / (1.0 + (t * t));
            const ik_6r_real x = ((1.0 - (t * t)) * w) - circle[m][0];
            const ik_6r_real y = (2.0 * t * w) - circle[m][1];
            inside |= (int)(((x * x) + (y * y)) < (circle[m][2] * circle[m][2]));
        }
        total += (int)((inside == 0));
    }
    return ((known != 0) && (total >= 0) && ((total % 2) == 0)) ? total : -1;
}

/* Lower bound of the smallest singular value of the Jacobian at a solution (lengths scaled), at least a third of it: the inverse of the
 * norm of its inverse. joint: the one that moves most in the direction in which the tip moves least. */
LOCAL ik_6r_real ik_6r_gain(const ik_6r_real pose[12], ik_6r_real cs[6][2], int *joint)
{
    ik_6r_real r[6];
    ik_6r_real jac[6][6];
    ik_6r_real a[6][12];
    ik_6r_real norm = 0.0;
    ik_6r_real most = 0.0;
    int i;
    int j;
    int k;
    (void)ik_6r_residual(pose, cs, r, jac);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 6; ++j) {
            a[i][j] = jac[i][j];
            a[i][6 + j] = (ik_6r_real)(i == j);
        }
    }
    for (k = 0; k < 6; ++k) {
        int pivot = k;
        ik_6r_real scale;
        for (i = k + 1; i < 6; ++i) {
            pivot = (fabs(a[i][k]) > fabs(a[pivot][k])) ? i : pivot;
        }
        for (j = 0; j < 12; ++j) {
            const ik_6r_real x = a[pivot][j];
            a[pivot][j] = a[k][j];
            a[k][j] = x;
        }
        scale = a[k][k];
        scale = (fabs(scale) > (IK_6R_EPS * IK_6R_EPS)) ? scale : (IK_6R_EPS * IK_6R_EPS);
        for (j = 0; j < 12; ++j) {
            a[k][j] /= scale;
        }
        for (i = 0; i < 6; ++i) {
            const ik_6r_real factor = a[i][k];
            for (j = 0; (j < 12) && (i != k); ++j) {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    for (j = 0; j < 6; ++j) {
        ik_6r_real moved = 0.0;
        for (i = 0; i < 6; ++i) {
            moved += a[i][6 + j] * a[i][6 + j];
        }
        norm += moved;
        *joint = (moved > most) ? j : *joint;
        most = (moved > most) ? moved : most;
    }
    return 1.0 / sqrt(norm);
}

/* Moves one joint of a solution by `by` (rad or scaled length) and the others after it, such that the pose is met to within twice the
 * rounding error. Returns the error of an entry of the pose that remains. */
LOCAL ik_6r_real ik_6r_follow(const ik_6r_real pose[12], int joint, ik_6r_real by, ik_6r_real cs[6][2])
{
    ik_6r_real step[6] = {0};
    ik_6r_real r[6];
    ik_6r_real jac[6][6];
    ik_6r_real error = 10.0;
    int it;
    int i;
#if DH_SLIDES
    if (joint == DH_SLIDE) {
        cs[joint][0] += by;
    } else
#endif
    {
        const ik_6r_real x = cs[joint][0];
        const ik_6r_real y = cs[joint][1];
        const ik_6r_real c = cos(by);
        const ik_6r_real s = sin(by);
        cs[joint][0] = (x * c) - (y * s);
        cs[joint][1] = (y * c) + (x * s);
    }
    for (it = 0; it <= IK_6R_STEPS; ++it) {
        ik_6r_move(cs, step);
        error = ik_6r_residual(pose, cs, r, jac);
        if (error < (ik_6r_real)VALUE_6R_FOLLOWED) {
            break;
        }
        for (i = 0; i < 6; ++i) {
            jac[joint][i] = 0.0;
        }
        (void)ik_6r_step(jac, r, IK_6R_EPS, step);
    }
    return error;
}

/* Whether a singular solution is one of a continuum, in which a joint can turn freely: 1 if it is, -1 if it is nearly one, so that the
 * pose hardly tells where on it the solutions lie, else 0. Of a continuum it becomes the one with that joint at its reference (of all six
 * joints: rad or scaled length), if a path of solutions leads there. */
LOCAL int ik_6r_free(const ik_6r_real pose[12], int joint, const REAL ref[6], ik_6r_real cs[6][2])
{
    ik_6r_real x[6][2];
    ik_6r_real by = 0.01;
    ik_6r_real least = 1.0;
    int side;
    int i;
    for (side = 0; side < 2; ++side) {
        ik_6r_real error;
        for (i = 0; i < 12; ++i) {
            x[i / 2][i % 2] = cs[i / 2][i % 2];
        }
        error = ik_6r_follow(pose, joint, by, x);
        if (error < (ik_6r_real)VALUE_6R_FOLLOWED) {
            break;
        }
        least = (error < least) ? error : least;
        by = -by;
    }
    if (side == 2) {
        return -(int)(least < (ik_6r_real)VALUE_6R_NEARLY);
    }
    for (i = 0; i < 12; ++i) {
        x[i / 2][i % 2] = cs[i / 2][i % 2];
    }
#if DH_SLIDES
    by = (joint == DH_SLIDE) ? ((ik_6r_real)ref[joint] - cs[joint][0]) : (ik_6r_real)ik_wrap(ref[joint] - ik_atan2((REAL)cs[joint][1], (REAL)cs[joint][0]));
#else
    by = (ik_6r_real)ik_wrap(ref[joint] - ik_atan2((REAL)cs[joint][1], (REAL)cs[joint][0]));
#endif
    for (side = 0; (side < VALUE_PATH_STEPS) && (ik_6r_follow(pose, joint, by / (ik_6r_real)VALUE_PATH_STEPS, x) < (ik_6r_real)VALUE_6R_FOLLOWED); ++side) {
    }
    for (i = 0; (i < 12) && (side == VALUE_PATH_STEPS); ++i) {
        cs[i / 2][i % 2] = x[i / 2][i % 2];
    }
    return 1;
}

/* Number of solutions, a double one counting twice: a solution at which the Jacobian is singular, unless its other half is listed as
 * well. */
LOCAL int ik_6r_weigh(const ik_6r_real gain[IK_6R_MAX], ik_6r_real rows[IK_6R_MAX + 1][6][2], int count)
{
    int i;
    int k;
    int total = count;
    for (i = 0; i < count; ++i) {
        int alone = (int)(gain[i] < (ik_6r_real)VALUE_6R_DOUBLE);
        for (k = 0; k < count; ++k) {
            alone &= (int)((k == i) || !(gain[k] < (ik_6r_real)VALUE_6R_DOUBLE) || (ik_6r_apart(rows[i], rows[k]) > (ik_6r_real)VALUE_6R_TWINS));
        }
        total += alone;
    }
    return total;
}

#if !DH_SLIDES
/* Whether a target is farther away than the arm can reach, so that it has no solution. */
LOCAL int ik_6r_beyond(const ik_6r_real pose[12])
{
    ik_6r_real distance = 0.0; /* squared */
    int i;
    for (i = 0; i < 3; ++i) {
        const ik_6r_real along = pose[9 + i] + (ik_6r_span[1] * pose[(3 * i) + 2]) - ((i == 2) ? ik_6r_span[0] : 0.0);
        distance += along * along;
    }
    return (int)(distance > (ik_6r_span[2] * ik_6r_span[2]));
}

#endif
#if NARROW
/* Makes the rotation of a pose, which is known in single precision, more orthonormal: R (3 - R'R) / 2, which squares the error. */
LOCAL void ik_6r_straighten(ik_6r_real pose[12])
{
    ik_6r_real gram[3][3];
    int i;
    int j;
    int k;
    for (i = 0; i < 3; ++i) {
        for (j = 0; j < 3; ++j) {
            gram[i][j] = (i == j) ? 1.5 : 0.0;
            for (k = 0; k < 3; ++k) {
                gram[i][j] -= 0.5 * pose[(3 * k) + i] * pose[(3 * k) + j];
            }
        }
    }
    for (i = 0; i < 9; i += 3) {
        const ik_6r_real row[3] = {pose[i], pose[i + 1], pose[i + 2]};
        for (j = 0; j < 3; ++j) {
            pose[i + j] = (row[0] * gram[0][j]) + (row[1] * gram[1][j]) + (row[2] * gram[2][j]);
        }
    }
}

#endif
/* Finds all joint angles (rad, in (-pi, pi]) with Rz(q1)Tz(d1)Tx(a1)Rx(alpha1) .. Rz(q6)Tz(d6)Tx(a6)Rx(alpha6) = t (row-major
 * 4 x 4); a prismatic joint has Tz(q)Rz(theta) for Rz(q)Tz(d). A solution that is one of a continuum is flagged IK_FREE, and has the free
 * joint at its value in ref if it can. Returns the number of solutions. *certain: these are all. That is so if their number is the one
 * that an elimination at the target counts, and no solution is nearly one of a continuum. */
LOCAL int ik_solve6r(const REAL t[16], const REAL ref[6], REAL q[IK_6R_MAX][6], unsigned flags[IK_6R_MAX], int *certain)
{
    ik_6r_real pose[12];
    ik_6r_real rows[IK_6R_MAX + 1][6][2];
    ik_6r_real gain[IK_6R_MAX];
    int i;
    int j;
    int count = 0;
    int pass;
    int here = -1;
    int plain = 1;
    int joint = 0;
    ik_6r_real firm = 1.0;
#if NARROW
    ik_6r_real r[6];
    ik_6r_real jac[6][6];
    int exact;
#endif
    for (i = 0; i < 9; ++i) {
        pose[i] = (ik_6r_real)t[i + (i / 3)];
    }
    for (i = 0; i < 3; ++i) {
        pose[9 + i] = (ik_6r_real)t[(4 * i) + 3] * PER_LENGTH;
    }
#if NARROW
    ik_6r_straighten(pose);
    ik_6r_straighten(pose);
#endif
#if DH_SLIDES
    *certain = 0;
#else
    *certain = ik_6r_beyond(pose);
#endif
    for (pass = 0; (pass < PASSES) && !*certain; ++pass) {
        const int total = ik_6r_eliminate(pose, ik_6r_pass[pass], ik_6r_noise[pass], rows, &count, &plain, &firm);
        here = (ik_6r_pass[pass][5] != 0) ? here : total;
        *certain = (int)(count == here);
        if (!*certain) {
            for (i = 0; i < count; ++i) {
                gain[i] = ik_6r_gain(pose, rows[i], &joint);
            }
            *certain = (int)((plain < 1) && (ik_6r_weigh(gain, rows, count) == here));
#if NARROW
            exact = 0;
            for (i = 0; i < count; ++i) {
                exact += (int)(ik_6r_residual(pose, rows[i], r, jac) < (ik_6r_real)VALUE_6R_EXACT);
            }
            *certain |= (int)(exact == here);
#endif
        }
    }
    for (i = 0; i < count; ++i) {
        flags[i] = 0u; /* the Jacobian decides whether solutions meet, see ik_aspect */
        if ((firm < (ik_6r_real)VALUE_6R_FIRM) && (ik_6r_gain(pose, rows[i], &joint) < (ik_6r_real)VALUE_6R_DOUBLE)) {
            const int loose = ik_6r_free(pose, joint, ref, rows[i]);
            flags[i] = (loose > 0) ? (unsigned)IK_FREE : 0u;
            *certain = (loose < 0) ? 0 : *certain;
        }
        for (j = 0; j < 6; ++j) {
            const REAL x = ik_atan2((REAL)rows[i][j][1], (REAL)rows[i][j][0]);
            q[i][j] = (x > (REAL)-3.141592653589793) ? x : (REAL)3.141592653589793;
        }
#if DH_SLIDES
        q[i][DH_SLIDE] = (REAL)(rows[i][DH_SLIDE][0] * LENGTH);
#endif
    }
    return count;
}
