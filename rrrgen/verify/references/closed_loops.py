"""Closed loops solved by Newton's method from many starts, over batches of states, as a reference.

Nothing here knows of dyads: unknown are all passive displacements at once, equations are the distances of the pins
across the axis of the loop, and of the solutions found that one is taken whose middle pin lies on the right side. Of
two displacements of a prismatic joint, the derivative of a distance tells the larger one.

Loops that the robot file starts near a posture are followed from there along a straight line in q, until they close at
every step.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.verify.references.numeric_robot import Array, NumericLoop, NumericRobot

if TYPE_CHECKING:
    from rrrgen.verify.references.newton_euler import NewtonEuler

ITERATIONS = 25
STARTS = 60
CLOSED = 1e-13
"""Distance (m) below which a pin is closed; one further step brings it to round-off."""

LONGEST_STEP = 1.0
"""Longest step of Newton's method, rad or m."""

PART = 0.05
"""Longest step of a drive along that line, rad or m."""

REMEMBERED = 64
"""Number of batches whose solutions are kept: every function of a reference asks for them again."""


class LoopSolver:
    """The loops of ``chain``; ``tree`` is the same robot without its pins, with a position for every passive row."""

    def __init__(self, chain: NumericRobot, tree: NewtonEuler) -> None:
        self._chain, self._tree = chain, tree
        self._n, self._passive = chain.n, [row for loop in chain.loops for row in loop.passive]
        self._known: dict[bytes, tuple[Array, NDArray[np.bool_]]] = {}
        self._pivots = [np.linalg.inv(after)[:3, 3] for _, after in chain.around_joints()]

    def solve(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Positions x (N, n + p) of all rows with a position of their own, and which states (N,) were solved."""
        key = q.tobytes()
        if key not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            self._known[key] = self._solve(q)
        x, solved = self._known[key]
        return x.copy(), solved.copy()

    @cached_property
    def _start(self) -> Array:
        """The positions x (n + p,) of all rows at the start, which the passive ones are given near."""
        chain = self._chain
        x = np.array([[*chain.home, *(v for loop in chain.loops for v in loop.start)]])
        for _ in range(4):
            self._refine(x)
        return np.asarray(x[0])

    def _follow(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Follow the loops in small steps from the start to the drive positions ``q`` (N, n).

        Returns the positions x (N, n + p) of all rows, rad or m, and a mask (N,) of the states that were reached
        without passing a dead point, that is in the assembly mode of the start.
        """
        home, x = self._start[: self._n], np.tile(self._start, (len(q), 1))
        parts = max(1, int(np.ceil(np.abs(q - home).max(initial=0.0) / PART)))
        solved = np.ones(len(q), dtype=bool)
        for part in range(1, parts + 1):
            x[solved, : self._n] = (home + (q - home) * (part / parts))[solved]
            trial = x[solved]
            closed = self._refine(trial)
            closed[closed] &= self._on_the_right_side(trial[closed])
            x[solved] = trial
            solved[solved] = closed
        x[:, : self._n] = q
        return x, solved

    def _solve(self, q: Array) -> tuple[Array, NDArray[np.bool_]]:
        if self._chain.loops[0].start:
            return self._follow(q)
        rng = np.random.default_rng(0)
        x = np.concatenate([q, np.zeros((len(q), len(self._passive)))], axis=1)
        waiting = np.arange(len(q))
        for _ in range(STARTS):
            trial = x[waiting]
            trial[:, self._n :] = rng.uniform(-np.pi, np.pi, (len(waiting), len(self._passive)))
            closed = self._refine(trial)
            closed[closed] &= self._on_the_right_side(trial[closed])
            x[waiting[closed]] = trial[closed]
            waiting = waiting[~closed]
            if not len(waiting):
                break
        solved = np.ones(len(q), dtype=bool)
        solved[waiting] = False
        return x, solved

    def _refine(self, x: Array) -> NDArray[np.bool_]:
        """Newton's method on the passive part of ``x``, in place; returns which states are closed."""
        closed, active = np.zeros(len(x), dtype=bool), np.arange(len(x))
        for _ in range(ITERATIONS):
            gap, J = self._equations(x[active])
            singular = np.abs(np.linalg.det(J[:, :, self._n :])) < 1e-12
            J[singular, :, self._n :] += np.eye(len(self._passive))
            step = np.linalg.solve(J[:, :, self._n :], gap[:, :, None])[:, :, 0]
            x[active, self._n :] -= np.clip(step, -LONGEST_STEP, LONGEST_STEP)
            met = np.abs(gap).max(axis=1) < CLOSED
            closed[active[met]] = True
            active = active[~met]
            if not len(active):
                break
        return closed

    def _equations(self, x: Array) -> tuple[Array, Array]:
        """The gaps (N, 2 k) of the pins of all k loops across their axes, and their Jacobian (N, 2 k, n + p)."""
        frames = self._tree.link_frames(x)
        gaps, rows = [], []
        for loop in self._chain.loops:
            across = self._across(loop, frames)
            ends = self._ends(loop, frames)
            J = [self._tree.point_jacobian(frames, x, *end)[:, :3] for end in ends]
            gaps.append(np.einsum("nij,nj->ni", across, ends[0][1] - ends[1][1]))
            rows.append(across @ (J[0] - J[1]))
        return np.concatenate(gaps, axis=1), np.concatenate(rows, axis=1)

    def _axis(self, row: int, frames: Array) -> Array:
        """The axis (N, 3) of a ``row``, about which it turns or along which it slides."""
        return np.asarray(frames[:, row, :3, :3] @ self._tree.axes[row][0 if self._chain.revolute[row] else 1])

    def _turning(self, loop: NumericLoop) -> int:
        """The first passive row of ``loop`` that turns."""
        return next(row for row in loop.passive if self._chain.revolute[row])

    def _across(self, loop: NumericLoop, frames: Array) -> Array:
        """Two orthogonal unit vectors (N, 2, 3) across the axis of a loop."""
        axis = self._axis(self._turning(loop), frames)
        aside = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
        first = np.cross(axis, aside)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return np.stack([first, np.cross(axis, first)], axis=1)

    def _pin(self, row: int, place: NDArray[Any], frames: Array) -> Array:
        T = self._chain.base if row < 0 else frames[:, row]
        points = T[..., :3, :3] @ place + T[..., :3, 3]
        return np.asarray(np.broadcast_to(points, (len(frames), 3)), dtype=np.float64)

    def _ends(self, loop: NumericLoop, frames: Array) -> tuple[tuple[int, Array], tuple[int, Array]]:
        """The row of each of the two links that a pin joins, and the place of the pin on it (N, 3) in the base frame.

        An offset along the axis of the pin does not matter: the second point is moved along it until it is level with
        the first.
        """
        (first, at), (second, there) = ((row, self._pin(row, place, frames)) for row, place in loop.pins)
        axis = self._axis(self._turning(loop), frames)
        along = np.einsum("ni,ni->n", axis, at - there)
        return (first, at), (second, there + along[:, None] * axis)

    def _in_link(self, row: int, point: Array, frames: Array) -> Array:
        """A point (N, 3) of the base frame in the frame of the link ``row``."""
        R, p = frames[:, row, :3, :3], frames[:, row, :3, 3]
        return np.asarray(np.einsum("nji,nj->ni", R, point - p))

    def _corners(self, loop: NumericLoop, frames: Array) -> tuple[Array, Array, Array]:
        """The outer pin of the first passive link, the pin between both, the outer pin of the second, (N, 3) each."""
        first, second = (self._pin(row, self._pivots[row], frames) for row in loop.passive)
        (_, closing), _ = self._ends(loop, frames)
        behind = loop.passive[0] in self._chain.path(loop.passive[1])
        return (first, second, closing) if behind else (first, closing, second)

    def sines(self, x: Array) -> Array:
        """The sines (N, k) of the angles between the two bars of every loop, positive on the right side.

        Of loops that are followed from a start, the volume of unit vectors along the columns of their Jacobian.
        """
        if self._chain.loops[0].start:
            side = np.sign(self._volumes(self._start[None]))
            return np.repeat(side * self._volumes(x)[:, None], len(self._chain.loops), axis=1)
        frames = self._tree.link_frames(x)
        sines = []
        for loop in self._chain.loops:
            if not all(self._chain.revolute[row] for row in loop.passive):
                sines.append(loop.assembly * self._beside_slide(loop, frames))
                continue
            a, b, c = (np.einsum("nij,nj->ni", self._across(loop, frames), p) for p in self._corners(loop, frames))
            one, other = b - a, c - b
            turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
            lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
            sines.append(-loop.assembly * turn / lengths)  # the middle pin on the left turns right
        return np.stack(sines, axis=1)

    def _volumes(self, x: Array) -> Array:
        """The volume (N,) that unit vectors along the columns of the Jacobian of all gaps by passive rows span."""
        J = self._equations(x)[1][:, :, self._n :]
        return np.asarray(np.linalg.det(J / np.linalg.norm(J, axis=1, keepdims=True)))

    def _beside_slide(self, loop: NumericLoop, frames: Array) -> Array:
        """The sine (N,) between the bar and a line across the slide, positive at the larger displacement.

        The bar goes from the joint that turns to the pin. Opened, the pin moves along the axis of the slide, or the
        joint does where it stands on the slide; at the larger displacement their distance then grows.
        """
        turning = self._turning(loop)
        slide = next(row for row in loop.passive if row != turning)
        (_, pin), _ = self._ends(loop, frames)
        between = self._across(loop, frames)
        bar = np.einsum("nij,nj->ni", between, pin - self._pin(turning, self._pivots[turning], frames))
        axis = np.einsum("nij,nj->ni", between, self._axis(slide, frames))
        axis = -axis if slide in self._chain.path(turning) else axis
        column = self._chain.n + [row for chain_loop in self._chain.loops for row in chain_loop.passive].index(slide)
        sense = np.sign(self._chain.coupling[slide, column])
        return np.asarray(sense * np.sum(bar * axis, axis=1) / np.linalg.norm(bar, axis=1))

    def _on_the_right_side(self, x: Array) -> NDArray[np.bool_]:
        return np.asarray(np.all(self.sines(x) > 0.0, axis=1))

    def passive_rates(self, x: Array) -> Array:
        """The matrix W (N, p, n) of the rates of the passive rows over those of q."""
        _, J = self._equations(x)
        return np.asarray(-np.linalg.solve(J[:, :, self._n :], J[:, :, : self._n]))

    def passive_accelerations(self, x: Array, dx: Array) -> Array:
        """The accelerations (N, p) of the passive rows for ddq = 0, from those of the pins of the open tree."""
        frames, (_, J) = self._tree.link_frames(x), self._equations(x)
        moved = []
        for loop in self._chain.loops:
            places = ((row, self._in_link(row, p, frames)) for row, p in self._ends(loop, frames))
            first, second = (self._tree.point_acceleration(x, dx, row, place) for row, place in places)
            moved.append(np.einsum("nij,nj->ni", self._across(loop, frames), first - second))
        return np.asarray(-np.linalg.solve(J[:, :, self._n :], np.concatenate(moved, axis=1)[:, :, None])[:, :, 0])
