"""Functions that the unit calls and that the model does not have: laws without friction, the step of the estimator, and
laws and observer that share what both compute from q or from parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.controller.table import ControllerUnit
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.derive.recursions.link_frames import rational
from rrrgen.emit.controller.online_estimators import safe_step
from rrrgen.program import Builder, Op, Port, Program, Role
from rrrgen.program.builder import Value, replay
from rrrgen.program.sharing import share_values
from rrrgen.robot.model.drives import inertia_terms

ESTIMATOR = "estimator"

SINES = "sines"
"""The function of q, called once a tick, whose results the law, the observer and the estimator share."""

DECAY = "decay"
"""The function of parameters, called when they are set, whose result the observer and contact detection share."""


def own_programs(unit: ControllerUnit) -> dict[str, Program]:
    """The functions that are printed beside the unit, by name; those of them that the model has too replace it."""
    programs = {}
    if not unit.has("friction"):
        programs = {p.name: without_friction(p) for p in called_programs(unit) if p.takes(Role.FRICTION)}
    if unit.has("estimator"):
        programs[ESTIMATOR] = estimator_program(unit)
    if unit.has("observer"):
        both = {name: programs.get(name, unit.model.programs[name]) for name in ("momentum_observer", "contact")}
        programs |= share_values(
            both, DECAY, ("gain", "Ts"), (Op.EXP,), "The share of an estimate that a period leaves."
        )
    if unit.has("observer") or unit.has("estimator"):
        laws = {unit.law(mode) for mode in unit.modes} - {"", "gravity"}
        every = {name: unit.model.programs[name] for name in sorted(laws)} | programs
        programs |= share_values(every, SINES, ("q",), (Op.SIN, Op.COS), "Sines and cosines of the positions.")
    return programs


def called_programs(unit: ControllerUnit) -> list[Program]:
    """The functions of the model that the unit calls."""
    names = [unit.law(mode) for mode in unit.modes]
    names += ["momentum_observer", "momentum_observer_start", "contact"] if unit.has("observer") else []
    names += ["add_payload"] if unit.has("payload") else []
    names += ["jacobian"] if unit.has("velocity") else []
    names += ["closed_loops"] if unit.model.spec.loops else []
    return [unit.model.programs[name] for name in dict.fromkeys(filter(None, names))]


def without_friction(program: Program) -> Program:
    """The program with all friction parameters zero: recording it again folds every operation on them."""
    builder = Builder()
    known = {"friction": 0, "width": 1}
    inputs: list[Sequence[Value]] = [
        [known[port.name]] * port.size if port.name in known else builder.input(port) for port in program.inputs
    ]
    outputs = list(zip(program.outputs, replay(program, builder, inputs), strict=True))
    return builder.program(
        program.name, outputs, f"{program.summary} Without friction.", "", program.notes, program.status
    )


def estimator_program(unit: ControllerUnit) -> Program:
    """One step of the gradient estimator (14.23) of the base parameters, with a gain for each of them.

    With ``e = Y beta + f(dq) - tau`` at the joints that move, ``beta_next = beta - mu G Y' e`` with G = diag(gain) and
    mu = 1, or less where the sample needs it: a step shrinks the weighted distance ``|beta - true|^2`` (weights 1/gain)
    while ``mu e' Y G Y' e < 2 e' e``. Friction f has the known parameters of the unit.
    """
    builder, n, model = Builder(), unit.n, unit.model
    size = model.beta_size
    known: dict[str, Any] = {
        name: builder.input(Port(name, (count,), quantity, "", meaning, role))
        for name, count, quantity, meaning, role in (
            ("q", n, "rad | m", "positions", Role.POSITION),
            ("dq", n, "rad/s | m/s", "velocities", Role.VELOCITY),
            ("ddq", n, "rad/s^2 | m/s^2", "accelerations", Role.ACCELERATION),
            ("tau", n, "N m | N", "torques of the last period", Role.TORQUE),
            ("rest", n, "rad/s | m/s", "speeds below which the equation of a joint is left out", Role.OTHER),
            ("gain", size, "SI", "gains of the parameters", Role.OTHER),
            ("beta", size, "SI", "parameters", Role.BASE_PARAMETERS),
        )
    }
    (torques,) = _record(builder, model.programs["inverse_dynamics"], known)
    if unit.has("friction") and friction_parameters(model.spec):
        (friction,) = _record(builder, model.programs["smooth_friction"], {**known, "tau_load": known["tau"]})
        torques = [a + b for a, b in zip(torques, friction, strict=True)]
    e = [
        builder.select(builder.abs(dq) - rest, model_torque - tau, 0)
        for dq, rest, model_torque, tau in zip(known["dq"], known["rest"], torques, known["tau"], strict=True)
    ]
    (links,) = _record(builder, model.programs["regressor_transpose"], {**known, "e": e})
    drives = [[w if type(w) is int else rational(w) for w in term.direction] for term in inertia_terms(model.spec)]
    r = [*links[: model.b], *(_dot(w, e) * _dot(w, known["ddq"]) for w in drives)]
    scaled = [g * value for g, value in zip(known["gain"], r, strict=True)]
    mu, _ = safe_step(builder, 1, _dot(scaled, r), _dot(e, e))
    following = [b - mu * step for b, step in zip(known["beta"], scaled, strict=True)]
    outputs = [(Port("beta_next", (size,), "SI", "", "parameters after this sample"), following)]
    return builder.program(
        ESTIMATOR,
        outputs,
        summary="One step of the online estimator of the base parameters.",
        formula="beta_next = beta - mu G Y' e,  e = Y beta + f(dq) - tau   (14.22), (14.23)",
        notes=("mu = 1, or e' e/(e' Y G Y' e) where a sample breaks the bound of stability.",),
    )


def _record(builder: Builder, program: Program, known: dict[str, Any]) -> list[list[Value]]:
    """Record ``program`` with the ``known`` values of its inputs; the others become inputs, known from then on."""
    for port in program.inputs:
        if port.name not in known:
            known[port.name] = builder.input(port)
    return replay(program, builder, [known[port.name] for port in program.inputs])


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    total: Any = 0
    for left, right in zip(a, b, strict=True):
        total = total + left * right
    return total
