"""Every threshold of the inverse kinematics, stated once: those of the compiler, then those of emitted code.

Lengths are relative to the reach of the arm, sines and cosines absolute, angles in rad, unless a reason says otherwise.
Emitted C, the evaluation in Python and the manifest take the values from here.
"""

from __future__ import annotations

from typing import NamedTuple

# -- what kind of arm it is -------------------------------------------------------------------------------------------

EXACT = 1e-14
"""Lengths (over the reach), sines and cosines of the geometry below this count as zero: they are rounding errors of the
numbers in the DH table, and removing them changes no result."""

SPECIAL = 1e-9
"""Lengths (over the reach), sines and cosines below this are set to zero to obtain a simpler arm with simpler
equations. Every solution of the simpler arm is then refined on the true arm; it is off by about 1e-9, which one Newton
step removes."""

NEARLY = (1e-6, 1e-3, 1e-2)
"""Magnitudes tried in turn: lengths (over the reach), sines and cosines below them are set to zero to obtain a simpler
arm, which is solved in addition. Reason: on an arm at the distance ``delta`` from a simpler one, the equations of the
general case (a quartic, or the elimination for six joints) are near a multiple root and lose accuracy, to an error of
about eps / delta^2. The solutions of both arms are refined on the true one. Equations that split into quadratics do not
lose digits and are solved alone."""

QUARTER = 2e-16
"""A cosine or sine this near -1, 0 or 1 is replaced by that integer, so that multiples of pi/2 have exact values; the
bound is one rounding error of a double near 1."""

ALONG = 1e-12
"""An axis is parallel to the normal of a plane if the magnitude of its direction cosine is this near 1; the bound
allows for some thousand rounding errors."""

RANK = 1e-7
"""Singular values of the Jacobian (lengths over the reach) below this times the largest one count as zero."""

DEPENDENT = 1e-7
"""Ratio of the smallest to the largest singular value of the Jacobian of six joints (lengths over the reach) below
which they move the tip in only five directions. Such six joints of a seven-joint arm cannot be solved for a prescribed
seventh: a pose then has either no solution or a continuum of them."""

NEARLY_DEPENDENT = 1e-3
"""Ratio of the smallest to the largest singular value of the Jacobian below which six joints are nearly dependent, and
another joint is prescribed where possible; usual ratios are 3e-3 to 3e-2."""

FARTHEST = 1e6
"""Largest coordinate of a target, in sizes of the arm (its reach, and the way from the base to joint 1). Farther away
the coordinates are rounded by more than 1e-10 of the arm."""

ROUNDINGS = 64
"""How many times eps the numbers of an exact target may be in error: sums of a dozen products of them."""

ON_COUPLING = 1e-7
"""How far (rad, reaches) the rows of a mechanism may be off their coupling in CasADi's functions, which refine nothing:
the error of an angle near a double root, eps^(1/2), with a margin of seven."""

NEARLY_PARALLEL = 0.02
"""Axes with a smaller sine of their angle are nearly parallel: where their common perpendicular lies says nothing."""

SHORTER = 2.0
"""Frames are moved where that shortens the arm, as the sum of its lengths, by more than this factor. On the bundled
robots it is at most 1.08; where calibration made axes nearly parallel, frames lie metres to hundreds of metres away."""

LONGEST_TOOL = 10
"""Largest coordinate, in reaches, of a tool that is an input: its rounding errors count relative to the reach, and from
about a hundred reaches on solutions would seem to miss their target."""

# -- whether its equations work ---------------------------------------------------------------------------------------

FOUND = 1e-5
"""Largest distance (rad, or lengths over the reach) between the random configuration whose pose is a trial's target and
the solution that must find it again. It is of the order of the square root of the rounding error, because a double root
is known to half the digits only."""

NO_DIRECTION = 1e-12
"""Length (in units of the vector's natural size) below which a vector has no direction, in the compiler's trials of its
equations; some thousand rounding errors."""

BELOW_ZERO = 1e-9
"""How far below zero a discriminant, relative to the size of its terms, may fall and still count as a double root, in
the compiler's trials. The poses of the trials are reachable, so only rounding makes a discriminant negative."""

