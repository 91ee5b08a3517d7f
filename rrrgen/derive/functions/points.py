"""Recorders of kinematics at any link or point: velocities, Jacobians, wrenches, tools, null space, manipulability.

A point that is fixed to a link is given in the frame of that link. The functions for it take the pose T and the
Jacobian J of the frame, which ``link_frames`` and ``link_jacobians`` give for all links at once: with r the vector from
the origin of the frame to the point, in base axes,

    v_p = v + omega x r,   a_p = a + alpha x r + omega x (omega x r).

The manipulability (Yoshikawa 1985) is ``w = sqrt(det(J J'))``, or ``sqrt(det(J' J))`` for fewer joints than rows: the
product of the singular values. Its gradient is ``dw/dq_k = w sum over i of P_i . dJ_i/dq_k`` with the columns P_i of
the transposed pseudo-inverse of J, and the columns of J, with parts v_i and w_i, change by

    dJ_i/dq_k = [w_k x v_i; w_k x w_i]  (k <= i),   [w_i x v_k; 0]  (k > i).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rrrgen.derive.functions.kinematics import BASE, jacobian_port, pose_port
from rrrgen.derive.functions.recording import FunctionBuilder, Recorder
from rrrgen.derive.recursions import kinematics
from rrrgen.derive.recursions.linear_algebra import (
    LDLFactors,
    Matrix,
    Vector,
    add,
    cross,
    dot,
    factorize,
    flat,
    product,
    subtract,
    times,
    transpose,
)
from rrrgen.derive.recursions.link_frames import Placement
from rrrgen.derive.recursions.velocities_and_accelerations import forward
from rrrgen.program import Port, Program, Status
from rrrgen.robot.model.mechanism import tip_arm

SPATIAL = "linear, then angular"


def link_velocities(r: FunctionBuilder) -> Program:
    """Record the velocities V (n, 6) of all link frames in the base frame, linear rows first."""
    chain = r.chain()
    dq = r.joints("dq")
    frames = kinematics.joint_frames(chain)
    rates = chain.joint_rates(dq)
    values: list[Any] = []
    moving: list[tuple[Vector, Vector]] = []
    for i, (joint, frame) in enumerate(zip(chain.joints, frames, strict=True)):
        v, omega = moving[joint.parent] if joint.parent >= 0 else ([0, 0, 0], [0, 0, 0])
        if joint.parent >= 0:
            v = add(v, cross(omega, subtract(frame.p, frames[joint.parent].p)))
        axis = [row[2] * rates[i] for row in frame.R]
        v, omega = (v, add(omega, axis)) if joint.revolute else (add(v, axis), omega)
        moving.append((v, omega))
        values += [*add(v, cross(omega, times(frame.R, chain.link_frames[i].p))), *omega]
    port = Port("V", (r.model.links, 6), "m/s, rad/s", BASE, f"of the origins of the link frames 1..n, {SPATIAL}")
    return r.builder.program(
        "link_velocities", [(port, values)], "Velocities of all link frames.", "[v_i; omega_i] = J_i(q) dq"
    )


def link_jacobians_dot_dq(r: FunctionBuilder) -> Program:
    """Record (dJ_i/dt) dq (n, 6) of all link frames: their accelerations in the base frame for ddq = 0."""
    chain = replace(r.chain(), gravity=[0, 0, 0])
    motions = forward(chain, r.joints("dq"), [0] * r.n, [True] * chain.n)
    frames = kinematics.joint_frames(chain)
    values: list[Any] = []
    for motion, frame, X in zip(motions, frames, chain.link_frames, strict=True):
        values += [*times(frame.R, add(motion.a, times(motion.U, X.p))), *times(frame.R, motion.alpha)]
    port = Port(
        "A",
        (r.model.links, 6),
        "m/s^2, rad/s^2",
        BASE,
        f"of the origins of the link frames 1..n for ddq = 0, {SPATIAL}",
    )
    return r.builder.program(
        "link_jacobians_dot_dq",
        [(port, values)],
        "Time derivatives of the Jacobians of all link frames times dq.",
        "A_i = (dJ_i/dt) dq",
    )


def _frame_inputs(r: FunctionBuilder) -> tuple[Matrix, Matrix]:
    """Pose T (4, 4) and Jacobian J (6, n) of a frame, declared as inputs."""
    T = r.builder.input(Port("T", (4, 4), "1, m", BASE, "pose of a frame, such as element i of link_frames"))
    J = r.builder.input(Port("J", (6, r.n), "m, 1", BASE, "its Jacobian, such as element i of link_jacobians"))
    return _matrix(4, T), _matrix(r.n, J)


def _matrix(columns: int, entries: Sequence[Any]) -> Matrix:
    """The matrix with this number of ``columns`` whose entries are given row by row."""
    return [list(entries[k : k + columns]) for k in range(0, len(entries), columns)]


def _point(r: FunctionBuilder, T: Matrix) -> Vector:
    """The vector from the origin of the frame ``T`` to a point, which is declared as an input, in base axes."""
    point = list(r.builder.input(Port("point", (3,), "m", "frame T", "a point that moves with the frame")))
    return [dot(row[:3], point) for row in T[:3]]


def point_jacobian(r: FunctionBuilder) -> Program:
    """Record the Jacobian J_p (6, n) of a point that is fixed to a frame, from pose and Jacobian of the frame."""
    T, J = _frame_inputs(r)
    at_point = _shift_jacobian(J, _point(r, T))
    port = Port("J_p", (6, r.n), "m, 1", BASE, "rows 1-3 linear, rows 4-6 angular velocity at the point")
    return r.builder.program(
        "point_jacobian",
        [(port, flat(at_point))],
        "Jacobian of a point that is fixed to a link or to the tip.",
        "[v_p; omega] = J_p dq,  v_p = v + omega x (R point)",
    )


def _shift_jacobian(J: Matrix, arm: Vector) -> Matrix:
    """The Jacobian at the end of ``arm`` (3,), a vector from the origin of the frame of ``J``."""
    columns = [[row[k] for row in J] for k in range(len(J[0]))]
    moved = [[*add(column[:3], cross(column[3:], arm)), *column[3:]] for column in columns]
    return transpose(moved)


def point_motion(r: FunctionBuilder) -> Program:
    """Record velocity and (dJ/dt) dq of a point, (6,) each, from pose, velocity and (dJ/dt) dq of its frame."""
    T = _matrix(4, r.builder.input(Port("T", (4, 4), "1, m", BASE, "pose of a frame")))
    V = list(r.builder.input(Port("V", (6,), "m/s, rad/s", BASE, f"its velocity, {SPATIAL}")))
    A = list(r.builder.input(Port("A", (6,), "m/s^2, rad/s^2", BASE, f"its acceleration, {SPATIAL}")))
    arm = _point(r, T)
    swing = cross(V[3:], arm)
    velocity = [*add(V[:3], swing), *V[3:]]
    acceleration = [*add(add(A[:3], cross(A[3:], arm)), cross(V[3:], swing)), *A[3:]]
    return r.builder.program(
        "point_motion",
        [
            (Port("V_p", (6,), "m/s, rad/s", BASE, f"velocity at the point, {SPATIAL}"), velocity),
            (Port("A_p", (6,), "m/s^2, rad/s^2", BASE, f"acceleration of the point, {SPATIAL}"), acceleration),
        ],
        "Velocity and acceleration of a point that is fixed to a link or to the tip.",
        "v_p = v + omega x r,  a_p = a + alpha x r + omega x (omega x r),  r = R point",
        ["With A = (dJ/dt) dq of the frame, A_p is (dJ_p/dt) dq of the point."],
    )


def wrench_torques(r: FunctionBuilder) -> Program:
    """Record tau = J' F (n,): the joint torques that hold a wrench F (6,) at the frame of the Jacobian J."""
    J = _matrix(r.n, r.builder.input(Port("J", (6, r.n), "m, 1", BASE, "Jacobian of a frame or point")))
    F = list(r.builder.input(Port("F", (6,), "N, N m", BASE, "force and moment that act there, in base axes")))
    port = Port("tau", (r.n,), r.torque_unit, "", "generalized forces of the wrench")
    return r.builder.program(
        "wrench_torques",
        [(port, [dot(column, F) for column in transpose(J)])],
        "Generalized forces of a wrench that acts on a link or on the tip.",
        "tau = J' F,  M ddq + c + g = tau_motors + J' F",
    )


