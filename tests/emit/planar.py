"""A 2R arm in a vertical plane, written by hand: every program of a derived model, small enough to read.

Standard DH, axes z, lengths a1 = 0.5 and a2 = 0.35 m, gravity along -y. Base parameters (first moments X, Y about the
joint in front): b1 = inertia of link 1 and of m2 at a1, b2 = X1 + a1*m2, b3 = Y1, b4 = J2, b5 = X2, b6 = Y2; the drive
inertias follow.
"""

from __future__ import annotations

from fractions import Fraction

import sympy as sp

from rrrgen.derive.derived_model import BaseParameter, DerivedModel
from rrrgen.derive.recursions.linear_algebra import status_at
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.robot.spec import DriveSpec, FrictionSpec, JointSpec, LinkSpec, RobotSpec

F = Fraction
A1, A2, G = F(1, 2), F(7, 20), F(981, 100)
Q = Port("q", (2,), "rad", "joint", "joint positions", Role.POSITION)
DQ = Port("dq", (2,), "rad/s", "joint", "joint velocities", Role.VELOCITY)
DDQ = Port("ddq", (2,), "rad/s^2", "joint", "joint accelerations", Role.ACCELERATION)
TAU = Port("tau", (2,), "N m", "joint", "joint torques", Role.TORQUE)
IA_NOMINAL = (F(1, 50), F(1, 100))
LINKS = (  # mass, com x, com y, Izz about the com
    (F(4), F(-1, 5), F(1, 40), F(3, 20)),
    (F(3), F(-1, 10), F(-1, 60), F(1, 10)),
)


def spec(name: str = "planar", links: bool = True, drives: bool = True) -> RobotSpec:
    zero = sp.Integer(0)
    joints = tuple(
        JointSpec(f"q{i + 1}", "revolute", zero, sp.Rational(a.numerator, a.denominator), zero, zero,
                  friction=FrictionSpec(viscous=0.3, coulomb=0.7, offset=0.1) if i else FrictionSpec(viscous=0.2),
                  drive=DriveSpec(inertia=float(IA_NOMINAL[i])) if drives else None)
        for i, a in enumerate((A1, A2))
    )  # fmt: skip
    rational = lambda x: sp.Rational(x.numerator, x.denominator)  # noqa: E731
    bodies = tuple(
        LinkSpec(
            rational(m),
            (rational(x), rational(y), zero),
            (rational(J / 2), rational(J / 2), rational(J), *[zero] * 3),
            "com",
        )
        for m, x, y, J in LINKS
    )
    gravity = (zero, sp.Rational(-981, 100), zero)
    return RobotSpec(name, "standard", gravity, {}, joints, bodies if links else None, description="Planar arm")


def _beta(drives: bool) -> Port:
    return Port("beta", (8 if drives else 6,), "mixed", "", "base parameters", Role.BASE_PARAMETERS)


def _model(b, q, dq, beta):
    """M, C, g of the arm for any base parameters and drive inertias, as recorded values."""
    s1, c1 = b.sin(q[0]), b.cos(q[0])
    s2, c2 = b.sin(q[1]), b.cos(q[1])
    q12 = q[0] + q[1]
    s12, c12 = b.sin(q12), b.cos(q12)
    coupling = A1 * (beta[4] * c2 - beta[5] * s2)
    h = -A1 * (beta[4] * s2 + beta[5] * c2)
    m12 = beta[3] + coupling
    m11 = beta[0] + beta[3] + 2 * coupling
    M = [m11, m12, m12, beta[3]]
    if len(beta) > 6:
        M = [m11 + beta[6], m12, m12, beta[3] + beta[7]]
    C = [h * dq[1], h * (dq[0] + dq[1]), -h * dq[0], 0]
    g2 = G * (beta[4] * c12 - beta[5] * s12)
    g = [G * (beta[1] * c1 - beta[2] * s1) + g2, g2]
    potential = G * (beta[1] * s1 + beta[2] * c1 + beta[4] * s12 + beta[5] * c12)
    return M, C, g, potential


def _times(A, x):
    return [A[0] * x[0] + A[1] * x[1], A[2] * x[0] + A[3] * x[1]]


def _transposed(A):
    return [A[0], A[2], A[1], A[3]]


