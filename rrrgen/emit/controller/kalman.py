"""Program for one step of the steady-state Kalman filters of all joints, with their coefficients as constants."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.program.guard import guarded

_MOTION = (
    ("q_r", "rad | m", "positions"),
    ("dq_r", "rad/s | m/s", "velocities"),
    ("ddq_r", "rad/s^2 | m/s^2", "accelerations"),
)


def kalman_program(
    transitions: Sequence[Sequence[Sequence[float]]], gains: Sequence[Sequence[float]], period: float
) -> Program:
    """Program for one step of the Kalman filters of all joints: encoder readings to positions, speeds, accelerations.

    The state x is the predicted deviation from the reference, [e, de, dde]. Per joint ``e = y - q_r - x_0``, ``x_bar =
    x + k e``, ``x_next = E x_bar``, and the motion is ``x_bar + [q_r, dq_r, ddq_r]``. ``transitions`` (n, 3, 3) are E
    of (14.29), ``gains`` (n, 3) k of (14.30), ``period`` Ts in s, for the documentation. Inputs ``x`` (n, 3), the
    prediction of the step before (0 at the start), ``y`` (n,), and the reference ``q_r``, ``dq_r``, ``ddq_r`` (n,);
    outputs ``x_next`` (n, 3), ``q``, ``dq``, ``ddq`` (n,), ``e`` (n,). Source: (14.30)-(14.31).
    """
    n = len(gains)
    if len(transitions) != n or any(len(k) != 3 for k in gains):
        raise InputError("Kalman filter: the transitions must be (n, 3, 3) and the gains (n, 3)")
    builder = Builder()
    state = builder.input(Port("x", (n, 3), "rad, rad/s, rad/s^2 | m..", "joint", "prediction of the deviation"))
    y = builder.input(Port("y", (n,), "rad | m", "joint", "encoder readings"))
    references = [
        builder.input(Port(name, (n,), unit, "joint", f"reference {meaning}")) for name, unit, meaning in _MOTION
    ]
    following: list[Any] = []
    motion: list[list[Any]] = [[], [], []]
    innovations: list[Any] = []
    for i in range(n):
        innovation = y[i] - references[0][i] - state[3 * i]
        updated = [state[3 * i + k] + Fraction(float(gains[i][k])) * innovation for k in range(3)]
        for row in transitions[i]:
            total: Any = 0
            for weight, value in zip(row, updated, strict=True):
                total = total + Fraction(float(weight)) * value
            following.append(total)
        for k in range(3):
            motion[k].append(updated[k] + references[k][i])
        innovations.append(innovation)
    outputs = [
        (
            Port("x_next", (n, 3), "rad, rad/s, rad/s^2 | m..", "joint", "prediction for the next sample", state="x"),
            following,
        ),
        (Port("q", (n,), "rad | m", "joint", "positions", Role.POSITION), motion[0]),
        (Port("dq", (n,), "rad/s | m/s", "joint", "velocities", Role.VELOCITY), motion[1]),
        (Port("ddq", (n,), "rad/s^2 | m/s^2", "joint", "accelerations", Role.ACCELERATION), motion[2]),
        (Port("e", (n,), "rad | m", "joint", "innovations"), innovations),
    ]
    program = builder.program(
        "kalman_step",
        outputs,
        summary=f"One step of the steady-state Kalman filter, once per sample of {period:.9g} s.",
        formula="e = y - q_r - x_0, x_bar = x + k e, x_next = E x_bar, motion = x_bar + reference   (14.30), (14.31)",
        notes=("Start with x = 0; pass x_next as x at the next sample.",),
    )
    return guarded(program)
