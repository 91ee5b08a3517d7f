"""The geometry of a chain with the parameters that calibration estimates, and the derivatives of the tip by them.

``T(q) = base  prod_i Rz(theta_i + q_i) Tz(d_i) Tx(a_i) Rx(alpha_i) Ry(beta_i)  tool``, with d_i + q_i for a prismatic
joint. The twist after the last joint is part of the tool. ``beta_i`` is zero in a Denavit-Hartenberg table; it is a
parameter where the axes i and i+1 are parallel. When such axes tilt a little, their common perpendicular, and with it
d, jumps by metres, while beta is as small as the tilt (Hayati 1983). With gains, ``g_j q_j`` stands for q_j: errors of
gear ratios and scales. Fixtures, such as a plane that the tip touches, are part of the geometry too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.emit.targets.rigid_bodies import homogeneous
from rrrgen.robot.model.canonical_frames import dh_rows
from rrrgen.robot.model.mechanism import refuse_loops
from rrrgen.robot.spec import RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# Fixtures of unknown place that the tip touches, or to which a wire leads: their parameters and start values.
#
# - plane: unit normal n (3,) and offset c, the height ``n . p - c`` of the tip p is measured (0 where it touches); -
# contact: a point P (3,) that the tip touches, ``p = P``; - wire: anchor A (3,) and zero z of a draw wire, whose
# length ``|p - A| + z`` is measured.
# ------------------------------------------------------------------------------------------------------------------

FixtureKind = Literal["plane", "contact", "wire"]
KEYS: dict[FixtureKind, tuple[str, ...]] = {
    "plane": ("tilt1", "tilt2", "offset"),
    "contact": ("x", "y", "z"),
    "wire": ("x", "y", "z", "zero"),
}
"""Names of the parameters of a fixture: the normal of a plane turns towards two directions in the plane."""

ROUNDED = 1e-12  # share of |P|^2 below which a sum of products is rounding error


@dataclass(frozen=True)
class Fixture:
    """A fixture called ``name``; ``vector`` (3,) is its normal, point or anchor, ``offset`` (m) its offset or zero."""

    kind: FixtureKind
    name: str
    vector: Array
    offset: float = 0.0

    def predict(self, p: Array) -> Array:
        """Values (N, components) that the measurements would have with the tip at the positions ``p`` (N, 3), in m."""
        if self.kind == "plane":
            return np.asarray((p @ self.vector - self.offset)[:, None])
        if self.kind == "contact":
            return np.asarray(p - self.vector)
        return np.asarray(np.linalg.norm(p - self.vector, axis=1)[:, None] + self.offset)

    def by_position(self, p: Array) -> Array:
        """Derivative (N, components, 3) of :meth:`computed` by the positions ``p`` (N, 3)."""
        if self.kind == "plane":
            return np.broadcast_to(self.vector, (len(p), 1, 3))
        if self.kind == "contact":
            return np.broadcast_to(np.eye(3), (len(p), 3, 3))
        return directions(p - self.vector)

    def by_parameters(self, p: Array) -> Array:
        """Derivative (N, components, parameters) of :meth:`computed` by the parameters in the order of ``KEYS``."""
        ones = np.ones((len(p), 1, 1))
        if self.kind == "plane":
            return np.concatenate([(p @ self._tangents().T)[:, None], -ones], axis=2)
        if self.kind == "contact":
            return -self.by_position(p)
        return np.concatenate([-self.by_position(p), ones], axis=2)

    def with_step(self, step: Mapping[str, float]) -> Fixture:
        """Add changes, by the names in ``KEYS``, to the parameters."""
        if self.kind == "plane":
            tilt = np.array([step.get("tilt1", 0.0), step.get("tilt2", 0.0)])
            normal = self.vector + tilt @ self._tangents()
            return replace(self, vector=normal / np.linalg.norm(normal), offset=self.offset + step.get("offset", 0.0))
        shift = np.array([step.get(key, 0.0) for key in ("x", "y", "z")])
        return replace(self, vector=self.vector + shift, offset=self.offset + step.get("zero", 0.0))

    def change_from(self, start: Fixture) -> dict[str, float]:
        """Parameters minus those of ``start``, by the names in ``KEYS``: those of :meth:`moved`, to first order."""
        vector, offset = self.vector - start.vector, self.offset - start.offset
        if self.kind == "plane":
            tilt1, tilt2 = start._tangents() @ vector
            return {"tilt1": float(tilt1), "tilt2": float(tilt2), "offset": offset}
        return dict(zip(("x", "y", "z"), map(float, vector), strict=True)) | {"zero": offset}

    def _tangents(self) -> Array:
        """Two unit vectors (2, 3) in the plane, at right angles."""
        first = np.cross(self.vector, np.eye(3)[int(np.argmin(np.abs(self.vector)))])
        first /= np.linalg.norm(first)
        return np.array([first, np.cross(self.vector, first)])


def directions(p: Array) -> Array:
    """Unit vectors (N, 1, 3) along ``p`` (N, 3), the derivative of its length."""
    return np.asarray((p / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-12))[:, None])


def fit_fixture(kind: FixtureKind, name: str, p: Array, values: Array) -> Fixture:
    """Fit a fixture to tip positions ``p`` (N, 3) and measured ``values`` (N,), in m, where the estimation starts."""
    centre = p.mean(axis=0)
    if kind == "contact":
        return Fixture(kind, name, centre)
    if kind == "plane":
        normal = _unit_regression(p - centre, values - values.mean())
        return Fixture(kind, name, normal, float(normal @ centre - values.mean()))
    # |p - A| = l - z squared: 2 A.p - 2 z l + (z^2 - |A|^2) = |p|^2 - l^2, linear in A, z and the bracket
    system = np.column_stack([2 * p, -2 * values, np.ones(len(p))])
    *anchor, zero, _ = np.linalg.lstsq(system, np.sum(p * p, axis=1) - values**2, rcond=None)[0]
    return Fixture(kind, name, np.array(anchor), float(zero))


def _unit_regression(P: Array, h: Array) -> Array:
    """The unit vector n that minimizes ``|P n - h|``, for P (N, 3) and h (N,).

    It is ``(P'P + k)^-1 P'h`` with the k for which its length is one, found by bisection. Where h is constant, P'h is
    zero, and n is the direction in which P varies least; its sign makes its largest component positive.
    """
    squares, axes = np.linalg.eigh(P.T @ P)
    b = axes.T @ (P.T @ h)
    b[np.abs(b) < ROUNDED * squares[-1]] = 0.0
    low, high = -squares[0], float(np.linalg.norm(b))
    for _ in range(200):
        middle = (low + high) / 2
        length = np.linalg.norm(b / np.maximum(squares + middle, 1e-300))
        low, high = (middle, high) if length > 1 else (low, middle)
    n = b / np.maximum(squares + high, 1e-300)
    missing = 1 - float(n @ n)
    if missing > 1e-6:  # even the least k is too large: the rest lies along the direction of least variation
        sign = 1.0 if axes[int(np.argmax(np.abs(axes[:, 0]))), 0] > 0 else -1.0
        n[0] += sign * np.sqrt(missing)
    vector = axes @ n
    return np.asarray(vector / np.linalg.norm(vector))


# ------------------------------------------------------------------------------------------------------------------
# The geometry of a chain with the parameters that calibration estimates, and the derivatives of the tip by them
# ------------------------------------------------------------------------------------------------------------------

PARALLEL = 0.01  # rad; axes this near to parallel get a beta
EXACT = 1e-12  # rad; axes this near to parallel are so but for rounding errors
NEAR = 1e-3  # m; parallel axes this near have no certain direction from one to the other
ROW = ("theta", "d", "a", "alpha", "beta")
RIGID = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class GeometryEntry:
    """One geometric parameter: its ``place`` (base, row, tool, gain, fixture), its ``key``, and a number (from 0).

    ``key`` is an entry of ``ROW``, ``RIGID`` or ``fixtures.KEYS``, or "gain"; ``row`` counts the rows of the table, the
    joints of gains, or the fixtures, of which one is called ``fixture``.
    """

    place: str
    key: str
    row: int = -1
    fixture: str = ""

    @property
    def name(self) -> str:
        """The name, such as ``base_rz``, ``alpha2``, ``gain3``, ``table_tilt1``; rows and joints are counted from 1."""
        if self.place in ("row", "gain"):
            return f"{self.key}{self.row + 1}"
        return f"{self.fixture or self.place}_{self.key}"

    @property
    def unit(self) -> str:
        """The unit of the parameter: m, rad, or 1 for gains."""
        if self.is_angle:
            return "rad"
        return "1" if self.place == "gain" else "m"

    @property
    def is_angle(self) -> bool:
        """Whether the unit is rad."""
        return self.key in ("theta", "alpha", "beta", "rx", "ry", "rz", "tilt1", "tilt2")


@dataclass(frozen=True)
class Geometry:
    """Geometry of a robot in numbers: transforms ``base`` and ``tool`` (4, 4), and between them the rows of its table.

    ``rows`` (n, 5) are theta, d, a, alpha, beta in rad and m, ``revolute`` tells which rows turn and which slide. Each
    row moves by its joint position q or, in a mechanism, by ``coupling q`` with the matrix ``coupling`` (n, joints).
    With ``gains`` (joints,), which are then parameters, q is multiplied by them. ``fixtures`` are what is touched.
    """

    base: Array
    rows: Array
    tool: Array
    revolute: tuple[bool, ...]
    coupling: Array | None = None
    gains: Array | None = None
    fixtures: tuple[Fixture, ...] = ()

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.revolute)

    @property
    def joints(self) -> int:
        """Number of measured joint positions q; in a mechanism there are fewer of them than rows."""
        return self.n if self.coupling is None else int(self.coupling.shape[1])

    def with_exact_parallels(self) -> Geometry:
        """A copy in which nearly parallel axes are parallel: the geometry that decides what can be distinguished."""
        rows = self.rows.copy()
        for i in (i for i in range(self.n - 1) if self.is_parallel(i)):
            rows[i, 3:] = np.pi * np.round(rows[i, 3] / np.pi), 0.0
        return replace(self, rows=rows)

    def turning(self) -> list[bool]:
        """Whether each joint position is an angle, the one of the first row that it moves."""
        moved = np.eye(self.n) if self.coupling is None else self.coupling
        return [self.revolute[int(np.argmax(moved[:, j] != 0))] for j in range(self.joints)]

    def with_gains(self) -> Geometry:
        """A copy whose gains are parameters, 1 to begin with."""
        return replace(self, gains=np.ones(self.joints))

    def entries(self) -> list[GeometryEntry]:
        """List every parameter that measurements may determine.

        Where several have the same effect on the measurements, only the first of them in this order is estimated.
        Fixtures stand before the base, which stays where it is if they are all unknown.
        """
        between = range(self.n - 1)
        parallel = [i for i in between if self.is_parallel(i)]
        entries = [
            GeometryEntry("fixture", key, k, fixture.name)
            for k, fixture in enumerate(self.fixtures)
            for key in KEYS[fixture.kind]
        ]
        entries += [GeometryEntry("base", key) for key in RIGID] + [GeometryEntry("tool", key) for key in RIGID]
        entries += [GeometryEntry("gain", "gain", j) for j in range(self.joints if self.gains is not None else 0)]
        entries += [GeometryEntry("row", "beta", i) for i in parallel]
        entries += [GeometryEntry("row", key, i) for key in ("a", "alpha", "theta", "d") for i in between]
        return entries + [GeometryEntry("row", key, self.n - 1) for key in ("theta", "d")]

    def is_parallel(self, i: int) -> bool:
        """Whether the axes i and i+1 are parallel, or nearly so."""
        return bool(abs(np.sin(self.rows[i, 3])) < PARALLEL)

    def forward(self, q: Array) -> Array:
        """Poses (N, 4, 4) of the tip in the world frame, for the joint positions ``q`` (N, joints)."""
        return self._frames(q)[-1]

    def _frames(self, q: Array) -> list[Array]:
        """Poses (N, 4, 4) of the tip, last, and of every frame about whose axes a parameter turns or shifts.

        For each row these are the frames before the joint's screw along z, before the twist along x, and before beta
        about y.
        """
        q = q if self.gains is None else q * self.gains
        q = q if self.coupling is None else q @ self.coupling.T
        T = np.broadcast_to(self.base, (len(q), 4, 4))
        frames = []
        for i, (theta, d, a, alpha, beta) in enumerate(self.rows):
            turn = theta + q[:, i] if self.revolute[i] else np.full(len(q), theta)
            shift = np.full(len(q), d) if self.revolute[i] else d + q[:, i]
            frames.append(T)
            T = T @ _screws(turn, shift, 2)
            frames.append(T)
            T = T @ _screws(np.array([alpha]), np.array([a]), 0)
            frames.append(T)
            T = T @ _screws(np.array([beta]), np.zeros(1), 1)
        return [*frames, T @ self.tool]

    def jacobian(self, q: Array, entries: Sequence[GeometryEntry]) -> Array:
        """Derivative (N, 6, p) of the tip's position (m) and orientation (rotation vector) in the world frame."""
        frames = self._frames(q)
        J = np.zeros((len(q), 6, len(entries)))
        for k, entry in enumerate(entries):
            if entry.place == "gain":
                J[:, :, k] = self._by_drive(frames, entry.row) * q[:, entry.row, None]
            elif entry.place != "fixture":
                J[:, :, k] = _twist_of(entry, frames)
        return J

    def by_joints(self, q: Array) -> Array:
        """Derivative (N, 6, joints) of the tip's position and orientation by the joint positions ``q`` (N, joints)."""
        frames = self._frames(q)
        gains = np.ones(self.joints) if self.gains is None else self.gains
        return np.stack([self._by_drive(frames, j) * gains[j] for j in range(self.joints)], axis=2)

    def _by_drive(self, frames: list[Array], j: int) -> Array:
        """Derivative (N, 6) of the tip by the position of drive ``j``, as its gain has scaled it."""
        factors = np.eye(self.n)[:, j] if self.coupling is None else self.coupling[:, j]
        keys = ["theta" if turns else "d" for turns in self.revolute]
        moving = [(factor, GeometryEntry("row", keys[i], i)) for i, factor in enumerate(factors) if factor != 0]
        return sum((factor * _twist_of(entry, frames) for factor, entry in moving), np.zeros((len(frames[0]), 6)))

    def with_step(self, entries: Sequence[GeometryEntry], step: Array) -> Geometry:
        """A copy with ``step`` (p,) added to the parameters ``entries``, in m and rad.

        Base and tool move along and about the axes of their own frames.
        """
        rows, gains = self.rows.copy(), None if self.gains is None else self.gains.copy()
        change = {"base": np.zeros(6), "tool": np.zeros(6)}
        touched: list[dict[str, float]] = [{} for _ in self.fixtures]
        for entry, value in zip(entries, step, strict=True):
            if entry.place == "row":
                rows[entry.row, ROW.index(entry.key)] += value
            elif entry.place == "fixture":
                touched[entry.row][entry.key] = float(value)
            elif gains is not None and entry.place == "gain":
                gains[entry.row] += value
            else:
                change[entry.place][RIGID.index(entry.key)] += value
        base, tool = self.base @ rigid(change["base"]), self.tool @ rigid(change["tool"])
        fixtures = tuple(fixture.with_step(by) for fixture, by in zip(self.fixtures, touched, strict=True))
        return replace(self, rows=rows, base=base, tool=tool, gains=gains, fixtures=fixtures)


_AXES = {"theta": 2, "d": 2, "a": 0, "alpha": 0, "beta": 1} | {key: "xyz".index(key[-1]) for key in RIGID}
_PLACES = {"theta": 0, "d": 0, "a": 1, "alpha": 1, "beta": 2}


def _twist_of(entry: GeometryEntry, frames: list[Array]) -> Array:
    """Derivative (N, 6) of the tip by a parameter of base, row or tool: a turn about, or a shift along, an axis."""
    frame, tip = _frame_of(entry, frames), frames[-1]
    axis = frame[:, :3, _AXES[entry.key]]
    if entry.is_angle:
        return np.concatenate([np.cross(axis, tip[:, :3, 3] - frame[:, :3, 3]), axis], axis=1)
    return np.concatenate([axis, np.zeros_like(axis)], axis=1)


def _frame_of(entry: GeometryEntry, frames: list[Array]) -> Array:
    if entry.place == "tool":
        return frames[-1]
    return frames[0] if entry.place == "base" else frames[3 * entry.row + _PLACES[entry.key]]


def _screws(angle: Array, length: Array, axis: int) -> Array:
    """Screw motions (N, 4, 4): rotations by ``angle`` (N,) about, and shifts by ``length`` along, a coordinate axis."""
    T = np.tile(np.eye(4), (max(len(angle), len(length)), 1, 1))
    i, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    T[:, i, i], T[:, i, k], T[:, k, i], T[:, k, k] = c, -s, s, c
    T[:, axis, 3] = length
    return T


def rigid(step: Array) -> Array:
    """The transform (4, 4) of a shift (3,) and a rotation vector (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.asarray(step[3:])), step[:3]
    return T


def rotation(w: Array) -> Array:
    """The rotation matrix (3, 3) of a rotation vector."""
    angle = float(np.linalg.norm(w))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = w / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors (N, 3) of rotation matrices (N, 3, 3), up to angles of pi."""
    skew = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine = np.linalg.norm(skew, axis=1)
    angle = np.arctan2(sine, (np.trace(R, axis1=1, axis2=2) - 1) / 2)
    scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return np.asarray(skew * scale[:, None])


def path_to_tip(spec: RobotSpec) -> tuple[int, ...]:
    """The numbers of the rows from base to tip; in a mechanism with branches others stand beside them."""
    return tuple(range(spec.n)) if spec.mechanism is None else spec.mechanism.path(spec.mechanism.tip)


def geometry_of(spec: RobotSpec) -> Geometry:
    """The geometry of a robot file between base and tip, at its nominal parameters."""
    geometry = geometry_of_table(spec)
    return replace(geometry, rows=_hayati(geometry.rows))


def geometry_of_table(spec: RobotSpec) -> Geometry:
    """The same in the rows of the table, whose common perpendiculars of nearly parallel axes may be far away."""
    if spec.has_placements:
        message = "calibration takes no rows with gamma or b: write each as a fixed row with theta: gamma and d: b"
        raise DerivationError(f"{spec.name}: {message}")
    refuse_loops(spec, "the calibration")
    path, every = path_to_tip(spec), dh_rows(spec, nominal=True)
    table = [every[i] for i in path]
    rows = np.zeros((len(table), 5))
    for i, (row, following) in enumerate(zip(table, (*table[1:], None), strict=True)):
        rows[i, :2] = float(row.theta), float(row.d)
        if following is not None:  # one of the two twists is zero
            rows[i, 2:4] = [float(x + y) for x, y in zip(row.behind, following.before, strict=True)]
    base = homogeneous(spec, spec.base) @ _twist(*map(float, table[0].before))
    tool = _twist(*map(float, table[-1].behind)) @ homogeneous(spec, spec.tool)
    coupling = None if spec.mechanism is None else np.array([spec.mechanism.matrix[i] for i in path], dtype=float)
    return Geometry(base, rows, tool, tuple(row.revolute for row in table), coupling)


def _hayati(rows: Array) -> Array:
    """Rows of the same chain in which nearly parallel axes have no common perpendicular far away, but an angle beta.

    The axis i+1 is met where it crosses the plane through the origin of frame i at right angles to axis i. The frame
    there differs from the one of the table by a screw along its axis, which goes into the next theta and d.
    """
    rows = rows.copy()
    for i in range(len(rows) - 1):
        if not EXACT < abs(np.sin(rows[i, 3])) < PARALLEL or rows[i, 4] != 0.0:
            continue
        theta, d, a, alpha, _ = rows[i]
        T = _screws(np.array([theta]), np.array([d]), 2)[0] @ _twist(a, alpha)
        axis, origin = T[:3, 2], T[:3, 3]
        met = origin - axis * (origin[2] / axis[2])
        if float(np.hypot(met[0], met[1])) < NEAR:
            continue  # the axes nearly coincide: there is no direction between them
        turn, length = float(np.arctan2(met[1], met[0])), float(np.hypot(met[0], met[1]))
        across = rotation(np.array([0.0, 0.0, -turn])) @ axis
        tilt = np.array([np.arctan2(-across[1], across[2]), np.arcsin(across[0])])
        rows[i] = turn, 0.0, length, *tilt
        new = (
            _screws(np.array([turn]), np.zeros(1), 2)[0]
            @ _twist(length, tilt[0])
            @ _screws(tilt[1:], np.zeros(1), 1)[0]
        )
        rest = np.linalg.solve(new, T)
        rows[i + 1, :2] += np.arctan2(rest[1, 0], rest[0, 0]), rest[2, 3]
    return rows


def _twist(a: float, alpha: float) -> Array:
    return np.asarray(_screws(np.array([alpha]), np.array([a]), 0)[0])
