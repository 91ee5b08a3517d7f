"""Validation in closed loop: simulates a known controller with the robot of a file and scores it on recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError, option_name
from rrrgen.lab.closed_loop.controller import LoopController
from rrrgen.lab.closed_loop.loop import CompiledLoop, LoopEquations, SimulatedLoop
from rrrgen.lab.closed_loop.loop_recording import LoopRecording, assumptions, loop_recordings
from rrrgen.lab.closed_loop.output_error import divergence
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.remainder import Errors, Piece, Remainder, remainder_notes, remainder_record, remainders
from rrrgen.lab.identify.friction_columns import stated_laws
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.robot.model.drives import drive_terms

# ------------------------------------------------------------------------------------------------------------------
# Scores of a closed-loop model: errors of the simulated loop, and of its controller run on the measured motion.
# ------------------------------------------------------------------------------------------------------------------

GOOD_REPLAY = 0.02
"""Relative torque error of a replayed controller, averaged over :data:`SMOOTH` samples, up to which it counts as the
recorded one."""
SMOOTH = 20  # samples averaged: noise of the recorded torque averages out, errors of a wrong controller do not
SHIFTS = 3  # controller periods by which the replayed torque is shifted at most, to look for a better delay
TAPS = 6  # last samples of position and reference that an error of the replay may follow from
RANK = 1e-12  # singular values of these samples below this share of the largest are zero
FOLLOWS = 0.5  # share of an error, in squares, that follows from them above which the controller is another one
SMALLEST = 0.003  # relative torque error below which this does not matter
LOOP_ERRORS = "torque errors of the simulated loop"
CLEARLY = 0.5  # another delay is reported only if its error is below this fraction of the error at the stated delay


@dataclass(frozen=True)
class LoopScore:
    """Errors of a simulated loop on ``count`` torque values of the data called ``data``.

    ``relative_error`` is ``|tau - tau_sim| / |tau|`` over all joints, ``joint_relative`` (n,) the same for each joint.
    ``rms`` (n,) are the RMS torque errors in N m (N), ``position`` (n,) the RMS position errors in rad (m).
    """

    data: str
    count: int
    relative_error: float
    joint_relative: tuple[float, ...]
    rms: tuple[float, ...]
    position: tuple[float, ...]

    def line(self, joints: Sequence[str]) -> str:
        """The score as a line of text for the report; ``joints`` are the joint names."""
        percentages = ", ".join(
            f"{name} {100 * value:.3g} %" for name, value in zip(joints, self.joint_relative, strict=True)
        )
        apart = ", ".join(f"{value:.3g}" for value in self.position)
        joint = f" ({percentages})" if len(joints) > 1 else ""
        return (
            f"closed loop, simulated along the reference, {self.data}: relative torque error "
            f"{100 * self.relative_error:.3g} %{joint}; RMS position error {apart}"
        )


@dataclass(frozen=True)
class Replay:
    """Check of a controller description: its torques, computed from the measured motion, against the recorded ones.

    ``errors`` (n,) are the relative torque errors of the joints, ``smooth`` (n,) those of torques averaged over
    :data:`SMOOTH` samples to suppress noise. ``follows`` (n,) are the shares of the squared errors that are linear in
    the last positions and references: noise of the torque is not, the error of a wrong difference or filter is.
    ``delay`` is a delay, in controller periods, that fits clearly better than the stated one; None if there is none.
    """

    errors: tuple[float, ...]
    smooth: tuple[float, ...]
    follows: tuple[float, ...]
    delay: float | None = None

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Numbers (from 0) of the joints whose error follows from the last samples."""
        pairs = enumerate(zip(self.errors, self.follows, strict=True))
        return tuple(j for j, (error, share) in pairs if error > SMALLEST and share > FOLLOWS)

    def line(self, joints: Sequence[str]) -> str:
        """The result of the check as a line of text for the report; ``joints`` are the joint names."""
        percentages = ", ".join(f"{name} {100 * error:.3g} %" for name, error in zip(joints, self.errors, strict=True))
        text = f"controller computed from the measured motion: relative torque error {percentages}"
        if max(self.smooth) <= GOOD_REPLAY and not self.doubtful:
            return text
        text = f"warning: {text}; it is not quite the one that was recorded"
        if self.delay is not None:
            return f"{text}: a delay of {self.delay:g} periods fits better"
        if not self.doubtful:
            return text
        share = max(self.follows[j] for j in self.doubtful)
        return (
            f"{text}: {100 * share:.0f} % of the error follows from the last samples of position and reference, so "
            "look at differences, averages, filters, gains and the delay"
        )