USUAL_RATIO = 10.0
"""For an equation solved for a cosine: ratio of the size of its terms to its divisor up to which the usual tolerance
for a cosine beyond +-1 is applied. For larger ratios the tolerance grows in proportion."""

SIZE_OF_NOTHING = 1e-6
"""Share of unit^2 (``unit``: the natural size of the quantity) that is added to the size of a discriminant before the
two are compared, so that the comparison also holds where both are zero."""

# -- eliminations for six joints --------------------------------------------------------------------------------------

SPURIOUS = 1e-9
"""Largest share of the polynomial's coefficients that those above degree 8, or its value at a known solution, may have.
Both are zero for a usable elimination; more than this cannot be rounding."""

NOISE = 1e-12
"""Rounding noise of the values of a polynomial, relative to the sum of the magnitudes of its coefficients. The values
are 12 x 12 determinants, whose computation adds up some thousand rounding errors."""

NOISE_OF_FLOAT = 1e-6
"""Error of the values of a polynomial by the rounding of the target to single precision, relative to the sum of the
magnitudes of the coefficients: two roots that such an error makes complex may be those of a singular target."""

MOST_NOISE = 1e-4
"""Largest rounding noise that is assumed for the values of a polynomial, relative to the sum of the magnitudes of its
coefficients: with a larger one, distinct roots would be taken for one."""

NOISE_FACTORS = (1.0, 1e3, 1e6)
"""Factors on the noise for successive passes of the solver. With more noise two close roots count as one double root,
so each pass finds double roots that the pass before has missed."""

SHALLOW = 1e-9
"""Size of a determinant, over the product of its row norms, below which its relative rounding error is larger: by the
factor (SHALLOW / size)^(3/4)."""

USABLE = 12.0
"""An elimination is rejected if its roots lose this many decimal digits or more, of the sixteen of a double."""

SPAN_STEPS, SPAN_LEAST = 200, 1e-6
"""Steps of the minimization that bounds the span of an arm from its first to its last axis, and the length (in units of
the solver) below which a side of that line counts as zero."""

BEYOND_SPAN = 1e-4
"""Share of that span by which a target must exceed it to be out of reach without further computation: far above the
rounding errors of a target in single precision."""

# -- the self-test of the emitted code --------------------------------------------------------------------------------

SHARP = 0.03
"""Least singular value of the Jacobian (rad, lengths over the reach) that every solution of a target of the self-test
must have, so that the expected solutions are well conditioned: no two of them are close to merging."""

SAME_GOLDEN = 1e-6
"""Expected solutions of the self-test whose joints differ by less than this (rad, m) are the same solution; rounding of
well conditioned solutions is far smaller."""

MEETS = 1e-9
"""Largest difference between an entry of the target pose and of the forward kinematics of a solution that meets the
target (rad; lengths in m, or in sizes of the arm where it is larger than 1 m)."""


# -- emitted code -----------------------------------------------------------------------------------------------------


class Tolerance(NamedTuple):
    """A threshold of emitted code: its name, its C literal in double and in single precision, and its meaning.

    ``reason`` says what is compared with the threshold and, where it is not plain, why the value was chosen.
    """

    name: str
    double: str
    single: str
    reason: str


def _both(name: str, value: str, reason: str) -> Tolerance:
    """A threshold that is the same in double and in single precision."""
    return Tolerance(name, value, value, reason)


