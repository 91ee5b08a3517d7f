"""Turns recordings into rows of the estimation problem: motion reconstruction, regressor, filtering, decimation.

A row is the equation ``tau_j = W_j theta`` of one joint at one instant.
Rows are produced in blocks, so that a recording may exceed the memory. Every block is computed from a window that is
longer than it by the memory of the filters on both sides; the result does not depend on where the recording was cut.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import ON_BASE
from rrrgen.lab.data.preprocessing import Decimator, Processing, reconstruction_reach
from rrrgen.lab.data.reconstruction import Reconstruction, Reconstructor
from rrrgen.lab.data.repair import Repairs
from rrrgen.lab.data.uniform_stream import Part, join_parts
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify.friction_columns import Sliding

BLOCK_BYTES = 4_000_000  # size of the part of the regressor held in memory
SHORTEST_BLOCK = 500  # samples

Regressor = Callable[..., Array]
"""``W(q, dq, ddq)``, or ``W(q, dq, ddq, s)`` with the states s of friction."""
KnownTorque = Callable[[Reconstruction], Array]


class Recording(Protocol):
    """Interface of a recording: a :class:`~rrrgen.lab.data.recordings.Log` in memory, or a ``LogStream`` on disk."""

    @property
    def period(self) -> float: ...  # noqa: D102
    @property
    def joints(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def span(self) -> tuple[float, float]: ...  # noqa: D102
    @property
    def repairs(self) -> Repairs: ...  # noqa: D102
    def parts(self) -> Iterator[Part]: ...  # noqa: D102
    def samples(self) -> Iterator[Part]: ...  # noqa: D102
    def __len__(self) -> int: ...


SMALLEST_TORQUE = 1e-100  # N m (N): the squares of smaller torques, and of those beyond its reciprocal, are no numbers


def require_torques(recordings: Sequence[Recording]) -> None:
    """Raise :class:`InputError` for joints of which no torque was recorded: each is zero, missing or out of range.

    Reads the recordings until every joint has shown one torque. Those without any are left to :class:`RowMaker`, and
    those with the motion of a floating base, whose wrench stands for missing torques, to the choice of their rows.
    """
    joints = recordings[0].joints
    missing = np.ones(len(joints), bool)
    for recording in recordings:
        for part in recording.parts():
            if part.tau is None or joints[: len(ON_BASE)] == ON_BASE:
                return
            size = np.abs(np.where(part.valid, part.tau, np.nan))
            missing &= ~np.any((size > SMALLEST_TORQUE) & (size < 1.0 / SMALLEST_TORQUE), axis=0)
            if not missing.any():
                return
    names = ", ".join(name for name, gone in zip(joints, missing, strict=True) if gone)
    raise InputError(
        f"no torque of {names} was recorded: all are zero or no valid number; check columns and units of the torques"
    )


@dataclass(frozen=True)
class RowMaker:
    """Turns recorded samples into rows of the estimation problem.

    ``regressor(q, dq, ddq)`` gives W (N, n, p) with p = ``columns``; ``processing`` holds filters and lowest speeds.
    ``known`` is a torque as a function of the motion that is subtracted from the measured one first, such as friction
    that is already known, (14.19). ``sliding`` computes the friction states that the regressor needs, None if it needs
    none. Samples of a joint below the speeds ``slow`` (n,), rad/s (m/s), and ``around`` samples on either side of them,
    are left out before the filters, so that friction near rest does not reach the rows beside them; empty for none.
    So are the ends of every stretch, as far as the reach of the filter that reconstructs the motion.
    ``beside(motion, W)`` gives further columns (N, n, k), those of nuisance parameters, which stand after those of the
    regressor.
    """

    regressor: Regressor
    processing: Processing
    columns: int
    known: KnownTorque | None = None
    sliding: Sliding | None = None
    slow: tuple[float, ...] = ()
    beside: Callable[[Reconstruction, Array], Array] | None = None
    around: int = 0

    def memory(self, period: float) -> int:
        """Number of samples on either side that a row depends on, for a sampling ``period`` in s."""
        filters = _reconstruction_memory(self.processing, period) + Decimator(self.processing.decimate or 1).memory
        return filters + self.around

    def rows(self, window: Window) -> Iterator[Rows]:
        """Iterate over the rows of one window in blocks; raises InputError for a recording without torques."""
        part = window.part.align_torques()
        if part.tau is None:
            raise InputError("the recording has no torques: nothing can be estimated from it")
        motion = reconstruct(part, self.processing)
        tau = part.tau if self.known is None else part.tau - self.known(motion)
        inner = self.inner(window)
        part = replace(part, valid=part.valid & within(inner, len(part)))
        if self.slow:
            part = replace(part, valid=part.valid & self._moving(motion.dq))
        states = None if self.sliding is None else self._states(window, motion)
        decimate = Decimator(self.processing.decimate or 1)
        block = max(SHORTEST_BLOCK, decimate.memory, BLOCK_BYTES // (8 * part.q.shape[1] * self.columns))
        end = min(window.stop, inner.stop)
        for start in range(max(window.start, inner.start), end, block):
            stop = min(start + block, end)
            lo, hi = max(0, start - decimate.memory), min(len(part), stop + decimate.memory)
            kept = kept_of(decimate, part.first + lo, start - lo, stop - lo, hi - lo)
            given = () if states is None else (states[lo:hi],)
            rows = self._block(motion.window(lo, hi), tau[lo:hi], part.slice_samples(lo, hi), decimate, kept, given)
            yield replace(rows, segment=np.full(len(rows.t), window.segment, np.int64))

    def inner(self, window: Window) -> slice:
        """The samples of a window that are farther from the ends of their stretch than the reach of the filter.

        Nearer, it knows the motion on one side only, and takes a joint as one that does not accelerate.
        """
        reach, length = reconstruction_reach(self.processing, _period(window.part)), len(window.part)
        return slice(max(0, reach - window.part.first), length - reach if window.stop == length else length)

    def _moving(self, dq: Array) -> NDArray[np.bool_]:
        """Mask (N, n) of the samples at the speeds ``dq`` (N, n) that are neither slow nor around a slow one.

        A fast reversal passes the slow speeds between two samples: both count as slow.
        """
        from scipy.ndimage import minimum_filter1d

        slow = np.asarray(self.slow)
        moving = (np.abs(dq) >= slow).astype(np.uint8)
        reversed_ = (dq[1:] * dq[:-1] < 0.0) & (slow > 0.0)
        moving[1:][reversed_] = moving[:-1][reversed_] = 0
        return np.asarray(minimum_filter1d(moving, 2 * self.around + 1, axis=0) > 0)

    def _states(self, window: Window, motion: Reconstruction) -> Array:
        """Directions (N, m) of friction with a state along the N samples of the ``motion`` in a window.

        The window gives the directions at one of its samples; before that sample they are taken as constant.
        """
        assert self.sliding is not None
        lead, start = (0, self.sliding.start()) if window.state is None else window.state
        states = self.sliding.states(motion.q[lead:], motion.dq[lead:], start)
        return np.concatenate([np.broadcast_to(start, (lead, len(start))), states])

    def following(self, window: Window) -> tuple[int, Array] | None:
        """Friction state handed to the window after ``window`` in the same stretch: sample number and directions (m,).

        The state is taken at the end of ``window``, because the first filtered positions of the next one are inexact.
        """
        if self.sliding is None:
            return None
        states = self._states(window, reconstruct(window.part, self.processing))
        at = max(0, window.stop - Decimator(self.processing.decimate or 1).memory)
        return at - max(0, window.stop - self.memory(window.period)), states[at]

    def _block(
        self, motion: Reconstruction, tau: Array, part: Part, decimate: Decimator, kept: slice, given: tuple[Array, ...]
    ) -> Rows:
        """Compute the rows of one block: regressor and torque pass the same filter and are decimated.

        Samples that are not valid, such as slow ones, are set to zero on both sides of the equation. ``kept`` selects
        the rows of the block from the decimated samples; ``given`` holds the directions of friction with a state, if
        there are any.
        """
        first, valid = part.first, part.valid
        W = self.regressor(motion.q, motion.dq, motion.ddq, *given)
        if self.beside is not None:
            W = np.concatenate([W, self.beside(motion, W)], axis=-1)
        W = W * valid[..., None]
        sound = decimate(valid.astype(float), first)[kept] > 0.5
        speed = np.abs(decimate(motion.dq, first)[kept])
        use = sound & (speed >= np.asarray(self.processing.low_speed)) if self.processing.low_speed else sound
        t = decimate.times(part.t, first)[kept]
        return Rows(
            t=t,
            W=decimate(W, first)[kept],
            tau=decimate(tau * valid, first)[kept],
            use=use,
            segment=np.zeros(len(t), np.int64),
            valid=sound,
        )


def within(inner: slice, length: int) -> NDArray[np.bool_]:
    """Mask (length, 1) of the samples of the slice ``inner``."""
    mask = np.zeros((length, 1), bool)
    mask[inner] = True
    return mask


def kept_of(decimate: Decimator, first: int, start: int, stop: int, length: int) -> slice:
    """Slice of the decimated indices that fall in [start, stop) of a piece of ``length`` samples.

    ``first`` is the index in the recording of the first sample of the piece.
    """
    grid = np.arange(-first % decimate.factor, length, decimate.factor)
    return slice(int(np.searchsorted(grid, start)), int(np.searchsorted(grid, stop)))


@dataclass(frozen=True)
class Window:
    """A piece of a recording: rows are made of samples ``start`` to ``stop`` of ``part``; the others feed the filters.

    ``recording`` is the number of the recording, ``segment`` that of the uninterrupted stretch over all recordings.
    ``period`` is that of the sampling, s; ``state`` is a pair (sample of the part, states of friction there).
    """

    part: Part
    start: int
    stop: int
    recording: int = 0
    segment: int = 0
    period: float = 0.0
    state: tuple[int, Array] | None = None


@dataclass(frozen=True)
class Observations:
    """The rows of several recordings, one after the other; each iteration recomputes them block by block."""

    recordings: tuple[Recording, ...]
    maker: RowMaker

    def __iter__(self) -> Iterator[Rows]:
        for window in self.windows():
            yield from self.maker.rows(window)

    def windows(self) -> Iterator[Window]:
        """Iterate over the windows of all recordings."""
        segment = -1
        for number, recording in enumerate(self.recordings):
            last, state = -1, None  # of friction
            for window in windows(recording, self.maker.memory(recording.period)):
                if window.part.segment != last:
                    segment, last, state = segment + 1, window.part.segment, None
                numbered = replace(window, recording=number, segment=segment, period=recording.period, state=state)
                yield numbered
                if window.stop < len(window.part):
                    state = self.maker.following(numbered)


def windows(recording: Recording, memory: int) -> Iterator[Window]:
    """Split a recording into windows that overlap by ``memory`` samples on either side."""
    pending: Part | None = None
    done = 0  # index within its stretch of the first sample that is still to be delivered
    for part in recording.parts():
        if pending is not None and part.segment != pending.segment:
            if done < pending.first + len(pending):
                yield Window(pending, done - pending.first, len(pending))
            pending, done = None, 0
        pending = part if pending is None else join_parts([pending, part])
        ready = pending.first + len(pending) - memory
        # a step shorter than the overlap would cost more than it delivers
        if ready - done > memory:
            yield Window(pending, done - pending.first, ready - pending.first)
            done = ready
            pending = pending.slice_samples(max(0, done - memory - pending.first), len(pending))
    if pending is not None and done < pending.first + len(pending):
        yield Window(pending, done - pending.first, len(pending))


def reconstruct(part: Part, processing: Processing) -> Reconstruction:
    """Reconstruct the motion of one stretch by the method of ``processing``.

    Raises :class:`InputError` for the method ``logged`` if speeds and accelerations were not recorded.
    """
    if processing.method == "logged":
        if part.dq is None or part.ddq is None or not (np.isfinite(part.dq).all() and np.isfinite(part.ddq).all()):
            raise InputError("the recording has no speeds and accelerations; choose a method of reconstruction")
        return Reconstruction(part.t, part.q, part.dq, part.ddq, "as recorded")
    # uniform times from zero: the round-off of their differences must not depend on where the stretch begins
    method, period = processing.reconstructor(), _period(part)
    motion = replace(method(np.arange(len(part)) * period, part.coordinates(period)), t=part.t)
    return _with_base(motion, part) if part.floating else motion


def _with_base(motion: Reconstruction, part: Part) -> Reconstruction:
    """The reconstructed ``motion`` with the recorded orientation of the base and, if there are any, twist rates."""
    six = len(ON_BASE)
    q, ddq = motion.q.copy(), motion.ddq.copy()
    q[:, :six] = part.q[:, :six]
    if part.ddq is not None and np.isfinite(part.ddq[:, :six]).all():
        ddq[:, :six] = part.ddq[:, :six]
    return replace(motion, q=q, ddq=ddq)


def _period(part: Part) -> float:
    """Sampling period (s) of a part, rounded to ten digits to remove the round-off of the times."""
    return float(f"{(part.t[-1] - part.t[0]) / max(1, len(part) - 1):.9e}")


def _reconstruction_memory(processing: Processing, period: float) -> int:
    if processing.method == "logged":
        return 0
    method: Reconstructor = processing.reconstructor()
    return method.memory(period)
