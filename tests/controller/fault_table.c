/*
 * The table of faults of docs/controller.md, in closed loop with the emitted dynamics.
 *
 * Half of the ticks are episodes: one mode, one kind of fault at a random tick and joint; status, phase, refusal of an early
 * reset and recovery are compared with what the table says. In the other half any number of the input is replaced by a wild
 * one. In every tick all outputs and everything kept in the state are finite, and the torques within their limits.
 *
 * Macros: ROBOT, UPPER (the name in capitals), MODEL_HEADER, UNIT_HEADER, MODES (list of numbers), FILTERED (speeds come from a
 * filter), OBSERVED (there is an observer). Arguments: number of ticks, seed. Exit status 1 and a line for the first surprise.
 */
#include MODEL_HEADER
#include UNIT_HEADER

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define JOINED(a, b, c) a##b##c
#define OF(a, b, c) JOINED(a, b, c)
#define UNIT(name) OF(ROBOT, _controller_, name)
#define MODEL(name) OF(ROBOT, _, name)
#define STATUS(name) OF(UPPER, _CONTROLLER_STATUS_, name)
#define PHASE(name) OF(UPPER, _CONTROLLER_PHASE_, name)
#define RESULT(name) OF(UPPER, _CONTROLLER_, name)
#define N RESULT(N)

typedef UNIT(real) real;
typedef UNIT(params) params;
typedef UNIT(input) input;
typedef UNIT(output) output;
typedef UNIT(state) state;

#define HUGE_NUMBER ((sizeof(real) == 8) ? (real)DBL_MAX : (real)FLT_MAX)
#define EPISODE 64

enum { NAN_POSITION, INFINITE_SPEED, JUMP, STALE, LONG_PERIOD, NAN_PERIOD, NAN_REFERENCE, UNKNOWN_MODE, FAST, OUTSIDE, LONG_GAP,
       OVERFLOW_OF_LAW, PUSH, KINDS };
static const char *const names[KINDS] = {"position not finite", "speed not finite", "jump", "stale", "long period",
    "period not finite", "reference not finite", "unknown mode", "fast joint", "outside", "long gap", "overflow", "push"};
static const int modes[] = {MODES}, referenced[] = {REFERENCED};
static const uint32_t harmless = STATUS(SATURATED) | STATUS(RATE) | STATUS(MODEL) | STATUS(CONTACT_UNKNOWN);

static params defaults, p;
static state s;
static input in;
static output out;
static real q[N], dq[N], push[N], rest[N];
static real last[N];
static uint64_t seed;
static long ticks, episodes[KINDS], injected;
static int braked;

static uint32_t number(uint32_t below)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (uint32_t)((seed >> 20) % below);
}

static int finite_all(const void *data, size_t bytes)
{
    const real *x = (const real *)data;
    size_t k;
    for (k = 0; k < bytes / sizeof(real); k++) {
        if (!(fabs((double)x[k]) <= (double)HUGE_NUMBER)) {
            return 0;
        }
    }
    return 1;
}

static void require(int holds, const char *what, int mode, int kind, int tick)
{
    if (!holds) {
        printf("FAILED: %s; mode %d, %s, tick %d: status 0x%x, phase %d, mode %d\n", what, mode, kind < 0 ? "fuzz" : names[kind],
               tick, (unsigned)out.status, (int)out.phase, (int)out.mode);
        exit(1);
    }
}

/* Sets all elements of a parameter. */
static void set(params *of, const char *name, real value)
{
    size_t f;
    uint32_t k;
    for (f = 0; f < RESULT(FIELDS); f++) {
        if (strcmp(UNIT(fields)[f].name, name) == 0) {
            for (k = 0; k < UNIT(fields)[f].count; k++) {
                memcpy((char *)of + UNIT(fields)[f].offset + k * sizeof(real), &value, sizeof(real));
            }
        }
    }
}

