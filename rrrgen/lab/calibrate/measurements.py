"""The kinds of measurements for calibration, with their residuals and the derivatives of these.

- pose: position (m) and orientation of the tip in the world frame;
- point: position only;
- distance: ``|p|`` of the tip from the origin of the world frame, the anchor of a ball bar or a draw wire;
- height: ``n . p`` of the tip along a known unit vector n, z of the world frame where none is given;
- plane, contact, wire: with a fixture of unknown place (:mod:`rrrgen.lab.calibrate.geometry`).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError
from rrrgen.base.yamltext.document import MAX_BYTES, decode
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.lab.calibrate.geometry import (
    KEYS,
    Fixture,
    FixtureKind,
    Geometry,
    GeometryEntry,
    directions,
    fit_fixture,
    rotation_vectors,
)

Kind = Literal["pose", "point", "distance", "height", "plane", "contact", "wire"]
COUNT = {"pose": 6, "point": 3, "contact": 3, "distance": 1, "height": 1, "plane": 1, "wire": 1}
"""Number of components of one measurement, by its kind."""
Numbers = NDArray[np.int64]
FIXTURES: tuple[FixtureKind, ...] = get_args(FixtureKind)


@dataclass(frozen=True)
class Measurements:
    """Measurements of one ``kind`` at the joint positions ``q`` (N, n), rad or m.

    ``values`` are poses (N, 4, 4), points (N, 3), or lengths (N,); for contacts they are unused. ``sigma`` (m) and
    ``sigma_angle`` (rad) are the standard deviations of one component. ``normals`` (N, 3) are the directions of
    heights. ``fixture`` (N,) is the number of the fixture touched, of those called ``names``.
    """

    kind: Kind
    q: Array
    values: Array
    sigma: float
    sigma_angle: float
    normals: Array | None = None
    fixture: Numbers | None = None
    names: tuple[str, ...] = ()

    @property
    def weights(self) -> Array:
        """The weight of each component of one measurement: 1 over its standard deviation."""
        lengths = np.full(min(COUNT[self.kind], 3), 1.0 / self.sigma)
        return np.concatenate([lengths, np.full(3, 1.0 / self.sigma_angle)]) if self.kind == "pose" else lengths

    def of(self, rows: Numbers, q: Array) -> Measurements:
        """The measurements number ``rows`` (from 0), as if made at the joint positions ``q``."""
        normals = None if self.normals is None else self.normals[rows]
        fixture = None if self.fixture is None else self.fixture[rows]
        return replace(self, q=q, values=self.values[rows], normals=normals, fixture=fixture)

    def with_fixtures(self, geometry: Geometry) -> Geometry:
        """Add the unknown fixtures to ``geometry``, fitted to the positions that it computes."""
        if self.fixture is None:
            return geometry
        p = geometry.forward(self.q)[:, :3, 3]
        fixtures = []
        for kind in (fixture_kind for fixture_kind in FIXTURES if fixture_kind == self.kind):
            for k, name in enumerate(self.names):
                i = self.fixture == k
                fixtures.append(fit_fixture(kind, name, p[i], self.values[i]))
        return replace(geometry, fixtures=tuple(fixtures))

    def residuals(self, geometry: Geometry) -> Array:
        """Measured minus computed, (N, components), in m and rad."""
        T = geometry.forward(self.q)
        p = T[:, :3, 3]
        if self.kind == "pose":
            turned = self.values[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
            return np.concatenate([self.values[:, :3, 3] - p, rotation_vectors(turned)], axis=1)
        if self.kind == "point":
            return np.asarray(self.values - p)
        if self.kind in FIXTURES:
            residuals = np.zeros((len(p), COUNT[self.kind]))
            for fixture, i in self._fixture_indices(geometry):
                residuals[i] = (0.0 if self.kind == "contact" else self.values[i, None]) - fixture.predict(p[i])
            return residuals
        computed = np.linalg.norm(p, axis=1) if self.kind == "distance" else np.sum(self._up(p)[:, 0] * p, axis=1)
        return np.asarray((self.values - computed)[:, None])

    def convert_jacobian(self, geometry: Geometry, J: Array) -> Array:
        """Convert the derivative J (N, 6, p) of the tip to that of the measurements (N, components, p)."""
        if self.kind == "pose":
            return J
        if self.kind == "point":
            return np.asarray(J[:, :3])
        p = geometry.forward(self.q)[:, :3, 3]
        if self.kind in FIXTURES:
            by: Array = np.zeros((len(p), COUNT[self.kind], 3))
            for fixture, i in self._fixture_indices(geometry):
                by[i] = fixture.by_position(p[i])
        else:
            by = np.asarray(directions(p) if self.kind == "distance" else self._up(p))
        return np.asarray(by @ J[:, :3])

    def jacobian(self, geometry: Geometry, entries: Sequence[GeometryEntry]) -> Array:
        """Derivative (N, components, p) of the computed measurements by the parameters ``entries``, in m and rad."""
        J = self.convert_jacobian(geometry, geometry.jacobian(self.q, entries))
        places = {(e.row, e.key): k for k, e in enumerate(entries) if e.place == "fixture"}
        if places:
            p = geometry.forward(self.q)[:, :3, 3]
            for number, (fixture, i) in enumerate(self._fixture_indices(geometry)):
                by = fixture.by_parameters(p[i])
                for k, key in enumerate(KEYS[fixture.kind]):
                    if (number, key) in places:
                        J[i, :, places[number, key]] = by[:, :, k]
        return J

    def _up(self, p: Array) -> Array:
        """The directions (N, 1, 3) of heights."""
        up = np.array([[0.0, 0.0, 1.0]]) if self.normals is None else self.normals
        return np.broadcast_to(up[:, None], (len(p), 1, 3))

    def _fixture_indices(self, geometry: Geometry) -> list[tuple[Fixture, Numbers]]:
        """Every fixture with the indices of the measurements that touched it."""
        return [(fixture, np.flatnonzero(self.fixture == k)) for k, fixture in enumerate(geometry.fixtures)]


# ------------------------------------------------------------------------------------------------------------------
# Reader of CSV files of measurements: a column per joint, and columns of what was measured.
#
# The header names the joints (or q1, q2, ...) and the measured quantities: ``x y z`` alone, with ``qw qx qy qz`` or
# with ``roll pitch yaw``; ``distance``; ``height``, along z or ``nx ny nz``; or a fixture by its name: ``plane``,
# touched or with the ``height`` over it, ``contact``, a touched point, or ``wire`` with ``distance``. A unit may
# follow, as in ``x [mm]``, ``q1 [deg]``; the default is m and rad.
# ------------------------------------------------------------------------------------------------------------------

UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3}
POSITION = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
NORMAL = ("nx", "ny", "nz")
ANGLES = ("roll", "pitch", "yaw")
UNIT_NORM = 1e-3  # largest error of the length of a quaternion or normal; others were cut short or are none
NAME = re.compile(r"[\w-]{1,40}")
FORMS: tuple[tuple[Kind, tuple[str, ...]], ...] = (
    ("pose", (*POSITION, *QUATERNION)),
    ("pose", (*POSITION, *ANGLES)),
    ("point", POSITION),
    ("plane", ("plane", "height")),
    ("plane", ("plane",)),
    ("contact", ("contact",)),
    ("wire", ("wire", "distance")),
    ("distance", ("distance",)),
    ("height", (*NORMAL, "height")),
    ("height", ("height",)),
)


@dataclass(frozen=True)
class MeasurementTable:
    """The numbers of a file: ``values`` (N, columns) in SI units under the ``names`` of the columns.

    ``joints`` are the columns of the joint positions, ``wanted`` the names of those that hold what was measured.
    ``labels`` (N,) name the fixtures touched, and ``places`` are the lines of the file, the header's first.
    """

    path: Path
    names: tuple[str, ...]
    values: Array
    kind: Kind
    joints: tuple[int, ...]
    wanted: tuple[str, ...]
    labels: tuple[str, ...]
    places: tuple[int, ...]

    def measurements(self, sigma: float, sigma_angle: float) -> Measurements:
        """The measurements with the standard deviations ``sigma`` (m) and ``sigma_angle`` (rad) of one component.

        Raises :class:`InputError` for quaternions and directions that have not the length one.
        """
        q, data = self.values[:, self.joints], self.values[:, [self.names.index(name) for name in self.wanted]]
        if self.kind == "pose":
            return Measurements("pose", q, _poses(data, self.places[1:], self.path), sigma, sigma_angle)
        if self.kind == "point":
            return Measurements("point", q, data, sigma, sigma_angle)
        if self.kind not in FIXTURES:
            normals = _units(data[:, :3], self.places[1:], self.path) if self.wanted[0] == "nx" else None
            return Measurements(self.kind, q, data[:, -1], sigma, sigma_angle, normals)
        fixtures = tuple(dict.fromkeys(self.labels))
        numbers = np.array([fixtures.index(label) for label in self.labels])
        lengths = data[:, 1] if len(self.wanted) > 1 else np.zeros(len(q))
        return Measurements(self.kind, q, lengths, sigma, sigma_angle, fixture=numbers, names=fixtures)


def read_table(path: Path, joints: Sequence[str]) -> MeasurementTable:
    """Read the file of measurements of a robot with the joints ``joints``; InputError with every fault."""
    return _table(*_lines(path), path, joints)


def table_of_arrays(arrays: Mapping[str, Any], joints: Sequence[str]) -> MeasurementTable:
    """The table of measurements in memory: ``q`` (N, n), and ``poses`` (N, 4, 4) or the columns of a file by name.

    They are checked as a file is; raises :class:`InputError` with every fault.
    """
    columns: dict[str, Any] = {}
    for key, values in arrays.items():
        if key == "q":
            q = np.asarray(values, float)
            if q.ndim != 2 or q.shape[1] != len(joints):
                raise InputError(f"'q' has the shape {q.shape}, not (N, {len(joints)})")
            columns |= zip(joints, q.T, strict=True)
        elif key == "poses":
            T = np.asarray(values, float)
            if T.ndim != 3 or T.shape[1:] != (4, 4):
                raise InputError(f"'poses' has the shape {T.shape}, not (N, 4, 4)")
            _check_rotations(T[:, :3, :3])
            columns |= zip((*POSITION, *QUATERNION), [*T[:, :3, 3].T, *_quaternions(T[:, :3, :3]).T], strict=True)
        else:
            columns[key] = np.ravel(values)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"the columns have different lengths: {', '.join(f'{k} {n}' for k, n in lengths.items())}")
    rows = [[str(value) for value in row] for row in zip(*columns.values(), strict=True)]
    return _table([list(columns), *rows], list(range(len(rows) + 1)), Path("arrays"), joints)


def _check_rotations(R: Array) -> None:
    """Raise InputError for the first of the matrices (N, 3, 3) that is no rotation; what is not finite passes."""
    misses = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    for k in np.flatnonzero((misses > UNIT_NORM) | (np.linalg.det(R) < 0.0)):
        what = f"R R^T misses the unit matrix by {misses[k]:.2g}" if misses[k] > UNIT_NORM else "it is a reflection"
        raise InputError(f"'poses' has no rotation at index {k}: {what}")


def _quaternions(R: Array) -> Array:
    """Quaternions (N, 4), w first, of rotation matrices (N, 3, 3): eigenvectors of Bar-Itzhack's matrix."""
    K = R + np.swapaxes(R, 1, 2)
    trace = np.trace(R, axis1=1, axis2=2)[:, None, None]
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    whole = (
        np.concatenate([trace, axis[:, None]], axis=2),
        np.concatenate([axis[:, :, None], K - trace * np.eye(3)], axis=2),
    )
    return np.asarray(np.linalg.eigh(np.concatenate(whole, axis=1))[1][:, :, -1])


