"""Estimation of the friction of one joint: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import require
from rrrgen.lab.studies.options import StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.closed_loop.controller import LoopController
    from rrrgen.lab.closed_loop.joint_friction import LoopRefinement
    from rrrgen.lab.data.recordings import Log
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.friction.estimation import FrictionEstimate
    from rrrgen.lab.friction.joint_recording import RecordedJoint
    from rrrgen.lab.friction.presliding import Presliding
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        ProgressCallback,
        RecordingInputs,
        RecordingSource,
        RecordingSources,
        RobotInput,
        RobotSource,
    )
    from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class FrictionOptions(StudyOptions):
    """Options of the estimation of the friction of one joint."""

    laws: tuple[Literal["coulomb_viscous", "asymmetric", "stribeck", "lugre", "neural"], ...] = option(
        (), "Law to try; repeat for several; default all.", flags=("--law",)
    )
    controller: Path | None = option(
        None,
        "Controller of the recorded loop: refine the chosen law by closed-loop output error.",
        metavar="FILE",
        recorded=False,
    )
    seed: int = option(0, "Seed for all random numbers; default 0.", least=0, recorded=False)


@dataclass(frozen=True, eq=False, repr=False)
class FrictionResult(StudyResult):
    """The result of :func:`rrrgen.estimate_friction`: inertia, gravity and friction of one joint.

    ``estimate`` holds the estimates by every law, ``rest`` stiffness and damping of the bristles at rest, ``loop`` the
    refinement in the simulated loop; the last two are None if they were not asked for. ``joint`` is what the robot says
    about the joint.
    """

    robot: RobotSpec
    joint: RecordedJoint
    estimate: FrictionEstimate
    rest: Presliding | None
    loop: LoopRefinement | None

    @property
    def law(self) -> str:
        """Name of the chosen law."""
        return self.estimate.chosen.name

    @property
    def values(self) -> dict[str, float]:
        """Inertia, gravity and the parameters of the chosen law by name, SI."""
        return self.estimate.chosen.values

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of :attr:`values` by name."""
        return self.estimate.chosen.std

    @property
    def spec(self) -> RobotSpec:
        """The robot whose joint has the chosen law, ready for :func:`rrrgen.compile`."""
        from rrrgen.lab.friction.report import with_friction

        return with_friction(self.robot, self.joint.name, self.estimate.chosen, self.rest)

    def lines(self, width: int | None = None) -> list[str]:
        """The report: table of laws, parameters of the chosen law, notes."""
        return self.estimate.lines() + ([] if self.rest is None else self.rest.lines()) + self._notes()

    def _notes(self) -> list[str]:
        return [f"note: {note}" for part in (self.estimate, self.rest) if part is not None for note in part.notes]

    def loop_lines(self) -> list[str]:
        """The report on the refinement in the simulated loop; empty without a controller."""
        return [] if self.loop is None else list(self.loop.lines())

    def __repr__(self) -> str:
        return "\n".join([*self.lines(), *self.loop_lines()])

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the parameters of the chosen law."""
        return ("parameter", "value", "std"), [(name, value, self.std[name]) for name, value in self.values.items()]

    def to_json(self) -> dict[str, Any]:
        """The content of ``friction.json``."""
        from rrrgen.lab.data.run_folder import plain_record

        rest = {} if self.rest is None else {"presliding": self.rest.to_json()}
        loop = {} if self.loop is None else {"closed_loop": self.loop.to_json()}
        return plain_record(self.estimate.to_json() | rest | loop)

    def figures(self) -> dict[str, FigureMaker]:
        """The figures: friction over speed, and torques and speeds of the experiment."""
        from rrrgen.lab.friction.report import plot_experiment, plot_friction

        return {
            "friction": lambda: plot_friction(self.estimate, self.joint.units),
            "experiment": lambda: plot_experiment(self.estimate, self.joint.units),
        }

    def write(self, folder: RunFolder) -> None:
        """Write ``friction.json``, ``robot.yaml`` with the law, and the figure ``friction`` into an open run folder."""
        from rrrgen.robot.file import dumps

        folder.write_json("friction.json", self.to_json())
        folder.write_text("robot.yaml", dumps(self.spec))
        folder.figure("friction", self.plot("friction"))


def estimate_friction(
    robot: RobotSource,
    recording: RecordingSource,
    options: FrictionOptions | None = None,
    *,
    joint: str,
    presliding: RecordingSources = (),
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> FrictionResult:
    """Estimate friction, inertia and gravity of one joint, (14.15).

    In the recording this joint moves and all others stand still. Coulomb-viscous, asymmetric, Stribeck, LuGre and
    neural laws are estimated by an extended Kalman filter and refined by output error. One of them is chosen by its
    error on windows that were not fitted, and with a controller refined in the simulated closed loop.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        recording: a recording or mapping file, a ``Log``, or arrays by name, as for :func:`rrrgen.identify`.
        options: a :class:`FrictionOptions`; the default options if None.
        joint: name of the joint that moves.
        presliding: recordings of the joint below break-away under a periodic multisine, each with another amplitude,
            from which stiffness and damping of the bristles at rest (14.16) are estimated.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file and repairs of the recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``laws=["stribeck", "lugre"]``.

    Raises:
        InputError: robot, recording or options cannot be used; an OptionError for the options.
        DerivationError: the motion does not determine inertia or friction.
    """
    chosen = with_changes(FrictionOptions, options, changes)
    require("rrrgen experiment friction", "scipy", "matplotlib")
    from rrrgen.lab.closed_loop.controller import load_controller
    from rrrgen.lab.friction.joint_recording import recorded_joint
    from rrrgen.lab.studies.sources import as_list, ignore, recording_inputs, robot_input

    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    controller = None if chosen.controller is None else load_controller(chosen.controller)
    recordings = [recording, *as_list(presliding)]
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line, check=False)
    moving = recorded_joint(arm.spec, logs.sources[0], joint)
    files = arm.files | logs.files | ({} if chosen.controller is None else {"controller": chosen.controller})
    settings = {"joint": joint, **chosen.settings(), "skip_truncated_line": skip_truncated_line}
    run = Run("friction", files, settings | arm.settings | logs.settings, chosen.seed)
    return run.result(partial(_estimate, run, arm, logs, moving, controller, chosen, progress, findings), folder, fresh)


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    moving: RecordedJoint,
    controller: LoopController | None,
    chosen: FrictionOptions,
    progress: ProgressCallback,
    findings: FindingsCallback,
    _: RunFolder | None,
) -> FrictionResult:
    """Estimate the laws, refine the chosen one in the loop, and estimate the bristles at rest."""
    from rrrgen.lab.closed_loop.joint_friction import refine
    from rrrgen.lab.friction.estimation import estimate_friction as estimate
    from rrrgen.lab.friction.joint_recording import joint_data

    log, *resting = logs.load()
    findings(log.repairs)
    data = joint_data(log, moving.name, moving.resolution)
    friction = estimate(data, moving.gravity, chosen.laws, chosen.seed, progress, moving.revolute)
    loop = None if controller is None else refine(friction, log, controller, progress)
    friction = friction if loop is None else loop.estimate
    rest = _bristles(friction, resting, moving) if resting else None
    return FrictionResult(arm.spec, moving, friction, rest, loop, run=run)


def _bristles(friction: FrictionEstimate, resting: Sequence[Log], moving: RecordedJoint) -> Presliding:
    """Estimate stiffness and damping of the bristles from recordings whose torques stay below break-away."""
    from rrrgen.lab.friction.joint_recording import resting_record
    from rrrgen.lab.friction.presliding import presliding

    law = friction.chosen
    theta = dict(zip(law.candidate.names, law.theta.tolist(), strict=True))
    return presliding(
        [resting_record(log, moving.name) for log in resting],
        friction.data.resolution,
        law.break_away,
        law.values.get("viscous", 0.0),
        (theta.get("gravity_cos", 0.0), theta.get("gravity_sin", 0.0)) if moving.gravity == 2 else (0.0, 0.0),
        law.values["delay"],
    )
