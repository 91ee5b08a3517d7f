"""Simulation of an experiment on the virtual robot: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import Fault, option_name, require, with_names
from rrrgen.lab.studies.options import ExperimentOptions, OptionError, option, with_changes
from rrrgen.lab.studies.results import Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.data.recordings import Log
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.fourier_series import FourierTrajectory
    from rrrgen.lab.experiment.experiment_file import Experiment
    from rrrgen.lab.experiment.loop_design import LoopDesign
    from rrrgen.lab.plant.experiment import Instruments, SimulatedRecording
    from rrrgen.lab.plant.tracking import Tracking
    from rrrgen.lab.studies.excite import ExcitationResult
    from rrrgen.lab.studies.sources import FindingsCallback, ProgressCallback, RecordingSource, RobotInput, RobotSource
    from rrrgen.robot.spec import RobotSpec

Motion = Callable[[Any], Any]


@dataclass(frozen=True)
class SimulateOptions(ExperimentOptions):
    """Options of a simulated experiment; None: as the experiment file says."""

    duration: float | None = option(None, "Duration in seconds; default: one period of the motion.", unit="s", above=0)
    bandwidth: float | None = option(
        None,
        "Bandwidth of the loops of all joints; default: 4 or what its load needs, as far as the loop is robust.",
        unit="Hz",
        above=0,
    )
    control: Literal["pd", "computed-torque"] | None = option(
        None,
        "Control law; default: pd, or computed torque with the exact model of the robot file where a robust PD loop is "
        "too slow for the motion.",
    )
    torque_noise: float | None = option(
        None, "Standard deviation of the torque noise, N m; default: no noise.", least=0, metavar="NM"
    )
    base_mode: float | None = option(
        None, "Natural frequency of a flexible base, such as 28; default: rigid.", unit="Hz", above=0
    )

    def of_file(self, joints: int) -> Experiment:
        """The experiment with these options, for a robot of ``joints`` joints."""
        experiment = super().of_file(joints)
        virtual_robot, control = dict(experiment.virtual_robot), experiment.control
        if self.torque_noise is not None:
            virtual_robot["torque_noise"] = (self.torque_noise,) * joints
        if self.base_mode is not None:
            virtual_robot["flexible_base"] = {**virtual_robot.get("flexible_base", {}), "frequency": self.base_mode}
        if self.bandwidth is not None:
            places = {key: place for key, place in control.places.items() if key not in ("kp", "kd")}
            places["bandwidth"] = Fault(option_name("bandwidth"), 0, 0, "")
            control = replace(control, bandwidth=(self.bandwidth,) * joints, kp=None, kd=None, places=places)
        if self.control is not None:
            control = replace(control, kind=self.control.replace("-", "_"))
        return replace(experiment, virtual_robot=virtual_robot, control=control)

    def settings(self) -> dict[str, Any]:
        """What ``run.json`` keeps of the options."""
        names = ("duration", "rate", "bandwidth", "control", "torque_noise", "base_mode")
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult(StudyResult):
    """The result of :func:`rrrgen.simulate`: the ``recording`` with the true signals, and its control ``loop``.

    ``tracking`` tells how well the arm follows the motion, ``instruments`` which encoders and drives it has.
    """

    robot: RobotSpec
    recording: SimulatedRecording
    instruments: Instruments
    loop: LoopDesign
    tracking: Tracking

    @property
    def log(self) -> Log:
        """What the instruments of the arm have recorded, as :func:`rrrgen.identify` takes it."""
        from rrrgen.lab.data.recordings import Log
        from rrrgen.lab.plant.recording_files import torque_delay

        recording = self.recording
        signals = {name: getattr(recording, name) for name in ("t", "q", "tau", "reference", "feedforward")}
        delay = torque_delay(recording, self.instruments)
        return Log(joints=self._joints, period=recording.period, torque_delay=delay, **signals)

    @property
    def ok(self) -> bool:
        """Whether the arm follows the motion and no joint oscillates."""
        return self.tracking.ok

    @property
    def failures(self) -> tuple[str, ...]:
        """What failed, with what can be done about it."""
        return tuple(self._failures())

    @property
    def clipped(self) -> int:
        """Number of torques that a limit has clipped."""
        return int(self.recording.saturated.sum())

    @property
    def _joints(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.robot.joints)

    @property
    def _prismatic(self) -> list[bool]:
        return [not joint.is_revolute for joint in self.robot.joints]

    def _failures(self) -> Iterator[str]:
        tracking, joints, prismatic = self.tracking, self._joints, self._prismatic
        for swing in tracking.oscillations:
            unit = "N" if prismatic[swing.joint] else "N m"
            why = ": the loop is unstable" if self.loop.margin.unstable else ""
            yield (
                f"{joints[swing.joint]} oscillates at {swing.frequency:.3g} Hz with {swing.amplitude:.3g} {unit} "
                f"from t = {swing.start:.2f} s to {swing.stop:.2f} s{why}"
            )
        for i in tracking.lost:
            unit = "m" if prismatic[i] else "rad"
            yield (
                f"{joints[i]} does not follow the motion: it is up to {tracking.deviation[i]:.3g} {unit} away "
                f"from a motion over {tracking.span[i]:.3g} {unit}"
            )
        if tracking.ok:
            return
        if self.clipped:
            remedy = "ask for a slower motion or stronger drives"
            yield f"{self.clipped} torques are clipped at the limits of the drives: {remedy}"
        elif tracking.oscillations:
            yield "a lower bandwidth or a higher rate calms the loop; without stated gains and observer it is designed"
        else:
            yield with_names(
                "a higher {rate} allows stiffer PD control; {control} computed-torque follows with the model of the arm"
            )

    def lines(self, width: int | None = None) -> list[str]:
        """The report: the loop and its margin, and the largest deviations from the motion."""
        worst = ", ".join(
            f"{name} {value:.3g} {'m' if slides else 'rad'}"
            for name, value, slides in zip(self._joints, self.tracking.deviation, self._prismatic, strict=True)
        )
        counts = f"{len(self.recording.t)} samples, {self.clipped} clipped torques"
        return [*self.loop.lines(), f"{counts}; largest deviations from the motion: {worst}"]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the joints: largest deviation from the motion, and range of the motion, rad (m)."""
        columns = (self.tracking.deviation, self.tracking.span)
        rows = zip(self._joints, *([float(value) for value in column] for column in columns), strict=True)
        return ("joint", "largest deviation", "range"), list(rows)

    def to_json(self) -> dict[str, Any]:
        """Samples, loop and tracking as plain data."""
        from rrrgen.lab.data.run_folder import plain_record

        record = {"samples": len(self.recording.t), "clipped_torques": self.clipped, "loop": self.loop.to_json()}
        return plain_record(record | {"tracking": {"ok": self.ok, **asdict(self.tracking)}})

    def write(self, folder: RunFolder) -> None:
        """Write the recording as ``log.csv`` with its mapping file, and its controller, into an open run folder."""
        from rrrgen.lab.plant.recording_files import write_recording

        write_recording(
            folder.path / "results",
            "log",
            self.recording,
            joints=self._joints,
            prismatic=self._prismatic,
            instruments=self.instruments,
        )