def replay_controller(loop: CompiledLoop, recordings: Sequence[LoopRecording]) -> Replay:
    """Run the controller of ``loop`` on the measured motion and compare its torques with the recorded ones."""
    controller = loop.controller
    squares: dict[int, Array] = {}
    n = loop.equations.n
    size, slow, left, whole = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for recording in recordings:
        tau, use = loop.replay(recording).tau, recording.scored
        size += np.sum(np.where(use, recording.tau, 0.0) ** 2, axis=0)
        slow += SMOOTH * np.sum(_block_means(np.where(use, recording.tau - tau, 0.0)) ** 2, axis=0)
        unexplained, squared = _unexplained_squares(recording, recording.tau - tau)
        left, whole = left + unexplained, whole + squared
        for shift in range(-SHIFTS, SHIFTS + 1):
            moved = np.roll(tau, shift * recording.every, axis=0)
            moved = np.where(use, recording.tau - moved, 0.0)[SHIFTS * recording.every : -SHIFTS * recording.every]
            squares[shift] = squares.get(shift, 0.0) + np.sum(moved**2, axis=0)
    errors = {shift: np.sqrt(total / np.maximum(size, 1e-300)) for shift, total in squares.items()}
    best = min(errors, key=lambda shift: float(np.sum(errors[shift] ** 2)))
    stated_errors = tuple(float(value) for value in errors[0])
    better = best and float(np.max(errors[best])) < CLEARLY * max(stated_errors)
    smooth = tuple(float(value) for value in np.sqrt(slow / np.maximum(size, 1e-300)))
    follows = tuple(float(value) for value in 1.0 - left / np.maximum(whole, 1e-300))
    delay = controller.delay + best if better and controller.delay + best >= 0.0 else None
    return Replay(stated_errors, smooth, follows if np.any(whole) else (0.0,) * n, delay)


def _unexplained_squares(recording: LoopRecording, error: Array) -> tuple[Array, Array]:
    """Squared ``error`` (N, n) of each joint that is not linear in its last samples, and the whole, (n,) each.

    Both are zero for a recording with a lower rate than its controller, whose positions are interpolated.
    """
    n = error.shape[1]
    left, whole = np.zeros(n), np.zeros(n)
    # one sample newer than the stated delay allows, where there is one
    newest = max(0, int(np.ceil(recording.delay)) - recording.every)
    at = np.arange(recording.warm + newest + TAPS * recording.every, len(recording), recording.every)
    if recording.stride > 1 or len(at) < 10 * TAPS:
        return left, whole
    for j in range(n):
        signals = [recording.reference[:, j] - recording.q[:, j], recording.reference[:, j]]
        if np.any(recording.reference_velocity):
            signals.append(recording.reference_velocity[:, j])
        lags = [signal[at - newest - k * recording.every] for signal in signals for k in range(TAPS)]
        use = recording.scored[at, j]
        A = np.column_stack([np.ones(len(at)), *lags])[use]
        e = error[at, j][use]
        e = e - np.mean(e) if len(e) else e
        left[j] = np.sum(solve(A, e, RANK).residual(e) ** 2)
        whole[j] = np.sum(e**2)
    return left, whole


def _block_means(values: Array) -> Array:
    """Means (N // SMOOTH, n) of ``values`` (N, n) over consecutive blocks of SMOOTH samples."""
    count = len(values) // SMOOTH
    return np.asarray(values[: count * SMOOTH].reshape(count, SMOOTH, -1).mean(axis=1))


def loop_score(
    data: str,
    loop: CompiledLoop,
    theta: Array,
    recordings: Sequence[LoopRecording],
    chosen: Callable[[LoopRecording], NDArray[np.bool_]],
) -> tuple[LoopScore | None, list[SimulatedLoop]]:
    """Simulate ``recordings`` with the parameters ``theta`` and score them; returns the score and all simulated runs.

    ``chosen`` gives the mask (N,) of the samples to score in a recording, ``data`` the name of this selection in
    reports. The score is None if no sample is chosen. Raises DerivationError if the simulated loop diverges.
    """
    n = loop.equations.n
    count, squares, size, apart = 0, np.zeros(n), np.zeros(n), np.zeros(n)
    runs = []
    for recording in recordings:
        run = loop.run(theta, recording)
        if run.diverged is not None:
            raise DerivationError(divergence(run, recording))
        use = recording.scored & chosen(recording)[:, None]
        count += int(np.sum(use))
        squares += np.sum(np.where(use, recording.tau - run.tau, 0.0) ** 2, axis=0)
        size += np.sum(np.where(use, recording.tau, 0.0) ** 2, axis=0)
        apart += np.sum(np.where(use, recording.q - run.q, 0.0) ** 2, axis=0)
        runs.append(run)
    if not count:
        return None, runs
    rows = count / n
    return LoopScore(
        data,
        count,
        float(np.sqrt(np.sum(squares) / max(float(np.sum(size)), 1e-300))),
        tuple(float(v) for v in np.sqrt(squares / np.maximum(size, 1e-300))),
        tuple(float(v) for v in np.sqrt(squares / rows)),
        tuple(float(v) for v in np.sqrt(apart / rows)),
    ), runs