/* One tick of the controller and the arm, and what holds in every tick. */
static void tick(int mode, int kind, int number_of)
{
    real tau[N], ddq[N];
    int j;

    (void)UNIT(step)(&s, &in, &out);
    ticks++;
    require(finite_all(&out, offsetof(output, status)), "an output is not finite", mode, kind, number_of);
    require(finite_all(&s.memory, sizeof(s.memory)), "the state is not finite", mode, kind, number_of);
    for (j = 0; j < N; j++) {
        const real rate = s.params.tau_rate[j] * s.params.Ts * (real)1.0001;
        require(fabs((double)out.tau[j]) <= (double)s.params.tau_max[j], "a torque above its limit", mode, kind, number_of);
        require(out.brake || fabs((double)(out.tau[j] - last[j])) <= (double)rate, "a torque too fast", mode, kind, number_of);
        last[j] = out.tau[j];
        tau[j] = out.tau[j] + push[j];
    }
    require(out.brake == (out.phase == PHASE(BRAKE)), "brake and phase differ", mode, kind, number_of);
    braked = out.brake;
    (void)MODEL(forward_dynamics)(q, dq, tau, p.beta, ddq);
    for (j = 0; j < N; j++) {
        dq[j] = braked ? (real)0 : dq[j] + p.Ts * ddq[j];
        q[j] += p.Ts * dq[j];
    }
}

/* The readings of this tick, and the reference at rest. */
static void read_arm(int mode)
{
    const uint32_t sample = in.sample;
    int j;
    memset(&in, 0, sizeof(in));
    for (j = 0; j < N; j++) {
        in.q[j] = q[j];
        in.q_d[j] = rest[j];
#ifndef FILTERED
        in.dq[j] = dq[j];
#endif
    }
    MODEL(forward_kinematics)(rest, in.T_d);
    in.dt = p.Ts;
    in.sample = sample + 1u;
    in.mode = mode;
}

static void start(int mode)
{
    int j;
    p = defaults;
    for (j = 0; j < N; j++) {
        const int bounded = p.q_min[j] > (real)-100 && p.q_max[j] < (real)100;
        rest[j] = bounded ? p.q_min[j] + (real)0.6 * (p.q_max[j] - p.q_min[j]) : (real)0.5;
        q[j] = rest[j];
        dq[j] = push[j] = last[j] = (real)0;
        p.tau_max[j] = (p.tau_max[j] < (real)300) ? p.tau_max[j] : (real)300;
        p.tau_rate[j] = (real)1e5;
        p.q_jump[j] = (real)0.1;
        p.dq_max[j] = (real)30;
    }
    set(&p, "friction", (real)0);
    p.sensor_action = (int32_t)number(2);
    read_arm(mode);
}

