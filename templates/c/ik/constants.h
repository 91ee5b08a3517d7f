/* Tolerances and inner flags, for all kernels. The values stand in one table, rrrgen/ik/tolerances.py. */
#include "settings.h"
/* Tolerances: relative to the reach for lengths, absolute for angles. */
#define IK_TOL_REACH (REAL)VALUE_REACH
#define IK_TOL_EPS (REAL)VALUE_EPS
#define IK_TOL_FREE (REAL)VALUE_FREE /* a direction shorter than this is none: the joint is free */
#define IK_TOL_DOUBT (REAL)VALUE_DOUBT /* a direction shorter than this may be none, as accurate as the target is */
#define IK_TOL_MERGE (REAL)VALUE_MERGE /* square of the half angle between roots that may be one */
#define IK_TOL_SAME (REAL)VALUE_SAME /* rows nearer than this are one */
#define IK_TOL_SLACK (REAL)VALUE_SLACK /* a discriminant this far below zero is still tried */
#define IK_TOL_CIRCLE (REAL)VALUE_CIRCLE /* square of the distance from the unit circle of a double root */
#define IK_TOL_TIGHT (REAL)VALUE_TIGHT /* squared error above which a row is refined */
#define IK_TOL_ACCEPT (REAL)VALUE_ACCEPT /* squared error above which a row is dropped */
#if BANDED
#define IK_TOL_BAND (REAL)VALUE_BAND /* square of half the angle that nearly double roots are moved apart */
#endif
#if VIRTUAL
#define IK_TOL_LOOSE (REAL)VALUE_LOOSE /* squared error above which a row is not even refined */
#endif
#define IK_TOL_DONE (REAL)VALUE_DONE
#define IK_TOL_ORTHONORMAL (REAL)VALUE_ORTHONORMAL
#define IK_TOL_LIMIT (REAL)VALUE_LIMIT
#define IK_PUBLIC 15u /* the flags that are handed out */
#define IK_NEAR 16u /* inner flag: a root of this row may be double */
#if OPENED
#define IK_OPEN OPEN_BITS /* inner flags, 256 << joint: the vector that decides the joint is short; 65536 << joint: free */
#define IK_HELD(flags) (((flags) >> 16) & 0x7fu) /* the joints that are free */
#define IK_GONE 32u /* inner flag: another row stands for this one */
#define IK_FIXED 64u /* inner flag: refined already, with the free joint held */
#endif
