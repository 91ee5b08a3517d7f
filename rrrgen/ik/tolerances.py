"""Every threshold of the inverse kinematics, stated once: those of the compiler, then those of emitted code.

Lengths are relative to the reach of the arm, sines and cosines absolute, angles in rad, unless a reason says otherwise.
Emitted C, the evaluation in Python and the manifest take the values from here.
"""

from __future__ import annotations

from typing import NamedTuple

# -- what kind of arm it is -------------------------------------------------------------------------------------------

EXACT = 1e-14
"""Geometry is set to zero below this magnitude, which is the rounding of a table and has no effect at run time."""

SPECIAL = 1e-9
"""Geometry closer than this to a simpler case is solved as that case, and every solution is refined on the true chain.
The first guess is off by at most 1e-9, which one Newton step removes."""

NEARLY = (1e-6, 1e-3, 1e-2)
"""Distances from a simpler case within which the equations of the general case (a quartic, or the elimination for six
joints) are near a multiple root and have an error of about eps / distance^2. There the simpler case is solved as well,
with these distances tried in order, and the solutions of both are refined on the true chain. Equations that split into
quadratics do not lose digits and are solved alone."""

QUARTER = 2e-16
"""An offset whose cosine or sine is this near a whole number is a multiple of a quarter turn: one rounding at 1."""

ALONG = 1e-12
"""An axis whose direction cosine is this near 1 lies along the normal of a plane: some thousand roundings."""

RANK = 1e-7
"""Singular values of the Jacobian (lengths over the reach) below this times the largest one count as zero."""

DEPENDENT = 1e-7
"""Six joints whose Jacobian has a smallest singular value (lengths in reaches, over the largest) below this move the
tip in five directions only: prescribing the seventh leaves a pose without a solution or with a continuum."""

NEARLY_DEPENDENT = 1e-3
"""Ratio of singular values below which six joints are nearly dependent; usual ratios are 3e-3 to 3e-2."""

# -- whether its equations work ---------------------------------------------------------------------------------------

FOUND = 1e-5
"""How near the configuration that made a trial pose must be found; double roots cost half the digits."""

NO_DIRECTION = 1e-12
"""In trials a vector shorter than this has no direction: some thousand roundings of a product of unit vectors."""

BELOW_ZERO = 1e-9
"""In trials a discriminant (over its size) may be this far below zero and count as a double root. Trial poses can be
reached, so that only rounding takes one there."""

NO_CONDITION = 1e-5
"""In trials an equation without its joint holds where its right side is below this: the root of BELOW_ZERO, rounded
up."""

COMPLEX = 1e-6
"""In trials a root of a quartic this far from the circle, or from the real axis in reaches, is a real double one: half
of the digits of NumPy's roots, and a factor of sixty."""

SIZE_OF_NOTHING = 1e-6
"""A discriminant is compared with its size plus this times the square of the unit, so that both may vanish."""

# -- eliminations for six joints --------------------------------------------------------------------------------------

SPURIOUS = 1e-9
"""Coefficients above degree 8, or a value at a solution, larger than this share of the polynomial are no noise."""

NOISE = 1e-12
"""What the solver takes for noise in a polynomial, relative to the sum of its coefficients: some thousand roundings
for values of a determinant of 12 x 12."""

LEAST_NOISE = {"double": NOISE, "float": 4e-6}
"""Lower bound of the noise of a polynomial, by the precision of the emitted code."""

MOST_NOISE = 1e-4
"""Upper bound of the noise of a polynomial: with a larger one, distinct roots would be taken for one."""

NOISE_FACTORS = (1.0, 1e3, 1e6)
"""Factors on the noise for the successive passes; each looks for double roots that the pass before has missed."""

SHALLOW = 1e-9
"""Size of a determinant, over the product of its row norms, below which its rounding error grows: with the power 3/4 of
the ratio."""

USABLE = 12.0
"""Decimal digits lost in a root at which an elimination is useless."""

# -- the self-test of the emitted code --------------------------------------------------------------------------------

SHARP = 0.03
"""Least singular value of the Jacobian (rad, reaches) at every row of a golden target: far from where rows meet."""

SAME_GOLDEN = 1e-6
"""Golden rows (rad, m) nearer than this are one: far more than the rounding of sharp ones."""

MEETS = 1e-9
"""A row whose forward kinematics (rad, m or parts of the arm's size) is this near the target meets it."""


# -- emitted code -----------------------------------------------------------------------------------------------------


class Tolerance(NamedTuple):
    """A threshold of emitted code: its name, its C literal in both precisions, and where the values come from."""

    name: str
    double: str
    single: str
    reason: str


