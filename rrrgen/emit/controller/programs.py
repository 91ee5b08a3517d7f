"""Programs of the online estimators that depend on the robot: regressor rows, and one step of the gradient method.

The estimated parameters are the base parameters, then the drive inertias and friction parameters that the robot file
states, without those whose values the caller fixes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.recursions.link_frames import rational
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.program.builder import replay
from rrrgen.robot.model.drive_terms import DriveTerm, drive_terms, friction_surfaces, inertia_terms, unit

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
    is left to estimate.
    """
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
        along = [_dot(w, used) * f for w, f in zip(self.directions, forces, strict=True)]
        r = [[*transposed[: self.derived.b], *along][k] for k in self.estimated]
        step, shortened = _safe_step(builder, gain, _dot(r, r), _dot(used, used))
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
        found: list[Any] = []
        for term, w in zip(self.terms, self.directions, strict=True):
            match term.kind:
                case "inertia":
                    found.append(_dot(w, inputs["ddq"]))
                case "viscous":
                    found.append(_dot(w, inputs["dq"]))
                case "coulomb":
                    found.append(builder.sign(_dot(w, inputs["dq"])))
                case _:
                    found.append(1)
        return found

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
        found: list[Any] = [1] * self.n
        for direction in directions:
            w = [part if type(part) is int else rational(part) for part in direction]
            size = math.sqrt(sum(float(part) ** 2 for part in w))
            speed = builder.abs(_dot(w, inputs["dq"]))
            limit = rest if size == 1.0 else Fraction(size) * rest
            for i in range(self.n):
                if w[i]:
                    found[i] = builder.select(limit - speed, 0, found[i])
        return found


def _rest(builder: Builder) -> Any:
    meaning = "speed below which a joint counts as at rest"
    return builder.input(Port("rest", (), "rad/s | m/s", "", meaning))[0]


def _dot(weights: Sequence[Any], values: Sequence[Any]) -> Any:
    total: Any = 0
    for weight, value in zip(weights, values, strict=True):
        total = total + weight * value
    return total


def _safe_step(builder: Builder, gain: Any, rr: Any, ee: Any) -> tuple[Any, Any]:
    """Limit the gain of one step to a stable value: ``ee / rr`` instead of ``gain`` unless ``gain rr < 2 ee``.

    ``rr = |Y' e|^2`` and ``ee = |e|^2``, with the torque errors e of this sample. Returns the gain, and 1 if it was
    reduced, else 0.
    """
    excess = gain * rr - 2 * ee
    largest = builder.div(ee, builder.select(excess, rr, 1))
    return builder.select(excess, largest, gain), builder.select(excess, 1, 0)