def tool_kinematics(r: FunctionBuilder) -> Program:
    """Record pose T (4, 4) and Jacobian J (6, n) of a tool whose pose in the last link frame is an input."""
    chain = r.chain()
    tool = _matrix(4, r.builder.input(_tool_port()))
    frames = kinematics.joint_frames(chain)
    link = chain.tip_link
    flange = kinematics.compose(frames[link], chain.link_frames[link])
    pose = kinematics.compose(flange, Placement([row[:3] for row in tool[:3]], [row[3] for row in tool[:3]]))
    J = kinematics.point_jacobian(chain, frames, link, chain.link_frames[link].p)
    return r.builder.program(
        "tool_kinematics",
        [
            (pose_port(), flat(kinematics.homogeneous(pose))),
            (jacobian_port(r), flat(_shift_jacobian(J, subtract(pose.p, flange.p)))),
        ],
        "Pose and Jacobian of a tool that is chosen at run time.",
        "T = T_base A_1(q_1) ... A_n(q_n) tool",
        ["The tool takes the place of that of the robot file."],
    )


def _tool_port() -> Port:
    return Port("tool", (4, 4), "1, m", "last link frame", "pose of the tool, a homogeneous transform")


def tool_target(r: FunctionBuilder) -> Program:
    """Record the target (4, 4) of the tip for which a tool chosen at run time has the pose T (4, 4)."""
    T = _matrix(4, r.builder.input(Port("T", (4, 4), "1, m", BASE, "wanted pose of the tool")))
    tool = _matrix(4, r.builder.input(_tool_port()))
    last = r.model.link_frames[r.model.tip_link]
    constant = [[r.constant(v) for v in (last.R.T * r.model.tip.R).row(k)] for k in range(3)]
    shift = [r.constant(v) for v in last.R.T * (r.model.tip.p - last.p)]
    R = product([row[:3] for row in T[:3]], transpose([row[:3] for row in tool[:3]]))
    p = subtract([row[3] for row in T[:3]], times(R, [row[3] for row in tool[:3]]))
    target = Placement(product(R, constant), add(p, times(R, shift)))
    port = Port("target", (4, 4), "1, m", BASE, "pose of the tip of the robot file, for its inverse kinematics")
    return r.builder.program(
        "tool_target",
        [(port, flat(kinematics.homogeneous(target)))],
        "Target of the inverse kinematics for a tool that is chosen at run time.",
        "target = T tool^-1 T_tool, T_tool the tool of the robot file",
    )