RUNTIME = (
    Tolerance("eps", "2.220446049250313e-16", "1.1920929e-07", "machine epsilon: from 1 to the next larger number"),
    Tolerance(
        "free",
        "1e-13",
        "2e-6",
        "a shorter vector, in units of its natural size, has no direction: the joint that turns it is free",
    ),
    Tolerance(
        "doubt",
        "1e-5",
        "1e-2",
        "a shorter vector may be zero but for the error of a target that is just accurate enough to be accepted",
    ),
    _both("turn", "0.01", "a joint is free if turning it by this angle (rad) still meets the target"),
    Tolerance("merge", "1e-13", "2e-6", "squared half angle below which two roots may be one: (same / 2)^2 rounded up"),
    Tolerance(
        "same",
        "5e-7",
        "2e-3",
        "solutions whose joints differ less are one: at a double root angles have half the digits",
    ),
    Tolerance("slack", "1e-5", "1e-3", "how far below zero a discriminant may fall and still give a candidate"),
    Tolerance(
        "circle", "1.6e-11", "1e-4", "squared distance from the unit circle of a double root, known to half the digits"
    ),
    Tolerance(
        "tight", "1e-26", "1e-11", "squared error above which a solution is refined: some hundred roundings of the pose"
    ),
    Tolerance(
        "accept", "1.6e-25", "1e-9", "squared error above which a candidate is dropped: it does not meet the target"
    ),
    Tolerance("band", "1e-5", "1e-4", "squared half angle by which double roots of a nearby arm are moved apart"),
    Tolerance(
        "loose", "1e-4", "1e-3", "squared error beyond which a candidate of an arm with virtual joints is not refined"
    ),
    Tolerance("done", "1e-31", "1e-13", "squared error that refinement cannot improve: rounding of the pose"),
    Tolerance(
        "orthonormal",
        "1e-7",
        "1e-4",
        "largest error of a rotation (R' R - 1, handedness) that is repaired, not refused",
    ),
    Tolerance("limit", "1e-10", "1e-5", "how far beyond a limit a joint still counts as inside: rounding of an angle"),
    Tolerance("tiny", "1e-300", "1e-30", "far below every length of an arm; added to denominators to avoid 0 / 0"),
    Tolerance(
        "rounding",
        "6755399441055744.0",
        "12582912.0",
        "1.5 2^52 (float: 1.5 2^23); adding and subtracting it rounds to an integer",
    ),
)
"""Tolerances of every solver; the manifest lists them. Errors are those of the task: position over the reach, rotation
in rad."""

ELIMINATION = (
    _both("eps", "2.220446049250313e-16", "machine epsilon"),
    _both("tiny", "1e-290", "added to denominators to avoid 0 / 0; large enough not to underflow"),
    _both("done", "1.4e-14", "error of the pose (lengths scaled) at which refinement stops: its rounding"),
    Tolerance("accept", "9e-13", "3e-05", "error of the pose above which a candidate is dropped"),
    Tolerance("followed", "2.8e-14", "8e-06", "error of the pose that remains along a continuum of solutions"),
    Tolerance(
        "nearly",
        "3e-9",
        "8e-06",
        "and along what is nearly one: above rounding, far below that beside a double solution, 5e-5",
    ),
    _both("exact", "9e-13", "error of the pose above which a solution is none but for the rounding of a float"),
    _both(
        "same",
        "3e-06",
        "solutions nearer (sum of the differences of sines and cosines) are one: their poses agree up to rounding",
    ),
    _both("rounding", "0.3", "rounding errors of the 17 samples that add up in the polynomial, as a share of them"),
    _both(
        "mismatch",
        "4.0",
        "noise of the polynomial over its largest difference from the determinant at three angles",
    ),
    _both("rank", "3e-5", "pivot of the matrix at a root, over the first one, below which it counts as zero"),
    _both("unreal", "0.02", "imaginary part of an eigenvalue above which a solution that shares a root is complex"),
    _both("aberth", "24", "steps of Aberth's iteration for these eigenvalues: each at least doubles the digits"),
    _both("mapped", "1e-6", "squared error with which the tangents map a null space; more in a continuum"),
    _both("circle", "1e-3", "least radius of the circle in which the roots of a cluster are counted"),
    _both("widest", "0.2", "and largest one"),
    _both("clear", "30", "on that circle the polynomial exceeds its noise by this factor"),
    _both("whole", "0.05", "largest error of that count, which is an integral, from a whole number"),
    _both("firm", "1e-5", "pivot of J'J in the last Newton step above which a solution is not singular"),
    Tolerance("double", "1e-5", "3e-3", "least gain of the Jacobian (lengths scaled) of a solution that counts once"),
    Tolerance(
        "twins", "0.03", "0.3", "distance (see `same`) up to which two singular solutions are halves of a double one"
    ),
    _both("shape", "1e-2", "largest distance of a null vector from a product of powers of two half-angle tangents"),
    _both("close", "1e-3", "a solution belongs to the root it was refined from if the first error is below this"),
    Tolerance(
        "singular", "3e-6", "3e-3", "pivot of the Jacobian (lengths scaled) below which it is singular, see `same`"
    ),
    _both("narrowest", "1e-3", "an arc of the circle (tangent of a quarter of it) this narrow is not magnified"),
    _both("zones", "8", "most arcs of the circle, itself included, in which roots are searched"),
    _both("wider", "0.02", "an arc to be magnified exceeds the intervals of its roots by this angle (rad)"),
    _both("joined", "0.1", "neighbouring intervals of roots with a smaller gap (rad) belong to one arc"),
    _both("narrower", "0.4", "an arc is magnified if it is at most this share of the one around it"),
    _both("inside", "1.5", "a root is left to an arc magnified later if it is inside so many half widths"),
    _both("steps", "6", "most Newton steps for a solution; six times as many in a patient search"),
    _both("patience", "400", "most Newton steps of all patient searches of an elimination"),
    _both("hopeless", "0.1", "error of the pose after three Newton steps above which a search is given up"),
    _both("trig_done", "1.5e-10", "Newton step at which a root is final: the error left is of the step's square"),
    _both(
        "trig_narrowest",
        "6.103515625e-05",
        "2^-14: an interval of roots narrower than this share of an arc is not split again, but magnified",
    ),
)
"""Additional tolerances of the elimination for six joints, which always computes in double. Two values differ where the
errors of a target in single precision count."""

