/* Angles: reduction to (-pi, pi], and atan2 without branches and tables. */
#include "kernel.h"
/* Reduces an angle (rad) to (-pi, pi]. */
LOCAL REAL ik_wrap(REAL x)
{
    /* enough for |x| up to 3 pi */
    x -= (x > (REAL)3.141592653589793) ? (REAL)6.283185307179586
                                       : ((x <= (REAL)-3.141592653589793) ? (REAL)-6.283185307179586 : (REAL)0);
    if ((x > (REAL)3.141592653589793) || (x <= (REAL)-3.141592653589793)) {
        x -= (REAL)6.283185307179586 * FLOOR((x * (REAL)0.15915494309189535) + (REAL)0.5);
    }
    return x;
}
#if NEEDS_OPPOSITE

/* x +- pi in (-pi, pi], for x in (-pi, pi]. */
LOCAL REAL ik_opposite(REAL x)
{
    return (x > (REAL)0) ? (x - (REAL)3.141592653589793) : (x + (REAL)3.141592653589793);
}
#endif

#if NEEDS_ATAN2
/* atan2(y, x) in rad with an error of at most 2.7 ulp; pi/2 at the origin. Without branches and tables, so that compilers can
 * vectorize it; the same bits on every machine that rounds each operation. The result is start + turn * arc: start is a multiple
 * of pi/4, turn is +1 or -1 and the arc at most pi/8; start and arc are computed in parallel. */
LOCAL_INLINE REAL ik_atan2(REAL y, REAL x)
{
    const REAL ax = FABS(x);
    const REAL ay = FABS(y);
    const REAL small = (ax < ay) ? ax : ay;
    const REAL large = (ax > ay) ? ax : ay;
    const REAL sense = COPYSIGN((REAL)1, (REAL)0 + y); /* +1 for y = -0 */
    const REAL front = COPYSIGN((REAL)1, x);
    const REAL flat = -COPYSIGN((REAL)1, ay - ax);
    const REAL half = COPYSIGN((REAL)0.5, ((REAL)0.41421356237309503 * large) - small);
    const REAL beyond = (REAL)0.5 - half; /* tan(pi/8) */
    const REAL axis = flat * ((REAL)0.5 + half); /* the arc is measured from the x axis (1), the diagonal (0) or the y axis (-1) */
    const REAL start = sense * ((REAL)1.5707963267948966 - (front * ((REAL)0.7853981633974483 + ((REAL)0.7853981633974483 * axis))));
    const REAL turn = sense * front * flat;
    const REAL t = (small - (beyond * large)) / (large + (REAL)VALUE_TINY + (beyond * small)); /* the tiny constant avoids 0 / 0 */
    const REAL s = turn * t;
    const REAL u = t * t;
    const REAL v = u * u;
    const REAL w = v * v;
    const REAL p0 = (REAL)-0.333333333333332 + (u * (REAL)0.19999999999953244);
    const REAL p1 = (REAL)-0.14285714280166237 + (u * (REAL)0.11111110782140723);
    const REAL p2 = (REAL)-0.09090897724893458 + (u * (REAL)0.07692059711868017);
    const REAL p3 = (REAL)-0.06663099148471298 + (u * (REAL)0.05847858920620302);
    const REAL p4 = (REAL)-0.050391890304237796 + (u * (REAL)0.038062108726007564) + (v * (REAL)-0.017905009476816506);
    return start + (s + (s * u * ((p0 + (v * p1)) + (w * ((p2 + (v * p3)) + (w * p4))))));
}
#endif
#if NEEDS_ARCS

/* atan2 of count pairs of sine and cosine; the loop is written so that compilers vectorize it. */
LOCAL void ik_arcs(int count, const REAL *RESTRICT sine, const REAL *RESTRICT cosine, REAL *RESTRICT angle)
{
    int i;
    for (i = 0; i < count; ++i) {
        angle[i] = ik_atan2(sine[i], cosine[i]);
    }
}
#endif