def simulate(
    robot: RobotSource,
    motion: ExcitationResult | FourierTrajectory | str | os.PathLike[str] | None = None,
    options: SimulateOptions | None = None,
    *,
    reference: RecordingSource | None = None,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    **changes: Any,
) -> SimulationResult:
    """Simulate an experiment: the arm follows a motion under feedback control.

    The arm has the links, friction, drives, encoders and torque limits of the robot; an experiment file can add other
    friction laws, flexible joints, a flexible base, noise and the gains of the controller. Gains and observer are
    otherwise designed from the arm, with a modulus margin of 0.5 in all postures along the motion.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        motion: the result of :func:`rrrgen.excite`, its trajectory, or the JSON file of either; without it and
            ``reference``, the arm follows the writing task of the experiment file.
        options: a :class:`SimulateOptions`; the default options if None.
        reference: recording whose positions are followed instead, as for :func:`rrrgen.identify`.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file, the control loop, and of tasks beyond the range of a joint.
        changes: single options by name, such as ``torque_noise=0.05``.

    Raises:
        InputError: robot, motion or options cannot be used; an OptionError for the options.
    """
    chosen = with_changes(SimulateOptions, options, changes)
    require("rrrgen experiment simulate", "scipy")
    from rrrgen.lab.experiment.loop_design import design_loop
    from rrrgen.lab.experiment.setup import arm_of
    from rrrgen.lab.studies.sources import ignore, robot_input

    findings, progress = findings or ignore, progress or ignore
    if motion is not None and reference is not None:
        raise OptionError("the arm follows a motion or {reference}, not both")
    arm = robot_input(robot, findings)
    experiment = chosen.of_file(arm.spec.n)
    if arm.model.beta is None:
        name = str(robot) if isinstance(robot, (str, os.PathLike)) else arm.spec.name
        raise OptionError(f"{name} has no links: there is nothing to simulate")
    followed = _motion_to_follow(arm, experiment, motion, reference, findings)
    settings = {"writing": motion is None and reference is None, **chosen.settings(), **arm.settings}
    files = arm.files | {key: file for key, file in followed.files.items() if key == "trajectory"} | chosen.files()
    run = Run("simulate", files | followed.files, settings | followed.settings, experiment.seed)
    duration = chosen.duration or followed.period
    controlled = arm_of(experiment, arm.model, followed.evaluate, duration)
    loop = design_loop(controlled, experiment.control)
    for fault in loop.warnings:
        findings(fault)
    compute = partial(_simulate, run, arm, experiment, followed, duration, controlled, loop, progress)
    return run.result(compute, folder, fresh)


