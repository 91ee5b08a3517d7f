"""Programs that compute the friction of all joints; the C, CasADi and NumPy functions are printed from them.

The optional argument ``surfaces`` serves robots whose motors are coupled, where friction acts at joints and at motor
shafts: it maps the name of each to its direction w (joints,), with the speed ``w dq`` and the joint torques ``w' f``.
Equation numbers (14.x): Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.program import Builder, Domain, Port, Program, Role, Value
from rrrgen.program.builder import Number
from rrrgen.program.guard import add_guard
from rrrgen.robot.friction.laws import FrictionLaw

Surfaces = Mapping[str, Sequence[Number]]
"""The joints and motor shafts at which friction acts, by name, each with its direction ``w`` (joints,) in joint space:
the sliding speed is ``w dq``, and friction f contributes the joint torques ``w' f``."""


def _ports(
    builder: Builder, law: FrictionLaw, joints: int, names: Sequence[str], surfaces: Surfaces | None = None
) -> tuple[list[list[Any]], list[Any]]:
    """Declare the inputs of a friction program: the vectors ``names`` ("dq", "z") and the parameters ``friction``.

    Returns the vectors in the order of ``names``, where dq holds the sliding speed at each of the ``surfaces``, and the
    parameters, one list per joint or surface. For a load-dependent law the program also gets the input ``tau_load``,
    the torques that each joint or motor carries without friction, and the parameters returned are those under this
    load.
    """
    count, frame = (joints, "joint") if surfaces is None else (len(surfaces), "joint or motor")
    described = {
        "dq": (joints, "rad/s | m/s", "joint velocities", Role.VELOCITY),
        "z": (count, "rad | m", f"bristle deflections, one per {frame}", Role.OTHER),
    }
    vectors = []
    for name in names:
        size, unit, meaning, role = described[name]
        vectors.append(list[Any](builder.input(Port(name, (size,), unit, "joint", meaning, role))))
    if surfaces is not None:
        vectors[0] = [_along(w, vectors[0]) for w in surfaces.values()]
    size = len(law.parameters)
    rows = "row per joint" if surfaces is None else f"rows {', '.join(surfaces)}"
    meaning = f"{rows}: " + ", ".join(p.name for p in law.parameters)
    values = builder.input(Port("friction", (count, size), "mixed", "joint", meaning, Role.FRICTION))
    parameters: list[Any] = [values[i * size : (i + 1) * size] for i in range(count)]
    if law.has_load:
        meaning = f"torques without friction, one per {frame}"
        load = builder.input(Port("tau_load", (count,), "N m | N", "joint", meaning))
        parameters = [law.under_load(row, builder.abs(at)) for row, at in zip(parameters, load, strict=True)]
    return vectors, parameters


def _along(w: Sequence[Number], values: Sequence[Any]) -> Any:
    total: Any = 0
    for weight, value in zip(w, values, strict=True):
        total = total + weight * value
    return total


def _at_joints(torques: list[Any], joints: int, surfaces: Surfaces | None) -> list[Any]:
    """Joint torques (joints,) ``sum_k w_k' f_k`` of the friction ``torques`` f_k at the ``surfaces``.

    Without surfaces friction acts at the joints, and the torques are returned as they are.
    """
    if surfaces is None:
        return torques
    return [_along([w[i] for w in surfaces.values()], torques) for i in range(joints)]


def _torque_port(joints: int) -> Port:
    return Port(
        "tau_f", (joints,), "N m | N", "joint", "friction torques, to be added to the rigid body's", Role.TORQUE
    )


