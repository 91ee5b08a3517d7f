"""Validation in closed loop: simulates a known controller with the robot of a file and scores it on recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.closed_loop.controller import LoopController
from rrrgen.lab.closed_loop.equations import LoopEquations
from rrrgen.lab.closed_loop.loop import CompiledLoop
from rrrgen.lab.closed_loop.loop_recording import LoopRecording, assumptions, loop_recordings
from rrrgen.lab.closed_loop.scores import LoopScore, Replay, as_json, loop_score, replayed
from rrrgen.lab.data.processing import Processing
from rrrgen.lab.identify.estimated_terms import DriveTerms
from rrrgen.lab.identify.friction_columns import stated_laws
from rrrgen.lab.identify.full_regressor import FullRegressor
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Recording
from rrrgen.robot.model.drive_terms import drive_terms


@dataclass(frozen=True)
class ClosedLoopValidation:
    """Result of a validation in closed loop.

    ``replay`` compares the controller's torques, computed from the measured motion, with the recorded ones; ``score``
    holds the errors of the simulated loop. ``notes`` are sentences on what was assumed.
    """

    replay: Replay
    score: LoopScore
    notes: tuple[str, ...] = ()

    def lines(self, joints: Sequence[str]) -> list[str]:
        """Lines of text for the report: the check of the controller and the score of the loop."""
        return [self.replay.line(joints), *self.notes, self.score.line(joints)]

    def failures(self, relative_error: float) -> tuple[str, ...]:
        """Sentence that the relative torque error exceeds the limit ``relative_error``; empty if it does not."""
        found = self.score.relative_error
        if found <= relative_error:
            return ()
        return (f"relative error of the simulated loop {100 * found:.3g} % exceeds {100 * relative_error:.3g} %",)

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: the check of the controller and the score of the loop."""
        return {"controller_error": list(self.replay.errors), "score": as_json(self.score)}


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
    own = loop_recordings(recordings, controller, processing)

    def chosen(recording: LoopRecording) -> NDArray[np.bool_]:
        if split is None or split.kind == "none":
            return np.ones(len(recording), bool)
        return split.scored(recording.t, *recording.span)

    score, _ = loop_score(
        "all samples" if split is None or split.kind == "none" else "held out", loop, theta, own, chosen
    )
    if score is None:
        raise InputError("no sample is left to score the simulated loop")
    return ClosedLoopValidation(replayed(loop, own), score, tuple(assumptions(own, "the recordings")))
