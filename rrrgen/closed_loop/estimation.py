"""Identification by closed-loop output error: from the inverse-dynamics estimate to that of the simulated loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.closed_loop.controller import LoopController
from rrrgen.closed_loop.equations import LoopEquations
from rrrgen.closed_loop.instruments import simulated_bias_check
from rrrgen.closed_loop.loop import CompiledLoop, Run
from rrrgen.closed_loop.loop_recording import LoopRecording, loop_recordings
from rrrgen.closed_loop.output_error import LoopFit, OutputError, Parameters
from rrrgen.closed_loop.scores import LoopScore, Replay, as_json, loop_score, replayed
from rrrgen.errors import DerivationError
from rrrgen.identify.bias_check import BiasCheck
from rrrgen.identify.estimation.observations import Recording
from rrrgen.identify.estimation.tsqr import Rows
from rrrgen.identify.friction_laws.choice import FrictionFit
from rrrgen.identify.identification import Identification, refitted
from rrrgen.identify.options import Options

SCHEMA = "rrrgen-closed-loop/1"
MOST_NUMBERS = 20_000_000
"""Numbers in the sensitivities that are kept as rows; of longer recordings every k-th sample is."""

Tell = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class ClosedLoopEstimate:
    """The estimate of the simulated loop, with the scores of the written model.

    ``identification`` holds parameters, deviations and the physically consistent estimate; ``start`` is the score of
    the inverse-dynamics estimate it started from. ``theta`` are the parameters of the
    written model with the shapes of its friction laws, ``runs`` its loops along ``recordings``. ``bias`` compares the
    inverse-dynamics estimate with instruments from the simulated loop, None where that is too far from the recording.
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
    runs: tuple[Run, ...]
    iterations: int
    bias: BiasCheck | None

    def lines(self, joints: Sequence[str]) -> list[str]:
        """Check of the controller and scores as text."""
        found = [self.replay.line(joints)]
        found += [] if self.bias is None else self.bias.lines()
        found += [score.line(joints) for score in (self.start, self.fit, self.held_out, self.test) if score is not None]
        return found

    def to_json(self) -> dict[str, Any]:
        """Check of the controller and scores as plain data for ``closed_loop.json``."""
        return {
            "schema": SCHEMA,
            "controller_error": list(self.replay.errors),
            "better_delay": self.replay.delay,
            "inverse_dynamics": as_json(self.start),
            "fit": as_json(self.fit),
            "held_out": as_json(self.held_out),
            "test": as_json(self.test),
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

    ``tests`` are recordings that are scored only.

    Raises InputError where controller and recordings do not fit each other, DerivationError where the simulated loop
    diverges from the start.
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
    work = OutputError(loop, parameters, own, use, options.jobs)
    try:
        fit = work.fit(z, tell)
    except DerivationError as error:
        raise DerivationError(f"{error}; {check.line(controller.names)}") from None
    friction = (
        None if found.friction is None else _shaped(found.friction, fit.z, work.covariance(fit), parameters.count)
    )
    blocks, held = _rows(found, own, fit, parameters.count)
    again = refitted(found, recordings, options, blocks, held, friction, progress)
    delivered = again.theta if again.consistent is None else again.consistent.theta
    theta = np.concatenate([delivered, np.exp(fit.z[parameters.count :])])
    first = np.concatenate([started, equations.shapes])
    split = found.split
    note = "in sample, before the fit"
    start = loop_score(note, loop, first, own, lambda r: split.fitted(r.t, *r.span))[0]
    ended, runs = loop_score("in sample", loop, theta, own, lambda r: split.fitted(r.t, *r.span))
    out = loop_score("held out", loop, theta, own, lambda r: split.scored(r.t, *r.span))[0]
    assert ended is not None
    test = (
        loop_score("recordings not fitted", loop, theta, unseen, lambda r: np.ones(len(r), bool))[0] if tests else None
    )
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
        bias=simulated_bias_check(found, own, runs, controller.names, options),
    )


def _shaped(friction: FrictionFit, z: Array, covariance: Array, count: int) -> FrictionFit:
    """The friction laws with the shapes of the fit, beyond ``count`` other parameters, and their deviations."""
    logs = z[count:]
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))[count:]
    surfaces, std, k = [], [], 0
    for surface in friction.surfaces:
        count = len(surface.definition.shapes)
        surfaces.append(replace(surface, shapes=tuple(float(v) for v in np.exp(logs[k : k + count]))))
        std.append(tuple(float(v) for v in spread[k : k + count]))
        k += count
    return replace(friction, surfaces=tuple(surfaces), std=tuple(std))


def _rows(
    found: Identification, recordings: Sequence[LoopRecording], fit: LoopFit, count: int
) -> tuple[list[Rows], list[Rows]]:
    """The loop linearised about the fit as rows ``tau = W theta`` of all columns, to fit and to score.

    The shapes of friction laws stay as fitted. ``tau`` is the recorded torque up to the small difference between the
    simulated torque and its linear part.
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
