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
#define IK_6R_EDGE (REAL)-0.3847 /* cosine of the angle x at the edge of what a zone resolves: tan(x/2) = 1.5 */
#define IK_6R_EPS (REAL)VALUE_EPS
#define IK_6R_TINY (REAL)VALUE_6R_TINY
#define IK_6R_DONE (REAL)VALUE_6R_DONE /* error of an entry of the pose below which a solution is not refined further */
#define IK_6R_ACCEPT (REAL)VALUE_6R_ACCEPT /* error above which a solution is rejected */
#define IK_6R_SAME (REAL)VALUE_6R_SAME /* solutions nearer than this are the same one: forward kinematics cannot tell them apart */

/* DH table: cos alpha, sin alpha, a, d of each joint, lengths in units of the length that the solver is scaled by. */
static const REAL ik_6r_dh[6][4] = DH;
#if DH_SLIDES
/* Cosine and sine of the constant angle theta of the prismatic joint. In arrays of joint cosines and sines the prismatic joint
 * has its displacement and 0. */
static const REAL ik_6r_fixed[2] = DH_TURN;
#endif
/* Eliminations to try, best first. The entries are: the joint at which the numbering of the loop begins, and its direction; which
 * of the joints 3, 4, 5 of that numbering (0, 1, 2) are kept, shifted and other; and an index of ik_6r_nudge, the small motion of
 * the target at which the elimination is done, because coinciding roots separate at a pose nearby. */
static const signed char ik_6r_pass[PASSES][6] = PASS;
/* Rounding noise of the polynomial of each elimination, relative to the sum of the magnitudes of its coefficients. */
static const REAL ik_6r_noise[PASSES] = PASS_NOISE;
/* No motion, a small motion in no special direction, and its inverse. */
static const REAL ik_6r_nudge[3][12] = {
    {(REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)0.0, (REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)0.0, (REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)0.0},
    {(REAL)0.9999996152000963, (REAL)-0.0006401438399640401, (REAL)-0.0005998462500384375, (REAL)0.00063985584003604, (REAL)0.99999968000008, (REAL)-0.00048019187995203, (REAL)0.0006001534499616375, (REAL)0.00047980788004803, (REAL)0.9999997048000738, (REAL)0.0006, (REAL)0.00064, (REAL)-0.00048},
    {(REAL)0.9999996152000963, (REAL)0.00063985584003604, (REAL)0.0006001534499616375, (REAL)-0.0006401438399640401, (REAL)0.99999968000008, (REAL)0.00047980788004803, (REAL)-0.0005998462500384375, (REAL)-0.00048019187995203, (REAL)0.9999997048000738, (REAL)-0.0006001212032016992, (REAL)-0.0006393854011136498, (REAL)0.0004806670888572278}
};
/* A rotation about z by an angle that is not a simple fraction of pi; its cosine and sine are entries 0 and 3. */
static const REAL ik_6r_odd[12] = {(REAL)0.28, (REAL)-0.96, (REAL)0.0, (REAL)0.96, (REAL)0.28, (REAL)0.0, (REAL)0.0, (REAL)0.0, (REAL)1.0, (REAL)0.0, (REAL)0.0, (REAL)0.0};
/* Features that a rotation about z does not change, and the x components of the pairs that it rotates. */
static const signed char ik_6r_axial[7] = {3, 4, 7, 10, 11, 14, 0};
static const signed char ik_6r_planar[4] = {1, 5, 8, 12};
/* Bilinear product of the features of two lines that rigid transforms of both preserve (the second line is marked by '):
 * p.p' - (1 (p.p)' + (p.p) 1') / 2 + l.w' + w.l' - 2 m.m' + 2 (p.l) (p.l)'. Each feature is multiplied by the feature dual[i] of
 * the other line and by the factor form[i]. */
static const signed char ik_6r_dual[15] = {4, 1, 2, 3, 0, 12, 13, 14, 8, 9, 10, 11, 5, 6, 7};
static const REAL ik_6r_form[15] = {(REAL)-0.5, (REAL)1.0, (REAL)1.0, (REAL)1.0, (REAL)-0.5, (REAL)1.0, (REAL)1.0, (REAL)1.0, (REAL)-2.0, (REAL)-2.0, (REAL)-2.0, (REAL)2.0, (REAL)1.0, (REAL)1.0, (REAL)1.0};
/* cos(2 pi k / 17), sin(2 pi k / 17) */
static const REAL ik_6r_wave[17][2] = {
    {(REAL)1.0, (REAL)0.0},
    {(REAL)0.9324722294043558, (REAL)0.3612416661871529},
    {(REAL)0.7390089172206591, (REAL)0.6736956436465572},
    {(REAL)0.44573835577653825, (REAL)0.8951632913550623},
    {(REAL)0.092268359463302, (REAL)0.9957341762950345},
    {(REAL)-0.2736629900720829, (REAL)0.961825643172819},
    {(REAL)-0.6026346363792564, (REAL)0.7980172272802395},
    {(REAL)-0.8502171357296141, (REAL)0.5264321628773558},
    {(REAL)-0.9829730996839018, (REAL)0.18374951781657034},
    {(REAL)-0.9829730996839018, (REAL)-0.18374951781657034},
    {(REAL)-0.8502171357296141, (REAL)-0.5264321628773558},
    {(REAL)-0.6026346363792564, (REAL)-0.7980172272802395},
    {(REAL)-0.2736629900720829, (REAL)-0.961825643172819},
    {(REAL)0.092268359463302, (REAL)-0.9957341762950345},
    {(REAL)0.44573835577653825, (REAL)-0.8951632913550623},
    {(REAL)0.7390089172206591, (REAL)-0.6736956436465572},
    {(REAL)0.9324722294043558, (REAL)-0.3612416661871529}
};

/* Normalizes n pairs to cosine and sine; a pair without a direction becomes the angle zero. */
LOCAL void ik_6r_unit(int n, REAL cs[][2])
{
    int i;
    for (i = 0; i < n; ++i) {
        REAL scale;
        cs[i][0] += IK_6R_EPS * IK_6R_EPS;
        scale = (REAL)1 / SQRT((cs[i][0] * cs[i][0]) + (cs[i][1] * cs[i][1]));
        cs[i][0] *= scale;
        cs[i][1] *= scale;
    }
}

/* Rigid transforms are 12 numbers: the rotation row-major, then the translation. z = x y; z may be x. */
LOCAL void ik_6r_product(const REAL x[12], const REAL y[12], REAL z[12])
{
    int i;
    int j;
    for (i = 0; i < 3; ++i) {
        const REAL u = x[3 * i];
        const REAL v = x[(3 * i) + 1];
        const REAL w = x[(3 * i) + 2];
        for (j = 0; j < 3; ++j) {
            z[(3 * i) + j] = (u * y[j]) + (v * y[3 + j]) + (w * y[6 + j]);
        }
        z[9 + i] = (u * y[9]) + (v * y[10]) + (w * y[11]) + x[9 + i];
    }
}

LOCAL void ik_6r_inverse(const REAL x[12], REAL z[12])
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

LOCAL void ik_6r_identity(REAL x[12])
{
    int i;
    for (i = 0; i < 12; ++i) {
        x[i] = (((i & 3) == 0) && (i < 9)) ? (REAL)1 : (REAL)0;
    }
}

/* x Rz with the cosine and sine cs. */
LOCAL void ik_6r_turn(REAL x[12], const REAL cs[2])
{
    int i;
    for (i = 0; i < 9; i += 3) {
        const REAL u = x[i];
        const REAL v = x[i + 1];
        x[i] = (u * cs[0]) + (v * cs[1]);
        x[i + 1] = (v * cs[0]) - (u * cs[1]);
    }
}

#if DH_SLIDES
/* x Tz: a displacement along z. */
LOCAL void ik_6r_slide(REAL x[12], REAL by)
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
LOCAL void ik_6r_loop(const REAL pose[12], int start, int direction, REAL e[6][12])
{
    int k;
    for (k = 0; k < 6; ++k) {
        const int link = (start + 12 + (direction * k) + ((direction - 1) / 2)) % 6;
        const REAL *const row = ik_6r_dh[link];
        REAL x[12];
        REAL y[12];
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
            const REAL turn[2] = {ik_6r_fixed[0], ik_6r_fixed[1] * (REAL)direction};
            ik_6r_identity(e[k]);
            ik_6r_turn(e[k], turn);
            ik_6r_product(e[k], (direction < 0) ? y : x, e[k]);
            continue;
        }
#endif
        ik_6r_product(ik_6r_odd, (direction < 0) ? y : x, e[k]);
    }
}