def _kinematics() -> dict[str, Program]:
    programs = {}
    b = Builder()
    q = b.input(Q)
    q12 = q[0] + q[1]
    s1, c1, s12, c12 = b.sin(q[0]), b.cos(q[0]), b.sin(q12), b.cos(q12)
    x1, y1 = A1 * c1, A1 * s1
    x2, y2 = x1 + A2 * c12, y1 + A2 * s12
    T1 = [c1, -s1, 0, x1, s1, c1, 0, y1, 0, 0, 1, 0, 0, 0, 0, 1]
    T2 = [c12, -s12, 0, x2, s12, c12, 0, y2, 0, 0, 1, 0, 0, 0, 0, 1]
    programs["forward_kinematics"] = b.program(
        "forward_kinematics",
        [(Port("T", (4, 4), "1 | m", "base", "pose of the tip"), T2)],
        "Pose of the tip.",
        "T = A_1 A_2",
    )
    programs["link_frames"] = b.program(
        "link_frames", [(Port("T", (2, 4, 4), "1 | m", "base", "link frames"), T1 + T2)]
    )
    J = [-y2, -A2 * s12, x2, A2 * c12, 0, 0, 0, 0, 0, 0, 1, 1]
    programs["jacobian"] = b.program("jacobian", [(Port("J", (6, 2), "m | 1", "base", "linear rows first"), J)])
    J1 = [-y1, 0, x1, 0, 0, 0, 0, 0, 0, 0, 1, 0]
    port = Port("J", (2, 6, 2), "m | 1", "base", "linear rows first")
    programs["link_jacobians"] = b.program("link_jacobians", [(port, J1 + J)])
    b = Builder()
    q, dq = b.input(Q), b.input(DQ)
    q12, w = q[0] + q[1], dq[0] + dq[1]
    v1, v2 = dq[0] * dq[0] * A1, w * w * A2
    a = [-(v1 * b.cos(q[0]) + v2 * b.cos(q12)), -(v1 * b.sin(q[0]) + v2 * b.sin(q12)), 0, 0, 0, 0]
    programs["jacobian_dot_dq"] = b.program("jacobian_dot_dq", [(Port("a", (6,), "m/s^2", "base", "dJ/dt dq"), a)])
    return programs


def _dynamics(nominal: bool, drives: bool) -> dict[str, Program]:
    suffix = "_nominal" if nominal else ""
    programs = {}

    def record(name, ports, outputs, status=None):
        b = Builder()
        values = {port.name: b.input(port) for port in ports}
        beta = [*BETA_NOMINAL, *(IA_NOMINAL if drives else ())] if nominal else b.input(_beta(drives))
        q = values.get("q")
        dq = values.get("dq", [0, 0])
        parts = _model(b, q, dq, beta)
        summary = f"The {name} of the arm."
        program = b.program(name + suffix, outputs(b, values, *parts), summary, status=status)
        programs[name + suffix] = program.with_fields(specializes=name if nominal else "")

    vector = lambda name, unit="N m": Port(name, (2,), unit, "joint", name)  # noqa: E731
    matrix = lambda name, unit="kg m^2": Port(name, (2, 2), unit, "joint", name)  # noqa: E731
    record("mass_matrix", [Q], lambda b, v, M, C, g, U: [(matrix("M"), M)])
    record("coriolis_matrix", [Q, DQ], lambda b, v, M, C, g, U: [(matrix("C"), C)])
    record("coriolis", [Q, DQ], lambda b, v, M, C, g, U: [(vector("c"), _times(C, v["dq"]))])
    record("coriolis_transpose", [Q, DQ], lambda b, v, M, C, g, U: [(vector("c"), _times(_transposed(C), v["dq"]))])
    record("gravity", [Q], lambda b, v, M, C, g, U: [(vector("g"), g)])
    record("bias", [Q, DQ], lambda b, v, M, C, g, U: [(vector("bias"), [
        x + y for x, y in zip(_times(C, v["dq"]), g, strict=True)])])  # fmt: skip
    record("energy", [Q, DQ], lambda b, v, M, C, g, U: [(Port("kinetic", (), "J", "", "kinetic energy"), [
        F(1, 2) * sum(x * y for x, y in zip(v["dq"], _times(M, v["dq"]), strict=True))]),
        (Port("potential", (), "J", "", "potential energy"), [U])])  # fmt: skip
    record("inverse_dynamics", [Q, DQ, DDQ], lambda b, v, M, C, g, U: [(TAU, [
        x + y + z for x, y, z in zip(_times(M, v["ddq"]), _times(C, v["dq"]), g, strict=True)])])  # fmt: skip
    record("forward_dynamics", [Q, DQ, TAU], _solve, status_at(1))
    return programs


def _solve(b, v, M, C, g, U):
    r = [t - x - y for t, x, y in zip(v["tau"], _times(C, v["dq"]), g, strict=True)]
    determinant = M[0] * M[3] - M[1] * M[1]
    one = Builder.select
    status = one(b, M[0], one(b, determinant, 0, 1), 1)
    safe = one(b, F(1, 2) - status, determinant, 1)
    ddq = [(M[3] * r[0] - M[1] * r[1]) / safe, (M[0] * r[1] - M[1] * r[0]) / safe]
    ddq = [one(b, F(1, 2) - status, x, 0) for x in ddq]
    return [(DDQ, ddq), (Port("status", (), "", "", "0 = ok"), [status])]


