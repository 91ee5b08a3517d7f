/* One joint with friction under a sampled position controller. Fourth-order Runge-Kutta steps; sticking is exact, and
 * a stop is located within a step by bisection. Shares no code with the package. */
#include <math.h>

enum { COULOMB_VISCOUS, ASYMMETRIC, STRIBECK, LUGRE, TANH };

typedef struct {
    double law, inertia, gravity, hang, constant; /* load: gravity sin(q - hang) + constant */
    double coulomb, coulomb_n, viscous, viscous_n, excess, speed, sigma0, sigma1;
    double force[3], steepness[3];
} Joint;

typedef struct {
    double kp, kd, ki, cascade, resolution, limit, delay; /* the delay of the torque is in samples */
} Loop;

static double level(const Joint *j, double v) {
    double x = v / j->speed;
    return j->coulomb + j->excess * exp(-x * x);
}

/* Friction while the joint slides in the direction s; of a law without a jump, s is not used. */
static double friction(const Joint *j, double v, double s, double z, double *dz) {
    double sum = 0.0;
    int i;
    *dz = 0.0;
    switch ((int)j->law) {
    case COULOMB_VISCOUS: return j->coulomb * s + j->viscous * v;
    case ASYMMETRIC: return s > 0.0 ? j->coulomb + j->viscous * v : j->viscous_n * v - j->coulomb_n;
    case STRIBECK: return level(j, v) * s + j->viscous * v;
    case LUGRE:
        *dz = v - j->sigma0 * fabs(v) / level(j, v) * z;
        return j->sigma0 * z + j->sigma1 * *dz + j->viscous * v;
    default:
        for (i = 0; i < 3; i++) sum += j->force[i] * tanh(j->steepness[i] * v);
        return sum + j->viscous * v;
    }
}

static double load(const Joint *j, double q) { return j->gravity * sin(q - j->hang) + j->constant; }

static void slope(const Joint *j, double u, double s, const double x[3], double dx[3]) {
    double f = friction(j, x[1], s, x[2], &dx[2]);
    dx[0] = x[1];
    dx[1] = (u - load(j, x[0]) - f) / j->inertia;
}

static void step(const Joint *j, double u, double s, double h, const double x[3], double after[3]) {
    double a[3], b[3], c[3], d[3], at[3];
    int i;
    slope(j, u, s, x, a);
    for (i = 0; i < 3; i++) at[i] = x[i] + 0.5 * h * a[i];
    slope(j, u, s, at, b);
    for (i = 0; i < 3; i++) at[i] = x[i] + 0.5 * h * b[i];
    slope(j, u, s, at, c);
    for (i = 0; i < 3; i++) at[i] = x[i] + h * c[i];
    slope(j, u, s, at, d);
    for (i = 0; i < 3; i++) after[i] = x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
}

/* Advance by h under a constant torque; a law with a jump may stop, rest and start again within it. */
static void advance(const Joint *j, double u, double h, double x[3]) {
    double after[3], unused;
    int turns;
    if (j->law == LUGRE || j->law == TANH) {
        step(j, u, 0.0, h, x, after);
        x[0] = after[0], x[1] = after[1], x[2] = after[2];
        return;
    }
    for (turns = 0; turns < 3 && h > 0.0; turns++) {
        double s = x[1] > 0.0 ? 1.0 : -1.0, low = 0.0, high = h;
        int k;
        if (x[1] == 0.0) {
            double net = u - load(j, x[0]);
            if (net <= friction(j, 0.0, 1.0, 0.0, &unused) && net >= friction(j, 0.0, -1.0, 0.0, &unused)) return;
            s = net > 0.0 ? 1.0 : -1.0;
        }
        step(j, u, s, h, x, after);
        if (after[1] * s >= 0.0) {
            x[0] = after[0], x[1] = after[1];
            return;
        }
        for (k = 0; k < 40; k++) { /* when does it stop? */
            double middle = 0.5 * (low + high);
            step(j, u, s, middle, x, after);
            if (after[1] * s > 0.0) low = middle; else high = middle;
        }
        step(j, u, s, high, x, after);
        x[0] = after[0], x[1] = 0.0;
        h -= high;
    }
}

/* Record n samples: seen positions Q, commanded torques U, true speeds V. disturbance acts on the joint unrecorded. */
void record(const Joint *j, const Loop *c, int n, double period, int substeps, const double *q_ref, const double *dq_ref,
            const double *feedforward, const double *disturbance, double *Q, double *U, double *V) {
    double x[3] = {q_ref[0], 0.0, 0.0}, before = q_ref[0], integral = 0.0, rest = load(j, q_ref[0]);
    int k, i, lag = (int)c->delay;
    for (k = 0; k < n; k++) {
        double seen = c->resolution > 0.0 ? rint(x[0] / c->resolution) * c->resolution : x[0];
        double speed = (seen - before) / period, error = q_ref[k] - seen, u;
        if (c->cascade != 0.0) { /* a proportional position loop around a speed loop with integral part */
            double wanted = dq_ref[k] + c->kp / c->kd * error;
            integral += c->ki * period * (wanted - speed);
            u = c->kd * (wanted - speed) + integral;
        } else {
            integral += c->ki * period * error;
            u = c->kp * error + c->kd * (dq_ref[k] - speed) + integral;
        }
        u += feedforward[k];
        if (c->limit > 0.0) u = fmax(-c->limit, fmin(c->limit, u));
        before = seen, Q[k] = seen, V[k] = x[1], U[k] = u;
        u = (k >= lag ? U[k - lag] : rest) + disturbance[k];
        for (i = 0; i < substeps; i++) advance(j, u, period / substeps, x);
    }
}
