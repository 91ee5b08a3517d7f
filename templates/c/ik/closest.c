/* The nearest configuration to a target. Needs settle.c and descend.c. */
#include "kernel.h"
ik_status robot_closest(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    ik_solutions *RESTRICT out)
{
    static const REAL zero[JOINTS] = {0};
    const REAL *const ref = (q_ref != NULL) ? q_ref : zero;
    REAL T[TARGET];
    ik_status status = ik_check(target, q_ref REDUNDANCY, T);
    out->count = 0;
    out->stage = 0;
    out->distance = (REAL)0;
    if (status != IK_OK) {
        return status;
    }
    if (ik_far(T) != 0) {
        out->stage = FAR_STAGE;
        out->distance = (REAL)-1;
        return IK_UNREACHABLE;
    }
    (void)ik_descend(T, ref REDUNDANCY, out);
    out->count = 1;
    (void)ik_finish(TARGET_FIRST ref, options, out);
    return (out->count == 1) ? IK_OK : IK_OUTSIDE_LIMITS;
}