EIGENVALUES = (
    _both("complex", "0.1", "imaginary part (rad) of the kept angle up to which a root is tried"),
    _both("real", "1e-7", "and up to which it is real, so that it must have a solution"),
    _both("cluster", "1e-4", "roots (rad) that are nearer to each other are examined together"),
    _both("mixed", "1e-6", "singular value of their null vectors below which these are the same"),
)
"""Tolerances of the elimination where it is evaluated in Python, with roots that are eigenvalues."""


SEARCH = (
    _both("starts", "6", "descents that begin at the reference and at fixed configurations, beside all branches"),
    _both("spread", "2.0", "amplitude of the fixed configurations about the reference (rad or m)"),
    _both("descent_steps", "200", "most steps of a descent, or of refining a solution of a nearby arm"),
    _both("descent_damping", "0.1", "first damping of a descent, which begins far from a solution"),
    _both("steps", "12", "most steps for a candidate: each halves the error at a double root, squares it elsewhere"),
    _both("damping", "0.01", "first and least damping for a candidate, as a multiple of the error"),
    _both("less_damping", "0.2", "factor on the damping after a step that has reduced the error"),
    _both("more_damping", "100", "factor on the damping after several steps that have not"),
    _both("worse_steps", "3", "so many steps in a row may increase the error: a curved valley is left and met again"),
    _both("most_damping", "1e6", "damping above which steps are below rounding: the search ends"),
    _both("stuck", "0.999999999", "ratio of errors above which damped steps have reached a minimum"),
    _both("diverged", "1e4", "squared error (rad, reaches) above which a step is taken back"),
    _both("beyond", "1e6", "squared error above which a solution is dropped even where inexact ones are kept"),
    Tolerance("coupled", "1e-4", "1e-2", "how far (rad, reaches) rows may be off their coupling and are refined on it"),
    _both("small_turn", "0.9", "cosine of the rotation error above which its sine is used in place of the angle"),
    _both("newton", "0.01", "longest Newton step on a root of a quartic that Aberth's iteration has found"),
    _both("path_steps", "16", "of a path between two solutions with a free joint; each turns it by 0.2 rad or less"),
    _both("path_corrections", "4", "most Gauss-Newton steps of the other joints after each of these steps"),
    _both("path_move", "0.5", "largest move of a joint (rad, reaches) in a step of such a path; else it is broken"),
    _both(
        "standing",
        "64",
        "sum of moves, in errors of the target, up to which the joints beside a free one stand",
    ),
    _both(
        "reopened",
        "16",
        "largest squared error, in those of the target, of a solution with a free joint at its reference",
    ),
    _both(
        "limit_step",
        "0.04908738521234052",
        "pi/64: by such steps (rad) a free joint leaves its reference until the others are inside their limits",
    ),
    _both("limit_steps", "128", "of these steps a side: a whole turn"),
    _both("limit_dips", "8", "so many minima of the excess over the limits between two steps are looked into a side"),
    _both("dip_steps", "24", "of the ternary search for such a minimum: two steps shrink to 6e-6 rad"),
    _both("border_steps", "48", "of the bisection for the value at a limit: down to rounding"),
    _both("band_2", "1e-3", "factor on `band` in the second attempt; nearby arms differ by 1e-6 to 1e-2"),
    _both("band_3", "1e-6", "factor on `band` in the third attempt"),
)
"""Constants of the refinement of solutions, and of the search for the configuration nearest to an unreachable
target."""


