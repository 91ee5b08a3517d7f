"""Friction of all joints as programs: what the emitted C, CasADi and NumPy functions are printed from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.errors import InputError
from rrrgen.friction.laws import FrictionLaw
from rrrgen.program import Builder, Port, Program, Role, Value


def _ports(builder: Builder, law: FrictionLaw, joints: int, names: Sequence[str]) -> tuple[list[list[Any]], list[Any]]:
    """The vector inputs ``names`` in order, then the parameters (joints, k) row by row."""
    described = {
        "dq": ("rad/s | m/s", "joint velocities", Role.VELOCITY),
        "z": ("rad | m", "bristle deflections, one per joint", Role.OTHER),
    }
    vectors = []
    for name in names:
        unit, meaning, role = described[name]
        vectors.append(list[Any](builder.input(Port(name, (joints,), unit, "joint", meaning, role))))
    size = len(law.parameters)
    meaning = "row per joint: " + ", ".join(p.name for p in law.parameters)
    values = builder.input(Port("friction", (joints, size), "mixed", "joint", meaning, Role.FRICTION))
    return vectors, [values[i * size : (i + 1) * size] for i in range(joints)]


def _torque_port(joints: int) -> Port:
    return Port(
        "tau_f", (joints,), "N m | N", "joint", "friction torques, to be added to the rigid body's", Role.TORQUE
    )


def friction_program(law: FrictionLaw, joints: int) -> Program:
    """Friction torques (joints,) from ``dq`` (joints,) and the parameters ``friction`` (joints, k).

    A law with a state is taken in sliding, dz/dt = 0. Source: (14.11)-(14.14).
    """
    builder = Builder()
    (dq,), rows = _ports(builder, law, joints, ["dq"])
    torques = [law.torque(builder, dq[i], rows[i]) for i in range(joints)]
    return builder.program(
        f"friction_{law.name}",
        [(_torque_port(joints), torques)],
        summary="Friction torques of all joints." if law.rate is None else "Friction torques in steady sliding.",
        formula=f"{law.formula}   {law.equation}",
        notes=("sgn(0) = 0.",),
    )


def friction_columns_program(law: FrictionLaw, joints: int) -> Program:
    """The columns (joints, k*joints) that a linear law adds to a regressor; parameters stand joint by joint.

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


def friction_step_program(law: FrictionLaw, joints: int) -> Program:
    """One period of a law with a state: from ``dq``, ``z`` and the period ``Ts`` to the next z and the torque.

    Exact for a constant speed, so that no period makes it unstable. Source: (14.13).
    Raises InputError for a law without a state.
    """
    if law.step is None:
        raise InputError(f"friction law '{law.name}' has no state to step")
    builder = Builder()
    (dq, z), rows = _ports(builder, law, joints, ["dq", "z"])
    period = builder.input(Port("Ts", (), "s", "", "period"))[0]
    steps = [law.step(builder, z[i], dq[i], rows[i], period) for i in range(joints)]
    following = Port("z_next", (joints,), "rad | m", "joint", "bristle deflections at the end of the period")
    return builder.program(
        f"friction_step_{law.name}",
        [(following, [s[0] for s in steps]), (_torque_port(joints), [s[1] for s in steps])],
        summary="One period of friction with a state, stable for every period.",
        formula=f"{law.formula}   {law.equation}, exact for constant dq",
        notes=("sgn(0) = 0.",),
    )


def friction_rate_program(law: FrictionLaw, joints: int) -> Program:
    """The state equation of a law with a state: from ``dq`` and ``z`` to dz/dt and the torque. Source: (14.13).

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
