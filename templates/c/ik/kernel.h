/*
 * Declarations of the kernels, the C files from which the inverse kinematics of a robot is put together. With this header
 * each kernel can also be compiled and tested alone. A kernel is valid C99 and C++. What differs between robots are macros,
 * defined in settings.h, which rrrgen writes for the robot at hand:
 *
 * options, 1 or 0
 *   POSITION             the target is a position, not a pose
 *   SLIDES               some joint is prismatic
 *   LIMITED              some joint has limits
 *   OFFSETS              some joint has an offset between its value and the angle (or displacement) of its frame
 *   REDUNDANT            the caller prescribes the redundancy parameter, passed as the argument `lock`
 *   LOCKED               the redundancy parameter is the value of a joint. LOCKED_FIRST, LOCKED_LAST: it is the first or the
 *                        last joint; LOCKED_SLIDES: it is prismatic
 *   OPENED               some targets leave a joint undetermined (free). BRANCHES_OPEN, NEARBY_OPEN: this may happen in the
 *                        candidates of ik_branches, of ik_nearby; MERGES: several branches then have the same solution
 *   TOOL                 the position of the tool in the frame of the last link follows that of the target in T
 *   BANDED               the solved equations are those of a simpler arm close to this one. Where they have a double root
 *                        the true arm may have two roots; the argument `band` moves the double root apart
 *   COMPANION            the equations of the true arm are solved, and those of a simpler arm close to it as well
 *   VIRTUAL              the arm has too few joints for its equations and is solved with virtual joints added, whose values
 *                        must be zero in a solution
 *   SINGLE               ik_branches lists all candidates, from equations that are exact for this arm; ONE_ROW: at most one
 *   SOUND                ik_branches also computes the residuals, so that accurate candidates need no refinement
 *   ASPECTS              the branch label is the sign of the Jacobian's determinant
 *   INCOMPLETE           solutions may be missing: only a simpler arm close to this one could be solved
 *   GENERAL              the general six-joint solver is used: where it cannot prove that it has found all solutions, they may be
 *                        missing
 *   NARROW               the real type is float; the general six-joint solver computes in double, its type ik_6r_real
 *   NOMINAL_FIRST        the candidates of an arm nearby are refined first, and the general equations are for cases of doubt
 *   COUPLED              the joints are those of a mechanism, which its chain from base to tip follows: functions chain_...
 *   CHAIN_SLIDES, MIXED  that chain has a prismatic joint; the chain or the mechanism has one
 *   GEARED               several positions of the joints give one configuration of the chain
 *   FOLLOWERS_LIMITED    joints that follow others have limits
 *   NEEDS_...            the candidate functions call the function of that name, so it must be emitted
 *   DH_SLIDES, DH_SHIFTED   general six-joint solver: one of its joints is prismatic; its angles differ from those of the
 *                        robot by the constants DH_SHIFTS
 *
 * numbers, types, tables and pieces of code
 *   REAL, RESTRICT, SQRT, FABS, COPYSIGN, SIN, COS, FLOOR, CEIL   the real type, and functions of math.h in its precision
 *   LOCAL, LOCAL_INLINE  linkage: static in an emitted file, external where a kernel is compiled alone
 *   SHARED               linkage of the solver for one target: static where a mechanism calls it
 *   JOINTS, LAST_JOINT   number of joints n, and n - 1
 *   ERRORS, STACKED      entries of the task error (3 or 6), and ERRORS + JOINTS
 *   ROWS                 largest number of solutions
 *   TARGET, TARGET_READ  length of the array of a target, and how many of its entries are read
 *   AT_X, AT_Y, AT_Z     indices of the target position in that array
 *   SLIDING              bit mask of the prismatic joints
 *   LOCKED_JOINT         index of the prescribed joint; LOCKED_OFFSET: "+ its offset"; LOCKED_LINK: inverse of the constant
 *                        transform between it and the other joints
 *   TRANSFORMS, FIXED, OFFSET_VALUES, LOWER, UPPER   constant transforms, offsets and limits of the joints
 *   DH, DH_TURN, DH_SLIDE, DH_SPAN, DH_BEFORE, DH_AFTER, DH_SHIFTS, FREE_K, LENGTH, PER_LENGTH, PASSES, PASS, PASS_NOISE
 *                        tables of the general six-joint solver, described in general6r.c and candidates6r.c
 *   BAND, HELD, LOCK, REDUNDANCY, TARGET ..._PARAMETER, ..._FIRST, ..._K, NO_..., NONE_...
 *                        optional parameters and arguments, with the comma that separates them from their neighbours; empty
 *                        for robots that do not need them
 *   VALUE_...            tolerances, explained in rrrgen/ik/tolerances.py
 *   VALUE_REACH          length (m) that tolerances are relative to; FAR_AWAY: largest coordinate (m) of a target;
 *                        TOOL_AWAY: largest coordinate (m) of a tool;
 *                        ROUNDINGS: error of the numbers of an exact target, in units of eps; ROUNDING_UNITS: that of its pose
 *   CHAIN_JOINTS, CHAIN_ROWS, CHAIN_SLIDING, CHAIN_HELD_PARAMETER, CHAIN_NONE_HELD   the same for the chain of a mechanism
 *   MATRIX, RATES, INVERSE, PIVOTS, TURNS, COMBINATIONS, PERIODS, FOLLOWERS, FOLLOWER_..., LOCKED_FACTOR, UNFIT_STAGE
 *                        tables of the coupling, described in coupling.c and coupled.c
 *   STEPS                most Gauss-Newton steps for a candidate
 *   LANES                solutions that are refined together, at most as many as the arm nearby has
 *   OPEN_BITS, MERGED_BITS   inner flags of the joints that may be free; statements that set the bits of the branch number
 *                        which have no meaning while a joint is free
 *   FAR_STAGE, CHECK_STAGE, OUTSIDE_STAGE, REASONS, REASON_COUNT, STATUS_TEXTS, LAST_STATUS, UNKNOWN_STATUS
 *                        numbers and texts of the reasons why there is no solution, and of the statuses
 *
 * In an emitted file the prefixes ik_, IK_ and robot_ of names are replaced by the robot's own, and the macros above by
 * their values. Only C tokens are replaced, never the contents of strings and comments.
 */
