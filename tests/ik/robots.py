"""The robots of the test suite as RobotSpec objects and as oracle robots, from one table of rows."""

from __future__ import annotations

from math import pi

import numpy as np
import sympy as sp

from rrrgen.robot.spec import FixedTransform, JointSpec, Limits, RobotSpec

h = pi / 2


def exact(x: float) -> sp.Expr:
    """A multiple of pi/180 exactly where it is one, else the decimal."""
    degrees = x / pi * 180
    if x != 0 and abs(degrees - round(degrees)) < 1e-12 and abs(round(degrees)) <= 360:
        return sp.pi * sp.Rational(round(degrees), 180)
    return sp.Rational(repr(float(x)))


def fixed(T: np.ndarray | None) -> FixedTransform:
    if T is None:
        return FixedTransform()
    entries = [[sp.Rational(repr(float(x))) for x in row] for row in T]
    return FixedTransform(
        tuple(entries[i][j] for i in range(3) for j in range(3)), tuple(entries[i][3] for i in range(3))
    )


def make(name, rows, convention="standard", base=None, tool=None, limits=None) -> RobotSpec:
    """``rows``: (type, alpha, a, d, theta) with type R or P."""
    joints = tuple(
        JointSpec(
            f"q{i + 1}",
            "revolute" if kind in ("R", "revolute") else "prismatic",
            exact(alpha),
            exact(a),
            exact(d),
            exact(theta),
            Limits(*limits[i]) if limits else Limits(),
        )
        for i, (kind, alpha, a, d, theta) in enumerate(rows)
    )
    gravity = (sp.S.Zero, sp.S.Zero, sp.Rational(-981, 100))
    return RobotSpec(name, convention, gravity, {}, joints, base=fixed(base), tool=fixed(tool))


def table(types, alpha, a, d, theta=None):
    n = len(types)
    theta = [0.0] * n if theta is None else theta
    return [(types[i], alpha[i], a[i], d[i], theta[i]) for i in range(n)]


def pad(values, n):
    return list(values) + [0.0] * (n - len(values))


ROWS = {
    "rrr": table("RRR", (h, 0, 0), (0, 0.2, 0.415), (0.56, 0.169, 0.09)),
    "ortho3r": table("RRR", (-h, h, 0), (1, 2, 1.5), (0, 1, 0)),
    "puma": table("RRRRRR", (h, 0, -h, h, -h, 0), (0, 0.4318, 0.0203, 0, 0, 0), (0, 0, 0.15005, 0.4318, 0, 0)),
    "ur5": table(
        "RRRRRR", (h, 0, 0, h, -h, 0), (0, -0.425, -0.39225, 0, 0, 0), (0.089159, 0, 0, 0.10915, 0.09465, 0.0823)
    ),
    "ur10e": table(
        "RRRRRR", (h, 0, 0, h, -h, 0), (0, -0.6127, -0.57155, 0, 0, 0), (0.1807, 0, 0, 0.17415, 0.11985, 0.11655)
    ),
    "irb6640": table(
        "RRRRRR", (-h, 0, -h, h, -h, 0), (0.32, 1.075, 0.2, 0, 0, 0), (0.78, 0, 0, 1.1425, 0, 0.2), (0, -h, 0, 0, 0, 0)
    ),
    "irb120": table(
        "RRRRRR", (-h, 0, -h, h, -h, 0), (0, 0.27, 0.07, 0, 0, 0), (0.29, 0, 0, 0.302, 0, 0.072), (0, -h, 0, 0, 0, 0)
    ),
    "kr6": table(
        "RRRRRR",
        (-h, 0, h, -h, h, 0),
        (0.025, 0.315, 0.035, 0, 0, 0),
        (0.4, 0, 0, -0.365, 0, -0.08),
        (0, 0, -h, 0, 0, 0),
    ),
    "stanford": table("RRPRRR", (-h, h, 0, -h, h, 0), (0,) * 6, (0.412, 0.154, 0, 0, 0, 0.263), (0, 0, -h, 0, 0, 0)),
    "scara": table("RRPR", (0, pi, 0, 0), (0.325, 0.275, 0, 0), (0.387, 0, 0, 0)),
    "panda": table(
        "RRRRRRR", (-h, h, h, -h, h, h, 0), (0, 0, 0.0825, -0.0825, 0, 0.088, 0), (0.333, 0, 0.316, 0, 0.384, 0, 0.107)
    ),
    "iiwa14": table("RRRRRRR", (-h, h, h, -h, -h, h, 0), (0,) * 7, (0.36, 0, 0.42, 0, 0.4, 0, 0.126)),
    "crx10ia": table(
        "RRRRRR", (-h, pi, -h, h, -h, 0), (0, 0.54, 0, 0, 0, 0), (0, 0, 0, -0.54, 0.15, -0.16), (0, -h, 0, 0, 0, 0)
    ),
    "manseur_doty": table(
        "RRRRRR", (h, pi / 180, h, pi / 180, h, pi / 180), (0.3, 1, 0, 1.5, 0, 1.1353), (0.0106, 0, 0.2, 0, 0, 0.1049)
    ),
}


def _jaco2():
    k = 0.5 / np.sin(pi / 3)
    D3, D4, D6 = 0.2073, 0.0741, 0.16
    D5 = D4
    angle = pi / 3
    return table(
        "RRRRRR",
        (h, pi, h, angle, angle, pi),
        (0, 0.41, 0, 0, 0, 0),
        (0.2755, 0, -0.0098, -(D3 + k * D4), -k * (D4 + D5), -(k * D5 + D6)),
    )


ROWS["jaco2"] = _jaco2()


def robot(name: str, **options) -> RobotSpec:
    return make(name, ROWS[name], **options)


def reference(rows, q, base=None, tool=None, convention="standard") -> np.ndarray:
    """Forward kinematics written out once more, for arrays of joint values (N, n)."""
    q = np.atleast_2d(q)
    T = np.broadcast_to(np.eye(4) if base is None else base, (len(q), 4, 4))
    for (kind, alpha, a, d, theta), x in zip(rows, q.T, strict=True):
        angle = theta + (x if kind == "R" else 0 * x)
        shift = d + (x if kind == "P" else 0 * x)
        ca, sa = (float(sp.N(f(exact(alpha)), 30)) for f in (sp.cos, sp.sin))
        z = np.zeros((len(q), 4, 4))
        z[:, 0, 0] = z[:, 1, 1] = np.cos(angle)
        z[:, 1, 0] = np.sin(angle)
        z[:, 0, 1] = -z[:, 1, 0]
        z[:, 2, 2] = z[:, 3, 3] = 1
        z[:, 2, 3] = shift
        x_ = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        T = T @ z @ x_ if convention == "standard" else T @ x_ @ z
    return T if tool is None else T @ tool
