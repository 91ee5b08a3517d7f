/* Tolerances and internal flags of all kernels. The values are set and explained in rrrgen/ik/tolerances.py. */
#include "settings.h"
/* Tolerances: relative to the reach for lengths, absolute for angles. */
#define IK_TOL_REACH (REAL)VALUE_REACH
#define IK_TOL_EPS (REAL)VALUE_EPS
#define IK_TOL_FREE (REAL)VALUE_FREE /* a vector shorter than this has no direction: the joint that turns it is free */
#define IK_TOL_DOUBT (REAL)VALUE_DOUBT /* a vector shorter than this may be zero but for the error of the target */
#define IK_TOL_MERGE (REAL)VALUE_MERGE /* square of the half angle between roots that may be one */
#define IK_TOL_SAME (REAL)VALUE_SAME /* solutions nearer than this are one */
#define IK_TOL_SLACK (REAL)VALUE_SLACK /* a discriminant this far below zero is still tried */
#define IK_TOL_CIRCLE (REAL)VALUE_CIRCLE /* squared distance from the unit circle at which a complex root still counts as real */
#define IK_TOL_TIGHT (REAL)VALUE_TIGHT /* squared error above which a solution is refined */
#define IK_TOL_ACCEPT (REAL)VALUE_ACCEPT /* squared error above which a solution is dropped */
#if BANDED
#define IK_TOL_BAND (REAL)VALUE_BAND /* square of half the angle that nearly double roots are moved apart */
#endif
#if VIRTUAL
#define IK_TOL_LOOSE (REAL)VALUE_LOOSE /* squared error above which a candidate is dropped without refinement */
#endif
#define IK_TOL_DONE (REAL)VALUE_DONE
#define IK_TOL_ORTHONORMAL (REAL)VALUE_ORTHONORMAL
#define IK_TOL_LIMIT (REAL)VALUE_LIMIT
#define IK_PUBLIC 15u /* mask of the flags that the caller sees; the others are internal */
#define IK_NEAR 16u /* internal flag: a root of this solution may be double */
#if GENERAL
typedef double ik_6r_real; /* the real type of the elimination, whose matrices lose too many digits in single precision */
#define IK_DOUBT 256 /* added to the stage by ik_branches: solutions may be missing */
#endif
#if OPENED
#define IK_OPEN OPEN_BITS /* internal flags, 256 << joint: the vector that determines the joint is short; 65536 << joint: it is free */
#define IK_HELD(flags) (((flags) >> 16) & 0x7fu) /* bit mask of the joints that are free */
#define IK_GONE 32u /* internal flag: dropped, because another solution replaces this one */
#define IK_FIXED 64u /* internal flag: refined already, with the free joint kept at its value */
#endif
