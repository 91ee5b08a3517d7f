/*
 * A control loop at 1 kHz around the emitted model of the RRR arm: the controller of a real arm, on a simulated one.
 *
 *     loop LAW BANDWIDTH REFERENCE OUTPUT [realtime]
 *
 * LAW is pd, pd_gravity, feedforward, computed_torque, or resting_measured, resting_desired: computed torque with the
 * exact sign of the measured or desired speed in its friction. BANDWIDTH w, rad/s, gives the gains w^2, 2 w and, for the
 * integral of the laws with a model, w^3/5. REFERENCE has a row q_d dq_d ddq_d (9 numbers) per tick. OUTPUT gets a row q (3), tau (3), lateness, cost in ns per tick.
 *
 * The controller sees what a real one sees: positions in steps of the encoders, speeds as their differences,
 * parameters that are 2 % and friction that is 5 % off, and its torques act one tick later. With "realtime" every tick
 * waits for the clock; otherwise the ticks follow one another at once.
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "rrr.h"

#define N RRR_N
#define PERIOD 1e-3  /* s */
#define SUBSTEPS 10  /* of the simulated arm in a period */
#define ENCODER 1e-5 /* rad */

static const double FRICTION[3 * N] = {1.1, 3.0, 0.0, 0.3, 1.5, 0.0, 0.2, 0.8, 0.0}; /* viscous, Coulomb, offset */
static const double WIDTH[N] = {0.01, 0.01, 0.01};                                    /* rad/s */
static const double NONE[N] = {0.0, 0.0, 0.0};

/* Acceleration of the simulated arm: true parameters, smooth friction. */
static void acceleration(const double *q, const double *dq, const double *tau, double *ddq)
{
    double friction[N], driving[N];
    rrr_smooth_friction(dq, FRICTION, WIDTH, friction);
    for (int i = 0; i < N; i++) {
        driving[i] = tau[i] - friction[i];
    }
    (void)rrr_forward_dynamics_nominal(q, dq, driving, ddq); /* M of a rigid arm is never singular */
}