LOCAL void ik_6r_cross(const REAL a[3], const REAL b[3], REAL c[3])
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
LOCAL void ik_6r_carry(const REAL e[12], int n, REAL f[15][18])
{
    const REAL *const t = e + 9;
    const REAL tt = (t[0] * t[0]) + (t[1] * t[1]) + (t[2] * t[2]);
    int i;
    int j;
    for (j = 0; j < n; ++j) {
        REAL v[4][3];
        REAL tl[3];
        REAL tm[3];
        REAL along = (REAL)0;
        for (i = 0; i < 4; ++i) {
            const int at = ik_6r_planar[i];
            const REAL a = f[at][j];
            const REAL b = f[at + 1][j];
            const REAL c = f[at + 2][j];
            v[i][0] = (e[0] * a) + (e[1] * b) + (e[2] * c);
            v[i][1] = (e[3] * a) + (e[4] * b) + (e[5] * c);
            v[i][2] = (e[6] * a) + (e[7] * b) + (e[8] * c);
        }
        ik_6r_cross(t, v[1], tl);
        ik_6r_cross(t, v[2], tm);
        f[4][j] += tt * f[0][j];
        for (i = 0; i < 3; ++i) {
            along += t[i] * v[1][i];
            f[4][j] += (REAL)2 * t[i] * v[0][i];
        }
        along += f[11][j];
        for (i = 0; i < 3; ++i) {
            f[1 + i][j] = v[0][i] + (t[i] * f[0][j]);
            f[5 + i][j] = v[1][i];
            f[8 + i][j] = v[2][i] + tl[i];
            f[12 + i][j] = v[3][i] + (tt * v[1][i]) - ((REAL)2 * (tm[i] + (along * t[i])));
        }
        f[11][j] = along;
    }
}

/* Replaces each of n columns of features by three: the coefficients of 1, cos x and sin x of the features rotated by x about z
 * (sense -1: about -z). */
