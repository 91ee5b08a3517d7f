"""The printed closed forms of Kostic, de Jager, Steinbuch, "Modeling and Identification for Robot Motion Control".

Equations (14.43)-(14.47) of chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005), typed by hand with
the dots restored. Every function takes ``xp``, the module that supplies cos and sin: numpy (default) or sympy.

Conventions proved for them: standard DH, gravity g > 0 along -z0, inertias about the origin of the link frame, products
POSITIVE (Ixy = +int xy dm). A link is a mapping with keys m, x, y, z (centre of mass), Ixx, Iyy, Izz, Ixy, Ixz, Iyz.
"""

from __future__ import annotations

import numpy as np

from oracles.newton_euler import Link, Robot

A2, A3, D1, D2, D3 = 0.200, 0.415, 0.560, 0.169, 0.090  # Table 14.1, m
G = 9.81
LINK_KEYS = ("m", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


def rrr(links: tuple[Link, ...] = (), gravity=(0.0, 0.0, -G)) -> Robot:
    """The arm of Table 14.1."""
    rows = (("revolute", np.pi / 2, 0.0, D1, 0.0), ("revolute", 0.0, A2, D2, 0.0), ("revolute", 0.0, A3, D3, 0.0))
    return Robot("standard", rows, np.array(gravity), links=tuple(links), name="rrr")


def link_from_chapter(values: dict[str, float], about: str = "origin", products: str = "positive") -> Link:
    """The link whose ten numbers are read as inertia ``about`` origin or com, with ``products`` positive or tensor."""
    v = values
    sign = -1.0 if products == "positive" else 1.0
    xy, xz, yz = sign * v["Ixy"], sign * v["Ixz"], sign * v["Iyz"]
    tensor = np.array([[v["Ixx"], xy, xz], [xy, v["Iyy"], yz], [xz, yz, v["Izz"]]])
    r = np.array([v["x"], v["y"], v["z"]])
    if about == "origin":
        tensor = tensor - v["m"] * (r @ r * np.eye(3) - np.outer(r, r))
    return Link(v["m"], r, tensor)


def fk_1444(q, a2=A2, a3=A3, d1=D1, d2=D2, d3=D3, xp=np):
    """(14.44): the tip x, y, z."""
    q1, q2, q3 = q
    rho = a3 * xp.cos(q2 + q3) + a2 * xp.cos(q2)
    D = d2 + d3
    return [
        rho * xp.cos(q1) + D * xp.sin(q1),
        rho * xp.sin(q1) - D * xp.cos(q1),
        a3 * xp.sin(q2 + q3) + a2 * xp.sin(q2) + d1,
    ]


def orientation_1443(q, xp=np):
    """(14.43): the rotation of frame 3 as rows."""
    q1, q2, q3 = q
    c1, s1, c23, s23 = xp.cos(q1), xp.sin(q1), xp.cos(q2 + q3), xp.sin(q2 + q3)
    return [[c1 * c23, -c1 * s23, s1], [s1 * c23, -s1 * s23, -c1], [s23, c23, 0]]


def ik_1445_complete(p, a2=A2, a3=A3, d1=D1, d2=D2, d3=D3) -> np.ndarray:
    """The completed (14.45): all solutions (k, 3), rows (front, behind) x (sin q3 > 0, < 0); none when out of reach."""
    x, y, z = p
    D, h, rows = d2 + d3, z - d1, []
    if x * x + y * y < D * D:
        return np.zeros((0, 3))
    for front in (1, -1):
        rho = front * np.sqrt(x * x + y * y - D * D)
        C = (rho * rho + h * h - a2 * a2 - a3 * a3) / (2 * a2 * a3)
        if abs(C) > 1:
            continue
        for bend in (1, -1):
            S = bend * np.sqrt((1 - C) * (1 + C))
            q2 = np.arctan2((a2 + a3 * C) * h - a3 * S * rho, (a2 + a3 * C) * rho + a3 * S * h)
            rows.append([np.arctan2(D * x + rho * y, rho * x - D * y), q2, np.arctan2(S, C)])
    return np.array(rows).reshape(-1, 3)


def base_parameters_1446(links, a2=A2, a3=A3, d2=D2, d3=D3):
    """(14.46): the list p1..p15 from three link mappings (see module text)."""
    one, two, three = links
    m2, x2, y2, z2 = two["m"], two["x"], two["y"], two["z"]
    m3, x3, y3, z3 = three["m"], three["x"], three["y"], three["z"]
    D = d2 + d3
    return [
        a2**2 * m3 + a2 * m2 * (a2 + 2 * x2) - two["Ixx"] + two["Iyy"],
        -2 * (a2 * m2 * y2 + two["Ixy"]),
        m3 * (a3 + x3),
        m3 * y3,
        a3 * m3 * (a3 + 2 * x3) - three["Ixx"] + three["Iyy"],
        2 * (a3 * m3 * y3 + three["Ixy"]),
        2 * d2 * m2 * z2 + d2**2 * m2 + 2 * D * m3 * z3 + D**2 * m3 + one["Iyy"] + two["Ixx"] + three["Ixx"],
        -D * m3 * y3 - three["Iyz"],
        -a3 * m3 * (z3 + D) - D * m3 * x3 - three["Ixz"],
        -d2 * m2 * y2 - two["Iyz"],
        -a2 * (m3 * (z3 + D) + m2 * (d2 + z2)) - d2 * m2 * x2 - two["Ixz"],
        (a2**2 + a3**2 + 2 * a3 * x3) * m3 + a2 * m2 * (a2 + 2 * x2) + two["Izz"] + three["Izz"],
        a3 * m3 * (a3 + 2 * x3) + three["Izz"],
        m2 * (x2 + a2) + m3 * a2,
        m2 * y2,
    ]


def regressor_1447(q, dq, ddq, a2=A2, g=G, xp=np):
    """(14.47): R as three rows of fifteen entries, R p = tau; half = 1/2 stays exact with sympy."""
    _, q2, q3 = q
    v1, v2, v3 = dq
    w1, w2, w3 = ddq
    half = 0.5 if xp is np else xp.Rational(1, 2)
    sin, cos = xp.sin, xp.cos
    s2, c2, s3, c3, s23, c23 = sin(q2), cos(q2), sin(q3), cos(q3), sin(q2 + q3), cos(q2 + q3)
    s223, c223 = sin(2 * q2 + q3), cos(2 * q2 + q3)
    s2233, c2233 = sin(2 * q2 + 2 * q3), cos(2 * q2 + 2 * q3)
    row1 = [
        w1 * c2**2 - v1 * v2 * sin(2 * q2),
        half * w1 * sin(2 * q2) + v1 * v2 * cos(2 * q2),
        2 * a2 * ((w1 * c23 - v1 * v3 * s23) * c2 - v1 * v2 * s223),
        -2 * a2 * ((w1 * s23 + v1 * v3 * c23) * c2 + v1 * v2 * c223),
        w1 * c23**2 - v1 * (v2 + v3) * s2233,
        -half * w1 * s2233 - v1 * (v2 + v3) * c2233,
        w1,
        (w2 + w3) * c23 - (v2 + v3) ** 2 * s23,
        (w2 + w3) * s23 + (v2 + v3) ** 2 * c23,
        w2 * c2 - v2**2 * s2,
        w2 * s2 + v2**2 * c2,
        *(0, 0, 0, 0),
    ]
    swing = half * v3**2 + v2 * v3
    row2 = [
        half * v1**2 * sin(2 * q2),
        -half * v1**2 * cos(2 * q2),
        2 * a2 * ((w2 + half * w3) * c3 - swing * s3 + half * v1**2 * s223) + g * c23,
        2 * a2 * (-(w2 + half * w3) * s3 - swing * c3 + half * v1**2 * c223) - g * s23,
        half * v1**2 * s2233,
        half * v1**2 * c2233,
        0,
        w1 * c23,
        w1 * s23,
        w1 * c2,
        w1 * s2,
        w2,
        w3,
        g * c2,
        -g * s2,
    ]
    row3 = [
        *(0, 0),
        a2 * ((half * v1**2 + v2**2) * s3 + w2 * c3 + half * v1**2 * s223) + g * c23,
        a2 * ((half * v1**2 + v2**2) * c3 - w2 * s3 + half * v1**2 * c223) - g * s23,
        row2[4],
        row2[5],
        0,
        row2[7],
        row2[8],
        *(0, 0, 0),
        w2 + w3,
        *(0, 0),
    ]
    return [row1, row2, row3]
