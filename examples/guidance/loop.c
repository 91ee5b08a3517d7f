/* The scene of run.py in C: loop rrr.xml, built with rrrgen generate rrr --with controller and the library of MuJoCo. */
#include "rrr_controller.h"

#include <math.h>
#include <mujoco/mujoco.h>
#include <stdio.h>

int main(int count, char **arguments)
{
    mjModel *arm = mj_loadXML((count > 1) ? arguments[1] : "rrr.xml", NULL, NULL, 0);
    mjData *data = mj_makeData(arm);
    arm->opt.timestep = 0.001;
    rrr_controller_params params;
    rrr_controller_state state;
    rrr_controller_input in = {.mode = RRR_CONTROLLER_MODE_COMPUTED_TORQUE, .dt = 0.001};
    rrr_controller_output out;
    double start[3] = {0.0, 0.0, 0.0};
    rrr_controller_default(&params);
    params.contact_action = 2; /* stop */
    params.threshold[0] = params.threshold[1] = params.threshold[2] = 10.0;
    int fault = rrr_controller_init(&state, &params, &in);
    for (int k = 0; k < 4000 && fault == 0; k++) {
        const double s = 0.001 * k - ((k < 3000) ? 0.0 : 3.0);
        data->qfrc_applied[1] = (k / 100 == 10) ? 40.0 : ((k / 300 == 7) ? 2.0 : ((k / 300 == 8) ? -2.0 : 0.0)); /* the person */
        mju_copy(in.q, data->qpos, 3);
        mju_copy(in.dq, data->qvel, 3);
        if (k == 2000 || k == 3000) { /* the person comes to guide the arm, and leaves */
            params.contact_action = (k == 2000) ? 0 : 2;
            fault = (k == 2000) ? rrr_controller_reset(&state, &in) : 0;
            fault = fault ? fault : rrr_controller_set(&state, &params);
            in.mode = (k == 2000) ? RRR_CONTROLLER_MODE_GRAVITY : RRR_CONTROLLER_MODE_COMPUTED_TORQUE;
            mju_copy(start, in.q, 3);
        }
        for (int j = 0; j < 3; j++) {
            in.q_d[j] = start[j] + 0.3 * (1.0 - cos(s));
            in.dq_d[j] = 0.3 * sin(s);
            in.ddq_d[j] = 0.3 * cos(s);
        }
        in.sample++;
        (void)rrr_controller_step(&state, &in, &out);
        mju_copy(data->ctrl, out.tau, 3);
        printf("%d %d %.17g %.17g %.17g %.17g %.17g %.17g\n", (int)out.phase, (int)out.mode, in.q[0], in.q[1], in.q[2], out.tau[0],
               out.tau[1], out.tau[2]);
        mj_step(arm, data);
    }
    return fault != 0;
}