LOCAL void ik_6r_split(int n, REAL sense, REAL f[15][18])
{
    int i;
    int j;
    for (j = n - 1; j >= 0; --j) {
        for (i = 0; i < 7; ++i) {
            REAL *const x = f[ik_6r_axial[i]];
            x[3 * j] = x[j];
            x[(3 * j) + 1] = (REAL)0;
            x[(3 * j) + 2] = (REAL)0;
        }
        for (i = 0; i < 4; ++i) {
            REAL *const x = f[ik_6r_planar[i]];
            REAL *const y = f[ik_6r_planar[i] + 1];
            const REAL u = x[j];
            const REAL v = y[j];
            x[3 * j] = (REAL)0;
            y[3 * j] = (REAL)0;
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
LOCAL void ik_6r_stretch(int n, REAL sense, REAL f[15][18])
{
    int i;
    int j;
    for (j = n - 1; j >= 0; --j) {
        REAL v[15];
        for (i = 0; i < 15; ++i) {
            v[i] = f[i][j];
            f[i][3 * j] = v[i];
            f[i][(3 * j) + 1] = (REAL)0;
            f[i][(3 * j) + 2] = (REAL)0;
        }
        f[3][(3 * j) + 1] = sense * v[0];
        f[4][(3 * j) + 1] = (REAL)2 * sense * v[3];
        f[4][(3 * j) + 2] = v[0];
        f[8][(3 * j) + 1] = -sense * v[6];
        f[9][(3 * j) + 1] = sense * v[5];
        f[11][(3 * j) + 1] = sense * v[7];
        f[12][(3 * j) + 1] = (REAL)2 * sense * v[9];
        f[13][(3 * j) + 1] = -(REAL)2 * sense * v[8];
        f[14][(3 * j) + 1] = -(REAL)2 * sense * v[11];
        f[12][(3 * j) + 2] = v[5];
        f[13][(3 * j) + 2] = v[6];
        f[14][(3 * j) + 2] = -v[7];
    }
}

/* Replaces each of n columns of features by three coefficients of the motion of joint `place` of the loop, a rotation about z or
 * a displacement along z. */
LOCAL void ik_6r_part(const signed char pass[6], int place, int n, REAL sense, REAL f[15][18])
{
    if (place == (2 + pass[4])) {
        ik_6r_stretch(n, sense, f);
    } else {
        ik_6r_split(n, sense, f);
    }
}

#endif
/* Writes to column j the features of the z axis of the frame e, which is the axis of joint 6. */
LOCAL void ik_6r_line(const REAL e[12], int j, REAL f[15][18])
{
    const REAL *const point = e + 9;
    const REAL axis[3] = {e[2], e[5], e[8]};
    REAL moment[3];
    REAL pp = (REAL)0;
    REAL pl = (REAL)0;
    int i;
    for (i = 0; i < 3; ++i) {
        pp += point[i] * point[i];
        pl += point[i] * axis[i];
    }
    ik_6r_cross(point, axis, moment);
    f[0][j] = (REAL)1;
    f[4][j] = pp;
    f[11][j] = pl;
    for (i = 0; i < 3; ++i) {
        f[1 + i][j] = point[i];
        f[5 + i][j] = axis[i];
        f[8 + i][j] = moment[i];
        f[12 + i][j] = (pp * axis[i]) - ((REAL)2 * pl * point[i]);
    }
}

/* x -= scale (v.x) v on 8 entries */
LOCAL void ik_6r_reflect(const REAL v[8], REAL scale, REAL x[8])
{
    REAL dot = (REAL)0;
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
LOCAL void ik_6r_complement(int m, int n, REAL a[6][8], REAL y[4][8])
{
    REAL scale[6];
    int i;
    int j;
    int k;
    for (j = 0; j < (m - n); ++j) {
        for (i = 0; i < 8; ++i) {
            y[j][i] = (i == (n + j)) ? (REAL)1 : (REAL)0;
        }
    }
    for (k = 0; k < n; ++k) {
        REAL norm = (REAL)0;
        REAL length;
        for (i = 0; i < 8; ++i) {
            a[k][i] = (i < k) ? (REAL)0 : a[k][i];
            norm += a[k][i] * a[k][i];
        }
        length = SQRT(norm);
        scale[k] = (REAL)1 / (norm + (FABS(a[k][k]) * length) + IK_6R_TINY);
        a[k][k] += (a[k][k] < (REAL)0) ? -length : length;
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
LOCAL void ik_6r_cancel(REAL f[15][18], REAL row[15][18])
{
    REAL a[6][8];
    REAL y[4][8];
    int i;
    int j;
    int k;
    for (i = 0; i < 15; ++i) {
        for (j = 0; j < 6; ++j) {
            row[i][j] = (REAL)0;
        }
    }
    for (i = 0; i < 8; ++i) {
        a[0][i] = (i < 6) ? f[ik_6r_axial[i]][1] : (REAL)0;
        a[1][i] = (i < 6) ? f[ik_6r_axial[i]][2] : (REAL)0;
    }
    ik_6r_complement(6, 2, a, y);
    for (i = 0; i < 6; ++i) {
        const int at = ik_6r_axial[i];
        for (j = 0; j < 4; ++j) {
            row[ik_6r_dual[at]][j] += y[j][i] / ik_6r_form[at];
            row[4][j] += (REAL)2 * y[j][i] * f[at][0];
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
LOCAL void ik_6r_pencil(REAL e[6][12], const signed char pass[6], REAL h[3][6][10])
{
    static const signed char stride[3] = {60, 1, 3}; /* distance in g between the coefficients of joint 3, 4 and 5 */
    const int kept = stride[pass[2]];
    const int outer = stride[pass[3]];
    const int inner = stride[pass[4]];
    REAL f[15][18];
    REAL row[15][18];
    REAL g[180];
    REAL back[12];
    int i;
    int j;
    int k;
    int x;
    ik_6r_inverse(e[5], back);
    ik_6r_line(back, 0, f);
    ik_6r_split(1, -(REAL)1, f);
    ik_6r_inverse(e[0], back);
    ik_6r_carry(back, 3, f);
    ik_6r_cancel(f, row);
    ik_6r_inverse(e[1], back);
    ik_6r_carry(back, 6, row);
#if DH_SLIDES
    ik_6r_part(pass, 2, 6, -(REAL)1, row);
#else
    ik_6r_split(6, -(REAL)1, row);
#endif
    ik_6r_line(e[4], 0, f);
#if DH_SLIDES
    ik_6r_part(pass, 4, 1, (REAL)1, f);
    ik_6r_carry(e[3], 3, f);
    ik_6r_part(pass, 3, 3, (REAL)1, f);
#else
    ik_6r_split(1, (REAL)1, f);
    ik_6r_carry(e[3], 3, f);
    ik_6r_split(3, (REAL)1, f);
#endif
    ik_6r_carry(e[2], 9, f);
    for (i = 0; i < 15; ++i) {
        f[i][9] = (REAL)0;
    }
    for (j = 0; j < 18; ++j) {
        REAL *const sum = g + (60 * (j % 3)) + (10 * (j / 3));
        for (x = 0; x < 10; ++x) {
            sum[x] = (REAL)0;
        }
        for (i = 0; i < 15; ++i) {
            const REAL z = ik_6r_form[i] * row[ik_6r_dual[i]][j];
            for (x = 0; x < 10; ++x) {
                sum[x] += z * f[i][x];
            }
        }
    }
    for (x = 0; x < 6; ++x) {
        REAL norm = IK_6R_TINY;
        for (k = 0; k < 3; ++k) {
            REAL m[3][3];
            for (i = 0; i < 3; ++i) { /* 1, cos, sin -> powers of tan(x/2) */
                const REAL *const s = g + (10 * x) + (kept * k) + (outer * i);
#if DH_SLIDES
                m[i][0] = s[0];
                m[i][1] = s[inner];
                m[i][2] = s[2 * inner];
#else
                m[i][0] = s[0] + s[inner];
                m[i][1] = (REAL)2 * s[2 * inner];
                m[i][2] = s[0] - s[inner];
#endif
            }
            for (j = 0; j < 3; ++j) {
                h[k][x][j] = m[0][j] + m[1][j];
                h[k][x][3 + j] = (REAL)2 * m[2][j];
                h[k][x][6 + j] = m[0][j] - m[1][j];
            }
            h[k][x][9] = (REAL)0;
            for (j = 0; j < 9; ++j) {
                const REAL size = FABS(h[k][x][j]);
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
LOCAL REAL ik_6r_lu(REAL a[6][10], int n)
{
    REAL det = (REAL)1;
    int i;
    int j;
    int k;
    for (k = 0; k < n; ++k) {
        REAL best = FABS(a[k][k]);
        REAL top[10];
        REAL scale;
        int pivot = k;
        for (i = k + 1; i < 6; ++i) {
            const REAL size = FABS(a[i][k]);
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
        scale = (REAL)1 / ((best > IK_6R_TINY) ? top[k] : IK_6R_TINY);
        for (i = k + 1; i < 6; ++i) {
            const REAL factor = a[i][k] * scale;
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
LOCAL REAL ik_6r_reduce(REAL h[3][6][10], const REAL cs[2], REAL work[3][6][10])
{
    REAL det;
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
        work[1][i][9] = (REAL)0;
    }
    det = ik_6r_lu(work[0], 3) * ik_6r_lu(work[1], 3);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 6; ++j) {
            work[2][i][j] = work[i / 3][3 + (i % 3)][3 + j];
        }
        for (j = 6; j < 10; ++j) {
            work[2][i][j] = (REAL)0;
        }
    }
    return det;
}

/* Maps an angle y of the magnified circle to the angle x of the true circle, given as cosine and sine cs. A zone is an arc: its
 * centre (cosine zone[0], sine zone[1]) and its scale zone[2], with tan(x/2) = zone[2] tan(y/2) for x counted from the centre.
 * Returns cos(y/2)^2 + zone[2]^2 sin(y/2)^2. */
LOCAL REAL ik_6r_magnify(const REAL zone[3], const REAL y[2], REAL cs[2])
{
    const REAL a = (REAL)0.5 * ((REAL)1 + y[0]);
    const REAL b = (REAL)0.5 * ((REAL)1 - y[0]) * zone[2] * zone[2];
    const REAL weight = a + b;
    const REAL c = (a - b) / weight;
    const REAL s = zone[2] * y[1] / weight;
    cs[0] = (c * zone[0]) - (s * zone[1]);
    cs[1] = (c * zone[1]) + (s * zone[0]);
    return weight;
}

/* Tangent of half the angle from x to y. */
LOCAL REAL ik_6r_tangent(const REAL x[2], const REAL y[2])
{
    return ((x[0] * y[1]) - (x[1] * y[0])) / ((REAL)1 + (x[0] * y[0]) + (x[1] * y[1]) + (IK_6R_EPS * IK_6R_EPS));
}

/* Finds the roots y of the 12 x 12 determinant on the magnified circle of a zone. The determinant is a trigonometric polynomial of
 * degree 8 in x; times the 8th power of the value that ik_6r_magnify returns it is one of degree 8 in y, p[0] (cosines) and p[1]
 * (sines), which is interpolated from 17 samples. Its noise, *level, is measured: it is the largest of the usual relative noise, of
 * four times the difference between polynomial and determinant at three angles between the samples, and of the rounding errors of
 * the samples, which grow as the smallest pivot shrinks. order: 1 for a simple root, 2 for an unresolved one. */
LOCAL int ik_6r_scan(REAL h[3][6][10], const REAL zone[3], REAL noise, REAL p[2][9], REAL *level, REAL root[24][3], int order[24])
{
    REAL value[20];
    REAL size = (REAL)0;
    REAL rounding = (REAL)0;
    int j;
    int k;
    for (j = 0; j < 20; ++j) { /* 17 .. 19: the angles opposite to samples 4, 9 and 15 lie in the middle between two samples */
        REAL work[3][6][10];
        REAL cs[2];
        REAL weight;
        REAL least = (REAL)1;
        const REAL *const wave = ik_6r_wave[(j < 17) ? j : (((11 * j) + 4) % 17)];
        const REAL y[2] = {(j < 17) ? wave[0] : -wave[0], (j < 17) ? wave[1] : -wave[1]};
        weight = ik_6r_magnify(zone, y, cs);
        weight *= weight;
        weight *= weight;
        value[j] = weight * weight * ik_6r_reduce(h, cs, work);
        value[j] *= ik_6r_lu(work[2], 6);
        for (k = 0; k < 6; ++k) {
            const REAL inner = FABS(work[2][k][k]);
            const REAL outer = FABS(work[k / 3][k % 3][k % 3]);
            least = (inner < least) ? inner : least;
            least = (outer < least) ? outer : least;
        }
        rounding += (REAL)VALUE_6R_ROUNDING * IK_6R_EPS * FABS(value[j]) / (least + IK_6R_TINY);
    }
    for (k = 0; k <= 8; ++k) {
        int at = 0;
        p[0][k] = (REAL)0;
        p[1][k] = (REAL)0;
        for (j = 0; j < 17; ++j) {
            p[0][k] += value[j] * ik_6r_wave[at][0];
            p[1][k] += value[j] * ik_6r_wave[at][1];
            at += ((at + k) < 17) ? k : (k - 17);
        }
        p[0][k] *= (REAL)(2.0 / 17.0);
        p[1][k] *= (REAL)(2.0 / 17.0);
        size += FABS(p[0][k]) + FABS(p[1][k]);
    }
    p[0][0] *= (REAL)0.5;
    *level = size * noise;
    *level = (*level > rounding) ? *level : rounding;
    for (j = 17; j < 20; ++j) {
        const REAL *const y = ik_6r_wave[((11 * j) + 4) % 17];
        REAL v[2];
        REAL off;
        ik_trig8_value(p[0], p[1], -y[1] / ((REAL)1 - y[0]), v);
        off = (REAL)VALUE_6R_MISMATCH * FABS(v[0] - value[j]);
        *level = (off > *level) ? off : *level;
    }
    return ik_trig_roots_8(p[0], p[1], *level, root, order);
}

/* Inner products of parts of two null vectors. Their entries belong to powers of the two tangents; the low part omits the highest
 * power of one tangent and the high part the lowest one. by = 3 selects the tangent of the shifted angle, 1 that of the other. */
LOCAL void ik_6r_shift(const REAL u[12], const REAL v[12], int by, REAL s[4])
{
    int i;
    for (i = 0; i < 4; ++i) {
        s[i] = (REAL)0;
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
LOCAL REAL ik_6r_factor(const REAL w[12], REAL angle[2][2])
{
    REAL far = (REAL)0;
    int k;
    for (k = 0; k < 2; ++k) { /* low and high part are the cosine and sine of the half angle times the same vector */
        REAL s[4];
        REAL sum;
        REAL off;
        ik_6r_shift(w, w, 3 - (2 * k), s);
        sum = (REAL)1 / (s[0] + s[3] + IK_6R_TINY);
        angle[k][0] = (s[0] - s[3]) * sum;
        angle[k][1] = (REAL)2 * s[1] * sum;
        off = (REAL)1 - (angle[k][0] * angle[k][0]) - (angle[k][1] * angle[k][1]);
        far = (off > far) ? off : far;
    }
    return far;
}

/* Computes the null vector v of the 12 x 12 matrix at a kept angle if its null space has dimension one. */
LOCAL void ik_6r_null(REAL h[3][6][10], const REAL cs[2], REAL v[12])
{
    REAL work[3][6][10];
    REAL(*const low)[10] = work[0];
    REAL(*const high)[10] = work[1];
    REAL(*const s)[10] = work[2];
    int i;
    int j;
    (void)ik_6r_reduce(h, cs, work);
    (void)ik_6r_lu(s, 5);
    v[8] = s[4][4];
    v[7] = -s[4][5];
    for (i = 3; i >= 0; --i) {
        v[3 + i] = (REAL)0;
        for (j = i + 1; j < 6; ++j) {
            v[3 + i] -= s[i][j] * v[3 + j];
        }
        v[3 + i] /= s[i][i] + IK_6R_TINY;
    }
    for (i = 2; i >= 0; --i) {
        v[i] = (REAL)0;
        v[9 + i] = (REAL)0;
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
LOCAL int ik_6r_kernel(REAL a[12][12], int n, int least, REAL basis[IK_6R_WIDE][12])
{
    int column[12];
    int i;
    int j;
    int k;
    int m;
    REAL first = (REAL)0;
    for (j = 0; j < n; ++j) {
        column[j] = j;
    }
    for (k = 0; k < (n - least); ++k) {
        REAL best = (REAL)-1;
        int row = k;
        int at = k;
        for (i = k; i < n; ++i) {
            for (j = k; j < n; ++j) {
                if (FABS(a[i][j]) > best) {
                    best = FABS(a[i][j]);
                    row = i;
                    at = j;
                }
            }
        }
        first = (k == 0) ? best : first;
        if (!(best > ((REAL)VALUE_6R_RANK * first))) {
            break;
        }
        for (i = 0; i < n; ++i) {
            const REAL x = a[i][at];
            a[i][at] = a[i][k];
            a[i][k] = x;
        }
        j = column[at];
        column[at] = column[k];
        column[k] = j;
        for (j = 0; j < n; ++j) {
            const REAL x = a[row][j];
            a[row][j] = a[k][j];
            a[k][j] = x;
        }
        for (i = k + 1; i < n; ++i) {
            const REAL factor = a[i][k] / a[k][k];
            for (j = k; j < n; ++j) {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    if ((n - k) > IK_6R_WIDE) {
        return 0;
    }
    for (m = 0; m < (n - k); ++m) {
        REAL x[12];
        for (i = n - 1; i >= 0; --i) {
            x[i] = (i == (k + m)) ? (REAL)1 : (REAL)0;
            for (j = i + 1; (i < k) && (j < n); ++j) {
                x[i] -= a[i][j] / a[i][i] * x[j];
            }
            basis[m][column[i]] = x[i];
        }
    }
    return m;
}

/* Makes m vectors orthonormal. */
LOCAL void ik_6r_orthonormalize(int m, REAL v[IK_6R_WIDE][12])
{
    int pass;
    int i;
    int j;
    int k;
    for (k = 0; k < m; ++k) {
        for (pass = 0; pass < 2; ++pass) { /* the second time against rounding errors of the first */
            REAL norm = IK_6R_TINY;
            for (j = 0; j < k; ++j) {
                REAL dot = (REAL)0;
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
            norm = (REAL)1 / SQRT(norm);
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
LOCAL REAL ik_6r_multiply(int m, REAL v[IK_6R_WIDE][12], int by, REAL weight, REAL sum[12][12])
{
    REAL g[IK_6R_WIDE][16];
    REAL part[IK_6R_WIDE][IK_6R_WIDE];
    REAL error = (REAL)0; /* g: 2 IK_6R_WIDE */
    int i;
    int j;
    int k;
    for (i = 0; i < m; ++i) {
        for (j = 0; j < m; ++j) {
            REAL s[4];
            ik_6r_shift(v[i], v[j], by, s);
            g[i][j] = ((REAL)(25.0 / 169.0) * s[0]) + ((REAL)(60.0 / 169.0) * (s[1] + s[2])) + ((REAL)(144.0 / 169.0) * s[3]);
            g[i][m + j] = ((REAL)(60.0 / 169.0) * (s[3] - s[0])) + ((REAL)(25.0 / 169.0) * s[1]) - ((REAL)(144.0 / 169.0) * s[2]);
            part[i][j] = g[i][m + j];
            error += (i == j) ? (((REAL)(144.0 / 169.0) * s[0]) - ((REAL)(120.0 / 169.0) * s[1]) + ((REAL)(25.0 / 169.0) * s[3])) : (REAL)0;
        }
    }
    for (k = 0; k < m; ++k) { /* L'L is positive definite: no pivoting */
        const REAL pivot = (REAL)1 / (g[k][k] + IK_6R_TINY);
        for (j = k; j < (2 * m); ++j) {
            g[k][j] *= pivot;
        }
        for (i = 0; i < m; ++i) {
            const REAL factor = g[i][k];
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
LOCAL void ik_6r_eigenvalues(int m, REAL a[12][12], REAL z[IK_6R_WIDE][2])
{
    REAL c[IK_6R_WIDE + 1];
    REAL b[IK_6R_WIDE][IK_6R_WIDE];
    REAL size = (REAL)0;
    int i;
    int j;
    int k;
    int it;
    for (i = 0; i < m; ++i) {
        for (j = 0; j < m; ++j) {
            b[i][j] = (REAL)(i == j);
        }
    }
    c[0] = (REAL)1;
    for (k = 1; k <= m; ++k) {
        REAL ab[IK_6R_WIDE][IK_6R_WIDE];
        REAL trace = (REAL)0;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                REAL sum = (REAL)0;
                for (it = 0; it < m; ++it) {
                    sum += a[i][it] * b[it][j];
                }
                ab[i][j] = sum;
                size += (k == 1) ? FABS(sum) : (REAL)0;
            }
            trace += ab[i][i];
        }
        c[k] = -trace / (REAL)k;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                b[i][j] = ab[i][j] + ((i == j) ? c[k] : (REAL)0);
            }
        }
    }
    for (i = 0; i < m; ++i) {
        const REAL *const start = ik_6r_wave[(1 + (17 * i / m)) % 17];
        z[i][0] = (REAL)0.5 * size * start[0];
        z[i][1] = (REAL)0.5 * size * start[1];
    }
    for (it = 0; it < VALUE_6R_ABERTH; ++it) {
        for (i = 0; i < m; ++i) {
            const REAL x = z[i][0];
            const REAL y = z[i][1];
            REAL p = (REAL)1;
            REAL q = (REAL)0;
            REAL dp = (REAL)0;
            REAL dq = (REAL)0;
            REAL u;
            REAL v;
            REAL w;
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
                const REAL dx = x - z[j][0];
                const REAL dy = y - z[j][1];
                const REAL d = (REAL)1 / ((dx * dx) + (dy * dy) + IK_6R_TINY);
                if (j != i) {
                    u -= ((p * dx) + (q * dy)) * d;
                    v -= ((q * dx) - (p * dy)) * d;
                }
            }
            w = (REAL)1 / ((u * u) + (v * v) + IK_6R_TINY);
            z[i][0] -= ((p * u) + (q * v)) * w;
            z[i][1] -= ((q * u) - (p * v)) * w;
        }
    }
}

/* Computes the pairs (shifted, other) of eliminated angles of all solutions that share an unresolved root: in the null space they are
 * the vectors that both tangents multiply by a number, the eigenvectors of a weighted sum of the two multiplications. Returns their
 * number; *unreal counts the solutions with complex angles, as far as two different weights agree on them. */
LOCAL int ik_6r_shared(REAL h[3][6][10], const REAL cs[2], REAL pair[IK_6R_WIDE + 1][2][2], int *unreal)
{
    static const REAL weight[2][2] = {{(REAL)0.8, (REAL)-0.6}, {(REAL)0.47, (REAL)0.88}};
    REAL a[12][12];
    REAL v[IK_6R_WIDE][12];
    REAL z[IK_6R_WIDE][2];
    REAL error = (REAL)0;
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
            a[i][j] = ((at < 0) || (at > 8)) ? (REAL)0 : (h[0][row][at] + (cs[0] * h[1][row][at]) + (cs[1] * h[2][row][at]));
        }
    }
    m = ik_6r_kernel(a, 12, 2, v);
    ik_6r_orthonormalize(m, v);
    *unreal = m;
    for (way = 1; way >= 0; --way) {
        int unlike = 0;
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                a[i][j] = (REAL)0;
            }
        }
        error += ik_6r_multiply(m, v, 3, weight[way][0], a);
        error += ik_6r_multiply(m, v, 1, weight[way][1], a);
        ik_6r_eigenvalues(m, a, z);
        for (k = 0; k < m; ++k) {
            unlike += (int)(FABS(z[k][1]) > ((REAL)VALUE_6R_UNREAL * ((REAL)1 + FABS(z[k][0]))));
        }
        *unreal = (unlike < *unreal) ? unlike : *unreal;
        *unreal = (error < (REAL)VALUE_6R_MAPPED) ? *unreal : 0;
    }
    for (k = 0; k < m; ++k) {
        REAL less[12][12];
        REAL mix[IK_6R_WIDE][12];
        REAL w[12];
        if (FABS(z[k][1]) > ((REAL)VALUE_6R_UNREAL * ((REAL)1 + FABS(z[k][0])))) {
            continue;
        }
        for (i = 0; i < m; ++i) {
            for (j = 0; j < m; ++j) {
                less[i][j] = a[i][j] - ((i == j) ? z[k][0] : (REAL)0);
            }
        }
        if (ik_6r_kernel(less, m, 1, mix) == 0) {
            continue;
        }
        for (i = 0; i < 12; ++i) {
            w[i] = (REAL)0;
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
LOCAL void ik_6r_complete(REAL e[6][12], int slide, REAL t[6][2])
#else
LOCAL void ik_6r_complete(REAL e[6][12], REAL t[6][2])
#endif
{
    REAL x[12];
    REAL y[12];
    REAL goal[12];
    REAL f[15][18];
    REAL aa = (REAL)0;
    REAL ab = (REAL)0;
    REAL bb = (REAL)0;
    REAL ar = (REAL)0;
    REAL br = (REAL)0;
    int i;
    ik_6r_identity(x);
    ik_6r_identity(y);
    t[1][0] = (REAL)1;
    t[0][0] = t[0][1] = t[1][1] = t[5][0] = t[5][1] = (REAL)0;
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
    ik_6r_split(1, (REAL)1, f);
    ik_6r_carry(e[0], 3, f);
    ik_6r_line(goal, 3, f);
    for (i = 0; i < 6; ++i) {
        const REAL *const v = f[ik_6r_axial[i]];
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
        const REAL *const v = f[ik_6r_planar[i]];
        const REAL *const w = f[ik_6r_planar[i] + 1];
        const REAL vx = v[0] + (v[1] * t[1][0]) + (v[2] * t[1][1]);
        const REAL vy = w[0] + (w[1] * t[1][0]) + (w[2] * t[1][1]);
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
LOCAL REAL ik_6r_residual(const REAL pose[12], REAL cs[6][2], REAL r[6], REAL jac[6][6])
{
    REAL x[12];
    REAL err = (REAL)0;
    int i;
    int k;
    ik_6r_identity(x);
    for (k = 0; k < 6; ++k) {
        const REAL *const row = ik_6r_dh[k];
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
            const REAL v = x[(3 * i) + 1];
            const REAL w = x[(3 * i) + 2];
            x[9 + i] += (row[3] * w) + (row[2] * x[3 * i]);
            x[(3 * i) + 1] = (row[0] * v) + (row[1] * w);
            x[(3 * i) + 2] = (row[0] * w) - (row[1] * v);
        }
    }
    for (i = 0; i < 12; ++i) {
        const REAL off = FABS(pose[i] - x[i]);
        err = ((off > err) || !(off >= (REAL)0)) ? off : err;
    }
    for (k = 0; k < 6; ++k) {
        REAL arm[3];
        for (i = 0; i < 3; ++i) {
            arm[i] = x[9 + i] - jac[k][i];
        }
        ik_6r_cross(jac[k] + 3, arm, jac[k]);
    }
#if DH_SLIDES
    for (i = 0; i < 3; ++i) {
        jac[DH_SLIDE][i] = jac[DH_SLIDE][3 + i];
        jac[DH_SLIDE][3 + i] = (REAL)0;
    }
#endif
    for (i = 0; i < 3; ++i) {
        const int y = (i < 2) ? ((3 * i) + 3) : 0;
        const int z = (i > 0) ? ((3 * i) - 3) : 6;
        r[i] = pose[9 + i] - x[9 + i];
        r[3 + i] = (REAL)0;
        for (k = 0; k < 3; ++k) {
            r[3 + i] += (REAL)0.5 * ((x[y + k] * pose[z + k]) - (x[z + k] * pose[y + k]));
        }
    }
    return err;
}

/* (J'J + damping) step = J' r by the LDL' decomposition. */
LOCAL void ik_6r_step(REAL jac[6][6], const REAL r[6], REAL damping, REAL step[6])
{
    REAL l[6][6];
    REAL d[6];
    int i;
    int j;
    int k;
    for (i = 0; i < 6; ++i) {
        REAL pivot = damping + (IK_6R_EPS * IK_6R_EPS);
        step[i] = (REAL)0;
        for (k = 0; k < 6; ++k) {
            step[i] += jac[i][k] * r[k];
            pivot += jac[i][k] * jac[i][k];
        }
        for (j = 0; j < i; ++j) {
            REAL v = (REAL)0;
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
    }
    for (i = 5; i >= 0; --i) {
        step[i] /= d[i];
        for (k = i + 1; k < 6; ++k) {
            step[i] -= l[k][i] * step[k];
        }
    }
}

/* Moves the joints by a step, scaled down where a joint would move by more than half. Angles turn by 2 atan(step / 2), which is the step
 * up to third order and needs no sine and cosine. */
LOCAL void ik_6r_move(REAL cs[6][2], const REAL step[6])
{
    REAL largest = (REAL)1;
    int i;
    for (i = 0; i < 6; ++i) {
        largest = (((REAL)2 * FABS(step[i])) > largest) ? ((REAL)2 * FABS(step[i])) : largest;
    }
    for (i = 0; i < 6; ++i) {
        const REAL t = (REAL)0.5 * step[i] / largest;
        const REAL c = cs[i][0];
        const REAL s = cs[i][1];
        const REAL w = (REAL)1 / ((REAL)1 + (t * t));
        cs[i][0] = ((c * ((REAL)1 - (t * t))) - ((REAL)2 * s * t)) * w;
        cs[i][1] = ((s * ((REAL)1 - (t * t))) + ((REAL)2 * c * t)) * w;
#if DH_SLIDES
        if (i == DH_SLIDE) {
            cs[i][0] = c + (step[i] / largest);
            cs[i][1] = (REAL)0;
        }
#endif
    }
}

/* Refines a trial solution on the pose by Newton steps damped by the squared residual; the result is cs. A patient search, near
 * a singular pose, takes up to *left more steps; where it stalls it restarts at a distance of the square root of the error from
 * the best solution so far, which is the order of the distance to the solution where the Jacobian is singular. Returns 0 if the
 * pose is not met, 1 if it is met far from the start, 2 if it is met close to the start. */
LOCAL int ik_6r_polish(const REAL pose[12], int patient, int *left, REAL trial[6][2], REAL cs[6][2])
{
    REAL best = (REAL)10;
    REAL begin = (REAL)0;
    REAL before = (REAL)10;
    int it;
    int i;
    for (it = 0; (it <= IK_6R_STEPS) || ((patient != 0) && (*left > 0) && (it <= (6 * IK_6R_STEPS))); ++it) {
        REAL r[6];
        REAL jac[6][6];
        REAL step[6];
        REAL damping = (REAL)0;
        REAL (*from)[2] = trial;
        const REAL err = ik_6r_residual(pose, trial, r, jac);
        const bool better = err < best;
        const bool stalled = !((patient != 0) ? (FABS(err - before) > ((REAL)0.01 * err)) : (err < ((REAL)0.5 * before)));
        *left -= patient;
        begin = (it == 0) ? err : begin;
        if (better) {
            best = err;
            for (i = 0; i < 6; ++i) {
                cs[i][0] = trial[i][0];
                cs[i][1] = trial[i][1];
            }
        }
        if ((best < IK_6R_DONE) || ((it >= 3) && (best > (REAL)VALUE_6R_HOPELESS)) || ((best < IK_6R_ACCEPT) && !(err < ((REAL)0.5 * before))) || !((patient != 0) || better)) {
            break;
        }
        before = err;
        for (i = 0; i < 6; ++i) {
            damping += r[i] * r[i];
        }
        ik_6r_step(jac, r, damping, step);
        if (stalled && (patient != 0)) {
            const REAL kick = (REAL)2 * SQRT(best);
            from = cs;
            for (i = 0; i < 6; ++i) {
                step[i] = kick * ik_6r_wave[((5 * i) + (3 * it)) % 17][0];
            }
            before = (REAL)10;
        }
        for (i = 0; i < 6; ++i) {
            trial[i][0] = from[i][0];
            trial[i][1] = from[i][1];
        }
        ik_6r_move(trial, step);
    }
    return (best < IK_6R_ACCEPT) ? (1 + (int)(begin < (REAL)VALUE_6R_CLOSE)) : 0;
}

/* Sum of the differences of the cosines and sines (or displacements) of two solutions. */
LOCAL REAL ik_6r_apart(REAL a[6][2], REAL b[6][2])
{
    REAL apart = (REAL)0;
    int i;
    for (i = 0; i < 12; ++i) {
        apart += FABS(a[i / 2][i % 2] - b[i / 2][i % 2]);
    }
    return apart;
}

/* Index of the earlier solution that equals solution number count; count itself if it is new. */
LOCAL int ik_6r_place(REAL rows[IK_6R_MAX + 1][6][2], int count)
{
    int k;
    for (k = 0; (k < count) && (ik_6r_apart(rows[k], rows[count]) >= IK_6R_SAME); ++k) {
    }
    return k;
}

/* Adds the solutions of one root of the kept angle. A simple root has one of its own: where its null vector leads to none, or to one
 * that is among `taken` (bits) by other roots, the solutions that share it are sought as for an unresolved root. Returns the number
 * of complex solutions at the root. */
LOCAL int ik_6r_rows(const REAL pose[12], const signed char pass[6], REAL e[6][12], REAL h[3][6][10],
    const REAL root[2], int order, int *left, unsigned *taken, REAL rows[IK_6R_MAX + 1][6][2], int *count)
{
    int unreal = 0;
    int attempt;
    int met = 0;
    for (attempt = order; (attempt <= 2) && (met == 0) && (*left > 0); ++attempt) {
        REAL pair[IK_6R_WIDE + 1][2][2];
        REAL w[12];
        int i;
        int j;
        int pairs = 0;
        ik_6r_null(h, root, w);
        pairs = (int)(ik_6r_factor(w, pair[0]) < (REAL)VALUE_6R_SHAPE);
        if (attempt == 2) {
            pairs += ik_6r_shared(h, root, pair + pairs, &unreal);
        }
        for (j = 0; (j < pairs) && (*count < IK_6R_MAX); ++j) {
            REAL t[6][2];
            REAL cs[6][2];
            int place;
            int near;
            int joint;
            for (i = 0; i < 2; ++i) {
                t[2 + pass[2]][i] = root[i];
                t[2 + pass[3]][i] = pair[j][0][i];
                t[2 + pass[4]][i] = pair[j][1][i];
            }
#if DH_SLIDES
            t[2 + pass[4]][0] = pair[j][1][1] / ((REAL)1 + pair[j][1][0] + IK_6R_EPS);
            t[2 + pass[4]][1] = (REAL)0;
#endif
#if DH_SLIDES
            ik_6r_complete(e, 2 + pass[4], t);
#else
            ik_6r_complete(e, t);
#endif
            joint = pass[0];
            for (i = 0; i < 6; ++i) {
                REAL *const to = cs[joint];
                joint += pass[1];
                joint += (joint < 0) ? 6 : (joint > 5) ? -6 : 0;
                to[0] = (ik_6r_odd[0] * t[i][0]) - (ik_6r_odd[3] * t[i][1]);
                to[1] = ((ik_6r_odd[0] * t[i][1]) + (ik_6r_odd[3] * t[i][0])) * (REAL)pass[1];
            }
            ik_6r_unit(6, cs);
#if DH_SLIDES
            cs[DH_SLIDE][0] = t[2 + pass[4]][0] * (REAL)pass[1];
            cs[DH_SLIDE][1] = (REAL)0;
#endif
            near = ik_6r_polish(pose, (pass[5] != 0) || (attempt == 2), left, cs, rows[*count]);
            if (near > 0) {
                place = ik_6r_place(rows, *count);
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
LOCAL int ik_6r_zone(const REAL outer[3], REAL root[24][3], int n, REAL zone[3])
{
    int i;
    (void)ik_6r_magnify(outer, root[n / 2], zone);
    zone[2] = (REAL)0;
    for (i = 0; i < n; ++i) { /* both ends of the interval in which each root lies, widened by 0.02 rad */
        REAL turn = root[i][2] + (REAL)VALUE_6R_WIDER;
        int k;
        for (k = 0; k < 2; ++k) {
            const REAL end[2] = {root[i][0] - (turn * root[i][1]), root[i][1] + (turn * root[i][0])};
            REAL cs[2];
            REAL reach;
            (void)ik_6r_magnify(outer, end, cs);
            reach = FABS(ik_6r_tangent(zone, cs));
            zone[2] = (reach > zone[2]) ? reach : zone[2];
            turn = -turn;
        }
    }
    return (int)(zone[2] < ((REAL)VALUE_6R_NARROWER * outer[2]));
}

/* Counts the roots of a polynomial (see ik_6r_scan) in a circle of the complex plane around the point z = exp(i y) of the unit circle,
 * by the integral of its logarithmic derivative. The radius is doubled until the polynomial exceeds its noise on all of the circle.
 * Returns -1 if it does not. Of the roots inside, middle is the mean: it is accurate even where noise scatters a multiple root. */
LOCAL int ik_6r_wind(REAL p[2][9], REAL noise, const REAL at[2], REAL *radius, REAL middle[2])
{
    for (; *radius < (REAL)VALUE_6R_WIDEST; *radius *= (REAL)2) {
        REAL c = (REAL)1;
        REAL s = (REAL)0;
        REAL turns[2] = {(REAL)0, (REAL)0};
        REAL first[2] = {(REAL)0, (REAL)0};
        int clear = 1;
        int count;
        int i;
        int k;
        for (i = 0; (i < 48) && (clear != 0); ++i) {
            const REAL dx = *radius * c;
            const REAL dy = *radius * s;
            const REAL x = at[0] + dx;
            const REAL y = at[1] + dy;
            const REAL next = c;
            REAL re = p[0][8];
            REAL im = -p[1][8];
            REAL dr = (REAL)0;
            REAL di = (REAL)0;
            REAL size = (x * x) + (y * y);
            REAL u;
            REAL v;
            REAL least = (REAL)2 * (REAL)VALUE_6R_CLEAR * noise;
            for (k = 7; k >= -8; --k) { /* f = 2 z^8 p and its derivative by Horner's rule */
                u = (dr * x) - (di * y) + re;
                di = (dr * y) + (di * x) + im;
                dr = u;
                u = (re * x) - (im * y) + (((k == 0) ? (REAL)2 : (REAL)1) * p[0][(k < 0) ? -k : k]);
                im = (re * y) + (im * x) + ((k < 0) ? p[1][-k] : (REAL)0) - ((k > 0) ? p[1][k] : (REAL)0);
                re = u;
            }
            size *= size;
            size *= size;
            const REAL larger = (size > (REAL)1) ? size : (REAL)1;
            least *= larger * larger;
            size = (re * re) + (im * im);
            clear = (int)(size > (least * least));
            size = (REAL)(1.0 / 48.0) / (size + IK_6R_TINY);
            u = ((dr * re) + (di * im)) * size; /* f' / f */
            v = ((di * re) - (dr * im)) * size;
            re = (u * dx) - (v * dy); /* times z - at, which is dz / (i dy) */
            im = (u * dy) + (v * dx);
            turns[0] += re;
            turns[1] += im;
            first[0] += (re * dx) - (im * dy);
            first[1] += (re * dy) + (im * dx);
            c = ((REAL)0.9914448613738104 * c) - ((REAL)0.13052619222005157 * s);
            s = ((REAL)0.9914448613738104 * s) + ((REAL)0.13052619222005157 * next);
        }
        count = (int)(turns[0] + (REAL)0.5);
        if ((clear != 0) && ((FABS(turns[0] - (REAL)count) + FABS(turns[1])) < (REAL)VALUE_6R_WHOLE)) {
            const REAL share = (REAL)1 / (REAL)((count > 0) ? count : 1);
            REAL scale;
            middle[0] = at[0] + (first[0] * share);
            middle[1] = at[1] + (first[1] * share);
            scale = (REAL)1 / SQRT((middle[0] * middle[0]) + (middle[1] * middle[1]));
            middle[0] *= scale;
            middle[1] *= scale;
            return count;
        }
    }
    return -1;
}

#if BOUNDED
/* Gaussian elimination of the first n columns of a complex matrix (entries: real and imaginary part) with partial pivoting. Multiplies
 * `sign` by the pivots over their magnitudes, and by -1 for an exchange of rows. Returns the least magnitude of a pivot, at most 1. */
LOCAL REAL ik_6r_complex_lu(REAL a[6][9][2], int n, int columns, REAL sign[2])
{
    REAL least = (REAL)1;
    int i;
    int j;
    int k;
    for (k = 0; k < n; ++k) {
        REAL best = (REAL)-1;
        REAL size;
        REAL u;
        REAL v;
        REAL x;
        int pivot = k;
        for (i = k; i < 6; ++i) {
            size = (a[i][k][0] * a[i][k][0]) + (a[i][k][1] * a[i][k][1]);
            pivot = (size > best) ? i : pivot;
            best = (size > best) ? size : best;
        }
        for (j = k; j < columns; ++j) {
            for (i = 0; i < 2; ++i) {
                x = a[pivot][j][i];
                a[pivot][j][i] = a[k][j][i];
                a[k][j][i] = x;
            }
        }
        size = SQRT(best) + IK_6R_TINY;
        least = (size < least) ? size : least;
        u = a[k][k][0] / size;
        v = a[k][k][1] / size;
        x = (pivot == k) ? (REAL)1 : (REAL)-1;
        best = x * ((sign[0] * u) - (sign[1] * v));
        sign[1] = x * ((sign[0] * v) + (sign[1] * u));
        sign[0] = best;
        u /= size; /* the inverse of the pivot is u - i v */
        v /= size;
        for (i = k + 1; i < 6; ++i) {
            const REAL re = (a[i][k][0] * u) + (a[i][k][1] * v);
            const REAL im = (a[i][k][1] * u) - (a[i][k][0] * v);
            for (j = k + 1; j < columns; ++j) {
                a[i][j][0] -= (re * a[k][j][0]) - (im * a[k][j][1]);
                a[i][j][1] -= (re * a[k][j][1]) + (im * a[k][j][0]);
            }
        }
    }
    return least;
}

/* Phase of the 12 x 12 determinant at the complex kept angle with cosine and sine given (real and imaginary parts each), as a complex
 * number of magnitude 1. Returns the least magnitude of a pivot, see ik_6r_reduce. */
LOCAL REAL ik_6r_phase(REAL h[3][6][10], const REAL cosine[2], const REAL sine[2], REAL phase[2])
{
    REAL side[2][6][9][2];
    REAL rest[6][9][2];
    REAL least = (REAL)1;
    REAL size;
    int i;
    int j;
    int k;
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 9; ++j) {
            for (k = 0; k < 2; ++k) {
                const REAL x = ((k == 0) ? h[0][i][j] : (REAL)0) + (cosine[k] * h[1][i][j]) + (sine[k] * h[2][i][j]);
                side[0][i][j][k] = x;
                side[1][i][(j < 6) ? (j + 3) : (j - 6)][k] = x;
            }
        }
    }
    phase[0] = (REAL)1;
    phase[1] = (REAL)0;
    for (k = 0; k < 2; ++k) {
        size = ik_6r_complex_lu(side[k], 3, 9, phase);
        least = (size < least) ? size : least;
        for (i = 0; i < 3; ++i) {
            for (j = 0; j < 6; ++j) {
                rest[(3 * k) + i][j][0] = side[k][3 + i][3 + j][0];
                rest[(3 * k) + i][j][1] = side[k][3 + i][3 + j][1];
            }
        }
    }
    size = ik_6r_complex_lu(rest, 6, 6, phase);
    return (size < least) ? size : least;
}

/* Upper bound of the number of roots on the unit circle z = exp(i x), complex solutions with a real kept angle included: 16 less twice
 * the number of roots inside a smaller circle, since roots lie in pairs z, 1/conj(z). That number is the winding number of the
 * determinant on the smaller circle, plus 8, for its pole at zero. The determinant is evaluated at points of that circle, which come
 * closer where its phase turns fast, not interpolated: its phase is accurate where the least pivot is far above rounding, even if the
 * polynomial is below its noise. Ends at a bound of `enough` or less. */
LOCAL int ik_6r_bound(REAL h[3][6][10], int enough)
{
    static const REAL radius[3] = {(REAL)0.85, (REAL)0.7, (REAL)0.93}; /* nearer to the unit circle, rounding moves real roots of a cluster inside */
    static const REAL turn[6][2] = { /* by 1/32 .. 1/1024 of the circle */
        {(REAL)0.9807852804032304, (REAL)0.19509032201612825}, {(REAL)0.9951847266721969, (REAL)0.0980171403295606},
        {(REAL)0.9987954562051724, (REAL)0.049067674327418015}, {(REAL)0.9996988186962042, (REAL)0.024541228522912288},
        {(REAL)0.9999247018391445, (REAL)0.012271538285719925}, {(REAL)0.9999811752826011, (REAL)0.006135884649154475}};
    int bound = IK_6R_MAX;
    int ring;
    for (ring = 0; (ring < 3) && (bound > enough); ++ring) {
        const REAL near = (REAL)0.5 * (((REAL)1 / radius[ring]) + radius[ring]);
        const REAL far = (REAL)0.5 * (radius[ring] - ((REAL)1 / radius[ring]));
        REAL at[2] = {(REAL)1, (REAL)0};
        REAL before[2] = {(REAL)1, (REAL)0};
        REAL turned = (REAL)0;
        int fine = 0;
        int done = 0;
        int left;
        int clear = 1;
        for (left = VALUE_6R_POINTS; (clear != 0) && (done < 1024);) { /* ends: `clear` falls when no points are left */
            const REAL c = (left == VALUE_6R_POINTS) ? at[0] : ((at[0] * turn[fine][0]) - (at[1] * turn[fine][1]));
            const REAL s = (left == VALUE_6R_POINTS) ? at[1] : ((at[1] * turn[fine][0]) + (at[0] * turn[fine][1]));
            const REAL cosine[2] = {near * c, far * s};
            const REAL sine[2] = {near * s, -far * c};
            REAL phase[2];
            REAL step;
            clear = (int)((ik_6r_phase(h, cosine, sine, phase) > ((REAL)VALUE_6R_PIVOT * IK_6R_EPS)) && (left > 0));
            step = ik_atan2((phase[1] * before[0]) - (phase[0] * before[1]), (phase[0] * before[0]) + (phase[1] * before[1]));
            if (left-- < VALUE_6R_POINTS) {
                if (FABS(step) > (REAL)VALUE_6R_PHASE) {
                    clear &= (int)(fine < 5);
                    ++fine;
                    continue;
                }
                turned += step;
                done += 32 >> (unsigned)fine;
                fine -= (int)((fine > 0) && (FABS(step) < (REAL)(0.4 * VALUE_6R_PHASE)) && ((done % (64 >> (unsigned)fine)) == 0));
            }
            at[0] = c;
            at[1] = s;
            before[0] = phase[0];
            before[1] = phase[1];
        }
        if (clear != 0) {
            const int inside = 8 + (int)FLOOR((turned * (REAL)0.15915494309189535) + (REAL)0.5);
            bound = ((IK_6R_MAX - (2 * inside)) < bound) ? (IK_6R_MAX - (2 * inside)) : bound;
        }
    }
    return bound;
}
#endif

/* One elimination: adds its solutions. Returns how many solutions there are by its roots, a double one counting twice; -1 if that is
 * not known. The count is exact for simple roots. Unresolved ones are counted together by the winding number of the polynomial around
 * them, from which the complex solutions that share them are subtracted. h: its equations, see ik_6r_pencil. */
LOCAL int ik_6r_eliminate(const REAL pose[12], const signed char pass[6], REAL noise, REAL h[3][6][10],
    REAL rows[IK_6R_MAX + 1][6][2], int *count, int *plain)
{
    REAL e[6][12];
    REAL zone[IK_6R_ZONES][3];
    REAL seen[12];
    REAL simple[24][2];
    REAL circle[24][3];
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
    zone[0][0] = (REAL)1;
    zone[0][1] = (REAL)0;
    zone[0][2] = (REAL)1;
    ik_6r_product(pose, ik_6r_nudge[pass[5]], seen);
    ik_6r_loop(seen, pass[0], pass[1], e);
    ik_6r_pencil(e, pass, h);
    for (at = 0; at < zones; ++at) {
        REAL root[25][3];
        REAL p[2][9];
        REAL level;
        int order[25];
        int begin = -1;
        int empty = 1;
        int roots = ik_6r_scan(h, zone[at], noise, p, &level, root, order);
        known &= (int)(roots < 24); /* otherwise some may have been left out */
        for (k = 0; (k < roots) && (root[k][2] > (REAL)0.8); ++k) {
        }
        *plain = ((at == 0) && (roots > 0) && (k == roots) && (pass[5] == 0)) ? -1 : *plain; /* zero all round: a continuum */
        for (k = 0; k < roots; ++k) { /* clusters of unresolved roots become zones, magnified and solved again */
            int joined = 0;
            const REAL blur = root[k][2];
            const REAL reaches = root[k][0] + (FABS(root[k][1]) * blur) + ((REAL)0.5 * blur * blur);
            if ((order[k] == 1) || ((at > 0) && (reaches < IK_6R_EDGE)) || (zone[at][2] < (REAL)VALUE_6R_NARROWEST) || (zones == IK_6R_ZONES)) {
                continue; /* simple; beyond the edge of this zone; or as narrow as can be */
            }
            begin = (begin < 0) ? k : begin;
            if (((k + 1) < roots) && (order[k + 1] == 2)) {
                const REAL reach = root[k][2] + root[k + 1][2] + (REAL)VALUE_6R_JOINED;
                joined = (int)(((REAL)1 - (root[k][0] * root[k + 1][0]) - (root[k][1] * root[k + 1][1])) < ((REAL)0.5 * reach * reach));
#if BOUNDED
                if ((joined != 0) && (ik_6r_zone(zone[at], root + begin, k - begin + 2, zone[zones]) == 0)) { /* too wide to be magnified at once */
                    joined = 0;
                    known = 0; /* of two roots on the seam either zone may leave one to the other: only ik_6r_bound can tell */
                }
#endif
            }
            if (joined == 0) {
                zones += ik_6r_zone(zone[at], root + begin, k - begin + 1, zone[zones]);
                begin = -1;
            }
        }
        root[roots][0] = (REAL)1; /* in a zone without a real root try its centre: its roots may be complex only by rounding */
        root[roots][1] = (REAL)0;
        root[roots][2] = (REAL)0;
        order[roots] = 2;
        for (k = 0; k <= roots; ++k) {
            const bool middle = k == roots;
            const int before = *count;
            int m;
            int inside;
            int here = (int)(middle ? ((at > 0) && (empty != 0)) : ((at == 0) || (root[k][0] > IK_6R_EDGE)));
            REAL cs[2];
            (void)ik_6r_magnify(zone[at], root[k], cs);
            for (m = 1; m < zones; ++m) { /* a root inside a narrower zone is left to that zone, which resolves it better */
                here &= (int)(!(((zone[m][2] < zone[at][2]) || ((m > at) && (zone[m][2] <= zone[at][2]))) && (FABS(ik_6r_tangent(zone[m], cs)) <= ((REAL)VALUE_6R_INSIDE * zone[m][2]))));
            }
            if (here == 0) {
                continue;
            }
            empty = 0;
            if (order[k] == 1) {
                (void)ik_6r_rows(pose, pass, e, h, cs, 1, &left, &taken, rows, count);
                known &= (int)(singles < 24);
                simple[singles % 24][0] = cs[0];
                simple[singles % 24][1] = cs[1];
                ++singles;
                continue;
            }
            *plain = -(int)(*plain < 0);
            inside = 0;
            for (m = 0; m < circles; ++m) { /* counted with an earlier one? */
                const REAL x = root[k][0] - circle[m][0];
                const REAL y = root[k][1] - circle[m][1];
                const REAL r = circle[m][2] - root[k][2];
                inside |= (int)((of[m] == at) && (r > (REAL)0) && (((x * x) + (y * y)) < (r * r)));
            }
            (void)ik_6r_rows(pose, pass, e, h, cs, 2, &left, &taken, rows, count);
            if ((inside == 0) && (!middle || (*count > before))) {
                REAL mean[2];
                REAL *const radius = circle[circles % 24] + 2;
                int turns;
                *radius = (((REAL)1.5 * root[k][2]) > (REAL)VALUE_6R_CIRCLE) ? ((REAL)1.5 * root[k][2]) : (REAL)VALUE_6R_CIRCLE;
                turns = (circles < 24) ? ik_6r_wind(p, level, root[k], radius, mean) : -1;
                if (turns > 0) {
                    circle[circles][0] = root[k][0];
                    circle[circles][1] = root[k][1];
                    of[circles] = at;
                    (void)ik_6r_magnify(zone[at], mean, mean);
                    total += turns - ik_6r_rows(pose, pass, e, h, mean, 2, &left, &taken, rows, count);
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
            const REAL t = ik_6r_tangent(zone[of[m]], simple[k]) / zone[of[m]][2];
            const REAL w = (REAL)1 / ((REAL)1 + (t * t));
            const REAL x = (((REAL)1 - (t * t)) * w) - circle[m][0];
            const REAL y = ((REAL)2 * t * w) - circle[m][1];
            inside |= (int)(((x * x) + (y * y)) < (circle[m][2] * circle[m][2]));
        }
        total += (int)((inside == 0));
    }
    return ((known != 0) && (total >= 0) && ((total % 2) == 0)) ? total : -1;
}

/* Lower bound of the smallest singular value of the Jacobian at a solution (lengths scaled), at least a third of it: the inverse of the
 * norm of its inverse. joint: the one that moves most in the direction in which the tip moves least. */
LOCAL REAL ik_6r_gain(const REAL pose[12], REAL cs[6][2], int *joint)
{
    REAL r[6];
    REAL jac[6][6];
    REAL a[6][12];
    REAL norm = (REAL)0;
    REAL most = (REAL)0;
    int i;
    int j;
    int k;
    (void)ik_6r_residual(pose, cs, r, jac);
    for (i = 0; i < 6; ++i) {
        for (j = 0; j < 6; ++j) {
            a[i][j] = jac[i][j];
            a[i][6 + j] = (REAL)(i == j);
        }
    }
    for (k = 0; k < 6; ++k) {
        int pivot = k;
        REAL scale;
        for (i = k + 1; i < 6; ++i) {
            pivot = (FABS(a[i][k]) > FABS(a[pivot][k])) ? i : pivot;
        }
        for (j = 0; j < 12; ++j) {
            const REAL x = a[pivot][j];
            a[pivot][j] = a[k][j];
            a[k][j] = x;
        }
        scale = a[k][k];
        scale = (FABS(scale) > (IK_6R_EPS * IK_6R_EPS)) ? scale : (IK_6R_EPS * IK_6R_EPS);
        for (j = 0; j < 12; ++j) {
            a[k][j] /= scale;
        }
        for (i = 0; i < 6; ++i) {
            const REAL factor = a[i][k];
            for (j = 0; (j < 12) && (i != k); ++j) {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    for (j = 0; j < 6; ++j) {
        REAL moved = (REAL)0;
        for (i = 0; i < 6; ++i) {
            moved += a[i][6 + j] * a[i][6 + j];
        }
        norm += moved;
        *joint = (moved > most) ? j : *joint;
        most = (moved > most) ? moved : most;
    }
    return (REAL)1 / SQRT(norm);
}

/* Moves one joint of a solution by `by` (rad or scaled length) and the others after it, such that the pose is met to within twice the
 * rounding error. Returns 0 if it cannot be. */
LOCAL int ik_6r_follow(const REAL pose[12], int joint, REAL by, REAL cs[6][2])
{
    REAL step[6] = {0};
    REAL r[6];
    REAL jac[6][6];
    int it;
    int i;
#if DH_SLIDES
    if (joint == DH_SLIDE) {
        cs[joint][0] += by;
    } else
#endif
    {
        const REAL x = cs[joint][0];
        const REAL y = cs[joint][1];
        const REAL c = COS(by);
        const REAL s = SIN(by);
        cs[joint][0] = (x * c) - (y * s);
        cs[joint][1] = (y * c) + (x * s);
    }
    for (it = 0; it <= IK_6R_STEPS; ++it) {
        ik_6r_move(cs, step);
        if (ik_6r_residual(pose, cs, r, jac) < ((REAL)2 * IK_6R_DONE)) {
            return 1;
        }
        for (i = 0; i < 6; ++i) {
            jac[joint][i] = (REAL)0;
        }
        ik_6r_step(jac, r, IK_6R_EPS, step);
    }
    return 0;
}

/* Whether a singular solution is one of a continuum, in which a joint can turn freely. If so it becomes the one with that joint at its
 * reference (of all six joints: rad or scaled length), if a path of solutions leads there. */
LOCAL int ik_6r_free(const REAL pose[12], int joint, const REAL ref[6], REAL cs[6][2])
{
    REAL x[6][2];
    REAL by = (REAL)0.01;
    int side;
    int i;
    for (side = 0; side < 2; ++side) {
        for (i = 0; i < 12; ++i) {
            x[i / 2][i % 2] = cs[i / 2][i % 2];
        }
        if (ik_6r_follow(pose, joint, by, x) != 0) {
            break;
        }
        by = -by;
    }
    if (side == 2) {
        return 0;
    }
    for (i = 0; i < 12; ++i) {
        x[i / 2][i % 2] = cs[i / 2][i % 2];
    }
#if DH_SLIDES
    by = (joint == DH_SLIDE) ? (ref[joint] - cs[joint][0]) : ik_wrap(ref[joint] - ik_atan2(cs[joint][1], cs[joint][0]));
#else
    by = ik_wrap(ref[joint] - ik_atan2(cs[joint][1], cs[joint][0]));
#endif
    for (side = 0; (side < VALUE_PATH_STEPS) && (ik_6r_follow(pose, joint, by / (REAL)VALUE_PATH_STEPS, x) != 0); ++side) {
    }
    for (i = 0; (i < 12) && (side == VALUE_PATH_STEPS); ++i) {
        cs[i / 2][i % 2] = x[i / 2][i % 2];
    }
    return 1;
}

/* Number of solutions, a double one counting twice: a solution at which the Jacobian is singular, unless its other half is listed as
 * well. */
LOCAL int ik_6r_weigh(const REAL gain[IK_6R_MAX], REAL rows[IK_6R_MAX + 1][6][2], int count)
{
    int i;
    int k;
    int total = count;
    for (i = 0; i < count; ++i) {
        int alone = (int)(gain[i] < (REAL)VALUE_6R_DOUBLE);
        for (k = 0; k < count; ++k) {
            alone &= (int)((k == i) || !(gain[k] < (REAL)VALUE_6R_DOUBLE) || (ik_6r_apart(rows[i], rows[k]) > (REAL)VALUE_6R_TWINS));
        }
        total += alone;
    }
    return total;
}

/* Finds all joint angles (rad, in (-pi, pi]) with Rz(q1)Tz(d1)Tx(a1)Rx(alpha1) .. Rz(q6)Tz(d6)Tx(a6)Rx(alpha6) = t (row-major
 * 4 x 4); a prismatic joint has Tz(q)Rz(theta) for Rz(q)Tz(d). A solution that is one of a continuum is flagged IK_FREE, and has the free
 * joint at its value in ref if it can. Returns the number of solutions. *certain: these are all. That is so if their number is the one
 * that an elimination at the target counts, or at a pose nearby if no solution is so near a singular configuration that the number
 * there may differ. */
LOCAL int ik_solve6r(const REAL t[16], const REAL ref[6], REAL q[IK_6R_MAX][6], unsigned flags[IK_6R_MAX], int *certain)
{
    REAL pose[12];
    REAL h[3][6][10];
    REAL rows[IK_6R_MAX + 1][6][2];
    REAL gain[IK_6R_MAX];
    int i;
    int j;
    int count = 0;
    int pass;
    int here = -1;
    int plain = 1;
    int joint = 0;
    for (i = 0; i < 9; ++i) {
        pose[i] = t[i + (i / 3)];
    }
    for (i = 0; i < 3; ++i) {
        pose[9 + i] = t[(4 * i) + 3] * (REAL)PER_LENGTH;
    }
    *certain = 0;
    for (pass = 0; (pass < PASSES) && !*certain; ++pass) {
        const int total = ik_6r_eliminate(pose, ik_6r_pass[pass], ik_6r_noise[pass], h, rows, &count, &plain);
        const bool moved = ik_6r_pass[pass][5] != 0;
        here = moved ? here : total;
        *certain = (int)(count == here);
        if (!*certain) {
            REAL least = (REAL)1;
            int steady;
            for (i = 0; i < count; ++i) {
                gain[i] = ik_6r_gain(pose, rows[i], &joint);
                least = (gain[i] < least) ? gain[i] : least;
            }
            steady = (int)(moved && (plain >= 0) && (count > 0) && (least > (REAL)VALUE_6R_STEADY));
            *certain = (int)((ik_6r_weigh(gain, rows, count) == here) || ((steady != 0) && (count == total)));
#if BOUNDED
            /* The determinant itself may tell what its polynomial does not, of regular solutions only: it counts no continuum. */
            if (!*certain && ((steady != 0) || (!moved && (least > (REAL)VALUE_6R_DOUBLE)))) {
                *certain = (int)(ik_6r_bound(h, count) == count);
            }
#endif
        }
    }
    for (i = 0; i < count; ++i) {
        flags[i] = 0u; /* the Jacobian decides whether solutions meet, see ik_aspect */
        if ((plain < 1) && (ik_6r_gain(pose, rows[i], &joint) < (REAL)VALUE_6R_DOUBLE)) {
            flags[i] = (ik_6r_free(pose, joint, ref, rows[i]) != 0) ? (unsigned)IK_FREE : 0u;
        }
        for (j = 0; j < 6; ++j) {
            const REAL x = ik_atan2(rows[i][j][1], rows[i][j][0]);
            q[i][j] = (x > (REAL)-3.141592653589793) ? x : (REAL)3.141592653589793;
        }
#if DH_SLIDES
        q[i][DH_SLIDE] = rows[i][DH_SLIDE][0] * (REAL)LENGTH;
#endif
    }
    return count;
}
