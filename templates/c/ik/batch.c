/* All solutions for many targets. Needs solve.c. */
#include "kernel.h"
void robot_inverse_kinematics_batch(
    size_t count, const REAL *RESTRICT targets, const REAL *RESTRICT q_ref REDUNDANCIES_PARAMETER, unsigned options,
    REAL *RESTRICT q, int *RESTRICT counts, unsigned *flags, unsigned *branch, int *statuses, REAL *distances)
{
    size_t k;
    for (k = 0; k < count; ++k) {
        ik_solutions out;
        const ik_status status = robot_inverse_kinematics(&targets[k * (size_t)TARGET], q_ref REDUNDANCY_K, options, &out);
        int i;
        int j;
        counts[k] = out.count;
        for (i = 0; i < out.count; ++i) {
            for (j = 0; j < JOINTS; ++j) {
                q[(((k * (size_t)ROWS) + (size_t)i) * (size_t)JOINTS) + (size_t)j] = out.q[i][j];
            }
            if (flags != NULL) {
                flags[(k * (size_t)ROWS) + (size_t)i] = out.flags[i];
            }
            if (branch != NULL) {
                branch[(k * (size_t)ROWS) + (size_t)i] = out.branch[i];
            }
        }
        if (statuses != NULL) {
            statuses[k] = (int)status;
        }
        if (distances != NULL) {
            distances[k] = out.distance;
        }
    }
}