/* One period of the simulated arm under constant torques, by Runge-Kutta steps of fourth order. */
static void move(double *q, double *dq, const double *tau)
{
    const double h = PERIOD / SUBSTEPS;
    for (int step = 0; step < SUBSTEPS; step++) {
        double k[4][N], v[4][N], at[N], speed[N];
        for (int stage = 0; stage < 4; stage++) {
            const double part = stage == 0 ? 0.0 : stage == 3 ? h : h / 2.0;
            for (int i = 0; i < N; i++) {
                at[i] = q[i] + (stage ? part * v[stage - 1][i] : 0.0);
                speed[i] = v[stage][i] = dq[i] + (stage ? part * k[stage - 1][i] : 0.0);
            }
            acceleration(at, speed, tau, k[stage]);
        }
        for (int i = 0; i < N; i++) {
            q[i] += h / 6.0 * (v[0][i] + 2.0 * v[1][i] + 2.0 * v[2][i] + v[3][i]);
            dq[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
        }
    }
}

/* What the controller knows, and keeps. */
typedef struct {
    double beta[RRR_B], friction[3 * N], kp[N], kd[N], ki[N];
    double z[N]; /* the integral, from tick to tick */
} controller;

static void set_gains(controller *c, const char *law, double w, const double *q)
{
    double M[N * N];
    rrr_nominal_parameters(c->beta);
    for (int i = 0; i < RRR_B; i++) {
        c->beta[i] *= 1.02;
    }
    for (int i = 0; i < 3 * N; i++) {
        c->friction[i] = 1.05 * FRICTION[i];
    }
    rrr_mass_matrix(q, c->beta, M);
    const int scaled = strncmp(law, "pd", 2) == 0 || strcmp(law, "feedforward") == 0; /* gains in N m/rad, else 1/s^2 */
    for (int i = 0; i < N; i++) {
        const double D = scaled ? M[i * N + i] : 1.0;
        c->kp[i] = w * w * D;
        c->kd[i] = 2.0 * w * D;
        c->ki[i] = 0.2 * w * w * w * D;
        c->z[i] = 0.0;
    }
}

/* The torques of one tick. */
static int control(controller *c, const char *law, const double *q, const double *dq, const double *d, double *tau)
{
    const double limit[N] = RRR_TAU_MAX;
    const double *q_d = d, *dq_d = d + N, *ddq_d = d + 2 * N;
    const double zero[3 * N] = {0.0};
    double f[N], z[N] = {0.0};
    if (strcmp(law, "pd") == 0) {
        for (int i = 0; i < N; i++) {
            tau[i] = c->kp[i] * (q_d[i] - q[i]) + c->kd[i] * (dq_d[i] - dq[i]);
        }
    } else if (strcmp(law, "pd_gravity") == 0) {
        rrr_pd_gravity(q, dq, q_d, dq_d, ddq_d, c->kp, c->kd, c->ki, c->z, WIDTH, PERIOD, c->beta, c->friction, limit, tau, z);
    } else if (strcmp(law, "feedforward") == 0) {
        rrr_feedforward(q, dq, q_d, dq_d, ddq_d, c->kp, c->kd, c->ki, c->z, WIDTH, PERIOD, c->beta, c->friction, limit, tau, z);
    } else if (strcmp(law, "computed_torque") == 0) {
        rrr_computed_torque(q, dq, q_d, dq_d, ddq_d, c->kp, c->kd, c->ki, c->z, WIDTH, PERIOD, c->beta, c->friction, limit, tau, z);
    } else if (strncmp(law, "resting_", 8) == 0) {
        rrr_computed_torque(q, dq, q_d, dq_d, ddq_d, c->kp, c->kd, NONE, NONE, WIDTH, PERIOD, c->beta, zero, limit, tau, z);
        rrr_friction_with(strcmp(law, "resting_measured") == 0 ? dq : dq_d, c->friction, f);
        for (int i = 0; i < N; i++) {
            tau[i] += f[i];
        }
    } else {
        fprintf(stderr, "no law is called %s\n", law);
        return 1;
    }
    memcpy(c->z, z, sizeof z);
    return 0;
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Sleep until the next period begins; returns how much too late the loop woke up, s. */
static double wait_for(struct timespec *next)
{
    next->tv_nsec += (long)(1e9 * PERIOD);
    if (next->tv_nsec >= 1000000000L) {
        next->tv_nsec -= 1000000000L;
        next->tv_sec++;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, next, NULL);
    return seconds() - ((double)next->tv_sec + 1e-9 * (double)next->tv_nsec);
}

int main(int argc, char **argv)
{
    if (argc < 5) {
        fprintf(stderr, "usage: loop LAW BANDWIDTH REFERENCE OUTPUT [realtime]\n");
        return 2;
    }
    const int realtime = argc > 5 && strcmp(argv[5], "realtime") == 0;
    double w;
    FILE *reference = fopen(argv[3], "r"), *output = fopen(argv[4], "w");
    if (!reference || !output || sscanf(argv[2], "%lf", &w) != 1) {
        fprintf(stderr, "cannot open the files, or no bandwidth\n");
        return 2;
    }
    double d[3 * N], q[N], dq[N], seen[N], last[N], speed[N] = {0.0}, tau[N] = {0.0}, applied[N] = {0.0};
    controller c;
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (long tick = 0;; tick++) {
        int read = 0;
        for (int i = 0; i < 3 * N; i++) {
            read += fscanf(reference, "%lf", &d[i]);
        }
        if (read != 3 * N) {
            break;
        }
        if (tick == 0) { /* the arm starts at rest on the reference, its weight carried */
            memcpy(q, d, sizeof q);
            memset(dq, 0, sizeof dq);
            set_gains(&c, argv[1], w, q);
            rrr_gravity(q, c.beta, applied);
        }
        const double late = realtime ? wait_for(&next) : 0.0, begin = seconds();
        for (int i = 0; i < N; i++) {
            seen[i] = ENCODER * round(q[i] / ENCODER);
            speed[i] = tick == 0 ? 0.0 : (seen[i] - last[i]) / PERIOD;
            last[i] = seen[i];
        }
        if (control(&c, argv[1], seen, speed, d, tau)) {
            return 2;
        }
        const double cost = seconds() - begin;
        fprintf(output, "%.9g %.9g %.9g %.9g %.9g %.9g %.0f %.0f\n", q[0], q[1], q[2], tau[0], tau[1], tau[2], 1e9 * late, 1e9 * cost);
        move(q, dq, applied);
        memcpy(applied, tau, sizeof tau); /* acts from the next tick */
    }
    fclose(reference);
    return fclose(output) != 0;
}