#ifndef IK_KERNEL_H
#define IK_KERNEL_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "constants.h" /* includes settings.h */

#define LOCAL
#define LOCAL_INLINE

/* the same types as in the emitted header of a robot */
enum { IK_LIMITS = 1, IK_NEAREST = 2, IK_RESIDUAL = 4 };
enum { IK_MULTIPLE = 1, IK_FREE = 2, IK_OUTSIDE = 4, IK_INEXACT = 8 };
typedef enum ik_status {
    IK_OK = 0,
    IK_UNREACHABLE = 1,
    IK_OUTSIDE_LIMITS = 2,
    IK_NOT_FINITE = 3,
    IK_NOT_A_ROTATION = 4,
    IK_INCOMPLETE = 5
} ik_status;
typedef struct ik_solutions {
    int count;
    int stage;
    REAL distance;
    REAL q[ROWS][JOINTS];
    unsigned flags[ROWS];
    unsigned branch[ROWS];
    REAL residual[ROWS];
} ik_solutions;

#if COUPLED
typedef struct chain_solutions {
    int count;
    int stage;
    REAL distance;
    REAL q[CHAIN_ROWS][CHAIN_JOINTS];
    unsigned flags[CHAIN_ROWS];
    unsigned branch[CHAIN_ROWS];
    REAL residual[CHAIN_ROWS];
} chain_solutions;
#endif

