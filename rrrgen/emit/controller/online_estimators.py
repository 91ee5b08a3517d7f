"""Online estimators of base parameters and friction as C: regressor rows, gradient step, gains and files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import InputError
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.recursions.linear_algebra import dot
from rrrgen.derive.recursions.link_frames import rational
from rrrgen.emit import Real
from rrrgen.emit.c.function_files import Extension, function_files
from rrrgen.emit.c.language import Dialect, nonfinite_function
from rrrgen.emit.printing import columns
from rrrgen.program import Builder, Port, Program, Role, evaluate
from rrrgen.program.builder import replay
from rrrgen.robot.model.drives import DriveTerm, drive_terms, friction_surfaces, inertia_terms, unit
from rrrgen.robot.model.mechanism import refuse_newton

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


# ------------------------------------------------------------------------------------------------------------------
# Programs of the online estimators that depend on the robot: regressor rows, and one step of the gradient method.
#
# The estimated parameters are the base parameters, then the drive inertias and friction parameters that the robot
# file states, without those whose values the caller fixes.
# ------------------------------------------------------------------------------------------------------------------

JOINT_INPUTS = ("q", "dq", "ddq", "tau")
MEANINGS = {
    "q": ("rad | m", "positions", Role.POSITION),
    "dq": ("rad/s | m/s", "velocities", Role.VELOCITY),
    "ddq": ("rad/s^2 | m/s^2", "accelerations", Role.ACCELERATION),
    "tau": ("N m | N", "measured torques, less friction that is compensated with known parameters", Role.TORQUE),
}


@dataclass(frozen=True)
class Regression:
    """Linear regression ``Y p = y`` of a robot's torques y on the p parameters that are estimated online.

    ``robot`` is the robot's name, ``joints`` the number n of joints, ``names`` (p,) are the parameters. ``nominal``
    (p,) are their values in the robot file, None if it states no masses of links. The program ``rows`` computes Y
    (n, p), the torques y (n,) minus those of the fixed parameters, and a flag per joint that is 1 where it moves (n,).
    The program ``gradient`` is one step of the gradient method (14.23).
    """

    robot: str
    joints: int
    names: tuple[str, ...]
    nominal: tuple[float, ...] | None
    rows: Program
    gradient: Program


def regression(derived: DerivedModel, fixed: Mapping[str, float] | None = None) -> Regression:
    """Build the linear regression of a robot for online estimation; ``fixed`` (name -> value) are known parameters.

    Raises :class:`InputError` for a name that is no parameter of this robot, a value that is no number, or if nothing
    is left to estimate; DerivationError for a robot with closed loops whose positions Newton's method finds.
    """
    refuse_newton(derived.spec, "an online estimator")
    known = dict(fixed or {})
    terms = drive_terms(derived.spec)
    every = (*(parameter.name for parameter in derived.base_parameters), *(term.name for term in terms))
    unknown = sorted(set(known) - set(every))
    if unknown:
        raise InputError(f"'{unknown[0]}' is no parameter of {derived.name}: there are {', '.join(every)}")
    for name, value in known.items():
        if not math.isfinite(value):
            raise InputError(f"the fixed parameter {name} needs a finite value, not {value!r}")
    names = tuple(name for name in every if name not in known)
    if not names:
        raise InputError("all parameters are fixed: nothing is left to estimate")
    nominal = None
    if derived.beta_nominal is not None:
        numbers = [float(value) for value in derived.beta_nominal] + [term.value for term in terms]
        values = dict(zip(every, numbers, strict=True))
        nominal = tuple(values[name] for name in names)
    work = _Recorder(derived, terms, every, {name: Fraction(float(value)) for name, value in known.items()})
    return Regression(derived.name, derived.spec.n, names, nominal, work.rows(), work.gradient())


class _Recorder:
    """Records the programs ``rows`` and ``gradient`` of one :class:`Regression`."""

    def __init__(
        self, derived: DerivedModel, terms: Sequence[DriveTerm], every: Sequence[str], fixed: Mapping[str, Fraction]
    ) -> None:
        self.derived, self.terms, self.every, self.fixed = derived, terms, every, fixed
        self.n = derived.spec.n
        self.directions = [[w if type(w) is int else rational(w) for w in term.direction] for term in terms]
        self.estimated = [k for k, name in enumerate(every) if name not in fixed]

    def rows(self) -> Program:
        builder = Builder()
        inputs = self._inputs(builder)
        rest = _rest(builder)
        b, columns = self.derived.b, self.derived.beta_size
        (flat,) = replay(self.derived.programs["regressor"], builder, self._motion("regressor", inputs))
        forces = self._forces(builder, inputs)
        rows, torques = [], []
        for i in range(self.n):
            row = [
                *flat[i * columns : i * columns + b],
                *(w[i] * f for w, f in zip(self.directions, forces, strict=True)),
            ]
            known: Any = 0
            for value, name in zip(row, self.every, strict=True):
                known = known + self.fixed.get(name, 0) * value
            rows += [row[k] for k in self.estimated]
            torques.append(inputs["tau"][i] - known)
        outputs = [
            (Port("Y", (self.n, len(self.estimated)), "SI", "joint", "regressor in the estimated parameters"), rows),
            (Port("y", (self.n,), "N m | N", "joint", "torques less those of the fixed parameters"), torques),
            (
                Port("moves", (self.n,), "", "joint", "1 where the joint moves, 0 at rest"),
                self._moves(builder, inputs, rest),
            ),
        ]
        return builder.program(
            "rows",
            outputs,
            summary="The linear equations of one sample for the parameters to be estimated.",
            formula="y = Y(q, dq, ddq) p   (14.21)",
        )

    def gradient(self) -> Program:
        builder = Builder()
        inputs = self._inputs(builder)
        p = builder.input(Port("p", (len(self.estimated),), "SI", "", "estimated parameters"))
        gain = builder.input(Port("gain", (), "", "", "alpha Ts of (14.23)"))[0]
        rest = _rest(builder)
        values: dict[str, Any] = {**self.fixed, **{self.every[k]: p[i] for i, k in enumerate(self.estimated)}}
        forces = self._forces(builder, inputs)
        errors = [a - b for a, b in zip(self._torques(builder, inputs, values, forces), inputs["tau"], strict=True)]
        used = [e * moves for e, moves in zip(errors, self._moves(builder, inputs, rest), strict=True)]
        (transposed,) = replay(
            self.derived.programs["regressor_transpose"], builder, self._motion("regressor_transpose", inputs, used)
        )
        along = [dot(w, used) * f for w, f in zip(self.directions, forces, strict=True)]
        r = [[*transposed[: self.derived.b], *along][k] for k in self.estimated]
        step, shortened = safe_step(builder, gain, dot(r, r), dot(used, used))
        outputs = [
            (
                Port("p_next", (len(r),), "SI", "", "parameters after this sample"),
                [a - step * b for a, b in zip(p, r, strict=True)],
            ),
            (Port("e", (self.n,), "N m | N", "joint", "model torque minus measured torque, before the step"), errors),
            (Port("shortened", (), "", "", "1 where the gain exceeded its bound at this sample, else 0"), [shortened]),
        ]
        return builder.program(
            "step",
            outputs,
            summary="One step of the gradient estimator; the regressor Y is never formed.",
            formula="p_next = p - gain Y' e,  e = Y p - tau   (14.22), (14.23)",
            notes=(
                "Joints at rest are left out of Y' e. Without noise, the distance to the true parameters shrinks while "
                "gain |Y' e|^2 < 2 |e|^2; where a sample breaks that bound, the gain of this step is |e|^2/|Y' e|^2, "
                "with which it shrinks most.",
            ),
        )

    def _inputs(self, builder: Builder) -> dict[str, list[Any]]:
        ports = {name: Port(name, (self.n,), MEANINGS[name][0], "joint", *MEANINGS[name][1:]) for name in JOINT_INPUTS}
        return {name: list(builder.input(port)) for name, port in ports.items()}

    def _motion(self, function: str, inputs: Mapping[str, Any], e: Any = None, beta: Any = None) -> list[Any]:
        values = {
            Role.POSITION: inputs["q"],
            Role.VELOCITY: inputs["dq"],
            Role.ACCELERATION: inputs["ddq"],
            Role.COVECTOR: e,
            Role.BASE_PARAMETERS: beta,
        }
        return [values[port.role] for port in self.derived.programs[function].inputs]

    def _forces(self, builder: Builder, inputs: Mapping[str, Any]) -> list[Any]:
        """Torques that the drive inertias and friction parameters cause at the value 1, one number per parameter.

        Each acts along a direction w in joint space, a unit vector unless motors are coupled: ``w ddq`` for an inertia,
        ``w dq`` for viscous friction, ``sgn(w dq)`` for Coulomb friction, 1 for an offset.
        """
        forces: list[Any] = []
        for term, w in zip(self.terms, self.directions, strict=True):
            match term.kind:
                case "inertia":
                    forces.append(dot(w, inputs["ddq"]))
                case "viscous":
                    forces.append(dot(w, inputs["dq"]))
                case "coulomb":
                    forces.append(builder.sign(dot(w, inputs["dq"])))
                case _:
                    forces.append(1)
        return forces

    def _torques(
        self, builder: Builder, inputs: Mapping[str, Any], values: Mapping[str, Any], forces: list[Any]
    ) -> list[Any]:
        """Joint torques (n,) by inverse dynamics plus friction, for the parameter ``values`` (name -> value).

        ``forces`` are the torques per unit of the drive inertias and friction parameters, from :meth:`_forces`.
        """
        beta = [values[parameter.name] for parameter in self.derived.base_parameters]
        beta += [values.get(term.name, 0) for term in inertia_terms(self.derived.spec)]
        (torques,) = replay(
            self.derived.programs["inverse_dynamics"],
            builder,
            self._motion("inverse_dynamics", inputs, beta=beta),
        )
        for term, w, force in zip(self.terms, self.directions, forces, strict=True):
            if term.kind != "inertia":
                f = values[term.name] * force
                torques = [torque + weight * f for torque, weight in zip(torques, w, strict=True)]
        return torques

    def _moves(self, builder: Builder, inputs: Mapping[str, Any], rest: Any) -> list[Any]:
        """Flags (n,): 0 for a joint at rest, else 1.

        A joint is at rest if its own speed, or that of a coupled motor whose friction acts on it, is below ``rest``.
        """
        surfaces = friction_surfaces(self.derived.spec)
        directions = surfaces.values() if surfaces is not None else [unit(i, self.n) for i in range(self.n)]
        flags: list[Any] = [1] * self.n
        for direction in directions:
            w = [part if type(part) is int else rational(part) for part in direction]
            size = math.sqrt(sum(float(part) ** 2 for part in w))
            speed = builder.abs(dot(w, inputs["dq"]))
            limit = rest if size == 1.0 else Fraction(size) * rest
            for i in range(self.n):
                if w[i]:
                    flags[i] = builder.select(limit - speed, 0, flags[i])
        return flags


def _rest(builder: Builder) -> Any:
    meaning = "speed below which a joint counts as at rest"
    return builder.input(Port("rest", (), "rad/s | m/s", "", meaning))[0]


def safe_step(builder: Builder, gain: Any, rr: Any, ee: Any) -> tuple[Any, Any]:
    """Limit the gain of one step to a stable value: ``ee / rr`` instead of ``gain`` unless ``gain rr < 2 ee``.

    ``rr = |Y' e|^2`` and ``ee = |e|^2``, with the torque errors e of this sample. Returns the gain, and 1 if it was
    reduced, else 0.
    """
    excess = gain * rr - 2 * ee
    largest = builder.div(ee, builder.select(excess, rr, 1))
    return builder.select(excess, largest, gain), builder.select(excess, 1, 0)


# ------------------------------------------------------------------------------------------------------------------
# Gain of the gradient estimator ``p_next = p - gain Y' (Y p - tau)``: its stability bound along a motion, its
# default.
#
# The gain is ``alpha Ts`` of (14.23), with the sampling period Ts in s; Y is the regressor, p the estimated
# parameters.
# ------------------------------------------------------------------------------------------------------------------

USUAL_SHARE = 0.1
"""Share of the bound that averages the torque noise and still converges within some cycles of an exciting motion."""


def gain_bound(regression: Regression, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> float:
    """Largest stable gain along a motion: ``2 / max_k |Y(q_k, dq_k, ddq_k)|_2^2``, spectral norms of the regressor.

    ``q``, ``dq``, ``ddq`` (N, n) are joint positions, velocities and accelerations, rad (m), per s and per s^2. Raises
    :class:`InputError` if Y is zero or not finite all along the motion. Source: (14.23).
    """
    import numpy as np

    motion: list[Any] = [np.asarray(part, dtype=float) for part in (q, dq, ddq)]
    Y = evaluate(regression.rows, *motion, np.zeros_like(motion[0]), 0.0)[0]
    largest = float(np.max(np.linalg.norm(Y, 2, axis=(-2, -1))))
    if not 0.0 < largest < np.inf:
        raise InputError("the motion does not load the parameters: there is no gain for it")
    return 2.0 / largest**2


def chosen_gain(stated: float | None, bound: float | None) -> float:
    """Gain to use: the ``stated`` one, or a tenth of the ``bound`` of :func:`gain_bound` if none is stated.

    Raises :class:`InputError` for a stated gain that is not between 0 and the bound, or if both are None.
    """
    if stated is None and bound is None:
        raise InputError("the gradient estimator needs a gain: state one, or a motion from which it is chosen")
    if bound is not None and stated is not None and not 0.0 < stated < bound:
        raise InputError(
            f"the gradient estimator is unstable along this motion: alpha Ts = {stated:.4g} is not below "
            f"2/max |Y|^2 = {bound:.4g}; a tenth of it, {USUAL_SHARE * bound:.4g}, averages the noise"
        )
    return stated if stated is not None else USUAL_SHARE * float(bound or 0.0)


# ------------------------------------------------------------------------------------------------------------------
# C code of the online estimators, recursive least squares and the gradient method; the caller holds their state.
# ------------------------------------------------------------------------------------------------------------------

Kind = Literal["rls", "gradient"]
KINDS: tuple[Kind, ...] = ("rls", "gradient")
TITLES = {"rls": "recursive least squares with directional forgetting", "gradient": "gradient estimation"}

DEFAULT_NOISE = 0.1
DEFAULT_FORGETTING = 0.999
DEFAULT_REST = 0.01
DEFAULT_SPREAD = 10.0
LARGEST = {"double": 1e150, "float": 1e15}
REAL_BYTES = {"double": 8, "float": 4}
SPARE_STACK = 512
"""Bytes beside the arrays of an update: saved registers and sums."""
NEGLIGIBLE = {"double": 1e-24, "float": 1e-12}
"""Share of the noise variance below which a row says nothing about the parameters: the square of the rounding."""


@dataclass(frozen=True)
class EstimatorSettings:
    """Initial values and tuning of an online estimator of p parameters for a robot of n joints.

    - ``start`` (p,): initial parameters; if None those of the robot file, or 0 if it states no link masses.
    - ``spread`` (p,): their standard deviations, for recursive least squares; if None, each is ten times the largest
      parameter of the robot file, or 10 if it states no link masses.
    - ``noise`` (n, n): covariance of the torque noise, (N m)^2; 0.1 N m at every joint if None.
    - ``forgetting``: forgetting factor of recursive least squares, in (0, 1]; 1 weights all samples alike.
    - ``gain``: gain ``alpha Ts`` of the gradient method, (14.23).
    - ``rest``: speed in rad/s (m/s) below which a joint's equation is skipped, because friction at rest is unknown.
    """

    start: tuple[float, ...] | None = None
    spread: tuple[float, ...] | None = None
    noise: tuple[tuple[float, ...], ...] | None = None
    forgetting: float = DEFAULT_FORGETTING
    gain: float | None = None
    rest: float = DEFAULT_REST

    def fill_defaults(self, regression: Regression) -> EstimatorTuning:
        """These settings with every default filled in; raises :class:`InputError` that lists all invalid ones."""
        p, n = len(regression.names), regression.joints
        typical = max((abs(value) for value in regression.nominal or ()), default=0.0) or 1.0
        tuning = EstimatorTuning(
            start=self.start if self.start is not None else regression.nominal or (0.0,) * p,
            spread=self.spread if self.spread is not None else (DEFAULT_SPREAD * typical,) * p,
            noise=self.noise
            if self.noise is not None
            else tuple(tuple(DEFAULT_NOISE**2 * (i == j) for j in range(n)) for i in range(n)),
            forgetting=self.forgetting,
            gain=self.gain,
            rest=self.rest,
        )
        faults = tuning.faults(p, n)
        if faults:
            raise InputError(f"online estimator: {'; '.join(faults)}")
        return tuning


@dataclass(frozen=True)
class EstimatorTuning:
    """Complete settings of an online estimator; the fields are those of :class:`EstimatorSettings`.

    Only ``gain`` may be None, because recursive least squares has none.
    """

    start: tuple[float, ...]
    spread: tuple[float, ...]
    noise: tuple[tuple[float, ...], ...]
    forgetting: float
    gain: float | None
    rest: float

    def faults(self, p: int, n: int) -> list[str]:
        """Messages about settings that are invalid for ``p`` parameters and ``n`` joints; empty if all are valid."""
        usable = {
            f"the start needs {p} finite values": len(self.start) == p and all(map(math.isfinite, self.start)),
            f"the standard deviations at the start are {p} values, finite and not negative": len(self.spread) == p
            and all(math.isfinite(value) and value >= 0.0 for value in self.spread),
            f"the forgetting factor lies in (0, 1], not {self.forgetting:g}": 0.0 < self.forgetting <= 1.0,
            "the speed of a joint at rest is finite and not negative": math.isfinite(self.rest) and self.rest >= 0.0,
            "the gain is finite and positive": self.gain is None or (math.isfinite(self.gain) and self.gain > 0.0),
            f"the torque noise needs a symmetric, positive definite {n} x {n} covariance": _is_covariance(
                self.noise, n
            ),
        }
        return [fault for fault, holds in usable.items() if not holds]


def _is_covariance(rows: Sequence[Sequence[float]], n: int) -> bool:
    """Whether ``rows`` form a symmetric, positive definite matrix (n, n), judged by the pivots of its elimination."""
    if len(rows) != n or any(len(row) != n or not all(map(math.isfinite, row)) for row in rows):
        return False
    if any(rows[i][j] != rows[j][i] for i in range(n) for j in range(i)):
        return False
    left = [list(row) for row in rows]
    for k in range(n):
        if not left[k][k] > 0.0:
            return False
        for i in range(k + 1, n):
            factor = left[i][k] / left[k][k]
            left[i] = [a - factor * b for a, b in zip(left[i], left[k], strict=True)]
    return True


def estimator_files(regression: Regression, kind: Kind, settings: EstimatorSettings, real: Real) -> dict[str, str]:
    """Header and source of an online estimator in C, as file name -> text: ``<robot>_<kind>.h`` and ``.c``.

    They define the state struct that the caller holds, a function that initializes it and one that updates it with a
    sample. ``kind`` is "rls" or "gradient", ``real`` the C type of all numbers. Raises :class:`InputError` for invalid
    settings, or for a gradient estimator without a gain.
    """
    prefix = f"{regression.robot}_{kind}"
    chosen = settings.fill_defaults(regression)
    if kind == "gradient" and chosen.gain is None:
        raise InputError("the gradient estimator needs a gain")
    dialect = Dialect(prefix, real)
    values = _values(regression, kind, chosen, dialect)
    title = f"online estimation of {len(regression.names)} parameters of {regression.robot}, {TITLES[kind]}"
    program = regression.rows if kind == "rls" else regression.gradient
    return function_files(
        prefix, title, [program], real, extension=Extension(kind, values, preamble=nonfinite_function(dialect))
    )


def _values(regression: Regression, kind: Kind, chosen: EstimatorTuning, dialect: Dialect) -> dict[str, object]:
    """Values of the variables in the C templates of the estimator ``kind``, by name."""

    def literal(value: float) -> str:
        return dialect.literal(Fraction(value))

    unit = "SI"
    arguments = columns(
        [
            ("in", "q, dq, ddq", "rad | m, per s", "the motion at this sample, as the Kalman filter returns it"),
            ("in", "tau", "N m | N", "measured torques, less friction compensated with known parameters"),
            ("out", "e", "N m | N", _ERRORS[kind]),
        ]
    )
    n, p = regression.joints, len(regression.names)
    arrays = n * (p + n + 3) + 3 * p if kind == "rls" else p
    values: dict[str, object] = {
        "n": n,
        "p": p,
        "stack": SPARE_STACK + arrays * REAL_BYTES[dialect.real],
        "names": regression.names,
        "zero": literal(0.0),
        "one": literal(1.0),
        "largest": literal(LARGEST[dialect.real]),
        "negligible": literal(NEGLIGIBLE[dialect.real]),
        "rest": literal(chosen.rest),
        "arguments": arguments,
    }
    listed = zip(regression.names, chosen.start, chosen.spread, strict=True)
    if chosen.gain is not None and kind == "gradient":
        values |= {"initial": [literal(v) for v in chosen.start], "gain": literal(chosen.gain)}
        values["start"] = columns(
            [(f"p[{k}]", name, unit, f"{value:.9g}") for k, (name, value, _) in enumerate(listed)]
        )
        return values
    values |= {
        "initial": [(literal(v), literal(s * s)) for v, s in zip(chosen.start, chosen.spread, strict=True)],
        "noise": [literal(v) for row in chosen.noise for v in row],
        "forgetting": literal(chosen.forgetting),
        "start": columns(
            [(f"p[{k}]", name, unit, f"{value:.9g} +- {std:.4g}") for k, (name, value, std) in enumerate(listed)]
        ),
    }
    return values


_ERRORS = {
    "rls": "measured minus model torque, before the update",
    "gradient": "model minus measured torque, before the update",
}
