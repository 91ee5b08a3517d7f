"""Closed-loop recordings prepared for simulation, on the finer of two time grids: recording and controller samples."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.closed_loop.controller import LoopController
from rrrgen.lab.closed_loop.fine_grid import FineGrid
from rrrgen.lab.data.mapping import Signal
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.repair import missing_number
from rrrgen.lab.data.uniform_stream import CHUNK, Part, join_parts
from rrrgen.lab.identify.observations import Recording, reconstruct

RATE_TOLERANCE = 0.01  # relative difference from a whole ratio of the two sampling periods
SHORTEST = 20  # samples after the warm-up
NEEDED: tuple[Signal, ...] = ("reference", "reference_velocity")
"""Inputs that a recording must have where its controller uses them; a missing feed-forward torque counts as zero."""
BOUND = 3.0  # times the range of the motion: a simulated loop farther than this from its reference has diverged


@dataclass(frozen=True, eq=False)
class LoopRecording:
    """One uninterrupted stretch of a recording: N samples of n joints with the grid ``period`` (s).

    Signals are (N, n), in SI units at the joints; ``valid`` marks usable torques. The controller runs at every
    ``every``-th sample; every ``stride``-th sample was recorded, and those between are interpolated. ``delay``, from
    encoder to torque, is in samples; ``records`` says which torque was stored. The first ``warm`` samples are a
    warm-up, in which only the controller runs; the simulation then starts at the positions and speeds ``start`` (2n,).
    ``span`` is the time range (s) of the whole recording. ``lacks_feedforward`` tells that the controller uses a
    feed-forward torque that was not recorded and is taken as zero.
    """

    t: Array
    q: Array
    tau: Array
    valid: NDArray[np.bool_]
    reference: Array
    reference_velocity: Array
    feedforward: Array
    period: float
    every: int
    stride: int
    delay: float
    records: str
    warm: int
    start: Array
    span: tuple[float, float]
    lacks_feedforward: bool = False

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def bounds(self) -> Array:
        """Distances (n,) from the reference, rad or m, beyond which a simulated loop counts as diverged."""
        span = np.ptp(self.q, axis=0) + np.ptp(self.reference, axis=0)
        error = np.max(np.abs(self.q - self.reference), axis=0)
        return np.asarray(BOUND * (np.maximum(span, 0.05 * float(np.max(span))) + error))

    @cached_property
    def scored(self) -> NDArray[np.bool_]:
        """Mask (N, n) of the samples to score: recorded (not interpolated), valid torque, after the warm-up."""
        mask = self.valid.copy()
        mask[: self.warm] = False
        samples = np.zeros(len(self), bool)
        samples[:: self.stride] = True
        return np.asarray(mask & samples[:, None])

    def apply_delay(self, values: Array) -> Array:
        """Controller outputs ``values`` (N, n) shifted by the delay: those that act at the start of each sample."""
        late = int(np.ceil(self.delay - 1e-9))
        return values if late == 0 else np.concatenate([np.repeat(values[:1], late, axis=0), values[:-late]])

    def as_recorded(self, command: Array) -> Array:
        """Convert commanded torques (N, n) to the torques that the recording would store for them."""
        if self.records == "command":
            return command
        applied = self.apply_delay(command)
        if self.records == "applied":
            return applied
        return np.asarray(0.5 * (applied + np.concatenate([applied[:1], applied[:-1]])))


def loop_recordings(
    recordings: Sequence[Recording], controller: LoopController, processing: Processing
) -> tuple[LoopRecording, ...]:
    """Prepare all sufficiently long uninterrupted stretches of ``recordings`` for simulation with ``controller``.

    ``processing`` says how the positions and speeds at the start are reconstructed. Raises InputError for a recording
    without reference or torque, for joints other than those of the controller, and if neither sampling period is a
    whole multiple of the other.
    """
    long_stretches = []
    for recording in recordings:
        require_joints(controller, recording.joints)
        stretches: dict[int, list[Part]] = {}
        for part in recording.parts():
            stretches.setdefault(part.segment, []).append(part)
        for parts in stretches.values():
            stretch = _stretch(join_parts(parts), recording, controller, processing)
            if stretch is not None:
                long_stretches.append(stretch)
    if not long_stretches:
        raise InputError("no uninterrupted stretch of the recording is long enough to simulate the loop")
    return tuple(long_stretches)


def _stretch(
    part: Part, recording: Recording, controller: LoopController, processing: Processing
) -> LoopRecording | None:
    if part.tau is None:
        raise InputError("the recording has no torques: the simulated loop could not be compared with it")
    require_inputs(controller, {name for name in NEEDED if getattr(part, name) is not None})
    every, stride = _ratio(controller.period, recording.period)
    reference = _finite_input(part, "reference", recording, controller, part.q)
    nothing = np.zeros_like(part.q)
    speed, feedforward = (
        _finite_input(part, name, recording, controller, nothing) for name in ("reference_velocity", "feedforward")
    )
    motion = reconstruct(part, processing)
    warm = min(controller.settling * every // stride + 1, len(part) // 4)
    if len(part) - warm < SHORTEST:
        return None
    grid = FineGrid(len(part), stride)
    return LoopRecording(
        t=grid.linear(part.t[:, None])[:, 0],
        q=grid.smooth(part.q),
        tau=grid.linear(part.tau),
        valid=grid.nearest(part.valid),
        reference=grid.smooth(reference),
        reference_velocity=grid.smooth(speed),
        feedforward=grid.smooth(feedforward),
        period=recording.period / stride,
        every=every,
        stride=stride,
        delay=controller.delay * every,
        records=controller.records,
        warm=warm * stride,
        start=np.concatenate([motion.q[warm], motion.dq[warm]]),
        span=recording.span,
        lacks_feedforward=part.feedforward is None and controller.uses("feedforward"),
    )


def _finite_input(
    part: Part, name: Signal, recording: Recording, controller: LoopController, substitute: Array
) -> Array:
    """The input ``name`` (N, n) of the controller in a ``part`` of a recording; ``substitute`` if it has none.

    Raises InputError if one of its values is no finite number; where the controller does not use the input, it is
    replaced.
    """
    values: Array | None = getattr(part, name)
    if values is None:
        return substitute
    gone = np.argwhere(~np.isfinite(values))
    if not len(gone):
        return values
    if not controller.uses(name):
        return substitute
    mapping = getattr(recording, "mapping", None)
    located = None if mapping is None else missing_number(mapping, name, recording.joints, CHUNK)
    sample, joint = gone[0]
    raise located or InputError(
        f"the {name} of joint {recording.joints[joint]} is no finite number at t = {part.t[sample]:.6g} s: mend or cut "
        "the recording"
    )


def require_joints(controller: LoopController, joints: Sequence[str]) -> None:
    """Raise InputError if the ``joints`` of a recording are not those of the ``controller`` in its order."""
    if tuple(joints) != controller.names:
        raise InputError(
            f"the controller has the joints {', '.join(controller.names)}, the recording {', '.join(joints)}: "
            "name them alike, in the same order"
        )


def require_inputs(controller: LoopController, recorded: Container[str]) -> None:
    """Raise InputError if ``controller`` uses one of the inputs NEEDED that is not in ``recorded``."""
    missing = [name for name in NEEDED if name not in recorded and controller.uses(name)]
    if missing:
        raise InputError(
            f"the controller uses '{missing[0]}', which the recording does not have: give the mapping file a column "
            f"'{missing[0]}' for every joint"
        )


def assumptions(recordings: Sequence[LoopRecording], data: str) -> list[str]:
    """Notes for the report on assumptions about ``recordings``: that a feed-forward torque not recorded is zero.

    ``data`` names the recordings in the notes; no notes if nothing is assumed.
    """
    if not any(recording.lacks_feedforward for recording in recordings):
        return []
    return [f"note: no feed-forward torque is recorded in {data}: it is taken as zero there"]


def _ratio(controller: float, recording: float) -> tuple[int, int]:
    """Grid steps per controller period and per recording period, from the two periods in s; one of them is 1."""
    ratio = controller / recording
    whole = max(1, round(ratio)), max(1, round(1.0 / ratio))
    if abs(ratio * whole[1] / whole[0] - 1.0) > RATE_TOLERANCE:
        raise InputError(
            f"the controller computes every {controller:.6g} s, the recording has a sample every {recording:.6g} s: "
            "one must be a whole multiple of the other"
        )
    return whole