def _table(lines: list[list[str]], places: list[int], path: Path, joints: Sequence[str]) -> MeasurementTable:
    """The table whose header and rows are ``lines``, with their line numbers ``places`` in the file."""
    names, factors = _header(lines[0], places[0], path)
    columns = _joint_columns(names, joints, path, places[0])
    kind, wanted = _form(names, path, places[0])
    known = {*(names[k] for k in columns), *wanted}
    faults = [
        Fault(str(path), places[0], 1, f"the column '{name}' is not used", hint=_columns_hint(joints))
        for name in names
        if name not in known
    ]
    words = names.index(kind) if kind in FIXTURES else None
    values = _numbers(lines[1:], places[1:], len(names), path, faults, words)
    if faults:
        raise InputError(faults)
    labels = () if words is None else tuple(line[words] for line in lines[1:])
    return MeasurementTable(path, tuple(names), values * factors, kind, tuple(columns), wanted, labels, tuple(places))


def _lines(path: Path) -> tuple[list[list[str]], list[int]]:
    """Read the rows of the file, without empty lines and comments, with their line numbers."""
    try:
        with path.open("rb") as stream:
            text = decode(stream.read(MAX_BYTES + 1), str(path))
    except OSError as error:
        raise InputError([Fault(str(path), 0, 0, f"the file cannot be read: {error.strerror}")]) from None
    rows, places = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            rows.append([word.strip() for word in next(csv.reader([line], skipinitialspace=True))])
            places.append(number)
    if len(rows) < 2:
        raise InputError(
            [Fault(str(path), 0, 0, "the file has no measurements", hint="a header, then a line for each")]
        )
    return rows, places