def _regressors(K, drives: bool) -> dict[str, Program]:
    programs, extra = {}, 2 if drives else 0

    def columns(b, q, dq, ddq, count, mixing):
        rows = [[], []]
        for k in range(count + extra):
            beta = [*(mixing(k) if k < count else [F(0)] * 6), *(F(int(k - count == i)) for i in range(extra))]
            M, C, g, _ = _model(b, q, dq, beta)
            tau = [x + y + z for x, y, z in zip(_times(M, ddq), _times(C, dq), g, strict=True)]
            for row, value in zip(rows, tau, strict=True):
                row.append(value)
        return rows

    b = Builder()
    q, dq, ddq = (b.input(port) for port in (Q, DQ, DDQ))
    Y = columns(b, q, dq, ddq, 6, lambda k: [F(int(i == k)) for i in range(6)])
    programs["regressor"] = b.program(
        "regressor", [(Port("Y", (2, 6 + extra), "mixed", "joint", "base regressor"), Y[0] + Y[1])]
    )
    b = Builder()
    q, dq, ddq = (b.input(port) for port in (Q, DQ, DDQ))
    e = b.input(Port("e", (2,), "", "joint", "weights", Role.COVECTOR))
    Y = columns(b, q, dq, ddq, 6, lambda k: [F(int(i == k)) for i in range(6)])
    r = [y1 * e[0] + y2 * e[1] for y1, y2 in zip(*Y, strict=True)]
    programs["regressor_transpose"] = b.program(
        "regressor_transpose", [(Port("r", (6 + extra,), "mixed", "", "Y' e"), r)]
    )
    b = Builder()
    q, dq, ddq = (b.input(port) for port in (Q, DQ, DDQ))
    Y = columns(b, q, dq, ddq, 20, lambda k: [F(row[k]) for row in K])
    programs["standard_regressor"] = b.program(
        "standard_regressor", [(Port("Y", (2, 20 + extra), "mixed", "joint", "standard regressor"), Y[0] + Y[1])]
    )
    return programs


def _friction() -> Program:
    b = Builder()
    dq = b.input(DQ)
    tau = [F(1, 5) * dq[0], F(3, 10) * dq[1] + F(7, 10) * b.sign(dq[1]) + F(1, 10)]
    return b.program("friction", [(Port("tau_f", (2,), "N m", "joint", "friction torque"), tau)], "Joint friction.")


def projection() -> list[list[F]]:
    """K with beta = K phi; phi per link: m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    K = [[F(0)] * 20 for _ in range(6)]
    K[0][0], K[0][1], K[0][9], K[0][10] = A1 * A1, 2 * A1, F(1), A1 * A1
    K[1][0], K[1][1], K[1][10] = A1, F(1), A1
    K[2][2] = F(1)
    K[3][10], K[3][11], K[3][19] = A2 * A2, 2 * A2, F(1)
    K[4][10], K[4][11] = A2, F(1)
    K[5][12] = F(1)
    return K


def _phi() -> list[F]:
    rows = []
    for m, x, y, J in LINKS:
        rows += [m, m * x, m * y, 0, J / 2 + m * y * y, -m * x * y, J / 2 + m * x * x, 0, 0, J + m * (x * x + y * y)]
    return rows


BETA_NOMINAL = tuple(sum((k * v for k, v in zip(row, _phi(), strict=True)), F(0)) for row in projection())


def planar_model(name: str = "planar", links: bool = True, drives: bool = True) -> DerivedModel:
    m2 = sp.Symbol("m2")
    expressions = [sp.Symbol("Izz1") + m2 / 4, sp.Symbol("mx1") + m2 / 2, sp.Symbol("my1"), sp.Symbol("Izz2"),
                   sp.Symbol("mx2"), sp.Symbol("my2")]  # fmt: skip
    units = ["kg m^2", "kg m", "kg m", "kg m^2", "kg m", "kg m"]
    programs = {
        **_kinematics(),
        **_dynamics(False, drives),
        **_regressors(projection(), drives),
        "friction": _friction(),
    }
    if links:
        programs |= _dynamics(True, drives)
    return DerivedModel(
        spec=spec(name, links, drives),
        programs=programs,
        base_parameters=tuple(
            BaseParameter(f"b{k + 1}", expression, unit)
            for k, (expression, unit) in enumerate(zip(expressions, units, strict=True))
        ),
        base_projection=tuple(tuple(float(x) for x in row) for row in projection()),
        regrouping=(),
        beta_nominal=BETA_NOMINAL if links else None,
        drive_inertia_nominal=IA_NOMINAL if drives else None,
        passes=(),
    )