static void episode(int index, int kind)
{
    const int mode = modes[index], fault = 15 + (int)number(10), joint = (int)number(N);
    const int follows = referenced[index], gap = (int)p.hold_ticks + 1 + (int)number(4);
    int t, i, action = 0, good = 0, latched = -1, seen = 0, result;
    real M[N * N];

#ifdef FILTERED
    if (kind == INFINITE_SPEED || kind == FAST || kind == OUTSIDE || kind == JUMP) {
        return; /* there are no speeds to be read; a jump passes through the filter afterwards */
    }
#endif
    start(mode);
    if (kind == PUSH) {
#ifdef OBSERVED
        int k;
        action = p.contact_action = (int32_t)number(4);
        (void)MODEL(mass_matrix)(rest, p.beta, M);
        for (k = 0; k < N; k++) {
            p.threshold[k] = 10 * M[k * N + k];
        }
#else
        return;
#endif
    }
    require(UNIT(init)(&s, &p, &in) == 0, "init refused", mode, kind, 0);
    episodes[kind]++;
    for (t = 1; t < EPISODE; t++) {
        const int now = t == fault || (kind == LONG_GAP && t > fault && t < fault + gap);
        uint32_t expected = 0u;
        int phase = latched < 0 ? PHASE(RUN) : latched;
        read_arm(mode);
        if (latched >= 0 && number(4) == 0) {
            result = UNIT(reset)(&s, &in);
            require(result == (good < s.params.recover_ticks ? RESULT(NOT_RECOVERED) : 0), "result of reset", mode, kind, t);
            latched = result == 0 ? -1 : latched;
            phase = result == 0 ? PHASE(RUN) : phase;
            if (result == 0) {
                memset(push, 0, sizeof(push));
            }
        }
        good++;
        if (now) {
            injected++;
            switch (kind) {
            case NAN_POSITION:
            case LONG_GAP:
                in.q[joint] = number(2) ? (real)NAN : (real)-INFINITY;
                expected = STATUS(NOT_FINITE);
                break;
#ifndef FILTERED
            case INFINITE_SPEED:
                in.dq[joint] = number(2) ? (real)NAN : (real)INFINITY;
                expected = STATUS(NOT_FINITE);
                break;
            case FAST:
                in.dq[joint] = (real)-45;
                expected = STATUS(SPEED);
                break;
            case OUTSIDE:
                in.dq[joint] = (real)0.5;
                p.q_max[joint] = q[joint] - (real)0.01;
                require(UNIT(set)(&s, &p) == 0, "set refused", mode, kind, t);
                expected = STATUS(POSITION);
                break;
#endif
            case JUMP:
                in.q[joint] += (real)0.25;
                expected = STATUS(JUMP);
                break;
            case STALE:
                in.sample--;
                expected = STATUS(STALE);
                break;
            case LONG_PERIOD:
                in.dt = p.Ts * (real)(2 + number(1000));
                expected = STATUS(PERIOD);
                break;
            case NAN_PERIOD:
                in.dt = number(2) ? (real)NAN : (real)-INFINITY;
                expected = STATUS(PERIOD);
                break;
            case NAN_REFERENCE:
                in.q_d[joint] = in.V_d[number(6)] = (real)NAN;
                expected = follows ? STATUS(REFERENCE) : 0u;
                break;
            case UNKNOWN_MODE:
                in.mode = number(2) ? 31 : -1 - (int32_t)number(1000);
                expected = STATUS(MODE);
                break;
            case OVERFLOW_OF_LAW:
                in.q_d[joint] = in.V_d[number(6)] = HUGE_NUMBER;
                break;
            default:
                for (i = 0; i < N; i++) {
                    push[i] = 40 * M[i * N + joint]; /* accelerates this joint alone, by 40 rad/s^2 or m/s^2 */
                }
                break;
            }
            if (expected & (STATUS(SPEED) | STATUS(POSITION) | STATUS(REFERENCE))) {
                phase = latched = PHASE(STOP);
                good = 0;
            } else if (expected & (STATUS(NOT_FINITE) | STATUS(JUMP) | STATUS(STALE))) {
                phase = PHASE(HOLD);
                good = 0;
                if (t - fault >= s.params.hold_ticks) {
                    phase = latched = p.sensor_action ? PHASE(STOP) : PHASE(BRAKE);
                }
            }
        }
        tick(mode, kind, t);
        if (kind == OUTSIDE && now) {
            p.q_max[joint] = defaults.q_max[joint];
            require(UNIT(set)(&s, &p) == 0, "set refused", mode, kind, t);
        }
        if (kind == PUSH && (out.status & STATUS(CONTACT))) {
            require(t >= fault, "a contact without a push", mode, kind, t);
            seen = 1;
            expected = STATUS(CONTACT);
            if (action >= 2 && latched < 0) {
                phase = latched = action == 2 ? PHASE(STOP) : PHASE(BRAKE);
            }
            require(action != 1 || out.mode == RESULT(MODE_GRAVITY), "no guidance after a contact", mode, kind, t);
        }
        if (kind == OVERFLOW_OF_LAW && now) {
            if (!(out.status & STATUS(OUTPUT))) {
                return; /* the torque was only clipped, and moves the arm as it may */
            }
            require(follows, "a reference without use is read", mode, kind, t);
            expected = STATUS(OUTPUT);
            phase = latched = PHASE(STOP);
        }
        require((out.status & ~harmless) == expected, "status", mode, kind, t);
        require(out.phase == phase, "phase", mode, kind, t);
        require(kind == PUSH || latched >= 0 || out.mode == mode, "mode", mode, kind, t);
        require(!now || (kind != NAN_POSITION && kind != JUMP && kind != FAST) || out.joints == 1u << joint, "joints", mode, kind, t);
    }
    require(kind != PUSH || seen, "a push was not felt", mode, kind, EPISODE);
}

