"""Candidate solutions of a general chain of six joints, found as eigenvalues.

The equations are those of :mod:`rrrgen.ik.solutions.elimination`, in the same labellings as in the emitted C. There the
kept angle is a root of a determinant. Here the tangent of half of it is an eigenvalue, whose eigenvector gives the two
eliminated joints (Manocha and Canny 1994), so that the two backends find the roots by methods that share no code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.ik.geometry.chain import IDENTITY, Matrix, inverse, multiply, shift_along_z, turn_about_z
from rrrgen.ik.interpreter.candidates import CandidateRow, Query
from rrrgen.ik.interpreter.task import PATIENT, USUAL, Task
from rrrgen.ik.recording.float_builder import FREE, MULTIPLE, SEARCH, TOLERANCE, wrap
from rrrgen.ik.solutions.elimination import (
    LINE,
    PLANAR,
    HalfAngles,
    constant_links,
    in_half_angles,
    numbering,
    pencil,
    relabel_transforms,
    rotate_features,
    transform_features,
)
from rrrgen.ik.solutions.general_6r import passes, shifts, tables_of
from rrrgen.ik.tolerances import elimination

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan

ELIMINATION = elimination()

ORIGIN, ODD = atan2(0.96, 0.28), turn_about_z(IDENTITY, 0.28, 0.96)
"""Angles of the loop are counted from this direction (rad): at round angles the tangent of a half is then finite."""

AXIAL = (3, 4, 7, 10, 11, 14)
"""Features of a line that a rotation about z does not change, besides the constant one."""

VIEWS = 8
"""The circle of the kept angle is cut open at this many places in turn; the eigenvalues are computed where no root is
near the cut."""


@dataclass(frozen=True)
class Root:
    """A root of an elimination, or several that lie so close together that their null vectors may be mixed.

    ``trials`` are trial values of the joints 3, 4, 5 of the labelling: angles (rad) counted from :data:`ORIGIN`, or the
    displacement of a prismatic joint. ``count`` is the number of solutions that there must be: 0 where the kept angle
    is complex; of several roots, those with complex values of the other joints are left out.
    """

    trials: tuple[tuple[float, float, float], ...]
    count: int


class General6R:
    """Solver of the general chain of ``plan``, six joints besides a prescribed one, for the target of ``query``.

    ``task`` is what a solution must meet.
    """

    def __init__(self, plan: SolverPlan, task: Task, query: Query) -> None:
        self._tables, self._shifts = tables_of(plan.solving, plan.locked), shifts(plan.solving, plan.locked)
        self._task, self._query, self._locked = task, query, plan.locked
        self._links = constant_links(self._tables.rows, self._tables.slide, self._tables.turn)
        self._pose = tuple((*row[:3], row[3] / self._tables.length) for row in _inner_pose(plan, query))
        self._rows: list[CandidateRow] = []
        self.certain = False

    def candidates(self) -> list[CandidateRow]:
        """Find the solutions, refined; sets ``certain``, which tells that these are all.

        The eliminations are tried in the order of :func:`~rrrgen.ik.solutions.general_6r.passes`, until the number of
        solutions is the one that the roots of an elimination at the target ask for. A solution that is one of a
        continuum has the flag FREE, and the free joint has its reference value if a path leads there. Of what is
        nearly a continuum nothing tells that all are found.
        """
        here = -1
        self.certain = self._beyond()
        if self.certain:
            return []
        for roles, _ in passes(self._tables, "double"):
            total = self._complete(roles)
            # Only the roots at the target itself tell how many solutions it has. At a nudged target, roles[-1] > 0,
            # coinciding roots have separated: it serves to find the solutions that they hide, and is not counted.
            here = here if roles[-1] > 0 else total
            gains = [_smallest_gain(self._task, row.q) for row in self._rows]
            self.certain = here in (len(gains), self._count_solutions(gains))
            if self.certain:
                break
        for row in self._rows:
            if _smallest_gain(self._task, row.q) < ELIMINATION["double"]:
                free = self._set_free_joint(row)
                row.flags |= FREE if free else 0
                self.certain = self.certain and free is not None
        return self._rows

    def _set_free_joint(self, row: CandidateRow) -> bool | None:
        """Whether the singular solution ``row`` is one of a continuum, in which a joint can turn freely.

        If so it becomes the one with that joint at its reference, if a path of solutions leads there. None if it is
        nearly one, so that the target hardly tells where on it the solutions lie.
        """
        task, chain = self._task, self._task.chain
        free = np.abs(np.linalg.svd(_moving(task, row.q))[2][-1])
        j = [k for k in range(chain.n) if k != self._locked][int(np.argmax(free))]

        def move_joint(q: Sequence[float], by: float, left: str = "followed") -> list[float] | None:
            x = [*q[:j], q[j] + by, *q[j + 1 :]]
            return task.reaches(x, ELIMINATION[left] ** 2, int(ELIMINATION["steps"]), frozenset({j}))

        small = TOLERANCE["turn"] * task.units[j]
        if move_joint(row.q, small) is None and move_joint(row.q, -small) is None:
            nearly = any(move_joint(row.q, by, "nearly") is not None for by in (small, -small))
            return None if nearly else False
        steps, by = int(SEARCH["path_steps"]), self._query.reference[j] - row.q[j]
        q: list[float] | None = row.q
        for _ in range(steps):
            q = None if q is None else move_joint(q, (wrap(by) if chain.joints[j].revolute else by) / steps)
        row.q = row.q if q is None else q
        return True

    def _beyond(self) -> bool:
        """Whether the target is farther away than the arm can reach, so that it has no solution."""
        if self._tables.span is None:
            return False
        first, last, longest = self._tables.span
        x, y, z = (row[3] + last * row[2] for row in self._pose)
        return hypot(x, y, z - first) > longest

    def _count_solutions(self, gains: Sequence[float]) -> int:
        """Number of solutions, where a singular one counts twice unless its other half is listed as well."""
        total = len(gains)
        for k, gain in enumerate(gains):
            others = [i for i, other in enumerate(gains) if i != k and other < ELIMINATION["double"]]
            q = self._rows[k].q
            twins = any(self._task.apart(q, self._rows[i].q) < 0.5 * ELIMINATION["twins"] for i in others)
            total += gain < ELIMINATION["double"] and not twins
        return total

    def _complete(self, roles: Sequence[int]) -> int:
        """Add the solutions of one elimination; returns their number by its roots, -1 if that is odd."""
        start, direction, kept, shifted, other, motion = roles
        loop = [*self._links[:5], multiply(self._links[5], inverse(multiply(self._pose, _nudge(motion))))]
        order = numbering(start, direction)
        slide = None if self._tables.slide is None else order.index(self._tables.slide)
        e = [x if k == slide else multiply(ODD, x) for k, x in enumerate(relabel_transforms(loop, start, direction))]
        total = 0
        for root in _roots(e, (kept, shifted, other), slide):
            total += root.count
            for trial in root.trials:
                joints = _complete_joints(e, trial, slide)
                q = [direction * (x * self._tables.length if k == slide else x + ORIGIN) for k, x in enumerate(joints)]
                self._settle([q[order.index(k)] for k in range(6)], patient=motion > 0)
        return total if total % 2 == 0 else -1

    def _settle(self, angles: Sequence[float], *, patient: bool) -> None:
        """Refine a trial solution, given by the joints of the elimination, and add the result if it is new."""
        slide = self._tables.slide
        q = [x + y if k == slide else wrap(x + y) for k, (x, y) in enumerate(zip(angles, self._shifts, strict=True))]
        if self._locked is not None:
            q.insert(0 if self._locked == 0 else 6, self._query.given)
        q, error = self._task.refine(q, *(PATIENT if patient else USUAL))
        new = all(self._task.apart(row.q, q) >= ELIMINATION["same"] for row in self._rows)
        if new and error <= TOLERANCE["accept"]:
            self._rows.append(CandidateRow(q, 0, 0, error))


def label(task: Task, rows: Sequence[CandidateRow]) -> None:
    """Set the branch of solutions of a general chain to the sign of det J: 0 if positive, else 1; flag singular ones.

    J is the Jacobian by the joints that are not prescribed, with lengths over the reach.
    """
    for row in rows:
        row.branch = int(not np.linalg.det(_moving(task, row.q)) > 0.0)
        row.flags |= MULTIPLE if _smallest_gain(task, row.q) < ELIMINATION["singular"] else 0


def _moving(task: Task, q: Sequence[float]) -> Any:
    """The Jacobian by the joints that are not prescribed, a column for each joint, with lengths over the reach."""
    _, columns = task.error(q)
    return np.array([c for k, c in enumerate(columns) if task.prescribed is None or k != task.prescribed[0]]).T


def _smallest_gain(task: Task, q: Sequence[float]) -> float:
    """The smallest singular value of that Jacobian; 0 at a singular configuration."""
    return float(np.linalg.svd(_moving(task, q), compute_uv=False)[-1])


def _inner_pose(plan: SolverPlan, query: Query) -> Matrix:
    """Pose of the last of the six joints of the elimination relative to the first one, behind its constant link."""
    chain = plan.solving
    pose = multiply(multiply(inverse(chain.base), query.T), inverse(chain.tip))
    if plan.locked is not None:
        joint, link = chain.joints[plan.locked], chain.links[0 if plan.locked == 0 else -1].matrix()
        x = query.given + float(joint.offset)
        moved = turn_about_z(IDENTITY, cos(x), sin(x)) if joint.revolute else shift_along_z(IDENTITY, x)
        if plan.locked == 0:
            pose = multiply(inverse(multiply(moved, link)), pose)
        else:
            pose = multiply(pose, inverse(multiply(link, moved)))
    return pose


def _roots(e: Sequence[Any], roles: tuple[int, int, int], slide: int | None) -> list[Root]:
    """The roots of an elimination that are real, or nearly so, in the order of the kept angle.

    ``e`` are the transforms of its labelling, ``roles`` say which of its joints 3, 4, 5 (0, 1, 2) are kept, shifted and
    other, ``slide`` (2 .. 4) which of its joints is prismatic.
    """
    equations = pencil(e, None if slide is None else slide - 2)
    m = _dialytic_matrices(in_half_angles(equations, roles, slides=slide is not None))
    tangents, vectors = _eigenvalues(m / np.abs(m).max(axis=(0, 2))[None, :, None])
    with np.errstate(divide="ignore", invalid="ignore"):  # the elimination adds roots +-i, which are no angles
        angles, near = 2.0 * np.arctan(tangents), ELIMINATION["cluster"]
    tried = [k for k in range(len(angles)) if -near < angles[k].imag < ELIMINATION["complex"]]
    # Where roots coincide, the null vectors that come with them are any basis of one null space, and rounding turns a
    # double root into a pair of complex ones. So roots nearer than ``near`` are taken apart together by their span.
    clusters: list[list[int]] = []
    for k in sorted(tried, key=lambda k: float(angles[k].real)):
        if clusters and abs(angles[clusters[-1][-1]] - angles[k]) < near:
            clusters[-1].append(k)
        else:
            clusters.append([k])
    roots = []
    for cluster in clusters:
        pairs, unreal = _pairs(vectors[cluster], slides=slide is not None)
        kept = float(angles[cluster].real.mean())
        trials = [tuple(value for _, value in sorted(zip(roles, (kept, *pair), strict=True))) for pair in pairs]
        real = len(cluster) > 1 or abs(float(angles[cluster[0]].imag)) < ELIMINATION["real"]
        roots.append(Root(tuple(trials), len(cluster) - unreal if real else 0))  # type: ignore[arg-type]
    return roots


def _dialytic_matrices(h: HalfAngles) -> Any:
    """The 12 x 12 matrices of the six equations and of the same times x, shape (3, 12, 12), for 1, cos and sin.

    At a solution their sum is singular: it multiplies the vector of all x^i y^j, i = 0 .. 3, j = 0 .. 2, to zero.
    """
    matrix = np.zeros((3, 12, 12))
    matrix[:, :6, :9] = matrix[:, 6:, 3:] = h
    return matrix


def _pairs(vectors: Any, *, slides: bool) -> tuple[list[tuple[float, float]], int]:
    """Pairs of the shifted and the other joint from the null vectors, shape (k, 12), of roots close to each other.

    Returns them, and the number of complex ones, as far as both maps below agree on them.

    An entry 3 i + j of a null vector is x^i y^j, with x and y the tangents of the half angles; y is a displacement if
    the other joint ``slides``. Several vectors may be mixed: in their span those of that form are the eigenvectors of
    the map by which a factor x, or y, multiplies them, or of a weighted sum of both maps.
    """
    unreal = 0
    trials = [(vector / vector[np.abs(vector).argmax()]).real for vector in vectors]
    if len(vectors) > 1:
        left, size, _ = np.linalg.svd(np.concatenate([vectors.real, vectors.imag]).T)
        span = left[:, : max(1, min(len(vectors), int((size > ELIMINATION["mixed"] * size[0]).sum())))]
        # Multiplication matrices (Auzinger and Stetter 1988). That of x cannot part solutions that share x, nor that of
        # y those that share y; sums of both with weights in no simple ratio can. The one whose eigenvalues lie farthest
        # apart is used.
        maps = [np.linalg.lstsq(low, high, rcond=None)[0] for low, high in (_by_x(span), _by_y(span))]
        maps += [0.8 * maps[0] - 0.6 * maps[1], 0.47 * maps[0] + 0.88 * maps[1]]
        parts = [np.linalg.eig(matrix) for matrix in maps]
        unlike = [np.abs(values.imag) > ELIMINATION["unreal"] * (1.0 + np.abs(values.real)) for values, _ in parts[2:]]
        unreal = int(min(mask.sum() for mask in unlike))
        parted = ((_by_x(span), maps[0]), (_by_y(span), maps[1]))
        error = sum(float(np.abs(low @ x - high).max()) for (low, high), x in parted)
        unreal = unreal if error < ELIMINATION["mapped"] ** 0.5 else 0  # else the solutions are a continuum
        gaps = [min((abs(a - b) for k, a in enumerate(part[0]) for b in part[0][:k]), default=0.0) for part in parts]
        trials += list((span @ parts[int(np.argmax(gaps))][1]).real.T)
    pairs = []
    for trial in trials:
        x, y = _ratio(*_by_x(trial)), _ratio(*_by_y(trial))
        if max(x[2], y[2]) < ELIMINATION["shape"]:
            other = y[0] / (y[1] + ELIMINATION["tiny"]) if slides else 2.0 * atan2(y[0], y[1])
            pairs.append((2.0 * atan2(x[0], x[1]), other))
    return pairs, unreal


def _by_x(w: Any) -> tuple[Any, Any]:
    """The parts of null vectors ``w``, shape (12, ...), of which the second is x times the first."""
    return w[:9], w[3:]


def _by_y(w: Any) -> tuple[Any, Any]:
    """The parts of null vectors ``w``, shape (12, ...), of which the second is y times the first."""
    return np.delete(w, np.s_[2::3], axis=0), np.delete(w, np.s_[0::3], axis=0)


def _eigenvalues(m: Any) -> tuple[Any, Any]:
    """Tangents x of half the angles at which ``m[0] + m[1] cos + m[2] sin`` is singular, and the null vectors there.

    ``m`` has shape (3, k, k). Times 1 + x^2 the matrix is quadratic in x; the angle is counted from the direction, of
    :data:`VIEWS`, for which the matrix of x^2 is conditioned best. Returns the 2 k tangents and vectors, both complex.
    """
    # A quadratic eigenvalue problem as a linear one of twice the size, by the block companion matrix. An angle of pi
    # has no finite tangent of its half, and a root near it makes the leading matrix singular: hence the choice of the
    # view.
    turns = 2.0 * pi * np.arange(VIEWS) / VIEWS
    leads = m[0] - np.cos(turns)[:, None, None] * m[1] - np.sin(turns)[:, None, None] * m[2]
    best = int(np.argmin(np.linalg.cond(leads)))
    c, s = np.cos(turns[best]), np.sin(turns[best])
    zero, one = np.linalg.solve(leads[best], np.stack([m[0] + c * m[1] + s * m[2], 2.0 * (c * m[2] - s * m[1])]))
    k = len(zero)
    values, vectors = np.linalg.eig(np.block([[np.zeros((k, k)), np.eye(k)], [-zero, -one]]))
    upper = np.abs(values) < 1.0  # the vector stands there twice, times 1 and times x: take the larger one
    t = np.tan(0.5 * turns[best])
    with np.errstate(divide="ignore", invalid="ignore"):
        return (values + t) / (1.0 - values * t), np.where(upper, vectors[:k], vectors[k:]).T


def _ratio(low: Any, high: Any) -> tuple[float, float, float]:
    """Numbers (s, c) on the unit circle with ``high = (s / c) low`` by total least squares, and the error left.

    The error is 0 for parallel vectors, and at most 1.
    """
    difference, twice = float(low @ low - high @ high), 2.0 * float(low @ high)
    whole = float(low @ low + high @ high) + ELIMINATION["tiny"]
    half = 0.5 * atan2(twice, difference)
    return sin(half), cos(half), 1.0 - (difference**2 + twice**2) / whole**2


def _complete_joints(e: Sequence[Any], joints: Sequence[float], slide: int | None) -> list[float]:
    """All six joints of a labelling from its joints 3, 4, 5; ``slide`` (0 .. 5) is the prismatic one.

    Joint 2 follows by least squares from the features of axis 6 that joint 1 does not change, joint 1 from those that
    it rotates, and joint 6 from the rotation that is left.
    """
    inner = e[1]
    for k, x in enumerate(joints, 2):
        inner = multiply(shift_along_z(inner, x) if k == slide else turn_about_z(inner, cos(x), sin(x)), e[k])
    goal = inverse(e[5])
    near = np.array([transform_features(e[0], part) for part in rotate_features(transform_features(inner, LINE), 1.0)])
    far = np.array(transform_features(goal, LINE))
    axial = list(AXIAL)
    (c2, s2), *_ = np.linalg.lstsq(near[1:, axial].T, far[axial] - near[0, axial], rcond=None)
    second = atan2(s2, c2)
    now = np.array([1.0, cos(second), sin(second)]) @ near
    planar, across = list(PLANAR), [k + 1 for k in PLANAR]
    (a, b), (c, d) = (now[planar], now[across]), (far[planar], far[across])
    first = atan2(float(a @ d - b @ c), float(a @ c + b @ d))
    moved = multiply(
        turn_about_z(multiply(turn_about_z(IDENTITY, cos(first), sin(first)), e[0]), cos(second), sin(second)), inner
    )
    left = multiply(inverse(moved), goal)
    return [first, second, *joints, atan2(left[1][0] - left[0][1], left[0][0] + left[1][1])]


def _nudge(motion: int) -> Matrix:
    """A small motion of the target in no special direction, at which coinciding roots separate: 0 none, 2 back."""
    if motion == 0:
        return IDENTITY
    x, y, z = 4.8e-4, -6.0e-4, 6.4e-4
    half = 0.5 * np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)  # Cayley's formula: a rotation
    pose = tuple((*map(float, row), shift) for row, shift in zip(turn, (y, z, x), strict=True))
    return pose if motion == 1 else inverse(pose)