def _header(words: list[str], line: int, path: Path) -> tuple[list[str], Array]:
    names, factors = [], []
    if len(words) == 1 and (other := next((character for character in ";\t" if character in words[0]), None)):
        separator = "tabs" if other == "\t" else f"'{other}'"
        hint = "separate them by commas, and write decimals with a point"
        message = f"the columns are separated by {separator}, not by ','"
        raise InputError([Fault(str(path), line, words[0].index(other) + 1, message, hint=hint)])
    for word in words:
        name, _, unit = word.replace("]", "").partition("[")
        if unit.strip() and unit.strip() not in UNITS:
            hint = did_you_mean(unit.strip(), UNITS) or f"units are {', '.join(UNITS)}"
            raise InputError(
                [Fault(str(path), line, 1, f"no unit '{unit.strip()}' of column '{name.strip()}'", hint=hint)]
            )
        names.append(name.strip())
        factors.append(UNITS[unit.strip()] if unit.strip() else 1.0)
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise InputError([Fault(str(path), line, 1, f"two columns are called '{twice[0]}'")])
    return names, np.array(factors)


def _joint_columns(names: list[str], joints: Sequence[str], path: Path, line: int) -> list[int]:
    numbered = [f"q{k + 1}" for k in range(len(joints))]
    for wanted in (list(joints), numbered):
        if all(name in names for name in wanted):
            return [names.index(name) for name in wanted]
    missing = [name for name in joints if name not in names]
    hint = did_you_mean(missing[0], names) or _columns_hint(joints)
    raise InputError([Fault(str(path), line, 1, f"there is no column for joint '{missing[0]}'", hint=hint)])


