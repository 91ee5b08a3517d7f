"""Rows of a separable least-squares problem: "fixed" columns, and friction columns that depend on shape parameters.

Friction is evaluated at every recorded sample, before the decimation filter: filtering the speed first would smooth the
changes of sign that determine the shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.decimation import Decimator
from rrrgen.lab.data.log_stream import Part, joined
from rrrgen.lab.identify.friction_columns import FrictionSurface, Sliding, along
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording, Regressor, RowMaker, Window, reconstruct

MOST_SAMPLES = 200_000
"""Samples from the beginning of the recordings on which shapes are tuned and laws compared."""
LOAD_BLOCK = 4000
"""Samples at which the load is computed at a time."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """One uninterrupted stretch of a recording: N recorded samples, and r instants after decimation.

    ``q``, ``dq``, ``ddq``, ``load`` (N, n) are motion and load torques at the samples, ``valid`` (N, n) marks valid
    torques, ``first`` is the index of the first sample. ``W`` (r, n, p) are the columns that do not depend on friction
    shapes, ``tau`` (r, n) the torques, ``use`` (r, n) marks rows with a valid torque, ``t`` (r,) are their instants, s.
    ``start`` and ``duration`` (s) are those of the whole recording.
    """

    q: Array
    dq: Array
    ddq: Array
    valid: NDArray[np.bool_]
    first: int
    t: Array
    W: Array
    tau: Array
    use: NDArray[np.bool_]
    start: float
    duration: float
    load: Array | None = None

    def columns(self, surface: FrictionSurface, decimate: Decimator) -> Array:
        """Columns (r, n, k) of the linear friction parameters of a joint or motor ``surface``, after decimation."""
        sliding = Sliding.of((surface,))
        s = None if sliding is None else sliding.states(self.q, self.dq, sliding.start())[:, 0]
        factors = surface.factors(self.dq, s, self.load)
        found = np.zeros((len(self.t), self.dq.shape[1], factors.shape[1]))
        every = decimate(factors, self.first) if self.valid.all() else None
        for i in surface.joints:
            filtered = every if every is not None else decimate(factors * self.valid[:, [i]], self.first)
            found[:, i] = surface.direction[i] * filtered
        return found


@dataclass(frozen=True, eq=False)
class Problem:
    """The rows of all stretches of the recordings, with their decimation filter."""

    stretches: tuple[Stretch, ...]
    decimate: Decimator

    @classmethod
    def of(cls, recordings: Sequence[Recording], maker: RowMaker, most: int = MOST_SAMPLES) -> Problem:
        """Build the problem from the first ``most`` samples of ``recordings``.

        ``maker`` evaluates the columns that do not depend on friction shapes.
        """
        found: list[Stretch] = []
        decimate = Decimator(maker.processing.decimate or 1)
        left = most
        for recording in recordings:
            start, duration = recording.span
            for part in _stretches(recording, left):
                rows = list(maker.rows(Window(part, 0, len(part))))
                motion = reconstruct(part, maker.processing)
                found.append(
                    Stretch(
                        motion.q,
                        motion.dq,
                        motion.ddq,
                        part.valid,
                        part.first,
                        np.concatenate([r.t for r in rows]),
                        np.concatenate([r.W for r in rows]),
                        np.concatenate([r.tau for r in rows]),
                        np.concatenate([r.use for r in rows]),
                        start,
                        duration,
                    )
                )
                left -= len(part)
        if not found:
            raise InputError("the recordings hold no samples to which friction laws could be fitted")
        return cls(tuple(found), decimate)

    def under_load(self, regressor: Regressor, theta: Array) -> Problem:
        """Copy of the problem whose friction depends on the load torques ``regressor(q, dq, ddq) theta``."""
        found = []
        for each in self.stretches:
            parts = range(0, len(each.q), LOAD_BLOCK)
            motions = [[x[k : k + LOAD_BLOCK] for x in (each.q, each.dq, each.ddq)] for k in parts]
            found.append(replace(each, load=np.concatenate([regressor(*motion) @ theta for motion in motions])))
        return replace(self, stretches=tuple(found))

    @property
    def load(self) -> Array:
        """The load (N, n) at all samples, zero if it is not known."""
        return np.concatenate([np.zeros_like(s.q) if s.load is None else s.load for s in self.stretches])

    @property
    def W(self) -> Array:
        """Regressor columns (r, n, p) that do not depend on friction shapes, over all stretches."""
        return np.concatenate([stretch.W for stretch in self.stretches])

    @property
    def tau(self) -> Array:
        """Measured torques (r, n), filtered, over all stretches."""
        return np.concatenate([stretch.tau for stretch in self.stretches])

    def fitted(self, split: Split) -> NDArray[np.bool_]:
        """Mask (r, n) of the rows that are fitted."""
        return self._use([split.fitted(s.t, s.start, s.duration) for s in self.stretches])

    def scored(self, split: Split) -> NDArray[np.bool_]:
        """Mask (r, n) of the rows that are held out."""
        return self._use([split.scored(s.t, s.start, s.duration) for s in self.stretches])

    def _use(self, masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
        return np.concatenate([s.use & mask[:, None] for s, mask in zip(self.stretches, masks, strict=True)])

    def speed(self, surface: FrictionSurface) -> float:
        """RMS sliding speed of a joint or motor ``surface``, rad/s (m/s)."""
        squares = [np.sum(along(surface.direction, s.dq) ** 2) for s in self.stretches]
        return float(np.sqrt(np.sum(squares) / sum(len(s.dq) for s in self.stretches)))

    def columns(self, surface: FrictionSurface) -> Array:
        """Columns (r, n, k) of the linear friction parameters of a joint or motor ``surface``, for its shapes."""
        return np.concatenate([s.columns(surface, self.decimate) for s in self.stretches])


def _stretches(recording: Recording, most: int) -> list[Part]:
    """The whole stretches of a recording, cut after ``most`` samples in all."""
    found: list[list[Part]] = []
    left = most
    for part in recording.parts():
        if left <= 0:
            break
        taken = part.sliced(0, min(len(part), left))
        left -= len(taken)
        if found and found[-1][-1].segment == taken.segment:
            found[-1].append(taken)
        else:
            found.append([taken])
    return [joined(parts) for parts in found if sum(map(len, parts)) > 1]
