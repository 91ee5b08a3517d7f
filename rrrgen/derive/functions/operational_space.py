"""Recorders of operational-space control: the tip accelerates as commanded, and the other motion does not disturb it.

After Khatib (1987), with the error e_x of the tip (position, then rotation), its desired velocity V_d and acceleration
A_d, and the state z of the integral action,

    tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0,   L = inv(J inv(M) J'),
    a = A_d + kp e_x + kd (V_d - J dq) + ki z.

``tau_0 - J' L J inv(M) tau_0`` is the dynamically consistent projection of the torques tau_0 of a second task: they
accelerate the joints of a redundant arm and not the tip.

Where J loses rank, L has no limit. ``A = J inv(M) J'`` is therefore damped: with A = F D F' (F unit lower triangular),
and s the mean diagonal entry of A over its linear or angular rows,

    A + delta diag(s),   delta = max(0, damping - min over i of D_i/s_i),

which is exact away from singular configurations and continuous on the way to them. While delta > 0 the status says so,
and the integral action rests. O. Khatib, A unified approach for motion and force control of robot manipulators, IEEE
Journal of Robotics and Automation 3(1), 1987.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.dynamics import block_frames_first, torque_port
from rrrgen.derive.functions.recording import FunctionBuilder, Recorder
from rrrgen.derive.recursions import kinematics, newton_euler
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.linear_algebra import (
    Matrix,
    Vector,
    add,
    cross,
    dot,
    factorize,
    product,
    scale,
    subtract,
    times,
    transpose,
)
from rrrgen.derive.recursions.link_frames import ResidueConstants, residue_chain
from rrrgen.program import Builder, Port, Program, Status, Value
from rrrgen.program.finite_field import Residue
from rrrgen.robot.model import build_model
from rrrgen.robot.spec import RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# Parts shared by control laws for the tip: the error of a pose, and the limitation of torques.
# ------------------------------------------------------------------------------------------------------------------


def rotation_error(R: Matrix, R_d: Matrix) -> Vector:
    """The rotation error from the orientation ``R`` to ``R_d``, (3, 3) each, as the vector sin(angle) axis (3,).

    It is half the sum over k of c_k x c_dk, with c_k and c_dk the columns of the matrices. The direction is exact below
    90 degrees; for larger angles the length decreases again.
    """
    total: Vector = [0, 0, 0]
    for k in range(3):
        total = add(total, cross([row[k] for row in R], [row[k] for row in R_d]))
    return scale(Fraction(1, 2), total)


def limit_torques(b: Builder, tau: Sequence[Any], tau_max: Sequence[Any]) -> tuple[Vector, Vector]:
    """Limit ``tau`` (n,) to +- ``tau_max`` (n,); also returns 1 for every joint that was beyond its limit, else 0."""
    above = [b.sub(b.abs(t), limit) for t, limit in zip(tau, tau_max, strict=True)]
    held = [b.select(over, b.mul(b.sign(t), limit), t) for over, t, limit in zip(above, tau, tau_max, strict=True)]
    return held, [b.select(over, 1, 0) for over in above]


# ------------------------------------------------------------------------------------------------------------------
# Recorders of operational-space control
# ------------------------------------------------------------------------------------------------------------------

GAINS = ("kp", "kd", "ki")


@dataclass(frozen=True)
class _ControlledTask:
    """The controlled quantity: the pose of the tip (6 rows of the Jacobian) or its position (the first 3)."""

    prefix: str
    rows: int
    words: str
    integral: str
    """Unit of the integral of its error."""

    def error(self, r: FunctionBuilder, T: Matrix) -> Vector:
        """The error e_x of the tip (rows,) at the pose ``T``; declares the desired pose or position."""
        if self.rows == 3:
            p_d = r.take("p_d")
            return [p_d[i] - T[i][3] for i in range(3)]
        T_d = r.take("T_d")
        turn = rotation_error([row[:3] for row in T[:3]], [T_d[4 * i : 4 * i + 3] for i in range(3)])
        return [*(T_d[4 * i + 3] - T[i][3] for i in range(3)), *turn]


def tip_moves(spec: RobotSpec) -> tuple[bool, bool]:
    """Whether the joints move the position of the tip anywhere, and whether they turn it.

    Where they do not, as in three axes through the tip or a branch beside it, A has a zero block and no mean to damp
    by. The Jacobian is that of a random configuration in the finite field, where nothing cancels by rounding.
    """
    chain, _ = residue_chain(build_model(spec), ResidueConstants(seed=1))
    J = kinematics.jacobian(chain)
    moved = [any(Residue.of(entry).value for entry in row) for row in J]
    return any(moved[:3]), any(moved[3:])


POSE = _ControlledTask("", 6, "pose", "m s, rad s")
POSITION = _ControlledTask("position_", 3, "position", "m s")


def operational_space(task: _ControlledTask) -> Recorder:
    """Make a recorder of one tick of operational-space control of the tip (Khatib 1987).

    Outputs are the torques (n,), limited to ``tau_max``, the state z of the integral action for the next tick, and the
    status, 1 where the tip is damped near a singular configuration.
    """

    def record(r: FunctionBuilder) -> Program:
        b, count = r.builder, task.rows
        chain, dq = r.chain_in_gravity("dq"), r.joints("dq")
        T, J = kinematics.forward_kinematics(chain), kinematics.jacobian(chain)[:count]
        e = task.error(r, T)
        V_d = r.take("V_d")
        A_d = r.take("A_d")
        kp, kd, ki = (r.take(name) for name in GAINS)
        z = r.take("z")
        tau_0 = r.take("tau_0")
        (damping,) = r.take("damping")
        inertias = r.inertias()
        mass = r.drive_inertia().added_to_mass(composite.mass_matrix(chain, inertias))
        M = factorize(b, mass, tips_first=r.branches)
        h = newton_euler.inverse_dynamics(chain, dq, [0] * r.n, inertias, block_frames_first(chain))
        X = transpose([M.solve(list(row)) for row in J])  # inv(M) J', (n, rows)
        wanted = [
            a + p * x + d * (v_d - v) + i * s
            for a, p, x, d, v_d, v, i, s in zip(A_d, kp, e, kd, V_d, times(J, dq), ki, z, strict=True)
        ]
        drift = add(kinematics.jacobian_dot_dq(chain, dq)[:count], times(transpose(X), tau_0))
        force, delta, singular = _damped_solution(b, product(J, X), subtract(wanted, drift), damping)
        tau_add = r.take("tau_add")
        tau = add(add(times(transpose(J), force), add(h, tau_0)), tau_add)
        tau_max = r.take("tau_max")
        (Ts,) = r.take("Ts")
        held, at_limit = limit_torques(b, tau, tau_max)
        rests = b.select(M.status, 1, b.select(delta, 1, b.select(singular, 1, 0)))
        stuck: Any = rests
        for flag in at_limit:
            stuck = stuck + flag
        following = [b.select(stuck, old, new) for old, new in zip(z, add(z, scale(Ts, e)), strict=True)]
        return b.program(
            f"{task.prefix}operational_space",
            [
                (torque_port(r, "tau", "torques to apply, within tau_max"), held),
                (Port("z_next", (count,), task.integral, "", "state for the next tick", state="z"), following),
                (Port("status", (), "1"), [rests]),
            ],
            f"Operational-space control of the {task.words} of the tip (Khatib 1987).",
            "tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add,  L = inv(J inv(M) J')\n"
            "a = A_d + kp e_x + kd (V_d - J dq) + ki z",
            [
                "L is damped near singular configurations; with damping, the tip follows only where it can move.",
                "z stays while a joint is at its limit or L is damped.",
                *(["e_x: position error, then sin(angle) axis of the rotation error."] if count == 6 else []),
            ],
            Status.of(2, "damped", "the tip is damped near a singular configuration", "J inv(M) J' is nearly singular"),
        )

    return record


def _damped_solution(b: Builder, A: Matrix, x: Vector, damping: Value) -> tuple[Vector, Value, Value]:
    """Solve ``(A + delta diag(s)) F = x`` with damping near singular A; returns F, delta, which is >= 0, and a status.

    The status is 1 where the matrix is singular all the same, since the damping is too small: F is of no use there.
    s holds the mean of the diagonal of A over its linear and its angular part; delta is 0 where no pivot of A is small.
    """
    count = len(A)
    means = [dot([1] * 3, [A[k][k] for k in range(part, part + 3)]) / 3 for part in range(0, count, 3)]
    s = [means[i // 3] for i in range(count)]
    smallest: Any = damping
    for pivot, size in zip(factorize(b, A).pivots, s, strict=True):
        share = b.div(pivot, size)
        smallest = b.select(b.sub(smallest, share), share, smallest)
    delta = b.sub(damping, b.select(smallest, smallest, 0))
    damped = [[A[i][j] + (delta * s[i] if i == j else 0) for j in range(count)] for i in range(count)]
    factors = factorize(b, damped)
    return factors.solve(x), delta, factors.status


OPERATIONAL_SPACE, POSITION_OPERATIONAL_SPACE = operational_space(POSE), operational_space(POSITION)