NOMINAL = (
    _both("margin_slack", "50.0", "a discriminant this far below zero, in deviations, may be positive"),
    _both("margin_least", "10.0", "a direction this short, in deviations, decides no joint"),
    _both(
        "margin_direction",
        "0.05",
        "nor one this short, whose errors in later equations the slack does not bear",
    ),
    _both("margin_inverse", "0.3", "largest norm of the inverse Jacobian times the deviation"),
    _both("newton_turn", "0.5", "largest norm of the inverse Jacobian times a Newton step"),
    _both("newton_steps", "5", "at most: each squares the error"),
    Tolerance("newton_near", "1e-16", "1e-8", "squared error below which a step may be the last one"),
    Tolerance("newton_met", "1e-29", "1e-12", "squared error after it below which it was the last one"),
    Tolerance("distinct", "1e-4", "1e-3", "solutions (rad, m) that are nearer may be one"),
)
"""When the solutions of a special arm, refined, are all solutions of an arm nearby: in doubt the general equations are
solved. Deviations are the largest difference of the poses of both arms, in rad or parts of the reach."""


def nominal_margins(deviation: float, real: str) -> dict[str, float]:
    """The thresholds :data:`NOMINAL` by name, scaled to two arms whose poses differ by at most ``deviation``.

    ``real`` is "double" or "float". Thresholds on norms are squared, because the emitted code compares squared norms.
    """
    values = {name: float(literal) for name, literal in _literals(NOMINAL, real).items()}
    least = max(deviation, 1e-9)
    return {
        **values,
        "margin_slack": values["margin_slack"] * least,
        "margin_least": max(values["margin_least"] * least, values["margin_direction"]),
        "margin_inverse": (values["margin_inverse"] / least) ** 2,
        "newton_turn": values["newton_turn"] ** 2,
        "newton_steps": int(values["newton_steps"]),
    }


def runtime(real: str) -> dict[str, str]:
    """The C literals of :data:`RUNTIME`, by name, in the precision ``"double"`` or ``"float"``."""
    return _literals(RUNTIME, real)


def search() -> dict[str, float]:
    """The values of :data:`SEARCH`, by name, in double precision, for the evaluation in Python."""
    return {tolerance.name: float(tolerance.double) for tolerance in SEARCH}


def elimination() -> dict[str, float]:
    """The values of :data:`ELIMINATION` and :data:`EIGENVALUES`, by name, for the evaluation in Python."""
    return {tolerance.name: float(tolerance.double) for tolerance in ELIMINATION + EIGENVALUES}


def kernel_values(real: str) -> dict[str, str]:
    """The C literals for the macros ``VALUE_<name>`` and ``VALUE_6R_<name>`` of the kernels in ``templates/c/ik``."""
    values = runtime(real) | _literals(SEARCH, real)
    values |= {f"6r_{name}": value for name, value in _literals(ELIMINATION, real).items()}
    return {f"VALUE_{name.upper()}": value for name, value in values.items()}


def _literals(table: tuple[Tolerance, ...], real: str) -> dict[str, str]:
    return {tolerance.name: tolerance.single if real == "float" else tolerance.double for tolerance in table}
