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
    replayed,
)
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.regression import least_squares
from rrrgen.lab.estimate.remainder import Remainder, remainder_notes, remainder_record
from rrrgen.lab.estimate.tsqr import Rows, factor_blocks
from rrrgen.lab.identify.bias import LIKE, BiasCheck, Paired, compare, position_difference
from rrrgen.lab.identify.figures import MOST_POINTS, TorqueCurves, plot_torque_curves
from rrrgen.lab.identify.friction_choice import FrictionFit
from rrrgen.lab.identify.identification import Identification, Options, refitted
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
    found: Identification,
    recordings: Sequence[LoopRecording],
    runs: Sequence[SimulatedLoop],
    joints: Sequence[str],
    options: Options,
) -> BiasCheck | None:
    """Compare the least-squares estimate ``found`` with the instrumental-variable estimate from simulated ``runs``.

    ``runs`` holds one simulated loop for each of ``recordings``. Returns None if the simulated motion is too far from
    the measured one to serve as an instrument.
    """
    assert found.regressor is not None
    assert found.parametrisation is not None
    far = max(
        position_difference(own.q[own.warm :], run.q[own.warm :]) for own, run in zip(recordings, runs, strict=True)
    )
    if far > LIKE:
        return None
    regressor, chosen = found.regressor, found.parametrisation
    maker = RowMaker(regressor, found.processing, len(regressor.columns), options.known, regressor.sliding)
    pairs: list[Paired] = []
    measured: list[Rows] = []
    for recording, run in zip(recordings, runs, strict=True):
        own = slice(recording.warm, None, recording.stride)
        logs = [_log(recording, q, own, joints) for q in (recording.q, run.q)]
        for a, b in zip(*(Observations((log,), maker) for log in logs), strict=True):
            fitted = found.split.fitted(a.t, *recording.span)
            use = a.use & b.use & fitted[:, None]
            pairs.append(Paired(a.W, b.W, a.tau, use))
            measured.append(Rows(a.t, a.W, a.tau, use, a.segment))
    factors = chosen.transform(factor_blocks(measured))
    x = least_squares(factors, chosen.structure.names, found.estimate.weights).x
    return compare(found, x, pairs)


def _log(recording: LoopRecording, q: Array, own: slice, joints: Sequence[str]) -> Log:
    period = recording.period * recording.stride
    t = recording.t[own]
    return Log(tuple(joints), t, q[own], recording.tau[own], period=period, valid=np.asarray(recording.valid[own]))


# ------------------------------------------------------------------------------------------------------------------
# Identification by closed-loop output error
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-closed-loop/1"
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
        found = [self.replay.line(joints), *self.notes]
        found += [] if self.bias is None else self.bias.lines()
        found += [score.line(joints) for score in (self.start, self.fit, self.held_out, self.test) if score is not None]
        return [*found, *(f"note: {note}" for note in self.held_out_notes)]

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
    found: Identification,
    recordings: Sequence[Recording],
    controller: LoopController,
    options: Options,
    progress: Tell | None = None,
    tests: Sequence[Recording] = (),
) -> ClosedLoopEstimate:
    """Refine ``found``, an identification from ``recordings``, by the output error of the loop with ``controller``.

    ``tests`` are recordings used for scoring only, not for the fit.

    ``options`` are those of the identification; ``progress`` is called with messages. Raises InputError if controller
    and recordings do not fit together, DerivationError if the simulated loop diverges at the initial parameters.
    """
    tell: Tell = progress or (lambda done, total, message: None)
    assert found.regressor is not None
    assert found.parametrisation is not None
    equations = LoopEquations(found.regressor)
    loop = CompiledLoop(equations, controller)
    own = loop_recordings(recordings, controller, found.processing)
    unseen = loop_recordings(tests, controller, found.processing) if tests else ()
    chosen = found.parametrisation
    parameters = Parameters(chosen.T, chosen.known, np.minimum(found.estimate.std, np.abs(found.estimate.x) + 1.0))
    started = found.theta if found.consistent is None else found.consistent.theta
    z = np.concatenate([chosen.contract(started), np.log(equations.shapes)])
    check = replayed(loop, own)
    use = [r.scored & found.split.fitted(r.t, *r.span)[:, None] for r in own]
    work = OutputErrorProblem(loop, parameters, own, use, options.jobs)
    try:
        fit = work.fit(z, tell)
    except DerivationError as error:
        raise DerivationError(f"{error}; {check.line(controller.names)}") from None
    friction = (
        None if found.friction is None else _shaped(found.friction, fit.z, work.covariance(fit), parameters.count)
    )
    if found.regressor.load:
        theta = np.where([c.kind in CARRIED for c in equations.columns], parameters.theta(fit.z)[: len(chosen.T)], 0.0)
        own_load = tuple(theta[: len(found.regressor.load)].tolist())
        found = replace(found, regressor=replace(found.regressor, load=own_load))
    blocks, held = _rows(found, own, fit, parameters.count)
    again = refitted(found, recordings, options, blocks, held, friction, progress)
    if len(fit.z) > parameters.count:
        again = _widened(again, work.spread_by_shapes(fit, parameters.count))
    delivered = again.theta if again.consistent is None else again.consistent.theta
    theta = np.concatenate([delivered, np.exp(fit.z[parameters.count :])])
    first = np.concatenate([started, equations.shapes])
    split, names = found.split, controller.names

    def fitted(r: LoopRecording) -> NDArray[np.bool_]:
        return split.fitted(r.t, *r.span)

    def scored(r: LoopRecording) -> NDArray[np.bool_]:
        return split.scored(r.t, *r.span)

    def whole(r: LoopRecording) -> NDArray[np.bool_]:
        return np.ones(len(r), bool)

    start = loop_score("in sample, before the fit", loop, first, own, fitted)[0]
    ended, runs = loop_score("in sample", loop, theta, own, fitted)
    out = loop_score("held out", loop, theta, own, scored)[0]
    assert ended is not None
    test, unseen_runs = loop_score("recordings not fitted", loop, theta, unseen, whole) if tests else (None, [])
    known = (runs, own, fitted)
    return ClosedLoopEstimate(
        identification=again,
        names=equations.names,
        theta=theta,
        replay=check,
        start=start,
        fit=ended,
        held_out=out,
        test=test,
        recordings=own,
        runs=tuple(runs),
        iterations=fit.iterations,
        bias=simulated_bias_check(found, own, runs, names, options),
        left=loop_remainders(runs, own, scored, names, known),
        left_in_test=loop_remainders(unseen_runs, unseen, whole, names, known),
        notes=(*assumptions(own, "the recordings that are fitted"), *assumptions(unseen, "the test recordings")),
    )