def loop_remainders(
    runs: Sequence[SimulatedLoop],
    recordings: Sequence[LoopRecording],
    chosen: Callable[[LoopRecording], NDArray[np.bool_]],
    joints: Sequence[str],
    fitted: tuple[Sequence[SimulatedLoop], Sequence[LoopRecording], Callable[[LoopRecording], NDArray[np.bool_]]]
    | None = None,
) -> tuple[Remainder, ...]:
    """What noise does not explain in the torques of simulated ``runs``, for each of the ``joints``.

    ``chosen`` gives the mask (N,) of the samples of a recording that were not fitted. ``fitted`` are the runs,
    recordings and masks of the samples that were fitted, None where they are not known.
    """
    before = None if fitted is None else Errors.of(_loop_pieces(*fitted))
    return remainders(Errors.of(_loop_pieces(runs, recordings, chosen)), before, joints)


def _loop_pieces(
    runs: Sequence[SimulatedLoop],
    recordings: Sequence[LoopRecording],
    chosen: Callable[[LoopRecording], NDArray[np.bool_]],
) -> Iterator[Piece]:
    for number, (run, recording) in enumerate(zip(runs, recordings, strict=True)):
        at = slice(None, None, recording.stride)
        use = (recording.scored & chosen(recording)[:, None])[at]
        errors = np.where(use, (recording.tau - run.tau)[at], np.nan)
        yield Piece(recording.t[at], recording.tau[at], errors, np.full(len(errors), number, np.int64))


def as_json(score: LoopScore | None) -> dict[str, Any] | None:
    """Convert a score to plain data for JSON; None stays None."""
    return None if score is None else dict(vars(score))


# ------------------------------------------------------------------------------------------------------------------
# Validation in closed loop
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ClosedLoopValidation:
    """Result of a validation in closed loop.

    ``replay`` compares the controller's torques, computed from the measured motion, with the recorded ones; ``score``
    holds the errors of the simulated loop. ``notes`` are sentences on what was assumed, ``left`` is what noise does not
    explain in the torques of the loop.
    """

    replay: Replay
    score: LoopScore
    notes: tuple[str, ...] = ()
    left: tuple[Remainder, ...] = ()

    def lines(self, joints: Sequence[str]) -> list[str]:
        """Lines of text for the report: the check of the controller and the score of the loop."""
        left = remainder_notes(self.left, LOOP_ERRORS)
        return [self.replay.line(joints), *self.notes, self.score.line(joints), *(f"note: {note}" for note in left)]

    def failures(self, relative_error: float) -> tuple[str, ...]:
        """Sentence that the relative torque error exceeds the limit ``relative_error``; empty if it does not."""
        error = self.score.relative_error
        if error <= relative_error:
            return ()
        return (f"relative error of the simulated loop {100 * error:.3g} % exceeds {100 * relative_error:.3g} %",)

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: the check of the controller and the score of the loop."""
        return {
            "controller_error": list(self.replay.errors),
            "score": as_json(self.score),
            "held_out_notes": list(remainder_notes(self.left, LOOP_ERRORS)),
            "held_out_remainder": remainder_record(self.left),
        }


def stated_equations(model: Any) -> tuple[LoopEquations, Array]:
    """Equations of motion of a compiled robot ``model`` and their parameters theta (p,) from its robot file, SI units.

    The file must state link inertias.
    """
    spec = model.spec
    surfaces = tuple(surface for surface, _ in stated_laws(spec))
    equations = LoopEquations(FullRegressor(model, DriveTerms.of_spec(spec), surfaces))
    known = dict(zip(model.base_parameter_names, np.asarray(model.beta, float).tolist(), strict=True))
    known |= {term.name: term.value for term in drive_terms(spec)}
    for surface, stated in stated_laws(spec):
        law = surface.definition
        names = (*(parameter.name for parameter in law.linear), *law.shapes)
        values = (*law.split(stated.values)[0], *surface.shapes)
        known |= {f"{name}{surface.owner}": value for name, value in zip(names, values, strict=True)}
    return equations, np.array([known[name] for name in equations.names])


def validate_loop(
    model: Any,
    controller: LoopController,
    recordings: Sequence[Recording],
    processing: Processing,
    split: Split | None = None,
) -> ClosedLoopValidation:
    """Simulate the loop of ``controller`` and the compiled ``model`` along the references of ``recordings``.

    ``processing`` says how the positions and speeds at the start are reconstructed; with a ``split`` only its held-out
    part is scored. Raises DerivationError if the simulated loop diverges, InputError if controller, model and
    recordings do not fit together.
    """
    equations, theta = stated_equations(model)
    loop = CompiledLoop(equations, controller)
    stretches = loop_recordings(recordings, controller, processing)

    def is_chosen(recording: LoopRecording) -> NDArray[np.bool_]:
        if split is None or split.kind == "none":
            return np.ones(len(recording), bool)
        return split.is_scored(recording.t, *recording.span)

    score, runs = loop_score(
        "all samples" if split is None or split.kind == "none" else "held out", loop, theta, stretches, is_chosen
    )
    if score is None:
        part = "" if split is None else f" ({split}): choose another {option_name('split')}"
        raise InputError(f"no sample is left to score the simulated loop{part}")
    left = loop_remainders(runs, stretches, is_chosen, controller.names)
    return ClosedLoopValidation(
        replay_controller(loop, stretches), score, tuple(assumptions(stretches, "the recordings")), left
    )