def tip_target(r: FunctionBuilder) -> Program:
    """Record the pose (4, 4) of a named tip in the frame of the link that carries its own joints, from T (4, 4)."""
    arm = tip_arm(r.model.spec, r.function.tip if r.function else "")
    T = _matrix(4, r.builder.input(Port("T", (4, 4), "1, m", BASE, "wanted pose of the tip")))
    chain = r.chain()
    carrier = kinematics.compose(kinematics.joint_frames(chain)[arm.carrier], chain.link_frames[arm.carrier])
    back = transpose(carrier.R)
    p = times(back, subtract([row[3] for row in T[:3]], carrier.p))
    target = Placement(product(back, [row[:3] for row in T[:3]]), p)
    frame = f"link frame of {r.model.spec.rows[arm.carrier].name}"
    return r.builder.program(
        "tip_target",
        [(Port("target", (4, 4), "1, m", frame, "pose of the tip"), flat(kinematics.homogeneous(target)))],
        "Target of the inverse kinematics of the tip, at prescribed values of the joints that other tips share.",
        "target = T_carrier(q)^-1 T",
        [f"Of q only {', '.join(r.model.spec.joints[k].name for k in arm.shared)} are read."],
    )


@dataclass(frozen=True)
class _PrescribedTask:
    """The quantity that a task prescribes: the pose of the tip (6 rows of the Jacobian) or its position (3 rows).

    ``prefix`` begins the names of the functions, ``words`` names the quantity in emitted files.
    """

    prefix: str
    rows: int
    words: str


POSE = _PrescribedTask("", 6, "pose")
POSITION = _PrescribedTask("position_", 3, "position")


def _singular(output: int) -> Status:
    return Status.of(output, "singular", "the configuration is singular", "the rows of the Jacobian lose rank")


