/* All solutions for many targets. Needs solve.c. */
#include "kernel.h"
void robot_inverse_kinematics_batch(
    size_t count, const REAL *RESTRICT targets, const REAL *RESTRICT q_ref REDUNDANCIES_PARAMETER, unsigned options,
    REAL *RESTRICT q, int *RESTRICT counts, unsigned *flags, unsigned *branch, int *statuses, REAL *distances)
{
    size_t k;
    for (k = 0; k < count; ++k) {
        ik_solutions out;
        const ik_status status = robot_inverse_kinematics(targets + (TARGET * k), q_ref REDUNDANCY_K, options, &out);
        int i;
        int j;
        counts[k] = out.count;
        for (i = 0; i < out.count; ++i) {
            for (j = 0; j < JOINTS; ++j) {
                q[(((k * ROWS) + (size_t)i) * JOINTS) + (size_t)j] = out.q[i][j];
            }
            if (flags) {
                flags[(k * ROWS) + (size_t)i] = out.flags[i];
            }
            if (branch) {
                branch[(k * ROWS) + (size_t)i] = out.branch[i];
            }
        }
        if (statuses) {
            statuses[k] = (int)status;
        }
        if (distances) {
            distances[k] = out.distance;
        }
    }
}
