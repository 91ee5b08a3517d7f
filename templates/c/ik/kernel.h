/*
 * What the kernels of the inverse kinematics share when each is compiled alone. A kernel is C99 and C++; what differs
 * between robots are macros of settings.h, which is written beside the kernels, one line for each:
 *
 * options, 1 or 0
 *   POSITION             the target is a position, not a pose
 *   SLIDES               some joint is prismatic
 *   LIMITED              some joint has limits
 *   OFFSETS              some joint has an offset between its value and the angle of its frame
 *   REDUNDANT            the caller prescribes the redundancy parameter, an argument `lock`
 *   LOCKED               which is a joint; LOCKED_FIRST, LOCKED_LAST, LOCKED_SLIDES: the first, the last, a prismatic one
 *   OPENED               the target may leave joints open; BRANCHES_OPEN, NEARBY_OPEN: in which list of candidates;
 *                        MERGES: and choices fall together then
 *   BANDED               the equations are those of an arm nearby, whose double roots may be two: an argument `band`
 *   COMPANION            candidates of an arm nearby are added
 *   VIRTUAL              the arm is solved as one of six joints, some of which must come out at zero
 *   SINGLE               there is one list of candidates, exact for this arm; ONE_ROW: of one row
 *   SOUND                its candidates say themselves whether they can be taken as they are
 *   ASPECTS              the branch label is the sign of the Jacobian's determinant
 *   INCOMPLETE           configurations may be missing
 *   NEEDS_...            the candidates call the function of that name
 *   DH_SLIDES, DH_SHIFTED   elimination: one of its six joints is prismatic; angles are counted from shifted directions
 *
 * words
 *   REAL, RESTRICT, SQRT, FABS, COPYSIGN, SIN, COS, FLOOR, CEIL   the real type, and math.h in its precision
 *   LOCAL, LOCAL_INLINE  the linkage: static in an emitted file, external here
 *   JOINTS, LAST_JOINT, ERRORS, STACKED, ROWS   joints, their last index, entries of the task error, sum of both, rows
 *   TARGET, TARGET_READ, AT_X, AT_Y, AT_Z       numbers of a target, those that are read, the places of its position
 *   SLIDING              bits of the prismatic joints
 *   LOCKED_JOINT, LOCKED_OFFSET, LOCKED_LINK    the prescribed joint, "+ its offset", inverse of the link beside it
 *   TRANSFORMS, FIXED, OFFSET_VALUES, LOWER, UPPER   tables of the chain
 *   DH, DH_TURN, DH_SLIDE, DH_BEFORE, DH_AFTER, DH_SHIFTS, FREE_K, LENGTH, PER_LENGTH, PASSES, PASS, PASS_NOISE
 *                        tables of the elimination for six joints
 *   BAND, HELD, LOCK, REDUNDANCY, TARGET ..._PARAMETER, ..._FIRST, ..._K, NO_..., NONE_...
 *                        optional parameters and arguments with the comma that joins them to the others, or nothing
 *   VALUE_...            tolerances, from rrrgen/ik/tolerances.py; VALUE_REACH, ROUNDING_UNITS, FAR_AWAY: sizes of the arm
 *   STEPS                Gauss-Newton steps for a candidate
 *   OPEN_BITS, MERGED_BITS   flags of joints that may be open; statements that collect the choices which fall together
 *   FAR_STAGE, CHECK_STAGE, OUTSIDE_STAGE, REASONS, REASON_COUNT, STATUS_TEXTS, LAST_STATUS, UNKNOWN_STATUS
 *                        numbers and texts of stages and statuses
 *
 * Names that begin with ik_, IK_ and robot_ get those of the robot in an emitted file. Words and beginnings of names are
 * replaced as tokens of C: never in strings and comments.
 */
#ifndef IK_KERNEL_H
#define IK_KERNEL_H

#include <math.h>
#include <stddef.h>

#include "constants.h" /* and with it settings.h */

#define LOCAL
#define LOCAL_INLINE

/* as in the header of a robot */
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

#ifdef __cplusplus
extern "C" {
#endif

/* angles.c */
REAL ik_wrap(REAL x);
REAL ik_opposite(REAL x);
REAL ik_atan2(REAL y, REAL x);
void ik_arcs(int count, const REAL *RESTRICT sine, const REAL *RESTRICT cosine, REAL *RESTRICT angle);
/* roots.c */
int ik_root(REAL w2, REAL size, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
int ik_cosine(REAL *k, REAL w2, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
int ik_linear(REAL *a, REAL *b, REAL *k, REAL w2, REAL unit, REAL ref, REAL least, unsigned open, unsigned none, REAL slack BAND_PARAMETER, REAL *w, unsigned *flags);
unsigned ik_unit(REAL *c, REAL *s, REAL least, unsigned open, unsigned none);
int ik_quartic(REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL slack, REAL *c, REAL *s, REAL *x, unsigned *g);
int ik_power4(REAL k0, REAL k1, REAL k2, REAL k3, REAL k4, REAL unit, REAL slack, REAL *x, unsigned *g, unsigned *flags);
int ik_quadratic(REAL k0, REAL k1, REAL k2, REAL unit, REAL slack BAND_PARAMETER, REAL *x, unsigned *g, unsigned *flags);
REAL ik_feasible(REAL ref, REAL mean, REAL a, REAL b, REAL lower, REAL upper);
/* refine.c */
void ik_advance(REAL x[12], const REAL f[12]);
REAL ik_error(const REAL *T, const REAL *q, REAL e[ERRORS], REAL J[ERRORS][JOINTS] HELD_PARAMETER);
void ik_step(REAL J[ERRORS][JOINTS], const REAL e[ERRORS], REAL damping, REAL d[JOINTS]);
REAL ik_refine(const REAL *T, REAL *q, int steps, REAL damping HELD_PARAMETER);
/* trig_roots.c, general6r.c, aspect.c */
int ik_trig_roots_8(REAL a[9], REAL b[9], REAL noise, REAL root[24][3], int mult[24]);
REAL ik_6r_lu(REAL a[6][10], int n);
int ik_solve6r(const REAL t[16], REAL q[16][6], int mult[16]);
unsigned ik_aspect(const REAL *T, const REAL *q);
/* candidates6r.c, or printed from the equations of the robot */
int ik_branches(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage);
int ik_nearby(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage);
/* rows.c */
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
void ik_reopen_branches(const REAL *T, const REAL *at LOCK_PARAMETER, unsigned options, REAL accuracy, ik_solutions *found, int rows);
void ik_reopen_nearby(const REAL *T, const REAL *at LOCK_PARAMETER, unsigned options, REAL accuracy, ik_solutions *found, int rows);
/* settle.c */
int ik_sound(const ik_solutions *found, int rows);
void ik_keep(const REAL *T, unsigned options, const ik_solutions *found, int i, ik_solutions *out);
void ik_add(const REAL *T, unsigned options, const ik_solutions *found, int rows, ik_solutions *out);
int ik_finish(TARGET_PARAMETER const REAL *ref, unsigned options, ik_solutions *out);
/* solve.c */
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