def _shaped(friction: FrictionFit, z: Array, covariance: Array, count: int) -> FrictionFit:
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


def _widened(found: Identification, factors: Array) -> Identification:
    """``found`` with standard deviations multiplied by ``factors`` (r,), at unchanged correlations."""
    grown = np.outer(factors, factors)
    return replace(
        found,
        estimate=replace(found.estimate, covariance=found.estimate.covariance * grown),
        delivered=replace(found.delivered, covariance=found.delivered.covariance * grown),
    )


def _rows(
    found: Identification, recordings: Sequence[LoopRecording], fit: LoopFit, count: int
) -> tuple[list[Rows], list[Rows]]:
    """Linearise the simulated loop about the fit: regression rows ``tau = W theta``, for fitting and for scoring.

    The friction shape parameters are fixed at their fitted values. ``tau`` is the recorded torque, corrected by the
    difference between the simulated torque and its linearisation.
    """
    chosen = found.parametrisation
    assert chosen is not None
    size = sum(len(r) for r in recordings) * recordings[0].q.shape[1] * len(chosen.T)
    every = max(1, int(np.ceil(size / MOST_NUMBERS)))
    x = fit.z[:count]
    blocks, held = [], []
    for number, (recording, run, J) in enumerate(zip(recordings, fit.runs, fit.sensitivities, strict=True)):
        at = slice(recording.warm, None, every * recording.stride)
        own = J[at, :, :count]
        W = np.zeros((*own.shape[:2], len(chosen.T)))
        W[..., list(chosen.free)] = own @ chosen.structure.G
        t, use = recording.t[at], recording.valid[at]
        tau = recording.tau[at] - run.tau[at] + own @ x + W @ chosen.known
        rows = Rows(t, W, tau, use, np.full(len(t), number, np.int64))
        blocks.append(rows.chosen(found.split.fitted(t, *recording.span)))
        held.append(rows.chosen(found.split.scored(t, *recording.span)))
    return blocks, held


# ------------------------------------------------------------------------------------------------------------------
# Figure that compares recorded torques with those of the simulated closed loop.
# ------------------------------------------------------------------------------------------------------------------


def plot_loop(found: ClosedLoopEstimate, joints: Sequence[str], units: Sequence[str]) -> Figure:
    """Plot recorded and simulated torques of all joints over time (s), with their difference.

    ``joints`` are the joint names, ``units`` the units of their torques.
    """
    pairs = list(zip(found.recordings, found.runs, strict=True))
    every = max(1, sum(map(len, found.recordings)) // MOST_POINTS)
    curves = TorqueCurves(
        np.concatenate([r.t[::every] for r, _ in pairs]),
        np.concatenate([r.tau[::every] for r, _ in pairs]),
        np.concatenate([run.tau[::every] for _, run in pairs]),
        np.concatenate([r.scored[::every] for r, _ in pairs]),
    )
    return plot_torque_curves(curves, list(joints), list(units))