RUNTIME = (
    Tolerance("eps", "2.220446049250313e-16", "1.1920929e-07", "from 1 to the next number"),
    Tolerance("free", "1e-13", "2e-6", "a unit direction is known no better: below it there is none"),
    Tolerance(
        "doubt", "1e-5", "1e-2", "a direction this short may be none, if the target is as inaccurate as is accepted"
    ),
    Tolerance("turn", "0.01", "0.01", "a joint that the target does not decide to this angle (rad) is free"),
    Tolerance("merge", "1e-13", "2e-6", "(same / 2)^2 rounded up: roots that may be one"),
    Tolerance(
        "same", "5e-7", "2e-3", "rows nearer are one: angles at a double root are good to the root of the precision"
    ),
    Tolerance("slack", "1e-5", "1e-3", "how far below zero a discriminant may fall and still give a candidate"),
    Tolerance(
        "circle", "1.6e-11", "1e-4", "squared distance from the unit circle of a double root, known to half the digits"
    ),
    Tolerance(
        "tight", "1e-26", "1e-11", "squared error above which rows are refined: some hundred roundings of the pose"
    ),
    Tolerance(
        "accept", "1.6e-25", "1e-9", "squared error above which rows are dropped: a target less out of reach is reached"
    ),
    Tolerance("band", "1e-5", "1e-4", "squared half angle by which double roots of a nearby arm are moved apart"),
    Tolerance("loose", "1e-4", "1e-3", "squared error beyond which a row of a virtual six-joint arm is not refined"),
    Tolerance("done", "1e-31", "1e-13", "squared error that refinement cannot improve: rounding of the pose"),
    Tolerance("orthonormal", "1e-7", "1e-4", "largest defect of R' R - 1 and of the handedness that is repaired"),
    Tolerance("limit", "1e-10", "1e-5", "how far beyond a limit a joint still counts as inside: rounding of an arc"),
    Tolerance("tiny", "1e-300", "1e-30", "below every length that matters; keeps quotients finite"),
    Tolerance(
        "rounding", "6755399441055744.0", "12582912.0", "1.5 2^52 (2^23): added and taken away, it rounds to integers"
    ),
)
"""Tolerances of every solver; the manifest lists them."""

ELIMINATION = (
    Tolerance("tiny", "1e-290", "1e-30", "keeps pivots and quotients finite; times a pivot it is still a number"),
    Tolerance("done", "1.4e-14", "4e-06", "error of an entry of the pose (mean link lengths) not worth a further step"),
    Tolerance("accept", "9e-13", "3e-05", "a row with a larger error is dropped"),
    Tolerance(
        "same",
        "3e-06",
        "0.01",
        "rows nearer (sum over sines and cosines) are one: forward kinematics sees no difference",
    ),
    Tolerance("shape", "1e-2", "1e-2", "how far a null vector may be from the product of two half angles"),
    Tolerance("close", "1e-3", "1e-3", "error of the pose at the start from which a row counts as found where it was"),
    Tolerance("narrowest", "1e-3", "1e-3", "a stretch of the circle this narrow (tangent of half) is not magnified"),
    Tolerance("trig_done", "1.5e-10", "3e-06", "a Newton step this short leaves its square, for roots are simple"),
    Tolerance(
        "trig_narrowest", "6.103515625e-05", "6.103515625e-05", "2^-14 of an arc: clusters are magnified, not split"
    ),
)
"""Additional tolerances of the elimination for six joints."""


SEARCH = (
    Tolerance(
        "starts", "6", "6", "descents that begin at the reference and at fixed configurations, beside all branches"
    ),
    Tolerance("spread", "2.0", "2.0", "amplitude of the fixed configurations about the reference (rad or m)"),
    Tolerance("descent_steps", "200", "200", "at most, in a descent or from an arm nearby: bounds the time"),
    Tolerance("descent_damping", "0.1", "0.1", "its first damping: ten times that of a candidate, which is close"),
    Tolerance("steps", "12", "12", "for a candidate: a double root halves the error in each, a simple one squares it"),
    Tolerance("damping", "0.01", "0.01", "times the error: the first damping, and the least that steps come down to"),
    Tolerance("most_damping", "1e6", "1e6", "steps damped more than this change no digit"),
    Tolerance("stuck", "0.999999999", "0.999999999", "an error that falls less under damping is the least there is"),
    Tolerance("diverged", "1e4", "1e4", "squared error (rad, reaches) from which no step is followed further"),
    Tolerance("beyond", "1e6", "1e6", "squared error of rows that are not handed out as inexact ones either"),
    Tolerance("small_turn", "0.9", "0.9", "cosine above which a missing rotation is taken by its sine, as steps do"),
    Tolerance("newton", "0.01", "0.01", "longest Newton step on a root of a quartic: Aberth's iteration found it"),
    Tolerance("band_2", "1e-3", "1e-3", "the second band in parts of the first; the geometry is off by 1e-6 to 1e-2"),
    Tolerance("band_3", "1e-6", "1e-6", "the third one"),
)
"""How rows are refined, and how the nearest configuration to a target out of reach is looked for."""


def runtime(real: str) -> dict[str, str]:
    """:data:`RUNTIME` in the precision ``"double"`` or ``"float"``: name -> C literal."""
    return _literals(RUNTIME, real)


def search() -> dict[str, float]:
    """:data:`SEARCH` in double precision, for the evaluation in Python: name -> value."""
    return {each.name: float(each.double) for each in SEARCH}


def kernel_values(real: str) -> dict[str, str]:
    """The values that the kernels of ``templates/c/ik`` ask for: ``VALUE_<name>``, ``VALUE_6R_<name>`` -> C literal."""
    values = runtime(real) | _literals(SEARCH, real)
    values |= {f"6r_{name}": value for name, value in _literals(ELIMINATION, real).items()}
    return {f"VALUE_{name.upper()}": value for name, value in values.items()}


def _literals(table: tuple[Tolerance, ...], real: str) -> dict[str, str]:
    return {each.name: each.single if real == "float" else each.double for each in table}
