/* The task error of a configuration and its Jacobian, by forward kinematics. */
#include "kernel.h"
/* Constant transforms of the chain before joint 1, between the joints and after the last one: 3 x 4 matrices, row by row. */
static const REAL ik_fixed[TRANSFORMS][12] = FIXED;
#if OFFSETS
static const REAL ik_offset[JOINTS] = OFFSET_VALUES;
#endif

/* x = x f: product of two rigid transforms, stored as 3 x 4 matrices row by row. */
LOCAL void ik_advance(REAL x[12], const REAL f[12])
{
    REAL y[12];
    int i;
    int j;
    for (i = 0; i < 3; ++i) {
        for (j = 0; j < 4; ++j) {
            y[(4 * i) + j] = (x[4 * i] * f[j]) + (x[(4 * i) + 1] * f[4 + j]) + (x[(4 * i) + 2] * f[8 + j]) + ((j == 3) ? x[(4 * i) + 3] : (REAL)0);
        }
    }
    for (i = 0; i < 12; ++i) {
        x[i] = y[i];
    }
}

#if OPENED
/* Task error e = target - forward kinematics (position over the reach, rotation in rad) and its Jacobian J, with zero columns
 * for the joints that are held (bits). Returns the squared error |e|^2. */
#else
/* Task error e = target - forward kinematics (position over the reach, rotation in rad) and its Jacobian J. Returns the squared
 * error |e|^2. */
#endif
LOCAL REAL ik_error(const REAL *T, const REAL *q, REAL e[ERRORS], REAL J[ERRORS][JOINTS] HELD_PARAMETER)
{
    REAL x[12];
    REAL axis[JOINTS][6];
    REAL cost = (REAL)0;
    int i;
    int k;
    for (i = 0; i < 12; ++i) {
        x[i] = ik_fixed[0][i];
    }
    for (k = 0; k < JOINTS; ++k) {
#if OFFSETS
        const REAL raw = q[k] + ik_offset[k];
#else
        const REAL raw = q[k];
#endif
        for (i = 0; i < 3; ++i) {
            axis[k][i] = x[(4 * i) + 2];
            axis[k][3 + i] = x[(4 * i) + 3];
        }
#if SLIDES
        if (((SLIDING >> (unsigned)k) & 1u) != 0u) {
            for (i = 0; i < 3; ++i) {
                x[(4 * i) + 3] += raw * x[(4 * i) + 2];
            }
        } else {
#endif
        {
            const REAL c = COS(raw);
            const REAL s = SIN(raw);
            for (i = 0; i < 3; ++i) {
                const REAL u = x[4 * i];
                const REAL v = x[(4 * i) + 1];
                x[4 * i] = (u * c) + (v * s);
                x[(4 * i) + 1] = (v * c) - (u * s);
            }
        }
#if SLIDES
        }
#endif
        ik_advance(x, ik_fixed[k + 1]);
    }
#if TOOL
    for (i = 0; i < 3; ++i) { /* from the frame of the last link to the tool */
        x[(4 * i) + 3] += (x[4 * i] * T[3]) + (x[(4 * i) + 1] * T[4]) + (x[(4 * i) + 2] * T[5]);
    }
#endif
    for (i = 0; i < 3; ++i) {
#if POSITION
        e[i] = (T[i] - x[(4 * i) + 3]) / IK_TOL_REACH;
#else
        e[i] = (T[(4 * i) + 3] - x[(4 * i) + 3]) / IK_TOL_REACH;
#endif
    }
#if !POSITION
    { /* rotation error as a vector along its axis with the angle (rad) as its length: E = R_target R' */
        REAL E[3][3];
        REAL s2;
        REAL c;
        int j;
        for (i = 0; i < 3; ++i) {
            for (j = 0; j < 3; ++j) {
                E[i][j] = (T[4 * i] * x[4 * j]) + (T[(4 * i) + 1] * x[(4 * j) + 1]) + (T[(4 * i) + 2] * x[(4 * j) + 2]);
            }
        }
        e[3] = (REAL)0.5 * (E[2][1] - E[1][2]);
        e[4] = (REAL)0.5 * (E[0][2] - E[2][0]);
        e[5] = (REAL)0.5 * (E[1][0] - E[0][1]);
        s2 = (e[3] * e[3]) + (e[4] * e[4]) + (e[5] * e[5]);
        c = (REAL)0.5 * (E[0][0] + E[1][1] + E[2][2] - (REAL)1);
        if (c < (REAL)VALUE_SMALL_TURN) {
            REAL f;
            if (s2 > IK_TOL_EPS) {
                f = ik_atan2(SQRT(s2), c) / SQRT(s2);
            } else { /* angle pi: every column of E + 1 is parallel to the axis, the largest one is the most accurate */
                j = (int)(E[0][0] <= E[1][1]);
                j = (E[j][j] > E[2][2]) ? j : 2;
                for (i = 0; i < 3; ++i) {
                    e[3 + i] = E[i][j] + ((i == j) ? (REAL)1 : (REAL)0);
                }
                f = (REAL)3.141592653589793 / SQRT((e[3] * e[3]) + (e[4] * e[4]) + (e[5] * e[5]));
            }
            e[3] *= f;
            e[4] *= f;
            e[5] *= f;
        }
    }
#endif
    for (i = 0; i < ERRORS; ++i) {
        cost += e[i] * e[i];
    }
    for (k = 0; k < JOINTS; ++k) {
        const REAL *z = axis[k];
        const REAL r0 = x[3] - z[3];
        const REAL r1 = x[7] - z[4];
        const REAL r2 = x[11] - z[5];
#if SLIDES
        if (((SLIDING >> (unsigned)k) & 1u) != 0u) { /* displacements are in units of the reach */
            for (i = 0; i < 3; ++i) {
                J[i][k] = z[i];
#if !POSITION
                J[3 + i][k] = (REAL)0;
#endif
            }
            continue;
        }
#endif
        J[0][k] = ((z[1] * r2) - (z[2] * r1)) / IK_TOL_REACH;
        J[1][k] = ((z[2] * r0) - (z[0] * r2)) / IK_TOL_REACH;
        J[2][k] = ((z[0] * r1) - (z[1] * r0)) / IK_TOL_REACH;
#if !POSITION
        J[3][k] = z[0];
        J[4][k] = z[1];
        J[5][k] = z[2];
#endif
    }
#if LOCKED
    for (i = 0; i < ERRORS; ++i) { /* the prescribed joint stays */
        J[i][LOCKED_JOINT] = (REAL)0;
    }
#endif
#if OPENED
    for (k = 0; k < JOINTS; ++k) {
        for (i = 0; (i < ERRORS) && (((held >> (unsigned)k) & 1u) != 0u); ++i) {
            J[i][k] = (REAL)0;
        }
    }
#endif
    return cost;
}
