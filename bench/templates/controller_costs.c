/*
 * Ticks of the controller along a motion: `controller_costs PASSES` makes PASSES over TICKS inputs, and prints the least
 * nanoseconds of a tick and, for more than two, the bytes of stack that one takes (valgrind forbids to look). Macros as in tests/controller/fault_table.c, and MODE.
 */
#define _POSIX_C_SOURCE 199309L
#include MODEL_HEADER
#include UNIT_HEADER

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define JOINED(a, b, c) a##b##c
#define OF(a, b, c) JOINED(a, b, c)
#define UNIT(name) OF(ROBOT, _controller_, name)
#define N OF(UPPER, _CONTROLLER_, N)
#define TICKS 1024
#define PAINTED 16384 /* bytes below the stack pointer whose use is looked for */

static UNIT(params) params;
static UNIT(state) state;
static UNIT(input) inputs[TICKS];
static UNIT(output) output;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static __attribute__((noinline)) int stack_of_tick(void)
{
    volatile unsigned char here, *const bottom = &here - PAINTED;
    int k;
    for (k = 0; k < PAINTED - 256; k++) {
        bottom[k] = 0xA5;
    }
    (void)UNIT(step)(&state, &inputs[1], &output);
    for (k = 0; k < PAINTED && bottom[k] == 0xA5; k++) {
    }
    return PAINTED - k;
}

int main(int count, char **arguments)
{
    const int passes = count > 1 ? atoi(arguments[1]) : 1;
    double least = 1e300;
    int k, j, pass;

    UNIT(default)(&params);
    for (k = 0; k < TICKS; k++) {
        UNIT(input) *const in = &inputs[k];
        for (j = 0; j < N; j++) {
            const double w = 6.283185307179586 / TICKS * (1 + j % 3), size = 0.05, middle = 0.3 + 0.1 * j;
            in->q[j] = middle - size * cos(w * k);
#ifndef FILTERED
            in->dq[j] = size * w / params.Ts * sin(w * k);
#endif
#ifdef FOLLOWS
            in->q_d[j] = in->q[j] + 1e-3;
            in->dq_d[j] = size * w / params.Ts * sin(w * k);
            in->ddq_d[j] = size * w * w / params.Ts / params.Ts * cos(w * k);
#endif
            params.q_min[j] = -100;
            params.q_max[j] = 100;
            params.dq_max[j] = 100;
            params.q_jump[j] = 1;
        }
        in->dt = params.Ts;
        in->mode = MODE;
    }
    if (UNIT(init)(&state, &params, &inputs[TICKS - 1]) != 0) {
        return 1;
    }
    for (pass = 0; pass < passes; pass++) {
        const double before = now();
        double each;
        for (k = 0; k < TICKS; k++) {
            inputs[k].sample = (unsigned)(pass * TICKS + k + 1);
            (void)UNIT(step)(&state, &inputs[k], &output);
        }
        each = (now() - before) / TICKS;
        least = each < least ? each : least;
    }
    printf("%.1f %d %d\n", least, passes > 2 ? stack_of_tick() : 0, (int)output.phase);
    return 0;
}