#ifdef __cplusplus
extern "C" {
#endif

#if COUPLED
/* the solver of the chain: angles.c, error.c, target.c, descend.c, solve.c */
REAL chain_wrap(REAL x);
REAL chain_error(const REAL *T, const REAL *q, REAL e[ERRORS], REAL J[ERRORS][CHAIN_JOINTS] CHAIN_HELD_PARAMETER);
ik_status chain_check(const REAL *target, const REAL *q_ref LOCK_PARAMETER, REAL T[TARGET]);
int chain_far(const REAL *T);
int chain_descend(const REAL *T, const REAL *ref LOCK_PARAMETER, chain_solutions *out);
ik_status chain_solve(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    chain_solutions *RESTRICT out);
/* coupling.c, coupled.c */
void ik_follow(const REAL *q, REAL y[CHAIN_JOINTS]);
void ik_lead(const REAL *y, int turn, REAL q[JOINTS]);
REAL ik_off(const REAL *y, const REAL *q);
void ik_couple(const REAL *T, unsigned options, const chain_solutions *found, int i, ik_solutions *out);
#endif
/* angles.c */
REAL ik_wrap(REAL x);
REAL ik_opposite(REAL x);
REAL ik_atan2(REAL y, REAL x);
void ik_arcs(int count, const REAL *RESTRICT sine, const REAL *RESTRICT cosine, REAL *RESTRICT angle);
/* roots.c */
REAL ik_wide(REAL slack, REAL size, REAL unit);
int ik_root(REAL w2, REAL size, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
int ik_cosine(REAL *k, REAL w2, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
int ik_linear(REAL *a, REAL *b, REAL *k, REAL w2, REAL unit, REAL ref, REAL least, unsigned open, unsigned none, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
unsigned ik_unit(REAL *c, REAL *s, REAL least, unsigned open, unsigned none);
int ik_quartic(REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL slack, REAL *c, REAL *s, REAL *x, unsigned *g);
int ik_power4(REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL unit, REAL slack, REAL *x, unsigned *g, unsigned *flags);
int ik_quadratic(REAL k0, REAL k1, REAL k2, REAL unit, REAL slack BAND_PARAMETER, REAL *x, unsigned *g, unsigned *flags);
REAL ik_feasible(REAL ref, REAL mean, REAL a, REAL b, REAL lower, REAL upper);
/* error.c, or coupling.c; refine.c */
void ik_advance(REAL x[12], const REAL f[12]);
REAL ik_error(const REAL *T, const REAL *q, REAL e[ERRORS], REAL J[ERRORS][JOINTS] HELD_PARAMETER);
void ik_step(REAL J[ERRORS][JOINTS], const REAL e[ERRORS], REAL damping, REAL d[JOINTS]);
REAL ik_refine(const REAL *T, REAL *q, int steps, REAL damping HELD_PARAMETER);
/* trig_roots.c, general6r.c, aspect.c */
#if GENERAL
void ik_trig8_value(const ik_6r_real a[9], const ik_6r_real b[9], ik_6r_real u, ik_6r_real out[2]);
int ik_trig_roots_8(ik_6r_real a[9], ik_6r_real b[9], ik_6r_real noise, ik_6r_real root[24][3], int mult[24]);
ik_6r_real ik_6r_lu(ik_6r_real a[6][10], int n);
#endif
int ik_solve6r(const REAL t[16], const REAL ref[6], REAL q[16][6], unsigned flags[16], int *certain);
unsigned ik_aspect(const REAL *T, const REAL *q, unsigned *flags);
/* candidates6r.c, or printed from the equations of the robot */
int ik_branches(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage);
int ik_nearby(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage);
/* nominal.c, and the step and the error printed from the geometry of the robot */
int ik_nominal_first(const REAL *T, const REAL *ref LOCK_PARAMETER, ik_solutions *found, ik_solutions *out);
#if NOMINAL_FIRST
void ik_newton(
    const REAL *RESTRICT T, REAL (*RESTRICT x)[LANES], REAL *RESTRICT error, REAL *RESTRICT moved,
    REAL *RESTRICT inverse, REAL *RESTRICT det);
void ik_missed(const REAL *RESTRICT T, REAL (*RESTRICT x)[LANES], REAL *RESTRICT error);
ik_status ik_answer(TARGET_PARAMETER const REAL *q_ref, unsigned options, ik_solutions *out);
#endif
/* rows.c, or coupling.c; order.c */
extern const REAL ik_lower[JOINTS];
extern const REAL ik_upper[JOINTS];
int ik_place(REAL q[JOINTS], const REAL *ref);
REAL ik_apart(const REAL *a, const REAL *b);
void ik_move(const ik_solutions *from, int i, ik_solutions *out, int to);
void ik_sort(const REAL *ref, ik_solutions *out);
int ik_repeated(ik_solutions *out, int i);
/* target.c, descend.c */
ik_status ik_check(const REAL *target, const REAL *q_ref LOCK_PARAMETER, REAL T[TARGET]);
REAL ik_accuracy(const REAL *target);
int ik_far(const REAL *T);
int ik_descend(const REAL *T, const REAL *ref LOCK_PARAMETER, ik_solutions *out);
/* open.c, and reopen.c for each list of candidates */
REAL ik_outside(const REAL *q, REAL margin);
REAL ik_clamped(REAL x, int j);
int ik_shift(const REAL *T, REAL *q, int j, const REAL *ref);
void ik_take(const ik_solutions *from, int i, ik_solutions *out, int to);
unsigned ik_loose(const REAL *T, REAL accuracy, ik_solutions *found, int i);
int ik_reaches(const REAL *T, REAL *x, REAL goal, int steps, unsigned held);
void ik_between(const REAL *from, const REAL *to, REAL part, REAL *x);
int ik_joined(const REAL *T, const REAL *from, const REAL *to, unsigned held, REAL goal);
void ik_reopen_branches(const REAL *T, const REAL *at LOCK_PARAMETER, unsigned options, REAL accuracy, ik_solutions *found, int rows);
void ik_reopen_nearby(const REAL *T, const REAL *at LOCK_PARAMETER, unsigned options, REAL accuracy, ik_solutions *found, int rows);
/* settle.c, finish.c */
int ik_sound(const ik_solutions *found, int rows);
void ik_keep(const REAL *T, unsigned options, const ik_solutions *found, int i, ik_solutions *out);
void ik_keep_all(
    const REAL *T, const REAL *target, const REAL *ref LOCK_PARAMETER, unsigned options, ik_solutions *found, int rows,
    ik_solutions *out);
void ik_add(const REAL *T, unsigned options, const ik_solutions *found, int rows, ik_solutions *out);
int ik_finish(TARGET_PARAMETER const REAL *ref, unsigned options, ik_solutions *out);
/* solve.c; batch.c, closest.c, texts.c */
ik_status robot_inverse_kinematics(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    ik_solutions *RESTRICT out);
void robot_inverse_kinematics_batch(
    size_t count, const REAL *RESTRICT targets, const REAL *RESTRICT q_ref REDUNDANCIES_PARAMETER, unsigned options,
    REAL *RESTRICT q, int *RESTRICT counts, unsigned *flags, unsigned *branch, int *statuses, REAL *distances);
ik_status robot_closest(
    const REAL target[RESTRICT TARGET], const REAL *RESTRICT q_ref REDUNDANCY_PARAMETER, unsigned options,
    ik_solutions *RESTRICT out);
const char *ik_status_string(ik_status status);
const char *ik_reason(int stage);

#ifdef __cplusplus
}
#endif

#endif
