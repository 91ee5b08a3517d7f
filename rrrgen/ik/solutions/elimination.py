"""Choose the best variable elimination for a general chain of six joints, by numerical tests on sample poses.

The eliminations are those of M. Raghavan and B. Roth (1990). The closed loop of the arm is
``Z1 E1 Z2 E2 .. Z6 E6 = 1``: Zi is the rotation about z by joint i, and the Ei are transforms that do not depend on the
joints, one of which contains the target pose. The numbering may begin at any joint and run in either direction, which
gives 12 labellings.

1. The line of axis 6, with point p and direction l, is described by 15 features
   (1, p, p.p, l, p x l, p.l, (p.p) l - 2 (p.l) p). A rigid transform acts on them linearly.
2. The features computed through joints 5, 4, 3 equal those computed from the other side, through joints 1 and 2. Six
   linear combinations of these 14 equations (the first feature is constant) do not contain joints 1 and 2. They are
   linear in (1, cos, sin) of each of joints 3, 4, 5.
3. One of joints 3, 4, 5 is kept as the unknown. The half-angle tangents of the other two are eliminated: the six
   equations, and the same six times one of the tangents, make a 12 x 12 matrix that is singular at a solution. Its
   determinant is a trigonometric polynomial of degree 8 in the kept angle, with up to 16 roots.

There are 36 choices: 12 labellings times three joints to keep. Which ones are usable depends on the chain; on
industrial arms most of the determinants vanish identically.

One joint may be prismatic. Its displacement x enters the features through 1, x, x^2, like the half-angle tangent of a
revolute joint. It must be one of joints 3, 4, 5 and is eliminated as a half-angle tangent would be; the kept joint is
revolute. A labelling for which the determinant then has a degree above 8 is rejected.

This is the only step from robot file to text that needs NumPy; it is loaded for the arms that have no other solver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.ik.tolerances import NOISE, SHALLOW, SPURIOUS, USABLE

Array = NDArray[np.float64]

POSES = 40  # number of random sample poses on which an elimination is scored
SAMPLES = 25  # values of the 12 x 12 determinant: a polynomial of degree <= 12 (25 coefficients) passes through them


@dataclass(frozen=True)
class Elimination:
    """One variable elimination: a labelling of the loop, the roles of its joints 3, 4, 5, and how accurate it is.

    Labelling: the loop is numbered from joint ``start`` (0 .. 5) in the sense of ``direction`` (+1 or -1).
    Roles, each 0, 1 or 2 for joints 3, 4 and 5 of the labelling: ``kept`` is the unknown of the polynomial; the
    half-angle tangents of ``shifted`` and ``other`` are eliminated, and the equations are also multiplied by that of
    ``shifted``. A prismatic joint is always ``other``.
    Quality: ``score`` is the number of decimal digits lost in a root; ``depth`` is log10 of the size of the determinant
    relative to the product of the norms of its rows; ``pure`` says that the polynomial has degree 8 up to rounding. On
    nearly special geometries a small remainder of higher degree is left, and roots close to each other are lost.
    """

    start: int
    direction: int
    kept: int
    shifted: int
    other: int
    score: float
    depth: float
    pure: bool

    @property
    def kept_joint(self) -> int:
        """Index in the chain (0 .. 5) of the joint whose angle is the root of the polynomial."""
        return (self.start + self.direction * (2 + self.kept)) % 6


def eliminations(table: Sequence[Sequence[float]], slide: int | None = None, turn: float = 0.0) -> list[Elimination]:
    """Find the usable eliminations of a chain, best first.

    ``table`` is the DH table, shape (6, 3): alpha (rad), a, d, with lengths scaled to the order of one. Joint ``slide``
    (0 .. 5), if any, is prismatic; ``turn`` (rad) is its constant angle theta, and its d is zero.
    """
    rows = np.array(table, dtype=float)
    rng = np.random.default_rng(6)
    q = rng.uniform(-np.pi, np.pi, (POSES, 6))
    c, s = np.cos(rows[:, 0]), np.sin(rows[:, 0])
    links = constant_links(np.column_stack([c, s, rows[:, 1:]]), slide, (np.cos(turn), np.sin(turn)))
    pose = np.broadcast_to(np.eye(4), (POSES, 4, 4))
    for k in range(6):
        pose = pose @ (_tz(q[:, k]) if k == slide else _rz(q[:, k])) @ links[k]
    loop = [np.broadcast_to(link, (POSES, 4, 4)) for link in links]
    loop[5] = loop[5] @ inverse(pose)
    found = []
    for start in range(6):
        for direction in (1, -1):
            order = numbering(start, direction)
            place = None if slide is None else order.index(slide) - 2
            if place is not None and not 0 <= place <= 2:
                continue
            equations = pencil(numbered(loop, start, direction), place)
            for kept in range(3):
                shifted, other = (kept + 1) % 3, (kept + 2) % 3
                if place == kept:
                    continue
                if place == shifted:
                    shifted, other = other, shifted
                turned = np.moveaxis(equations, (2 + kept, 2 + shifted, 2 + other), (2, 3, 4))
                score, depth, pure = _judge(turned, direction * q[:, order[2 + kept]], slides=place is not None)
                if score < USABLE:
                    found.append(Elimination(start, direction, kept, shifted, other, score, depth, pure))
    found = [e for e in found if e.pure] or found
    return sorted(found, key=lambda e: (e.score, e.start, e.direction, e.kept))


def numbering(start: int, direction: int) -> list[int]:
    """The joints of the chain (0 .. 5) in the order of a labelling: from ``start`` on, ``direction`` is +1 or -1."""
    return [(start + direction * k) % 6 for k in range(6)]


def numbered(loop: Sequence[Array], start: int, direction: int) -> list[Array]:
    """The transforms E1 .. E6 of a labelling, shape (poses, 4, 4) each.

    ``loop`` are those of the chain itself, E1 .. E6 from its first joint on. With ``direction`` -1 the labelling runs
    backwards, and its joints turn by minus their angles.
    """
    order = numbering(start, direction)
    return [loop[i] if direction > 0 else inverse(loop[(i - 1) % 6]) for i in order]


def constant_links(rows: Array, slide: int | None, turn: tuple[float, float]) -> list[Array]:
    """The constant transforms behind the joints of a chain, shape (4, 4) each.

    ``rows`` is the DH table, shape (6, 4): cos alpha, sin alpha, a, d. Joint ``slide``, if any, is prismatic; ``turn``
    is the cosine and sine of its theta, and its d is zero.
    """
    links = [np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, d], [0, 0, 0, 1.0]]) for c, s, a, d in rows]
    if slide is not None:
        c, s = turn
        links[slide] = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]) @ links[slide]
    return links


def _judge(pencil: Array, angle: Array, *, slides: bool) -> tuple[float, float, bool]:
    """Score an elimination: (digits lost in a root, log10 of the relative size of the determinant, degree is 8).

    ``pencil`` has shape (poses, 6, 3, 3, 3) with the kept joint first, ``angle`` (poses,) holds the true kept angles in
    rad. The digits lost are the 0.9 quantile over the poses; (inf, -inf, False) where the elimination is not usable.
    Both numbers are rounded, so that rounding errors of a machine do not change the choice.
    """
    h = in_half_angles(pencil, slides=slides)
    turns = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    basis = np.stack([np.ones(SAMPLES), np.cos(turns), np.sin(turns)])
    m = np.einsum("nakj,as->nskj", h, basis)
    matrix = doubled(m)
    size = np.prod(np.linalg.norm(matrix, axis=-1), axis=-1).max(axis=-1)
    c = np.fft.fft(np.linalg.det(matrix), axis=-1) / SAMPLES
    k = np.arange(-8, 9)
    wave = np.exp(1j * k * angle[:, None])
    level = np.abs(c[:, k]).sum(axis=-1) + 1e-300
    spurious = np.abs(c[:, 9:17]).max(axis=-1) / level
    value = np.abs((c[:, k] * wave).sum(axis=-1)) / level
    slope = np.abs((1j * k * c[:, k] * wave).sum(axis=-1)) / level
    depth = float(np.median(level / size))
    remainder = max(float(np.median(spurious)), float(np.median(value)))
    if not (remainder < SPURIOUS and depth > 0):
        return np.inf, -np.inf, False
    lost = float(np.quantile(-np.log10(slope + 1e-300), 0.9) + max(0.0, 0.75 * np.log10(SHALLOW / depth)))
    digits = round(float(np.log10(depth)), 1)
    return round(lost, 2), digits, remainder < NOISE * shallowness(digits)


def in_half_angles(equations: Array, *, slides: bool) -> Array:
    """Write the six equations in powers of the half-angle tangents x, y of the eliminated joints.

    ``equations`` has shape (poses, 6, 3, 3, 3), its last axes for the kept, the shifted and the other joint; with
    ``slides`` the other one is prismatic, and y its displacement. Returns the coefficients, shape (poses, 3, 6, 9), of
    (1, cos, sin) of the kept angle times x^i y^j, i and j = 0, 1, 2, at index 3 i + j of the last axis.
    """
    powers = np.array([[1, 0, 1], [1, 0, -1], [0, 2, 0.0]])  # 1, cos, sin times 1 + x^2 -> powers of x = tan(angle/2)
    other = np.eye(3) if slides else powers
    h: Array = np.einsum("nkabc,bi,cj->nakij", equations, powers, other).reshape(len(equations), 3, 6, 9)
    return h


def doubled(m: Array) -> Array:
    """The 12 x 12 matrices of the six equations ``m``, shape (..., 6, 9), and of the same times x.

    At a solution the matrix is singular: it multiplies the vector of all x^i y^j, i = 0 .. 3, j = 0 .. 2, to zero.
    """
    matrix = np.zeros((*m.shape[:-2], 12, 12))
    matrix[..., :6, :9] = m
    matrix[..., 6:, 3:] = m
    return matrix


def shallowness(depth: float) -> float:
    """Factor by which the noise of the polynomial grows where its determinant is small.

    It is max(1, SHALLOW / 10^depth)^0.75, with ``depth`` as in :class:`Elimination`.
    """
    return float(max(1.0, SHALLOW / 10**depth) ** 0.75)


def pencil(e: Sequence[Array], slide: int | None) -> Array:
    """Coefficients of the six equations without joints 1 and 2, shape (poses, 6, 3, 3, 3).

    Axis 1 numbers the equations; the last three axes belong to the monomials (1, cos, sin) of joints 3, 4, 5, or
    (1, x, x^2) for the prismatic one of them, joint 3 + ``slide``.
    """
    line = np.zeros(15)
    line[[0, 7]] = 1.0  # the point 0 and the direction z
    near = (features(e[4]) @ line)[..., None]
    for joint, transform in ((2, e[3]), (1, e[2]), (0, e[1])):
        near = features(transform) @ (_stretch(near) if joint == slide else spread(near, 1.0))
    near = near.reshape(*near.shape[:2], 3, 3, 3).transpose(0, 1, 4, 3, 2)
    far = (features(inverse(e[5])) @ line)[..., None]
    far = spread(features(inverse(e[0])) @ spread(far, -1.0), -1.0)
    equations = near[:, 1:].copy()
    equations[..., 0, 0, 0] -= far[:, 1:, 0]
    rest = np.linalg.svd(far[:, 1:, 1:])[0][:, :, 8:]
    reduced: Array = np.einsum("nik,nixyz->nkxyz", rest, equations)
    return reduced


def spread(f: Array, sense: float) -> Array:
    """Rotate features about z by sense times an unknown angle: coefficients of 1, cos and sin of that angle.

    Maps columns (poses, 15, m) to (poses, 15, 3 m); the new monomial index varies fastest.
    """
    out = np.zeros((*f.shape, 3))
    out[..., 0] = f
    for x in (1, 5, 8, 12):
        out[:, x : x + 2, :, 0] = 0.0
        out[:, x : x + 2, :, 1] = f[:, x : x + 2]
        out[:, x, :, 2], out[:, x + 1, :, 2] = -sense * f[:, x + 1], sense * f[:, x]
    return out.reshape(*f.shape[:2], -1)


def _stretch(f: Array) -> Array:
    """Shift features along z by an unknown displacement x: coefficients of 1, x and x^2.

    Maps columns (poses, 15, m) to (poses, 15, 3 m); the new monomial index varies fastest.
    """
    out = np.zeros((*f.shape, 3))
    out[..., 0] = f
    linear, square = out[..., 1], out[..., 2]
    linear[:, 3], linear[:, 4], square[:, 4] = f[:, 0], 2 * f[:, 3], f[:, 0]
    linear[:, 8], linear[:, 9], linear[:, 11] = -f[:, 6], f[:, 5], f[:, 7]
    linear[:, 12], linear[:, 13], linear[:, 14] = 2 * f[:, 9], -2 * f[:, 8], -2 * f[:, 11]
    square[:, 12], square[:, 13], square[:, 14] = f[:, 5], f[:, 6], -f[:, 7]
    return out.reshape(*f.shape[:2], -1)


def features(e: Array) -> Array:
    """Matrices, shape (poses, 15, 15), by which rigid transforms ``e`` (poses, 4, 4) act on the features of a line."""
    R, t = e[:, :3, :3], e[:, :3, 3]
    out = np.zeros((len(e), 15, 15))
    tt, tR = (t * t).sum(axis=-1), np.einsum("ni,nij->nj", t, R)
    cross = np.zeros((len(e), 3, 3))
    for i in range(3):
        cross[:, i, (i + 1) % 3], cross[:, i, (i + 2) % 3] = -t[:, (i + 2) % 3], t[:, (i + 1) % 3]
    SR = cross @ R
    out[:, 0, 0] = out[:, 4, 4] = out[:, 11, 11] = 1.0
    for x in (1, 5, 8, 12):
        out[:, x : x + 3, x : x + 3] = R
    out[:, 1:4, 0], out[:, 4, 0], out[:, 4, 1:4] = t, tt, 2 * tR
    out[:, 8:11, 5:8], out[:, 11, 5:8] = SR, tR
    out[:, 12:15, 8:11], out[:, 12:15, 11] = -2 * SR, -2 * t
    out[:, 12:15, 5:8] = tt[:, None, None] * R - 2 * t[:, :, None] * tR[:, None, :]
    return out


def inverse(pose: Array) -> Array:
    """Invert rigid transforms, shape (poses, 4, 4)."""
    out = np.zeros_like(pose)
    out[:, :3, :3] = np.swapaxes(pose[:, :3, :3], 1, 2)
    out[:, :3, 3] = -(out[:, :3, :3] @ pose[:, :3, 3, None])[..., 0]
    out[:, 3, 3] = 1.0
    return out


def _rz(angle: Array) -> Array:
    out = np.zeros((len(angle), 4, 4))
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0] = np.sin(angle)
    out[:, 0, 1] = -out[:, 1, 0]
    out[:, 2, 2] = out[:, 3, 3] = 1.0
    return out


def _tz(x: Array) -> Array:
    out = np.tile(np.eye(4), (len(x), 1, 1))
    out[:, 2, 3] = x
    return out