/* Any number of the input is wild; wrong parameters are refused; resets come at any time. */
static void fuzz(long count)
{
    const real wild[] = {(real)NAN, (real)INFINITY, (real)-INFINITY, HUGE_NUMBER, -HUGE_NUMBER, HUGE_NUMBER / (real)1e8,
                         (real)1e20, (real)-1e10, (real)1e-40, (real)0};
    const size_t reals = offsetof(input, sample) / sizeof(real);
    long t;

    for (t = 0; t < count; t++) {
        const int mode = modes[number(sizeof(modes) / sizeof(modes[0]))];
        int bad = 0, k;
        if (t % 4096 == 0) {
            start(mode);
#ifdef OBSERVED
            p.contact_action = (int32_t)number(4);
#endif
            p.model_action = (int32_t)number(2);
            set(&p, "threshold", (real)20);
            require(UNIT(init)(&s, &p, &in) == 0, "init refused", mode, -1, (int)t);
        }
        read_arm(t % 64 ? (int)s.mode : mode);
        for (k = 0; k < 2 && number(8) == 0; k++) {
            const real value = wild[number(sizeof(wild) / sizeof(wild[0]))];
            memcpy((char *)&in + sizeof(real) * number((uint32_t)reals), &value, sizeof(real));
            bad = 1;
            injected++;
        }
        in.sample -= number(50) == 0;
        in.mode = number(50) == 0 ? (int32_t)(number(64)) - 16 : in.mode;
        tick(mode, -1, (int)t);
        if (number(16) == 0) {
            params wrong = p;
            const real value = (real)NAN;
            const size_t f = number(RESULT(FIELDS));
            if (!UNIT(fields)[f].integer) {
                memcpy((char *)&wrong + UNIT(fields)[f].offset, &value, sizeof(real));
                require(UNIT(set)(&s, &wrong) == 256 * (int32_t)(f + 1), "a wrong parameter was taken", mode, -1, (int)t);
            }
        }
        if (out.phase >= PHASE(STOP) && number(32) == 0) {
            if (!bad && !finite_all(q, sizeof(q))) {
                exit(2);
            }
            (void)UNIT(reset)(&s, &in);
        }
        for (k = 0; k < N; k++) { /* the arm is put back where it ran away */
            if (!(fabs((double)q[k]) < 100.0) || !(fabs((double)dq[k]) < 100.0)) {
                q[k] = rest[k];
                dq[k] = (real)0;
            }
        }
    }
}

int main(int count, char **arguments)
{
    const long wanted = count > 1 ? atol(arguments[1]) : 10000;
    const int how_many = (int)(sizeof(modes) / sizeof(modes[0]));
    long k;

    seed = 88172645463325252u + (uint64_t)(count > 2 ? atol(arguments[2]) : 0) * 2654435761u;
    UNIT(default)(&defaults);
    p = defaults;
    for (k = 0; k < wanted / 2 / EPISODE; k++) {
        episode((int)(k % how_many), (int)(k / how_many % KINDS));
    }
    fuzz(wanted - ticks);
    printf("%ld ticks, %ld faults injected; episodes:", ticks, injected);
    for (k = 0; k < KINDS; k++) {
        printf(" %s %ld%s", names[k], episodes[k], k + 1 < KINDS ? "," : "\n");
    }
    return 0;
}
