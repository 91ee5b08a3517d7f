/*
 * A control loop on a Cortex-M4F or M7 under QEMU: computed torque and the momentum observer at 1 kHz against the emitted
 * plant. Prints the largest tracking error, the instructions of one tick, and its stack; QEMU must count instructions
 * (-icount shift=0: one per nanosecond).
 *
 * With -DTRACE every tenth tick also prints a line: seconds, and for each joint its reference, position and torque.
 *
 * Compile with -DROBOT=rrr -DHEADER='"rrr.h"' and the C of  rrrgen generate rrr -o DIR --real float --with control,observer
 */
#include HEADER

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#define JOINED(a, b) a##_##b
#define OF(a, b) JOINED(a, b)
#define CALL(name) OF(ROBOT, name)

typedef CALL(real) real;

#define TICKS 1000
#define PERIOD 1e-3f
#define BANDWIDTH 20.0f
#define NANOSECONDS_PER_COUNT 40u /* SysTick runs at 25 MHz on these boards */
#define PAINTED 4096              /* words below the stack pointer whose use is looked for */
#define PAINT 0xA5A5A5A5u

static volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010u; /* control, reload, value */

typedef struct {
    real q[JOINTS], dq[JOINTS], q_d[JOINTS], dq_d[JOINTS], ddq_d[JOINTS];
    real tau[JOINTS], z[JOINTS], r[JOINTS], p[JOINTS], u[JOINTS];
} state;

static real beta[PARAMETERS], friction[FRICTION], width[JOINTS], kp[JOINTS], kd[JOINTS], ki[JOINTS], tau_max[JOINTS];

/* What runs on the controller every tick. */
static __attribute__((noinline)) void tick(state *s, int first)
{
    real z[JOINTS], r[JOINTS], p[JOINTS], u[JOINTS];
    int i;
    if (!first) { /* the first period has not passed yet */
        CALL(momentum_observer)(s->q, s->dq, s->tau, width, s->p, s->u, s->r, 50.0f, PERIOD, beta, friction, r, p, u);
        for (i = 0; i < JOINTS; i++) {
            s->r[i] = r[i];
            s->p[i] = p[i];
            s->u[i] = u[i];
        }
    }
    CALL(computed_torque)(s->q, s->dq, s->q_d, s->dq_d, s->ddq_d, kp, kd, ki, s->z, width, PERIOD, beta, friction, tau_max,
                          s->tau, z);
    for (i = 0; i < JOINTS; i++) {
        s->z[i] = z[i];
    }
}

static void reference(state *s, real t)
{
    int i;
    for (i = 0; i < JOINTS; i++) {
        const real w = 1.0f + 0.25f * (real)i, size = 0.5f;
        s->q_d[i] = size * (1.0f - cosf(w * t));
        s->dq_d[i] = size * w * sinf(w * t);
        s->ddq_d[i] = size * w * w * cosf(w * t);
    }
}

/* Words of stack that tick() used, by painting what lies below. */
static __attribute__((noinline)) uint32_t stack_of_tick(state *s)
{
    volatile uint32_t here, *const bottom = &here - PAINTED;
    uint32_t i;
    for (i = 0; i < PAINTED - 64; i++) {
        bottom[i] = PAINT;
    }
    tick(s, 0);
    for (i = 0; i < PAINTED && bottom[i] == PAINT; i++) {
    }
    return PAINTED - i;
}

int main(void)
{
    static state s;
    real worst = 0.0f, external = 0.0f;
    uint32_t counts = 0, stack;
    int k, i;
    CALL(nominal_parameters)(beta);
    for (i = 0; i < JOINTS; i++) {
        width[i] = 0.01f;
        kp[i] = BANDWIDTH * BANDWIDTH;
        kd[i] = 2.0f * BANDWIDTH;
        tau_max[i] = 1e6f;
    }
    reference(&s, 0.0f);
    CALL(momentum_observer_start)(s.q, s.dq, width, beta, friction, s.p, s.u);
    systick[1] = 0xFFFFFFu;
    systick[0] = 5u; /* on, by the clock of the processor */
    for (k = 0; k < TICKS; k++) {
        real ddq[JOINTS];
        uint32_t before;
        reference(&s, (real)k * PERIOD);
        systick[2] = 0u;
        before = systick[2];
        tick(&s, k == 0);
        counts += (before - systick[2]) & 0xFFFFFFu;
#ifdef TRACE
        if (k % 10 == 0) {
            printf("%.3f", (double)((real)k * PERIOD));
            for (i = 0; i < JOINTS; i++) {
                printf(" %.6f %.6f %.4f", (double)s.q_d[i], (double)s.q[i], (double)s.tau[i]);
            }
            printf("\n");
        }
#endif
        (void)CALL(forward_dynamics)(s.q, s.dq, s.tau, beta, ddq);
        for (i = 0; i < JOINTS; i++) {
            const real error = fabsf(s.q_d[i] - s.q[i]);
            worst = error > worst ? error : worst;
            external = fabsf(s.r[i]) > external ? fabsf(s.r[i]) : external;
            s.dq[i] += PERIOD * ddq[i];
            s.q[i] += PERIOD * s.dq[i];
        }
    }
    stack = stack_of_tick(&s);
    printf("error %.2e rad, external torque at most %.2e, instructions %lu, stack %lu bytes\n", (double)worst, (double)external,
           (unsigned long)(counts * (uint64_t)NANOSECONDS_PER_COUNT / TICKS), (unsigned long)(4u * stack));
    return worst < 0.02f ? 0 : 1;
}