def _form(names: list[str], path: Path, line: int) -> tuple[Kind, tuple[str, ...]]:
    for kind, wanted in FORMS:
        if all(name in names for name in wanted):
            return kind, wanted
    raise InputError([Fault(str(path), line, 1, "no column says what was measured", hint=_columns_hint(()))])


def _columns_hint(joints: Sequence[str]) -> str:
    forms = "; ".join(" ".join(columns) for _, columns in FORMS)
    return f"columns are {' '.join(joints)} and one of: {forms}".replace("are  and", "are those of the joints and")


def _numbers(
    rows: list[list[str]], places: list[int], count: int, path: Path, faults: list[Fault], words: int | None
) -> Array:
    """Read the numbers (N, count) of all rows; 0 in the column ``words``, which holds names."""
    values = np.zeros((len(rows), count))
    for k, (row, line) in enumerate(zip(rows, places, strict=True)):
        if len(row) != count:
            faults.append(Fault(str(path), line, 1, f"{len(row)} values instead of {count}", hint="as in the header"))
            continue
        for j, word in enumerate(row):
            if j == words:
                if not NAME.fullmatch(word):
                    column = sum(len(cell) + 1 for cell in row[:j]) + 1
                    message = f"'{word[:30]}' is no name of what was touched"
                    faults.append(Fault(str(path), line, column, message, hint="letters, digits, _ and -"))
                continue
            try:
                values[k, j] = float(word)
            except ValueError:
                values[k, j] = math.nan
            if not math.isfinite(values[k, j]):
                column = sum(len(cell) + 1 for cell in row[:j]) + 1
                faults.append(Fault(str(path), line, column, f"'{word[:30]}' is not a number"))
    return values


def _units(data: Array, places: Sequence[int], path: Path) -> Array:
    """Check unit vectors (N, 3) and bring them to the length one."""
    sizes = np.linalg.norm(data, axis=1)
    for size, line in zip(sizes, places, strict=True):
        if abs(size - 1) > UNIT_NORM:
            message = f"the direction nx ny nz has the length {size:.6g}"
            raise InputError([Fault(str(path), line, 1, message, hint="a unit vector, along which heights count")])
    return np.asarray(data / sizes[:, None])


def _poses(data: Array, places: Sequence[int], path: Path) -> Array:
    """Convert positions with quaternions, or with roll, pitch and yaw, to poses (N, 4, 4)."""
    T = np.tile(np.eye(4), (len(data), 1, 1))
    T[:, :3, 3] = data[:, :3]
    if data.shape[1] == 6:
        for k, (roll, pitch, yaw) in enumerate(data[:, 3:]):
            (a, b, c), (d, e, f) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
            T[k, :3, :3] = [
                [c * b, c * e * d - f * a, c * e * a + f * d],
                [f * b, f * e * d + c * a, f * e * a - c * d],
                [-e, b * d, b * a],
            ]
        return T
    for k, (w, x, y, z) in enumerate(data[:, 3:]):
        size = math.sqrt(w * w + x * x + y * y + z * z)
        if abs(size - 1) > UNIT_NORM:
            message = f"the quaternion has the length {size:.6g}"
            raise InputError([Fault(str(path), places[k], 1, message, hint="qw qx qy qz of length one")])
        v, w = np.array([x, y, z]) / size, w / size
        K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        T[k, :3, :3] = np.eye(3) + 2 * w * K + 2 * K @ K
    return T
