"""Identification by closed-loop output error: refines an inverse-dynamics estimate with the simulated loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.closed_loop.controller import LoopController
from rrrgen.lab.closed_loop.loop import CompiledLoop, LoopEquations, SimulatedLoop
from rrrgen.lab.closed_loop.loop_recording import LoopRecording, assumptions, loop_recordings
from rrrgen.lab.closed_loop.output_error import LoopFit, OutputErrorProblem, Parameters
from rrrgen.lab.closed_loop.validation import (
    LOOP_ERRORS,
    LoopScore,
    Replay,
    as_json,
    loop_remainders,
    loop_score,
    replay_controller,
)
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.regression import least_squares
from rrrgen.lab.estimate.remainder import Remainder, remainder_notes, remainder_record
from rrrgen.lab.estimate.tsqr import Rows, factor_blocks
from rrrgen.lab.identify.bias import LIKE, BiasCheck, Paired, compare, position_difference
from rrrgen.lab.identify.figures import MOST_POINTS, TorqueCurves, plot_torque_curves
from rrrgen.lab.identify.friction_choice import FrictionFit
from rrrgen.lab.identify.identification import Identification, Options, refit
from rrrgen.lab.identify.observations import Observations, Recording, RowMaker

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# ------------------------------------------------------------------------------------------------------------------
# Instrumental variables from the simulated loop: a check whether noise in the motion biases least squares.
#
# The instruments are the regressor along the simulated motion, which follows the measured motion but is free of its
# noise (Janot, Vandanjon and Gautier 2014). Both motions pass through the same reconstruction and filters.
# ------------------------------------------------------------------------------------------------------------------


def simulated_bias_check(
    identification: Identification,
    recordings: Sequence[LoopRecording],
    runs: Sequence[SimulatedLoop],
    joints: Sequence[str],
    options: Options,
) -> BiasCheck | None:
    """Compare the estimate of ``identification`` with the instrumental-variable estimate from simulated ``runs``.

    ``runs`` holds one simulated loop for each of ``recordings``. Returns None if the simulated motion is too far from
    the measured one to serve as an instrument.
    """
    assert identification.regressor is not None
    assert identification.parametrisation is not None
    far = max(
        position_difference(recording.q[recording.warm :], run.q[recording.warm :])
        for recording, run in zip(recordings, runs, strict=True)
    )
    if far > LIKE:
        return None
    regressor, chosen = identification.regressor, identification.parametrisation
    maker = RowMaker(regressor, identification.processing, len(regressor.columns), options.known, regressor.sliding)
    pairs: list[Paired] = []
    measured: list[Rows] = []
    for recording, run in zip(recordings, runs, strict=True):
        samples = slice(recording.warm, None, recording.stride)
        logs = [_log(recording, q, samples, joints) for q in (recording.q, run.q)]
        for a, b in zip(*(Observations((log,), maker) for log in logs), strict=True):
            fitted = identification.split.is_fitted(a.t, *recording.span)
            use = a.use & b.use & fitted[:, None]
            pairs.append(Paired(a.W, b.W, a.tau, use))
            measured.append(Rows(a.t, a.W, a.tau, use, a.segment))
    factors = chosen.transform(factor_blocks(measured))
    x = least_squares(factors, chosen.structure.names, identification.estimate.weights).x
    return compare(identification, x, pairs)


def _log(recording: LoopRecording, q: Array, samples: slice, joints: Sequence[str]) -> Log:
    period = recording.period * recording.stride
    t = recording.t[samples]
    return Log(
        tuple(joints), t, q[samples], recording.tau[samples], period=period, valid=np.asarray(recording.valid[samples])
    )


# ------------------------------------------------------------------------------------------------------------------
# Identification by closed-loop output error
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-closed-loop/1"
FARTHER = 3.0
"""Ratio of the position errors after and before the fit from which the loop cannot be the recorded one."""
CARRIED = ("rigid", "inertia")  # kinds of columns whose torques load the friction
MOST_NUMBERS = 20_000_000
"""Largest number of sensitivity entries kept in memory; longer recordings are decimated to stay below it."""

Tell = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class ClosedLoopEstimate:
    """Estimate by closed-loop output error, with the scores of the resulting model.

    ``identification`` holds the parameters, their standard deviations and the physically consistent estimate.
    ``names`` and ``theta`` are the parameters of the model that is written to the robot file, friction shape
    parameters included; ``runs`` are its simulated loops along ``recordings``. ``replay`` is the check of the
    controller. ``start`` is the score of the inverse-dynamics estimate from which the fit started; ``fit``,
    ``held_out`` and ``test`` are those of the resulting model on the fitted samples, the samples left out, and separate
    recordings. ``bias`` compares inverse dynamics with instrumental variables from the simulated loop; None if the
    simulated motion is too far from the recorded one. ``notes`` are sentences on what was assumed. ``left`` is what
    noise does not explain in the torques of samples that were not fitted, ``left_in_test`` the same in separate
    recordings.
    """

    identification: Identification
    names: tuple[str, ...]
    theta: Array
    replay: Replay
    start: LoopScore | None
    fit: LoopScore
    held_out: LoopScore | None
    test: LoopScore | None
    recordings: tuple[LoopRecording, ...]
    runs: tuple[SimulatedLoop, ...]
    iterations: int
    bias: BiasCheck | None
    notes: tuple[str, ...] = ()
    left: tuple[Remainder, ...] = ()
    left_in_test: tuple[Remainder, ...] = ()

    @property
    def held_out_notes(self) -> tuple[str, ...]:
        """Sentences on what noise leaves unexplained in samples, and recordings, that were not fitted."""
        test = remainder_notes(self.left_in_test, f"{LOOP_ERRORS} in recordings not fitted")
        return (*remainder_notes(self.left, LOOP_ERRORS), *test)

    def lines(self, joints: Sequence[str]) -> list[str]:
        """Lines of text for the report: the check of the controller and the scores of the model."""
        lines = [self.replay.line(joints), *self.notes]
        lines += [] if self.bias is None else self.bias.lines()
        lines += [score.line(joints) for score in (self.start, self.fit, self.held_out, self.test) if score is not None]
        return [*lines, *(f"note: {note}" for note in self.held_out_notes)]

    def to_json(self) -> dict[str, Any]:
        """Plain data for ``closed_loop.json``: the check of the controller and the scores of the model."""
        return {
            "schema": SCHEMA,
            "controller_error": list(self.replay.errors),
            "better_delay": self.replay.delay,
            "inverse_dynamics": as_json(self.start),
            "fit": as_json(self.fit),
            "held_out": as_json(self.held_out),
            "test": as_json(self.test),
            "held_out_notes": list(self.held_out_notes),
            "held_out_remainder": remainder_record(self.left),
            "test_remainder": remainder_record(self.left_in_test),
            "iterations": self.iterations,
            "bias": None if self.bias is None else self.bias.to_json(),
            "parameters": dict(zip(self.names, self.theta.tolist(), strict=True)),
        }


def closed_loop_estimate(
    identification: Identification,
    recordings: Sequence[Recording],
    controller: LoopController,
    options: Options,
    progress: Tell | None = None,
    tests: Sequence[Recording] = (),
) -> ClosedLoopEstimate:
    """Refine the ``identification`` from ``recordings`` by the output error of the loop with ``controller``.

    ``tests`` are recordings used for scoring only, not for the fit.

    ``options`` are those of the identification; ``progress`` is called with messages. Raises InputError if controller
    and recordings do not fit together, DerivationError if the simulated loop diverges at the initial parameters.
    """
    tell: Tell = progress or (lambda done, total, message: None)
    assert identification.regressor is not None
    assert identification.parametrisation is not None
    equations = LoopEquations(identification.regressor)
    loop = CompiledLoop(equations, controller)
    stretches = loop_recordings(recordings, controller, identification.processing)
    unseen = loop_recordings(tests, controller, identification.processing) if tests else ()
    chosen = identification.parametrisation
    parameters = Parameters(
        chosen.T, chosen.known, np.minimum(identification.estimate.std, np.abs(identification.estimate.x) + 1.0)
    )
    started = identification.theta if identification.consistent is None else identification.consistent.theta
    z = np.concatenate([chosen.contract(started), np.log(equations.shapes)])
    check = replay_controller(loop, stretches)
    use = [r.scored & identification.split.is_fitted(r.t, *r.span)[:, None] for r in stretches]
    work = OutputErrorProblem(loop, parameters, stretches, use, options.jobs)
    try:
        fit = work.fit(z, tell)
    except DerivationError as error:
        raise DerivationError(f"{error}; {check.line(controller.names)}") from None
    friction = (
        None
        if identification.friction is None
        else _with_shapes(identification.friction, fit.z, work.covariance(fit), parameters.count)
    )
    if identification.regressor.load:
        theta = np.where([c.kind in CARRIED for c in equations.columns], parameters.theta(fit.z)[: len(chosen.T)], 0.0)
        fitted_load = tuple(theta[: len(identification.regressor.load)].tolist())
        identification = replace(identification, regressor=replace(identification.regressor, load=fitted_load))
    blocks, held = _rows(identification, stretches, fit, parameters.count)
    again = refit(identification, recordings, options, blocks, held, friction, progress)
    if len(fit.z) > parameters.count:
        again = _widen_covariances(again, work.spread_by_shapes(fit, parameters.count))
    delivered = again.theta if again.consistent is None else again.consistent.theta
    theta = np.concatenate([delivered, np.exp(fit.z[parameters.count :])])
    first = np.concatenate([started, equations.shapes])
    split, names = identification.split, controller.names

    def is_fitted(r: LoopRecording) -> NDArray[np.bool_]:
        return split.is_fitted(r.t, *r.span)

    def is_scored(r: LoopRecording) -> NDArray[np.bool_]:
        return split.is_scored(r.t, *r.span)

    def whole(r: LoopRecording) -> NDArray[np.bool_]:
        return np.ones(len(r), bool)

    start = loop_score("in sample, before the fit", loop, first, stretches, is_fitted)[0]
    ended, runs = loop_score("in sample", loop, theta, stretches, is_fitted)
    out = loop_score("held out", loop, theta, stretches, is_scored)[0]
    assert ended is not None
    test, unseen_runs = loop_score("recordings not fitted", loop, theta, unseen, whole) if tests else (None, [])
    known = (runs, stretches, is_fitted)
    return ClosedLoopEstimate(
        identification=again,
        names=equations.names,
        theta=theta,
        replay=check,
        start=start,
        fit=ended,
        held_out=out,
        test=test,
        recordings=stretches,
        runs=tuple(runs),
        iterations=fit.iterations,
        bias=simulated_bias_check(identification, stretches, runs, names, options),
        left=loop_remainders(runs, stretches, is_scored, names, known),
        left_in_test=loop_remainders(unseen_runs, unseen, whole, names, known),
        notes=(
            *assumptions(stretches, "the recordings that are fitted"),
            *assumptions(unseen, "the test recordings"),
            *position_notes(start, ended, names),
        ),
    )


def position_notes(start: LoopScore | None, fit: LoopScore, joints: Sequence[str]) -> list[str]:
    """Notes for the report on ``joints`` whose simulated motion lies much farther from the recorded one after the fit.

    ``start`` and ``fit`` are the scores before and after the fit of the torques. Position errors fall with the torque
    errors where the simulated controller acts on what the recorded one acted on.
    """
    notes = []
    for joint, before, after in zip(joints, start.position if start else (), fit.position, strict=start is not None):
        if after > FARTHER * before:
            notes.append(
                f"note: the fit of the torques made the position error of {joint} {after / max(before, 1e-300):.2g} "
                "times as large: reference, controller or delay are not quite those that were recorded"
            )
    return notes


def _with_shapes(friction: FrictionFit, z: Array, covariance: Array, count: int) -> FrictionFit:
    """Copy of ``friction`` with the fitted shape parameters of its laws and their standard deviations.

    ``z`` (k,) are the fitted unknowns, ``covariance`` (k, k) is their covariance. The first ``count`` are the
    parameters that the torque is linear in, the others the logarithms of the shape parameters.
    """
    logs = z[count:]
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))[count:]
    surfaces, std, k = [], [], 0
    for surface in friction.surfaces:
        count = len(surface.definition.shapes)
        surfaces.append(replace(surface, shapes=tuple(float(v) for v in np.exp(logs[k : k + count]))))
        std.append(tuple(float(v) for v in spread[k : k + count]))
        k += count
    return replace(friction, surfaces=tuple(surfaces), std=tuple(std))


def _widen_covariances(identification: Identification, factors: Array) -> Identification:
    """``identification`` with standard deviations multiplied by ``factors`` (r,), at unchanged correlations."""
    grown = np.outer(factors, factors)
    return replace(
        identification,
        estimate=replace(identification.estimate, covariance=identification.estimate.covariance * grown),
        delivered=replace(identification.delivered, covariance=identification.delivered.covariance * grown),
    )


def _rows(
    identification: Identification, recordings: Sequence[LoopRecording], fit: LoopFit, count: int
) -> tuple[list[Rows], list[Rows]]:
    """Linearise the simulated loop about the fit: regression rows ``tau = W theta``, for fitting and for scoring.

    The friction shape parameters are fixed at their fitted values. ``tau`` is the recorded torque, corrected by the
    difference between the simulated torque and its linearisation.
    """
    chosen = identification.parametrisation
    assert chosen is not None
    size = sum(len(r) for r in recordings) * recordings[0].q.shape[1] * len(chosen.T)
    every = max(1, int(np.ceil(size / MOST_NUMBERS)))
    x = fit.z[:count]
    blocks, held = [], []
    for number, (recording, run, J) in enumerate(zip(recordings, fit.runs, fit.sensitivities, strict=True)):
        at = slice(recording.warm, None, every * recording.stride)
        derivatives = J[at, :, :count]
        W = np.zeros((*derivatives.shape[:2], len(chosen.T)))
        W[..., list(chosen.free)] = derivatives @ chosen.structure.G
        t, use = recording.t[at], recording.valid[at]
        tau = recording.tau[at] - run.tau[at] + derivatives @ x + W @ chosen.known
        rows = Rows(t, W, tau, use, np.full(len(t), number, np.int64))
        blocks.append(rows.use_only(identification.split.is_fitted(t, *recording.span)))
        held.append(rows.use_only(identification.split.is_scored(t, *recording.span)))
    return blocks, held


# ------------------------------------------------------------------------------------------------------------------
# Figure that compares recorded torques with those of the simulated closed loop.
# ------------------------------------------------------------------------------------------------------------------


def plot_loop(estimate: ClosedLoopEstimate, joints: Sequence[str], units: Sequence[str]) -> Figure:
    """Plot recorded and simulated torques of all joints over time (s), with their difference.

    ``joints`` are the joint names, ``units`` the units of their torques.
    """
    pairs = list(zip(estimate.recordings, estimate.runs, strict=True))
    every = max(1, sum(map(len, estimate.recordings)) // MOST_POINTS)
    curves = TorqueCurves(
        np.concatenate([r.t[::every] for r, _ in pairs]),
        np.concatenate([r.tau[::every] for r, _ in pairs]),
        np.concatenate([run.tau[::every] for _, run in pairs]),
        np.concatenate([r.scored[::every] for r, _ in pairs]),
    )
    return plot_torque_curves(curves, list(joints), list(units))