def friction_program(law: FrictionLaw, joints: int, surfaces: Surfaces | None = None) -> Program:
    """Program for the friction torques (joints,) from ``dq`` (joints,) and the parameters ``friction`` (joints, k).

    With ``surfaces`` the parameters have one row per surface instead of one per joint. A law with a state is evaluated
    in steady sliding, dz/dt = 0. Source: (14.11)-(14.14).
    """
    builder = Builder()
    (speeds,), rows = _ports(builder, law, joints, ["dq"], surfaces)
    torques = [law.torque(builder, speed, row) for speed, row in zip(speeds, rows, strict=True)]
    return builder.program(
        f"friction_{law.name}",
        [(_torque_port(joints), _at_joints(torques, joints, surfaces))],
        summary="Friction torques of all joints." if law.rate is None else "Friction torques in steady sliding.",
        formula=f"{law.formula}   {law.equation}",
        notes=("sgn(0) = 0.",),
    )


def friction_columns_program(law: FrictionLaw, joints: int) -> Program:
    """Program for the regressor columns Y_f (joints, k joints) of a linear law: friction torques ``Y_f p_f``.

    p_f (k joints,) are the parameters, joint by joint. The input is ``dq`` (joints,).
    Raises InputError for a law that is not linear in its parameters.
    """
    if law.columns is None:
        raise InputError(f"friction law '{law.name}' is not linear in its parameters and has no regressor columns")
    builder = Builder()
    dq = builder.input(Port("dq", (joints,), "rad/s | m/s", "joint", "joint velocities", Role.VELOCITY))
    size = len(law.parameters)
    entries: list[Value] = [0] * (joints * joints * size)
    for i in range(joints):
        for k, value in enumerate(law.columns(builder, dq[i])):
            entries[i * joints * size + i * size + k] = value
    port = Port("Y_f", (joints, joints * size), "mixed", "joint", "friction columns, joint by joint")
    return builder.program(
        f"friction_columns_{law.name}", [(port, entries)], summary="Regressor columns of linear friction."
    )


def friction_step_program(law: FrictionLaw, joints: int, surfaces: Surfaces | None = None) -> Program:
    """Program that advances a law with a state by one period: from ``dq``, ``z`` and ``Ts`` (s) to next z and torques.

    With ``surfaces`` there is a state and a row of parameters per surface instead of per joint. The step is exact for
    constant speed and therefore stable for any period. Source: (14.13).
    Raises InputError for a law without a state.
    """
    if law.step is None:
        raise InputError(f"friction law '{law.name}' has no state to step")
    builder = Builder()
    (speeds, z), rows = _ports(builder, law, joints, ["dq", "z"], surfaces)
    period = builder.input(Port("Ts", (), "s", "", "period", domain=Domain.PERIOD))[0]
    steps = [law.step(builder, *arguments, period) for arguments in zip(z, speeds, rows, strict=True)]
    torques = _at_joints([torque for _, torque in steps], joints, surfaces)
    following = Port("z_next", (len(z),), "rad | m", "joint", "bristle deflections at the end of the period", state="z")
    program = builder.program(
        f"friction_step_{law.name}",
        [(following, [s[0] for s in steps]), (_torque_port(joints), torques)],
        summary="One period of friction with a state, stable for every period.",
        formula=f"{law.formula}   {law.equation}, exact for constant dq",
        notes=("sgn(0) = 0.",),
    )
    return add_guard(program)


def friction_rate_program(law: FrictionLaw, joints: int) -> Program:
    """Program for the state equation of a law with a state: from ``dq`` and ``z`` to dz/dt and torques, (14.13).

    Raises InputError for a law without a state.
    """
    if law.rate is None or law.state_torque is None:
        raise InputError(f"friction law '{law.name}' has no state")
    builder = Builder()
    (dq, z), rows = _ports(builder, law, joints, ["dq", "z"])
    rates = [law.rate(builder, z[i], dq[i], rows[i]) for i in range(joints)]
    torques = [law.state_torque(builder, z[i], dq[i], rows[i]) for i in range(joints)]
    return builder.program(
        f"friction_rate_{law.name}",
        [
            (Port("dz", (joints,), "rad/s | m/s", "joint", "rate of the bristle deflections"), rates),
            (_torque_port(joints), torques),
        ],
        summary="State equation of friction.",
        formula=f"{law.formula}   {law.equation}",
        notes=("sgn(0) = 0.",),
    )
