/* Runs every contender on the same states: values for the check, minimum times in turns, instructions by single steps.

   driver evaluate STATES OUT | time STATES ROUNDS NANOSECONDS | count STATES STATES_TO_COUNT
   STATES: two 64-bit integers, number and size, then doubles. Times and instructions go to stdout, one line each. */
#define _GNU_SOURCE
#include <inttypes.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "contenders.h"

static int64_t count, size;
static double *states;
static double out[MAX_OUTPUT];

static void fail(const char *what)
{
    perror(what);
    exit(2);
}

static void read_states(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (!file || fread(&count, 8, 1, file) != 1 || fread(&size, 8, 1, file) != 1) fail(path);
    states = malloc((size_t)(count * size) * sizeof *states);
    if (!states || fread(states, sizeof *states, (size_t)(count * size), file) != (size_t)(count * size)) fail(path);
    fclose(file);
}

static void evaluate(const char *path)
{
    FILE *file = fopen(path, "wb");
    if (!file) fail(path);
    for (int c = 0; c < CONTENDERS; c++)
        for (int64_t k = 0; k < count; k++) {
            for (int i = 0; i < contenders[c].outputs; i++) out[i] = 1e300;
            contenders[c].run(states + k * size, out);
            fwrite(out, sizeof *out, (size_t)contenders[c].outputs, file);
        }
    if (fclose(file)) fail(path);
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static double sample(void (*run)(const double *, double *), long sweeps)
{
    double start = now();
    for (long s = 0; s < sweeps; s++)
        for (int64_t k = 0; k < count; k++) run(states + k * size, out);
    return (now() - start) / (double)(sweeps * count);
}

/* Contenders of one function take turns, so that all of them see the same quiet and busy moments. */
static void measure_times(long rounds, double target)
{
    for (int first = 0, last; first < CONTENDERS; first = last) {
        for (last = first; last < CONTENDERS && contenders[last].group == contenders[first].group; last++) {}
        double best[CONTENDERS];
        long sweeps[CONTENDERS];
        for (int c = first; c < last; c++) {
            best[c] = sample(contenders[c].run, 1);
            best[c] = sample(contenders[c].run, 1);
            sweeps[c] = 1 + (long)(target / (best[c] * (double)count));
        }
        for (long r = 0; r < rounds; r++)
            for (int c = first; c < last; c++) {
                double t = sample(contenders[c].run, sweeps[c]);
                if (t < best[c]) best[c] = t;
            }
        for (int c = first; c < last; c++) printf("%d %.3f\n", c, best[c]);
    }
}

static void nothing(const double *in, double *result)
{
    (void)in;
    (void)result;
}

/* The child stops itself before and after each call; in between the parent steps and counts. */
static void child(long used)
{
    if (ptrace(PTRACE_TRACEME, 0, 0, 0)) _exit(3);
    for (int c = -1; c < CONTENDERS; c++) {
        void (*volatile run)(const double *, double *) = c < 0 ? nothing : contenders[c].run;
        for (long k = 0; k < used; k++) {
            run(states + k * size, out);
            raise(SIGSTOP);
            run(states + k * size, out);
            raise(SIGSTOP);
        }
    }
    _exit(0);
}

static long steps_to_stop(pid_t pid)
{
    for (long steps = 0;; steps++) {
        int status;
        if (ptrace(PTRACE_SINGLESTEP, pid, 0, 0) || waitpid(pid, &status, 0) != pid || !WIFSTOPPED(status)) return -1;
        if (WSTOPSIG(status) == SIGSTOP) return steps;
    }
}

static int count_instructions(long used)
{
    pid_t pid = fork();
    if (pid < 0) fail("fork");
    if (pid == 0) child(used);
    double empty = 0.0;
    for (int c = -1; c < CONTENDERS; c++) {
        double total = 0.0;
        for (long k = 0; k < used; k++) {
            int status;
            if (waitpid(pid, &status, 0) != pid || !WIFSTOPPED(status)) return 3;
            long steps = steps_to_stop(pid);
            if (steps < 0) return 3;
            total += (double)steps;
            ptrace(PTRACE_CONT, pid, 0, 0);
        }
        if (c < 0)
            empty = total;
        else
            printf("%d %.1f\n", c, (total - empty) / (double)used);
    }
    waitpid(pid, NULL, 0);
    return 0;
}

int main(int argc, char **argv)
{
    if (argc < 4) return 2;
    read_states(argv[2]);
    contenders_setup();
    if (strcmp(argv[1], "evaluate") == 0) evaluate(argv[3]);
    if (strcmp(argv[1], "time") == 0) measure_times(atol(argv[3]), argc > 4 ? atof(argv[4]) : 2e4);
    if (strcmp(argv[1], "count") == 0) return count_instructions(atol(argv[3]));
    return 0;
}
