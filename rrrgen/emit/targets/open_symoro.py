"""Export to ``.par``, the format of OpenSYMORO: modified Denavit-Hartenberg parameters, link inertias, friction.

Named lengths stay symbols; inertias are about the frame origins. A standard DH row ends with its twist (alpha, a), a
modified one begins with it. So for a standard table, modified frame j is the standard frame j with the twist of row j
removed. The frame of a joint with ``sign: -1`` is turned by 180 degrees about x, since the format has no sign. The tool
is one more fixed frame ``Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r)``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import sympy as sp

from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions, unused_entries, viscous_and_coulomb
from rrrgen.robot.file.writer import number_text
from rrrgen.robot.model.canonical_frames import NO_TWIST, Twist, dh_rows
from rrrgen.robot.model.exact_transforms import normal_form, rotation_x
from rrrgen.robot.spec import JointSpec, LinkSpec, RobotSpec

MOMENTS = ("MX", "MY", "MZ")
INERTIA = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
TINY = 1e-12  # of the sine of an angle: axes of a tool that are parallel


def _write(spec: RobotSpec, _: ExportOptions) -> Exported:
    rows = _rows(spec)
    after = _after(spec)
    has_tool = after != sp.eye(4)
    if has_tool:
        rows.append(_tool_row(after))
    count = len(rows)
    lists: dict[str, Sequence[Any]] = {"ant": range(count), "sigma": [row["sigma"] for row in rows]}
    lists |= {key: [row.get(key, 0) for row in rows] for key in ("b", "d", "r", "gamma", "alpha")}
    lists["mu"] = [1] * spec.n + [0] * has_tool
    lists["theta"] = [row["theta"] for row in rows]
    lines = [f"(* Robotname = '{spec.name}' *)", f"NF = {count}", f"NL = {count}", f"NJ = {count}", "Type = 0"]
    used = _used_parameters(spec, rows)
    if used:
        values = ", ".join(f"{name} = {number_text(value)}" for name, value in used.items())
        lines.append(f"(* values in SI units: {values} *)")
    lines += ["(* Geometric parameters, rad and m *)", *(_list(name, values) for name, values in lists.items())]
    lines += ["(* Dynamic parameters about the origins of the frames, and external forces *)", *_dynamics(spec, count)]
    R = sp.Matrix(3, 3, [spec.nominal(v) for v in spec.base.rotation])
    gravity = R.T * sp.Matrix([spec.nominal(g) for g in spec.gravity])
    lines.append(_list("G", list(gravity)))
    lines.append(_list("Z", list(spec.base.matrix().applyfunc(spec.nominal))))
    return Exported({f"{spec.name}.par": "\n".join([*lines, ""])}, tuple(_notes(spec, used)))


def _list(name: str, values: Sequence[Any]) -> str:
    return f"{name} = {{{','.join(number_text(sp.sympify(value, strict=True)) for value in values)}}}"


def _rows(spec: RobotSpec) -> list[dict[str, Any]]:
    """Modified DH rows, one per joint; the twist (alpha, a) of a standard row moves to the next row."""
    table = dh_rows(spec)
    behind = [NO_TWIST, *(row.behind for row in table[:-1])]
    rows = []
    for j, (joint, last, dh_row) in enumerate(zip(spec.joints, behind, table, strict=True), start=1):
        twist = last.compose(dh_row.before)
        row: dict[str, Any] = {"sigma": int(not joint.is_revolute), "alpha": twist.alpha, "d": twist.a}
        row |= {"theta": dh_row.theta, "r": dh_row.d}
        variable = "theta" if joint.is_revolute else "r"
        row[variable] = row[variable] + sp.Symbol(_variable(spec, joint, j), real=True)
        rows.append(row)
    return rows


def _used_parameters(spec: RobotSpec, rows: list[dict[str, Any]]) -> dict[str, sp.Expr]:
    """Named parameters that appear as symbols in ``rows``, name -> value in SI units."""
    symbols = {
        str(symbol) for row in rows for value in row.values() for symbol in sp.sympify(value, strict=True).free_symbols
    }
    return {name: value for name, value in spec.parameters.items() if name in symbols}


def _variable(spec: RobotSpec, joint: JointSpec, j: int) -> str:
    """Name for the variable of joint ``j`` that does not clash with a named parameter."""
    return joint.name if joint.name not in spec.parameters else f"q_{j}_{joint.name}"


def _after(spec: RobotSpec) -> sp.Matrix:
    """Transform (4, 4) behind the last modified frame: the twist behind the last joint, then the tool; nominal."""
    last = dh_rows(spec)[-1].behind
    T = spec.tool.matrix()
    if last != NO_TWIST:
        twist = rotation_x(last.alpha).row_join(sp.Matrix([last.a, 0, 0])).col_join(sp.Matrix([[0, 0, 0, 1]]))
        T = twist * T
    return T.applyfunc(lambda entry: normal_form(spec.nominal(entry)))


def _tool_row(T: sp.Matrix) -> dict[str, Any]:
    """Parameters gamma, b, alpha, d, theta, r of the fixed tool frame with the transform ``T`` (4, 4).

    gamma, alpha and theta are the z-x-z Euler angles of the rotation; d, b and r describe the translation.
    """
    R, p = T[:3, :3], T[:3, 3]
    across = sp.sqrt(normal_form(R[0, 2] ** 2 + R[1, 2] ** 2))
    if abs(float(across)) > TINY:
        gamma, theta = sp.atan2(R[0, 2], -R[1, 2]), sp.atan2(R[2, 0], R[2, 1])
        alpha = sp.atan2(across, R[2, 2])
    else:
        gamma = sp.S.Zero
        alpha = sp.S.Zero if float(R[2, 2]) > 0 else sp.pi
        theta = sp.atan2(R[1, 0], R[0, 0]) if alpha == 0 else sp.atan2(-R[0, 1], R[0, 0])
    c, s = sp.cos(gamma), sp.sin(gamma)
    d, side = c * p[0] + s * p[1], -s * p[0] + c * p[1]  # in the frame turned by gamma
    if abs(float(across)) > TINY:
        r = -side / sp.sin(alpha)
        b = p[2] - r * sp.cos(alpha)
    elif abs(float(side)) > TINY:
        turn = sp.atan2(p[1], p[0])
        sign = 1 if alpha == 0 else -1
        gamma, theta, d, r, b = turn, theta - sign * turn, sp.sqrt(p[0] ** 2 + p[1] ** 2), sp.S.Zero, p[2]
    else:
        r, b = sp.S.Zero, p[2]
    row = {"alpha": alpha, "gamma": gamma, "theta": theta, "d": d, "r": r, "b": b}
    return {"sigma": 2, **{key: _simple(value) for key, value in row.items()}}


def _simple(value: sp.Expr) -> sp.Expr:
    """Replace ``value`` by a decimal approximation, unless it is a short exact number (possibly with pi or a root)."""
    value = sp.nsimplify(normal_form(value)) if value.is_Rational else normal_form(value)
    exact = value.is_Rational or (value / sp.pi).is_Rational or (value**2).is_Rational
    return value if exact else sp.Rational(str(sp.N(value, 25)))


def _dynamics(spec: RobotSpec, count: int) -> Iterator[str]:
    twists = [row.behind for row in dh_rows(spec, nominal=True)]
    bodies = [_in_modified_frame(*pair) for pair in zip(spec.links, twists, strict=True)] if spec.links else []
    padding = count - spec.n
    if bodies:
        for name in (*INERTIA, *MOMENTS, "M"):
            yield _list(name, [body[name] for body in bodies] + [0] * padding)
    else:
        for name in (*INERTIA, *MOMENTS, "M"):
            symbols = [f"{name}{j + 1}" for j in range(spec.n)] + ["0"] * padding
            yield f"{name} = {{{','.join(symbols)}}}"
    for name in ("FX", "FY", "FZ", "CX", "CY", "CZ"):
        yield _list(name, [0] * count)
    friction = [viscous_and_coulomb(joint.friction) for joint in spec.joints]
    inertia = [(joint.drive.inertia if joint.drive else None) or 0.0 for joint in spec.joints]
    yield _list("FV", [_exact(viscous) for viscous, _ in friction] + [0] * padding)
    yield _list("FS", [_exact(coulomb) for _, coulomb in friction] + [0] * padding)
    yield _list("IA", [_exact(value) for value in inertia] + [0] * padding)


def _exact(value: float | None) -> sp.Rational:
    return sp.Rational(repr(float(value or 0.0)))


def _in_modified_frame(link: LinkSpec, behind: Twist) -> dict[str, sp.Expr]:
    """Mass, first moments and inertia of a link about the origin and in the axes of its modified frame.

    ``behind`` is the twist from that frame to the link frame.
    """
    R, shift = rotation_x(behind.alpha), sp.Matrix([behind.a, 0, 0])
    m, com = link.mass, sp.Matrix(link.com)
    xx, yy, zz, xy, xz, yz = link.inertia_about_origin()
    about_origin = sp.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    at_com = about_origin - m * (com.dot(com) * sp.eye(3) - com * com.T)
    c = R * com + shift
    tensor = R * at_com * R.T + m * (c.dot(c) * sp.eye(3) - c * c.T)
    places = {"XX": (0, 0), "XY": (0, 1), "XZ": (0, 2), "YY": (1, 1), "YZ": (1, 2), "ZZ": (2, 2)}
    values = {name: tensor[place] for name, place in places.items()}
    values |= dict(zip(MOMENTS, m * c, strict=True)) | {"M": m}
    return {name: _decimal(value) for name, value in values.items()}


def _decimal(value: sp.Expr) -> sp.Rational:
    value = normal_form(value)
    return value if value.is_Rational else sp.Rational(str(sp.N(value, 25)))


def _notes(spec: RobotSpec, used: dict[str, sp.Expr]) -> Iterator[str]:
    if used:
        listed = " ".join(f"--set {name}={number_text(value)}" for name, value in used.items())
        yield f"named parameters are symbols without values there; to read the file back: {listed}"
    if spec.drives is not None:
        yield "coupled drives are left out: the format has one drive per joint"
    if any(getattr(joint.limits, key) is not None for joint in spec.joints for key in ("lower", "upper", "velocity")):
        yield "limits are left out: the format has no such entry"
    yield from unused_entries(spec)


EXPORTER = Exporter("par", "OpenSYMORO .par: modified Denavit-Hartenberg parameters, inertia, friction", _write)
