"""Identification of a robot from recordings: its options, the study and its result."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import InputError, require
from rrrgen.base.parallel import CLUSTER
from rrrgen.lab.studies.options import OptionError, PreprocessingOptions, StudyOptions, group, option, with_changes
from rrrgen.lab.studies.results import EstimateResult, FigureMaker, Run

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from rrrgen.base.arrays import Array
    from rrrgen.lab.closed_loop.refinement import ClosedLoopEstimate
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.bias import BiasCheck
    from rrrgen.lab.identify.cross_validation import CrossValidation
    from rrrgen.lab.identify.diagnosis.causes import Cause
    from rrrgen.lab.identify.identification import Identification, Options
    from rrrgen.lab.identify.observations import Recording
    from rrrgen.lab.identify.regressor import RigidModel
    from rrrgen.lab.studies.sources import (
        FindingsCallback,
        LoopInputs,
        ProgressCallback,
        RecordingInputs,
        RecordingSources,
        RobotInput,
        RobotSource,
    )
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.model import Model


@dataclass(frozen=True)
class IdentifyOptions(StudyOptions):
    """Options of an identification."""

    preprocessing: PreprocessingOptions = group(PreprocessingOptions)
    estimator: Literal["ordinary", "weighted", "robust"] = option(
        "weighted",
        "Least squares: ordinary, weighted by the residual of each joint, or robust against outliers (Huber).",
        shown=True,
    )
    split: str = option(
        "none",
        "Part of the data to fit, the rest is held out: first:0.6, blocks:0.5 (every other half second), or none.",
        shown=True,
    )
    guard: float | None = option(
        None,
        "Guard band in seconds, left out on both sides of every border of {split}; default: reach of the filters.",
        unit="s",
        least=0,
    )
    cross_validate: int | None = option(
        None,
        "Also fit K times, to all but one of K parts of the recordings, and score on that part.",
        least=2,
        metavar="K",
    )
    bias_check: float | None = option(
        None,
        "Period of a repeated motion: check by instrumental variables whether noise in it biases the estimate.",
        unit="s",
        above=0,
    )
    friction: tuple[str, ...] = option(
        (),
        "Friction law to fit at all joints, or JOINT=LAW at one; auto chooses by held-out error. "
        "Default: as the robot file states. Repeat for several.",
        metavar="LAW",
    )
    controller: Path | None = option(
        None,
        "Controller of the recorded loop: also fit the simulated loop to the torques (closed-loop output error).",
        metavar="FILE",
        recorded=False,
    )
    tests: tuple[Path, ...] = option(
        (),
        "Recording that is not fitted, on which the loop with {controller} is scored; repeat for several.",
        flags=("--test",),
        metavar="LOG",
        recorded=False,
    )
    fix: tuple[str, ...] = option(
        (),
        "Known value of a base, friction or standard parameter, such as my2=0; repeat for several.",
        metavar="NAME=VALUE",
    )
    estimate: tuple[str, ...] = option(
        (),
        "Estimate with the model what the recording may get wrong: any of zeros, gains, delay (of all joints), delays "
        "(one of each), tilt, drift, separated by commas. Default: these are only diagnosed.",
        metavar="LIST",
    )
    consistent: bool = option(True, "Compute the physically consistent estimate.", shown=True)
    essential: bool = option(False, "Reduce the model to its essential parameters, too.")
    jobs: int = option(1, "Number of parallel processes.", least=1, flags=("-j", "--jobs"), shown=True, recorded=False)
    cluster: str | None = option(
        None,
        "Address of a Dask scheduler that distributes the work, tcp://HOST:PORT.",
        metavar="ADDRESS",
        recorded=False,
    )
    seed: int = option(0, "Seed for all random numbers; default 0.", least=0, recorded=False)

    def packages(self) -> tuple[str, ...]:
        """The optional packages that these options need."""
        consistency = ("cvxpy", "clarabel") if self.consistent else ()
        return ("scipy", "matplotlib", *consistency, *(CLUSTER if self.cluster else ()))


def known_values(entries: Sequence[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Split ``NAME=VALUE`` entries into known columns of the regressor and known standard parameters (m2, mx2, ...).

    Raises :class:`OptionError` for an entry of another form, and for two values of one parameter.
    """
    columns: dict[str, float] = {}
    standard: dict[str, float] = {}
    for entry in entries:
        match = re.fullmatch(r"\s*(\w+)\s*=\s*([-+0-9.eE]+)\s*", entry)
        try:
            name, value = (match.group(1), float(match.group(2))) if match else ("", 0.0)
        except ValueError:
            name, value = "", 0.0
        if not name or not math.isfinite(value):
            raise OptionError(f"'{entry}' is not NAME=VALUE", "fix")
        is_standard = re.fullmatch(r"(m|m[xyz]|I[xyz][xyz])\d+", name) is not None
        chosen = standard if is_standard else columns
        if chosen.setdefault(name, value) != value:
            raise OptionError(f"{{fix}} gives {name} two values, {chosen[name]:g} and {value:g}", "fix")
    return columns, standard


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(EstimateResult):
    """The result of :func:`rrrgen.identify`: parameters of the identifiable combinations, scores, diagnoses.

    ``identification`` holds all estimates and scores, ``model`` the compiled robot that was given, ``recordings`` the
    recordings after their repair, ``closed_loop``, ``bias`` and ``cross_validation`` what the options asked for.
    ``names``, ``values``, ``std`` and ``units`` are those of the written model, the physically consistent one unless
    the options say otherwise.
    """

    robot: RobotSpec
    model: Model
    recordings: tuple[Recording, ...]
    recording_names: tuple[str, ...]
    identification: Identification
    closed_loop: ClosedLoopEstimate | None = None
    bias: BiasCheck | None = None
    cross_validation: CrossValidation | None = None

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the identifiable parameters and combinations of parameters, in the order of the values."""
        return self.identification.names

    @property
    def values(self) -> Array:  # type: ignore[override]
        """Estimated values (r,) of the identifiable combinations, SI."""
        return self.identification.delivered.x

    @property
    def std(self) -> Array:  # type: ignore[override]
        """Standard deviations (r,) of :attr:`values`."""
        return self.identification.delivered.std

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Units of :attr:`values`."""
        return self.identification.units

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Sentences on what the structure, the motion or the data leave undetermined or doubtful."""
        from rrrgen.lab.identify.scores import held_out_notes

        identification, covered = self.identification, None
        for _, blocks in identification.parts:
            covered = identification.band.coverage(blocks)  # that of the held-out rows, which come last
        doubtful = held_out_notes(identification.scores, covered, self._joints, identification.left_in(self._joints))
        return (
            *identification.swinging,
            *identification.structural_notes,
            *identification.motion_notes,
            *identification.hardly_determined,
            *doubtful,
        )

    @property
    def diagnoses(self) -> tuple[Cause, ...]:
        """Probable faults in the recordings or the robot file, with evidence and remedy."""
        return self.identification.diagnoses

    @property
    def spec(self) -> RobotSpec:
        """The identified robot with the physically consistent estimate, ready for :func:`rrrgen.compile`.

        Raises :class:`OptionError` if the options left this estimate out, :class:`DerivationError` if no robot file can
        hold it.
        """
        from rrrgen.lab.identify.results import spec_with_provenance

        if self.identification.consistent is None:
            raise OptionError("an identified robot needs the physically consistent estimate: set {consistent}")
        return spec_with_provenance(self.identification, self.robot, ", ".join(self.recording_names))

    @property
    def _put_right(self) -> Recording:
        """The first recording with the errors that were estimated put right."""
        return self.identification.correct_recordings(self.recordings)[0]

    @property
    def _joints(self) -> tuple[str, ...]:
        return self.recordings[0].joints

    @property
    def _rigid(self) -> RigidModel:
        """The model whose rows were fitted."""
        from rrrgen.lab.identify.floating_base import FloatingModel, on_floating_base

        return FloatingModel(self.model) if on_floating_base(self.recordings) else self.model

    def lines(self, width: int | None = None) -> list[str]:
        """The report: parameters, friction laws, filters, scores, what is doubtful."""
        from rrrgen.lab.identify.results import parameter_lines
        from rrrgen.lab.identify.scores import joint_table, score_table

        identification = self.identification
        lines = [*parameter_lines(identification, width)]
        if identification.nuisances is not None:
            lines += identification.nuisances.lines(width)
        if identification.friction is not None:
            lines += identification.friction.lines(width)
        lines += identification.tuning.sentences()
        if identification.split.kind != "none":
            lines.append(f"data: {identification.split}")
        lines += [*score_table(identification.scores, width), *joint_table(identification.scores, self._joints, width)]
        for name, blocks in identification.parts:
            covered = identification.band.coverage(blocks)
            if covered is not None:
                lines.append(
                    f"95 % band of the predicted torque: covers {100 * covered.share:.1f} % of the rows {name}; "
                    f"{100 * covered.parameters:.0f} % of its width is that of the parameters"
                )
        if self.cross_validation is not None:
            lines += self.cross_validation.lines(width)
        for name, share in identification.indefinite.items():
            lines.append(f"random poses with an indefinite mass matrix, {name}: {100 * share:.2f} %")
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def loop_lines(self) -> list[str]:
        """The report on the fitted loop and on the check for bias; empty if the options did not ask for them."""
        loop = [] if self.closed_loop is None else list(self.closed_loop.lines(self._joints))
        return loop + ([] if self.bias is None else list(self.bias.lines()))

    def __repr__(self) -> str:
        return "\n".join([*self.lines(), *self.loop_lines()])

    def to_json(self) -> dict[str, Any]:
        """The content of ``identification.json``, with cross-validation and fitted loop if there are any."""
        from rrrgen.lab.data.run_folder import plain_record
        from rrrgen.lab.identify.results import as_record

        more = {} if self.cross_validation is None else {"cross_validation": self.cross_validation.to_json()}
        more |= {} if self.closed_loop is None else {"closed_loop": self.closed_loop.to_json()}
        return plain_record(as_record(self.identification, self._joints) | more)

    def figures(self) -> dict[str, FigureMaker]:
        """The figures: torques, torques_held_out, convergence, whiteness, bandwidth, friction, closed_loop."""
        from rrrgen.lab.identify.results import identification_figures

        makers = identification_figures(self.identification, self.robot, model=self._rigid, recording=self._put_right)
        return makers | ({} if self.closed_loop is None else {"closed_loop": self._loop_figure})

    def _loop_figure(self) -> Figure | None:
        from rrrgen.lab.closed_loop.refinement import plot_loop
        from rrrgen.lab.identify.figures import force_units

        loop = self.closed_loop
        return None if loop is None else plot_loop(loop, self._joints, force_units(self.robot))

    def write(self, folder: RunFolder) -> None:
        """Write parameters, tables, the identified robot file and figures into an open run folder."""
        from rrrgen.lab.identify.results import write_identification

        if self.closed_loop is not None:
            folder.write_json("closed_loop.json", self.closed_loop.to_json())
            figure = self._loop_figure()
            if figure is not None:
                folder.figure("closed_loop", figure)
        if self.cross_validation is not None:
            folder.write_json("cross_validation.json", self.cross_validation.to_json())
        write_identification(
            folder,
            self.identification,
            self.robot,
            recordings=", ".join(self.recording_names),
            model=self._rigid,
            recording=self._put_right,
        )


def identify(
    robot: RobotSource,
    recordings: RecordingSources,
    options: IdentifyOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> IdentificationResult:
    """Estimate base parameters, drive inertia and friction of a robot from recordings.

    Every friction and drive parameter that the robot states, even as 0, is estimated.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        recordings: a recording or mapping file, a ``Log``, arrays by name in SI at the joints, or a list of these. The
            arrays are ``t`` (N,) in s, ``q`` and ``tau`` (N, n), and ``dq``, ``ddq``, ``reference``,
            ``reference_velocity``, ``feedforward`` (N, n) if they were recorded. They are checked and repaired as files
            are. On a floating base that moves there are also ``orientation`` (N, 4), ``twist`` (N, 6) and, if they were
            recorded, ``twist_rate`` and ``wrench`` (N, 6), as the functions of the model take them; the wrench or
            ``tau`` may be missing, and in flight the wrench is zero.
        options: an :class:`IdentifyOptions`; the default options if None.
        folder: run folder to write to, from which an interrupted run is resumed; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file, repairs of every recording and probable faults, before the
            fit, which may fail because of them.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``split="blocks:0.5"`` or ``fix={"my2": 0}``.

    Raises:
        InputError: robot, recordings or options cannot be used; an OptionError for the options.
        DerivationError: the data determine nothing.
    """
    chosen = with_changes(IdentifyOptions, options, changes)
    require("rrrgen identify", *chosen.packages())
    if chosen.estimate and chosen.controller is not None:
        raise OptionError(
            "{controller} simulates the loop as it was recorded: correct the recording by {estimate} first"
        )
    from rrrgen.lab.studies.sources import chosen_processing, ignore, read_loop, recording_inputs, robot_input

    findings, progress = findings or ignore, progress or ignore
    arm = robot_input(robot, findings)
    logs = recording_inputs(recordings, arm.spec, skip_truncated_line=skip_truncated_line, floating=True)
    if logs.floating:
        _refuse_on_floating_base(arm.spec, chosen)
    loop = read_loop(chosen.controller, chosen.tests, arm.spec, logs, skip_truncated_line)
    processing = chosen_processing(logs.mappings, chosen.preprocessing)
    estimation = _estimation_options(chosen, arm.spec, logs.floating)
    settings = {**processing.settings(), **chosen.settings(), "skip_truncated_line": skip_truncated_line}
    run = Run("identify", arm.files | logs.files | loop.files, settings | arm.settings | logs.settings, chosen.seed)
    estimate = partial(_estimate, run, arm, logs, loop, processing, chosen, estimation, progress, findings)
    return run.result(estimate, folder, fresh)


def _refuse_on_floating_base(spec: RobotSpec, chosen: IdentifyOptions) -> None:
    """Raise an :class:`InputError` for options, and laws of the robot file, that a floating base does not have."""
    for name in ("friction", "estimate", "controller", "bias_check"):
        if getattr(chosen, name):
            raise OptionError(f"{{{name}}} is for a base at rest: leave it away, or hold the base", name)
    laws = [joint.name for joint in spec.joints if joint.friction is not None and joint.friction.law is not None]
    if laws:
        raise InputError(
            f"the friction law of {', '.join(laws)} is estimated with the base at rest; on a floating base, state "
            "friction: {viscous: 0, coulomb: 0}"
        )


def _check_flight(torques: bool, model: Model, chosen: IdentifyOptions) -> None:
    """Raise an OptionError if nothing sets the scale of the parameters in flight.

    The wrench on the base is zero there, so that every multiple of a solution is one, unless joint ``torques`` are
    recorded or a parameter is known.
    """
    if not torques and not chosen.fix:
        mass = next(name for name in model.base_parameter_names if name in ("m1", "m1R"))
        raise OptionError(
            "in flight the wrench is zero, and without joint torques the parameters are determined up to one factor "
            f"only: name one that is known by {{fix}}, such as the mass {mass} of the whole robot, or record torques",
            "fix",
        )


def _estimation_options(chosen: IdentifyOptions, spec: RobotSpec, floating: bool) -> Options:
    """The options of the estimation itself; raises InputError for laws, splits and known values that make no sense."""
    from rrrgen.lab.data.mapping import ON_BASE
    from rrrgen.lab.identify.friction_choice import LawChoice
    from rrrgen.lab.identify.held_out_data import Split
    from rrrgen.lab.identify.identification import Options
    from rrrgen.lab.identify.nuisance_estimate import parse_choices
    from rrrgen.lab.identify.parameters import DriveTerms

    columns, standard = known_values(chosen.fix)
    estimation = Options(
        method=chosen.estimator,
        terms=replace(DriveTerms.of_spec(spec), before=len(ON_BASE) if floating else 0),
        friction=LawChoice.parse(chosen.friction, spec),
        fixed=columns,
        fixed_standard=standard,
        estimate=parse_choices(chosen.estimate),
        split=Split.parse(chosen.split),
        guard=chosen.guard,
        consistent=chosen.consistent,
        essential=chosen.essential,
        seed=chosen.seed,
        jobs=chosen.jobs,
        cluster=chosen.cluster,
    )
    if chosen.cross_validate and estimation.split.kind != "none":
        raise OptionError("{cross_validate} holds out every part in turn: leave {split} away")
    if chosen.guard is not None and estimation.split.kind == "none" and not chosen.cross_validate:
        raise OptionError("{guard} keeps away from the borders of {split}: give a {split}, too", "guard")
    if chosen.estimate and chosen.controller is not None:
        raise OptionError(
            "{controller} simulates the loop as it was recorded: correct the recording by {estimate} first"
        )
    return estimation


def _estimate(
    run: Run,
    arm: RobotInput,
    logs: RecordingInputs,
    loop: LoopInputs,
    processing: Processing,
    chosen: IdentifyOptions,
    estimation: Options,
    progress: ProgressCallback,
    findings: FindingsCallback,
    folder: RunFolder | None,
) -> IdentificationResult:
    """Estimate, fit the loop, check and diagnose; ``folder`` keeps the state of unfinished work."""
    from rrrgen.lab.closed_loop.refinement import closed_loop_estimate
    from rrrgen.lab.identify.bias import check_bias
    from rrrgen.lab.identify.consistency import InconsistentEstimateError
    from rrrgen.lab.identify.cross_validation import cross_validate
    from rrrgen.lab.identify.diagnosis.causes import merge_causes
    from rrrgen.lab.identify.diagnosis.report import diagnose_fit, swinging_notes
    from rrrgen.lab.identify.floating_base import FloatingModel, check_base, measured_rows, on_floating_base
    from rrrgen.lab.identify.identification import identify as estimate
    from rrrgen.lab.studies.sources import tell_causes

    recordings = logs.open(findings)
    floating = on_floating_base(recordings)
    if floating:
        torques = check_base(recordings)
        if not measured_rows(recordings).any():
            raise InputError("the recordings have neither the wrench on the base nor joint torques: record one of them")
        _check_flight(torques, arm.model, chosen)
    before = () if floating else tell_causes(arm.spec, recordings, findings)
    model = FloatingModel(arm.model) if floating else arm.model
    fit = partial(
        estimate,
        model,
        recordings,
        processing,
        checkpoint=None if folder is None else folder.checkpoint("factors"),
        digest="" if folder is None else folder.digest,
        progress=progress,
    )
    try:
        identification = fit(estimation)
    except InconsistentEstimateError as error:  # such as wrong signs: say what the least-squares estimate tells
        identification = fit(replace(estimation, consistent=False))
        causes = () if floating else diagnose_fit(model, identification.correct_recordings(recordings), identification)
        lines = [line for cause in causes for line in cause.lines()]
        raise InconsistentEstimateError("\n".join([str(error), *lines])) from None
    put_right = identification.correct_recordings(recordings)
    fitted = None
    if loop.controller is not None:
        fitted = closed_loop_estimate(identification, recordings, loop.controller, estimation, progress, loop.open())
        identification = fitted.identification
    bias = None if chosen.bias_check is None else check_bias(identification, put_right, chosen.bias_check)
    parts = None
    if chosen.cross_validate:
        parts = cross_validate(model, recordings, processing, estimation, chosen.cross_validate, progress)
    if not floating:  # the rules of diagnosis are about arms: what the base should do, they do not know
        progress(0, 0, "diagnosis")
        causes = merge_causes([*before, *diagnose_fit(model, put_right, identification)])
        identification = replace(identification, diagnoses=causes, swinging=swinging_notes(recordings))
    return IdentificationResult(
        arm.spec, arm.model, tuple(recordings), logs.names, identification, fitted, bias, parts, run=run
    )