@dataclass(frozen=True)
class _Followed:
    """The motion that the arm follows: a function of time, its period in s, the files read, hashes of arrays."""

    evaluate: Motion
    period: float
    files: dict[str, Path]
    settings: dict[str, Any]


def _motion_to_follow(
    arm: RobotInput,
    experiment: Experiment,
    motion: Any,
    reference: RecordingSource | None,
    findings: FindingsCallback,
) -> _Followed:
    """The motion of a trajectory, of a recording, or of the writing task, which may be beyond the joints' limits."""
    from rrrgen.lab.design.fourier_series import read_trajectory
    from rrrgen.lab.design.friction_motion import read_friction_motion
    from rrrgen.lab.experiment.feedback_linearisation import RecordedMotion
    from rrrgen.lab.experiment.setup import writing_path
    from rrrgen.lab.experiment.writing_task import excesses_of_range
    from rrrgen.lab.studies.excite import ExcitationResult
    from rrrgen.lab.studies.options import MotionOptions
    from rrrgen.lab.studies.sources import chosen_processing, recording_inputs

    if reference is not None:
        logs = recording_inputs(reference, arm.spec, role="reference")
        (recording,) = logs.open()
        recorded = RecordedMotion.of(recording, chosen_processing(logs.mappings, MotionOptions()))
        return _Followed(recorded.evaluate, recorded.duration, logs.files, logs.settings)
    if motion is None:
        path = writing_path(experiment, arm.model)
        for sentence in excesses_of_range(path):
            hint = "move the plane of the task, or state another 'start' in the experiment file"
            findings(Fault(arm.spec.file or arm.spec.name, 0, 0, sentence, hint=hint, severity="warning"))
        return _Followed(path.evaluate, path.task.duration, {}, {})
    if isinstance(motion, (str, os.PathLike)):
        series: Any = read_friction_motion(Path(motion)) or read_trajectory(Path(motion))
        _require_joints(series, arm, str(motion))
        return _Followed(series.evaluate, series.period, {"trajectory": Path(motion)}, {})
    series = motion.trajectory if isinstance(motion, ExcitationResult) else motion
    if not hasattr(series, "evaluate"):
        raise TypeError(f"motion is of type {type(motion).__name__}, not a trajectory, a result of excite, or a file")
    _require_joints(series, arm, "the motion")
    return _Followed(series.evaluate, series.period, {}, {"motion": series.to_json()})


def _require_joints(series: Any, arm: RobotInput, name: str) -> None:
    """Raise InputError if the motion ``name``, given as ``series``, is of an arm with another number of joints."""
    import numpy as np

    from rrrgen.base.errors import InputError

    joints = np.shape(series.evaluate(np.zeros(1))[0])[-1]
    if joints != arm.spec.n:
        raise InputError(f"{name} moves {joints} joints, {arm.spec.name} has {arm.spec.n}")


def _simulate(
    run: Run,
    arm: RobotInput,
    experiment: Experiment,
    followed: _Followed,
    duration: float,
    controlled: Any,
    loop: LoopDesign,
    progress: ProgressCallback,
    _: RunFolder | None,
) -> SimulationResult:
    """Run the virtual robot, and check how well it follows the motion."""
    from rrrgen.lab.experiment.loop_design import check_loop
    from rrrgen.lab.experiment.setup import simulate_motion

    recording, instruments = simulate_motion(
        experiment, arm.model, followed.evaluate, duration, loop=loop, progress=progress
    )
    return SimulationResult(arm.spec, recording, instruments, loop, check_loop(recording, controlled, loop), run=run)
