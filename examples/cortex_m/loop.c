/*
 * The controller of an arm on a Cortex-M4F or M7 under QEMU, at 1 kHz against the emitted plant: computed torque with the
 * momentum observer and all gates. Prints the largest tracking error and external torque, the instructions of one tick, and
 * its stack; QEMU must count instructions (-icount shift=0: one per nanosecond).
 *
 * With -DTRACE every tenth tick also prints a line: seconds, and for each joint its reference, position and torque.
 *
 * Compile with -DROBOT=rrr -DUPPER=RRR -DMODEL='"rrr.h"' -DCONTROLLER='"rrr_controller.h"' and the C of
 * rrrgen generate rrr -o DIR --real float --with controller --modes computed_torque --parts observer
 */
#include MODEL
#include CONTROLLER

#include <math.h>
#include <stdio.h>

#define JOINED(a, b, c) a##b##c
#define OF(a, b, c) JOINED(a, b, c)
#define UNIT(name) OF(ROBOT, _controller_, name)
#define CONSTANT(name) OF(UPPER, _CONTROLLER_, name)
#define N CONSTANT(N)

#define TICKS 1000
#define NANOSECONDS_PER_COUNT 40u /* SysTick runs at 25 MHz on these boards */
#define PAINTED 4096              /* words below the stack pointer whose use is looked for */
#define PAINT 0xA5A5A5A5u

static volatile uint32_t *const systick = (volatile uint32_t *)0xE000E010u; /* control, reload, value */

static UNIT(params) params;
static UNIT(state) state;
static UNIT(input) in;
static UNIT(output) out;

static void reference(float t)
{
    int i;
    for (i = 0; i < N; i++) {
        const float w = 1.0f + 0.25f * (float)i, size = 0.5f;
        in.q_d[i] = size * (1.0f - cosf(w * t));
        in.dq_d[i] = size * w * sinf(w * t);
        in.ddq_d[i] = size * w * w * cosf(w * t);
    }
}

/* Words of stack that a tick uses, by painting what lies below. */
static __attribute__((noinline)) uint32_t stack_of_tick(void)
{
    volatile uint32_t here, *const bottom = &here - PAINTED;
    uint32_t i;
    for (i = 0; i < PAINTED - 64; i++) {
        bottom[i] = PAINT;
    }
    in.sample++;
    (void)UNIT(step)(&state, &in, &out);
    for (i = 0; i < PAINTED && bottom[i] == PAINT; i++) {
    }
    return PAINTED - i;
}

int main(void)
{
    float worst = 0.0f, external = 0.0f;
    uint32_t counts = 0, faults = 0, allowed = CONSTANT(STATUS_CONTACT_UNKNOWN); /* in the first tick */
    int k, i;

    UNIT(default)(&params);
    for (i = 0; i < N; i++) { /* the reference of this test does not care about the limits of the arm */
        params.q_min[i] = -INFINITY;
        params.q_max[i] = params.tau_max[i] = INFINITY;
    }
    in.mode = CONSTANT(MODE_COMPUTED_TORQUE);
    in.dt = params.Ts;
    if (UNIT(init)(&state, &params, &in) != 0) {
        return 1;
    }
    systick[1] = 0xFFFFFFu;
    systick[0] = 5u; /* on, by the clock of the processor */
    for (k = 0; k < TICKS; k++) {
        float ddq[N];
        uint32_t before;
        reference((float)k * params.Ts);
        in.sample++;
        systick[2] = 0u;
        before = systick[2];
        faults |= UNIT(step)(&state, &in, &out) & ~allowed;
        counts += (before - systick[2]) & 0xFFFFFFu;
        allowed = 0u;
#ifdef TRACE
        if (k % 10 == 0) {
            printf("%.3f", (double)((float)k * params.Ts));
            for (i = 0; i < N; i++) {
                printf(" %.6f %.6f %.4f", (double)in.q_d[i], (double)in.q[i], (double)out.tau[i]);
            }
            printf("\n");
        }
#endif
        (void)OF(ROBOT, _, forward_dynamics)(in.q, in.dq, out.tau, params.beta, ddq); /* the arm */
        for (i = 0; i < N; i++) {
            worst = fmaxf(worst, fabsf(in.q_d[i] - in.q[i]));
            external = fmaxf(external, fabsf(out.r[i]));
            in.dq[i] += params.Ts * ddq[i];
            in.q[i] += params.Ts * in.dq[i];
        }
    }
    printf("error %.2e rad, external torque at most %.2e, instructions %lu, stack %lu bytes\n", (double)worst, (double)external,
           (unsigned long)(counts * (uint64_t)NANOSECONDS_PER_COUNT / TICKS), (unsigned long)(4u * stack_of_tick()));
    return worst < 0.02f && faults == 0u ? 0 : 1;
}