def _gram(r: FunctionBuilder, J: Matrix, damping: Any = 0) -> LDLFactors:
    """The factors of ``J J' + damping^2 1``, or of ``J' J`` for fewer columns than rows."""
    A = J if len(J) <= r.n else transpose(J)
    square = damping * damping
    G = [[dot(x, y) + (square if i == j else 0) for j, y in enumerate(A)] for i, x in enumerate(A)]
    return factorize(r.builder, G)


def manipulability(task: _PrescribedTask) -> Recorder:
    """Make a recorder of the manipulability w and its gradient (n,); the status is 1, both 0, where J loses rank."""

    def record(r: FunctionBuilder) -> Program:
        b = r.builder
        chain = r.chain()
        whole = kinematics.jacobian(chain)
        J = whole[: task.rows]
        factors = _gram(r, J)
        total: Any = 1
        for reciprocal in factors.reciprocals:
            total = total * reciprocal
        w = b.select(factors.status, 0, b.div(1, b.sqrt(total)))
        minus = factors.negative_inverse()
        P = product(minus, J) if len(J) <= r.n else transpose(product(minus, transpose(J)))
        moving = chain.paths[chain.tip_link]
        columns = transpose(kinematics.jacobian(replace(chain, coupling=None)))
        weights = transpose([list(chain.joint_rates(row)) for row in P])
        rates: list[Any] = [0] * chain.n
        for k in moving:
            rates[k] = -(
                w * _rate([columns[i] for i in moving], [weights[i] for i in moving], moving.index(k), task.rows)
            )
        gradient = chain.forces(rates)
        # three rows have the unit m, the others none; of fewer columns than rows both are mixed
        unit = "m^3" if r.position_unit == "rad" and task.rows <= r.n else "SI"
        return b.program(
            f"{task.prefix}manipulability",
            [
                (Port("w", (), unit, "", "product of the singular values of the Jacobian"), [w]),
                (Port("dw_dq", (r.n,), unit, "", "gradient of w"), gradient),
                (Port("status", (), "1"), [factors.status]),
            ],
            f"Manipulability of the {task.words} of the tip and its gradient.",
            "w = sqrt(det(J J'))" if task.rows <= r.n else "w = sqrt(det(J' J))",
            [f"J: the first {task.rows} rows of the Jacobian. Lengths in m count like angles in rad."],
            _singular(2),
        )

    return record


def _rate(columns: Sequence[Vector], weights: Sequence[Vector], k: int, count: int) -> Any:
    """The sum over i of weights_i . dJ_i/dq_k over the first ``count`` rows; ``columns`` are the J_i."""
    total: Any = 0
    v_k, w_k = columns[k][:3], columns[k][3:]
    for i, (column, weight) in enumerate(zip(columns, weights, strict=True)):
        v_i, w_i = column[:3], column[3:]
        change = [*cross(w_k, v_i), *cross(w_k, w_i)] if k <= i else [*cross(w_i, v_k), 0, 0, 0]
        total = total + dot(change[:count], weight)
    return total


def nullspace(task: _PrescribedTask) -> Recorder:
    """Make a recorder of the null-space projector ``N = 1 - J' (J J' + damping^2 1)^-1 J`` (n, n).

    For damping = 0, N maps joint velocities to those that do not move the tip.
    """

    def record(r: FunctionBuilder) -> Program:
        J = kinematics.jacobian(r.chain())[: task.rows]
        (damping,) = r.take("damping")
        factors = _gram(r, J, damping)
        X = product(transpose(J), product(factors.negative_inverse(), J))
        N = [[X[i][j] + int(i == j) for j in range(r.n)] for i in range(r.n)]
        return r.builder.program(
            f"{task.prefix}nullspace",
            [
                (Port("N", (r.n, r.n), "1", "", "projection of joint velocities"), flat(N)),
                (Port("status", (), "1"), [factors.status]),
            ],
            f"Projection on the joint velocities that leave the {task.words} of the tip at rest.",
            "N = 1 - J' (J J' + damping^2 1)^-1 J,  J N dq = 0 for damping = 0",
            [f"J: the first {task.rows} rows of the Jacobian. N is 1 where the status is not ok."],
            _singular(1),
        )

    return record


MANIPULABILITY, POSITION_MANIPULABILITY = manipulability(POSE), manipulability(POSITION)
NULLSPACE, POSITION_NULLSPACE = nullspace(POSE), nullspace(POSITION)
