"""What a study works on: a robot, recordings from files or arrays, and the hashes by which a run folder knows them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError, option_name
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.lab.closed_loop.controller import LoopController, load_controller
from rrrgen.lab.closed_loop.loop_recording import NEEDED, require_inputs, require_joints
from rrrgen.lab.data.mapping import (
    BASE_COLUMNS,
    SIGNALS,
    Channel,
    FileSource,
    JointChannels,
    LogMapping,
    TimeSource,
    on_floating_base,
)
from rrrgen.lab.data.preprocessing import METHODS_OF_SETTING, Processing
from rrrgen.lab.data.recordings import Log, check_joints, check_robot, load_stream, open_log, recorded_joints
from rrrgen.lab.data.repair import Repairs
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.diagnosis.causes import Cause
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.response.response_file import ResponseFile, SignalColumn, load_response
from rrrgen.lab.studies.options import MotionOptions, OptionError
from rrrgen.robot.spec import RobotSpec
from rrrgen.runtime.load import compile as compile_model
from rrrgen.runtime.model import Model

RobotSource = str | os.PathLike[str] | RobotSpec | Model
"""A robot file, the name of a bundled robot, a description or a compiled model."""

RecordingSource = str | os.PathLike[str] | Log | Mapping[str, Any]
"""A recording or its mapping file, a recording in memory, or arrays by name: ``t`` (N,), ``q`` and ``tau`` (N, n).

``t`` is in s, or points in time such as datetime64, which count from the first.
"""

RecordingSources = RecordingSource | Sequence[RecordingSource]

Identity = tuple[Any, ...]
"""What two sources of one recording have in common: the hash of arrays, or files and columns of the positions."""

FindingsCallback = Callable[[Fault | Repairs | Cause], Any]
"""Receives what was found before the estimation: warnings of the robot file, repairs, probable faults."""

ProgressCallback = Callable[[int, int, str], Any]
"""Called as ``progress(done, total, message)``; ``total`` is 0 where the end is not known."""


def ignore(*_: Any) -> None:
    """Take no notice: the callback of a caller who gave none."""


def tell_causes(spec: RobotSpec, recordings: Sequence[Recording], findings: FindingsCallback) -> tuple[Cause, ...]:
    """Diagnose the clock, the recorded speeds and the limits of ``recordings``; ``findings`` receives every cause."""
    from rrrgen.lab.identify.diagnosis.report import diagnose_recordings

    causes = diagnose_recordings(spec, recordings)
    for cause in causes:
        findings(cause)
    return causes


COLUMN = {
    "position": "q",
    "velocity": "dq",
    "acceleration": "ddq",
    "torque": "tau",
    "reference": "reference",
    "reference_velocity": "reference_velocity",
    "feedforward": "feedforward",
}
"""Names of the arrays of a recording, by signal."""


@dataclass(frozen=True, eq=False)
class RobotInput:
    """The robot of a study: its description, the compiled model if the caller has one, and what a run folder records.

    ``files`` is the robot file by role; ``settings`` holds the hash of a robot that does not come from a file.
    """

    spec: RobotSpec
    given: Model | None
    files: dict[str, Path] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def model(self) -> Model:
        """The compiled model."""
        return compile_model(self.spec) if self.given is None else self.given


def robot_input(robot: RobotSource, findings: FindingsCallback) -> RobotInput:
    """Read the robot of a study, whose warnings ``findings`` receives. Raises :class:`InputError` for a faulty file."""
    arm = _robot_input(robot)
    for fault in arm.spec.faults:
        findings(fault)
    return arm


def _robot_input(robot: RobotSource) -> RobotInput:
    from rrrgen.robot.file import load_spec
    from rrrgen.robot.identity import identify

    if isinstance(robot, Model):
        if robot.spec is None:
            raise InputError("this model has no robot file, from which a study takes joints and drives")
        return RobotInput(robot.spec, robot, {}, {"robot": identify(robot.spec).model_hash})
    if isinstance(robot, RobotSpec):
        return RobotInput(robot, None, {}, {"robot": identify(robot).model_hash})
    if not isinstance(robot, (str, os.PathLike)):
        raise InputError(f"robot is of type {type(robot).__name__}, not a name, a file, a RobotSpec or a Model")
    spec = load_spec(robot)
    return RobotInput(spec, None, {"robot": Path(robot)} if Path(robot).is_file() else {})


@dataclass(frozen=True, eq=False)
class RecordingInputs:
    """The recordings of a study, and what a run folder records of them.

    ``sources`` holds a mapping of columns for every recording that is streamed, or a recording in memory. ``files`` are
    the files read by role, ``settings`` the hashes of arrays, ``names`` the names of the data files. ``identities``
    tells, by role, whether two recordings are the same one.
    """

    sources: tuple[LogMapping | Log, ...]
    files: dict[str, Path]
    settings: dict[str, Any]
    names: tuple[str, ...]
    identities: dict[str, Identity] = field(default_factory=dict)

    @property
    def floating(self) -> bool:
        """Whether some recording has the motion of a floating base."""
        return any(source.floating for source in self.sources)

    @property
    def mappings(self) -> list[LogMapping]:
        """The mappings of the recordings that have one."""
        mappings = [source.mapping if isinstance(source, Log) else source for source in self.sources]
        return [mapping for mapping in mappings if mapping is not None]

    def open(self, findings: FindingsCallback = ignore) -> list[Recording]:
        """The recordings, those of files and arrays after the first pass, which finds the period.

        ``findings`` receives the repairs of every recording.
        """
        recordings: list[Recording] = [
            source if isinstance(source, Log) else LogStream(source) for source in self.sources
        ]
        for recording in recordings:
            findings(recording.repairs)
        return recordings

    def load(self, findings: FindingsCallback = ignore) -> list[Log]:
        """The recordings in memory; ``findings`` receives their repairs."""
        logs = [source if isinstance(source, Log) else load_stream(LogStream(source)) for source in self.sources]
        for log in logs:
            findings(log.repairs)
        return logs


def as_list(recordings: RecordingSources) -> Sequence[RecordingSource]:
    """One recording as a list of it; several as they are."""
    one = isinstance(recordings, (str, os.PathLike, Log, Mapping)) or _is_data_frame(recordings)
    return [recordings] if one else recordings  # type: ignore[list-item, return-value]


def recording_inputs(
    recordings: RecordingSources,
    spec: RobotSpec,
    *,
    skip_truncated_line: bool = False,
    role: str = "log",
    check: bool = True,
    floating: bool = False,
) -> RecordingInputs:
    """Find out how ``recordings`` are read, and ``check`` that files fit the robot ``spec``.

    ``role`` names them in the record of the run; ``floating`` allows the motion of a floating base. Raises
    :class:`InputError` for recordings that cannot be read or are not of this robot.
    """
    joints = tuple(joint.name for joint in spec.joints)
    sources: list[LogMapping | Log] = []
    files: dict[str, Path] = {}
    hashes: dict[str, str] = {}
    names: list[str] = []
    identities: dict[str, Identity] = {}
    for k, recording in enumerate(as_list(recordings), start=1):
        if isinstance(recording, Log):
            check_joints(recording.joints, recorded_joints(spec, recording.floating))
            sources.append(recording)
            hashes[f"{role}{k}"] = hash_of_arrays(_arrays_of_log(recording))
        elif isinstance(recording, Mapping):
            allowed = ("t", *COLUMN.values(), *(BASE_COLUMNS if spec.floating_base else ()))
            arrays = checked_arrays(recording, len(joints), f"{role}{k}", allowed)
            sources.append(mapping_of_arrays(arrays, joints, f"{role}{k}"))
            hashes[f"{role}{k}"] = hash_of_arrays(arrays)
        elif isinstance(recording, (str, os.PathLike)):
            mapping = open_log(recording, skip_truncated=skip_truncated_line)
            if check:
                check_robot(mapping, spec)
            sources.append(mapping)
            files[f"{role}{k}"] = Path(recording)
            files |= {f"{role}{k}.{source.name}": Path(source.path) for source in mapping.files}
            names += [source.path.name for source in mapping.files]
            identities[f"{role}{k}"] = _positions_of(mapping)
        else:
            raise _foreign_recording(f"{role} {k}", recording)
    if not sources:
        raise InputError("there is no recording")
    identities |= {name: (digest,) for name, digest in hashes.items()}
    _refuse_repetition(identities, files)
    if not floating and any(source.floating for source in sources):
        raise InputError(
            "the recording has the motion of a floating base, which rrrgen identify takes; this study is for a base at "
            "rest"
        )
    return RecordingInputs(tuple(sources), files, {"arrays": hashes} if hashes else {}, tuple(names), identities)


def _foreign_recording(what: str, recording: Any) -> InputError:
    """The error for a ``recording`` of a type that is not read."""
    taken = f"{what} is of type {type(recording).__name__}, not a file, a Log or arrays by name"
    arrays = "{'t': frame['t'], 'q': frame[['q_1', 'q_2']], 'tau': frame[['tau_1', 'tau_2']]}"
    return InputError(f"{taken}: give columns of a data frame as {arrays}" if _is_data_frame(recording) else taken)


def _is_data_frame(data: Any) -> bool:
    """Whether ``data`` is a table of columns by name, as of pandas or polars, but no mapping."""
    return not isinstance(data, Mapping) and hasattr(data, "columns") and hasattr(data, "__getitem__")


def _positions_of(mapping: LogMapping) -> Identity:
    """Files and columns of the positions: those of another recording are others, however its mapping is called."""
    sources = {source.name: source for source in mapping.files}
    places: list[tuple[object, ...]] = []
    for channel in mapping.channels("position"):
        source = sources.get(channel.file)
        file = () if source is None else (source.path.resolve(), source.topic)
        places.append((*file, channel.column, channel.value))
    return tuple(places)


def _refuse_repetition(identities: Mapping[str, Identity], files: Mapping[str, Path]) -> None:
    """Raise InputError for a recording that is given twice: its noise would count as two independent observations.

    ``identities`` are those of the recordings by their role, such as ``log2``; ``files`` those that come from one.
    """
    first: dict[Identity, str] = {}
    for name, identity in identities.items():
        if identity in first:
            known, again = (files.get(role, Path(role)) for role in (first[identity], name))
            same = name in files and known.resolve() == again.resolve()
            given = f"{again} is given" if same else f"{known} and {again} are one recording, given"
            raise InputError(f"{given} twice: its noise would count as independent, and deviations come out too small")
        first[identity] = name


def shared_recording(one: RecordingInputs, other: RecordingInputs) -> str | None:
    """Name of the first recording of ``other`` that ``one`` has, too: its file, or its role if it is none; or None."""
    known = set(one.identities.values())
    shared = (str(other.files.get(name, name)) for name, identity in other.identities.items() if identity in known)
    return next(shared, None)


def single_recording(recording: RecordingSource, *, skip_truncated_line: bool = False) -> RecordingInputs:
    """Find out how one ``recording`` is read without a robot; the joints of arrays are called q1, q2, ..."""
    if isinstance(recording, Log):
        return RecordingInputs((recording,), {}, {"arrays": {"log": hash_of_arrays(_arrays_of_log(recording))}}, ())
    if isinstance(recording, Mapping):
        shape = np.shape(recording.get("q", ()))
        joints = tuple(f"q{i + 1}" for i in range(shape[1] if len(shape) == 2 else 1))
        arrays = checked_arrays(recording, len(joints), "log")
        mapping = mapping_of_arrays(arrays, joints, "log")
        return RecordingInputs((mapping,), {}, {"arrays": {"log": hash_of_arrays(arrays)}}, ())
    if not isinstance(recording, (str, os.PathLike)):
        raise _foreign_recording("the recording", recording)
    mapping = open_log(recording, skip_truncated=skip_truncated_line)
    files = {"log": Path(recording)} | {source.name: Path(source.path) for source in mapping.files}
    return RecordingInputs((mapping,), files, {}, tuple(source.path.name for source in mapping.files))


def checked_arrays(
    arrays: Mapping[str, Any],
    joints: int,
    name: str,
    allowed: Sequence[str] = ("t", *COLUMN.values()),
    needed: Sequence[str] = ("t", "q"),
) -> dict[str, Array]:
    """The arrays of a recording as numbers; raises :class:`InputError` listing every missing, unknown or misshapen one.

    ``t`` is (N,), s or points in time, those of a floating base have 4 or 6 columns, all others (N, joints), or (N,)
    for one joint. Masked values are missing: NaN. Twist and orientation of a base go together. ``allowed`` are the
    names of arrays that a recording of this kind may have, ``needed`` those that it must have.
    """
    faults = []
    signals: dict[str, Array] = {}
    for key, values in arrays.items():
        if key not in allowed:
            hint = " ".join(filter(None, (did_you_mean(str(key), allowed), f"there are {', '.join(allowed)}")))
            faults.append(Fault("", 0, 0, f"{name} has an array '{key}', which no recording has", hint=hint))
        elif values is not None:
            try:
                signals[key] = _real_numbers(key, values)
            except InputError as error:
                faults.append(Fault("", 0, 0, f"{name}: {error}"))
            except (TypeError, ValueError):
                faults.append(Fault("", 0, 0, f"{name}: '{key}' does not hold numbers"))
    base = ("orientation", "twist") if signals.keys() & BASE_COLUMNS.keys() else ()
    missing = [f"'{key}'" for key in (*needed, *base) if key not in arrays]
    if missing:
        faults.append(Fault("", 0, 0, f"{name} has no {' and no '.join(missing)}"))
    if "t" in signals:
        rows = signals["t"].size
        if signals["t"].ndim != 1:
            faults.append(Fault("", 0, 0, f"{name}: 't' has the shape {signals['t'].shape}, not (N,)"))
        for key in signals.keys() - {"t"}:
            width = len(BASE_COLUMNS.get(key, ())) or joints
            if width == 1 and signals[key].ndim == 1:
                signals[key] = signals[key][:, None]
            if signals[key].shape != (rows, width):
                faults.append(Fault("", 0, 0, f"{name}: '{key}' has the shape {signals[key].shape}, not {rows, width}"))
    if faults:
        raise InputError(faults)
    return signals


def _real_numbers(key: str, values: Any) -> Array:
    """The array ``key`` of a recording as numbers, NaN where masked, and points in time as seconds from the first.

    Raises :class:`InputError` for points in time that are missing or not ``t``, TypeError or ValueError for what is no
    array of real numbers.
    """
    masked: np.ma.MaskedArray[Any, Any] = np.ma.asarray(values)
    array = masked.data
    if array.dtype.kind in "Mm":
        return _seconds(key, masked.filled(array.dtype.type("NaT")))
    if array.dtype == object and array.size and all(isinstance(x, (datetime, timedelta)) for x in array.flat):
        return _seconds(key, array)
    if array.dtype.kind == "c":
        raise TypeError(f"'{key}' holds complex numbers")
    if isinstance(values, np.ma.MaskedArray):
        return np.where(np.ma.getmaskarray(values), np.nan, array.astype(float))
    return np.asarray(values, float)


def _seconds(key: str, points: NDArray[Any]) -> Array:
    """Seconds from the first of ``points`` in time, or spans of time, of NumPy or Python."""
    if key != "t":
        raise InputError(f"'{key}' holds points in time ({points.dtype}), which only t may")
    if points.dtype == object:
        # a difference of times of day in one time zone would ignore that clocks are put forward and back
        utc = [x.astimezone(UTC) if isinstance(x, datetime) and x.tzinfo is not None else x for x in points.flat]
        seconds = np.array([(x - utc[0]).total_seconds() for x in utc]).reshape(points.shape)
    else:
        unit = np.datetime_data(points.dtype)[0]
        if unit in ("Y", "M", "generic"):
            raise InputError(f"'t' counts in {unit}, which is no fixed time: state it in seconds, or as datetime64[ns]")
        seconds = (points - points.ravel()[:1]) / np.timedelta64(1, "s")
    missing = np.flatnonzero(np.isnan(seconds))
    if len(missing):
        raise InputError(f"'t' has no time (NaT) in row {missing[0]}")
    return seconds


def mapping_of_arrays(arrays: Mapping[str, Array], joints: Sequence[str], name: str) -> LogMapping:
    """The mapping by which ``arrays`` in SI at the ``joints`` are read as if they stood in a file called ``name``.

    So they pass the same checks and repairs: rows out of order, holes, jitter, clipped and missing torques.
    """
    columns = {"t": arrays["t"]}
    channels = []
    for i, joint in enumerate(joints):
        joint_arrays = {key: values for key, values in arrays.items() if key not in ("t", *BASE_COLUMNS)}
        columns |= {f"{key}_{joint}": values[:, i] for key, values in joint_arrays.items()}
        recorded: dict[Any, Any] = {
            signal: Channel(name, f"{COLUMN[signal]}_{joint}") for signal in SIGNALS if COLUMN[signal] in arrays
        }
        channels.append(JointChannels(joint, **recorded))
    base: dict[str, list[Channel]] = {}
    for key in arrays.keys() & BASE_COLUMNS.keys():
        names = [f"{key}_{part}" for part in BASE_COLUMNS[key]]
        columns |= dict(zip(names, arrays[key].T, strict=True))
        base[key] = [Channel(name, column) for column in names]
    source, time = FileSource(name, Path(name), arrays=columns), TimeSource(file=name, column="t")
    mapping = LogMapping((source,), time, tuple(channels))
    return on_floating_base(mapping, base) if base else mapping


def _arrays_of_log(log: Log) -> dict[str, Array]:
    signals = {name: getattr(log, name) for name in (*COLUMN.values(), "valid", "segment")}
    return {"t": log.t, "period": np.array(log.period)} | {k: v for k, v in signals.items() if v is not None}


def hash_of_arrays(arrays: Mapping[str, Array]) -> str:
    """SHA-256 of arrays with their names and shapes: a run folder must not mix recordings that were given as arrays."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name], "<f8")
        digest.update(f"{name} {values.shape} ".encode())
        digest.update(values.tobytes())
    return digest.hexdigest()


def chosen_processing(mappings: Iterable[LogMapping], options: MotionOptions) -> Processing:
    """Combine the preprocessing settings of the mapping files with the options of the study, which win.

    Settings that neither states are chosen later from the bandwidth of the motion. Raises OptionError for options that
    contradict each other or a mapping file, InputError for mapping files that contradict each other.
    """
    given = {name: getattr(options, name, None) for name in ("method", "cutoff", "decimate", "low_speed")}
    named: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    settings: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for mapping in mappings:
        for name, value in mapping.processing.items():
            if name not in named and settings.setdefault(name, value) != value:
                raise InputError(
                    f"{sources[name]} and {mapping.source} disagree on {name} of their processing, but recordings "
                    f"that are used together must be processed alike: make them agree, or set {option_name(name)}"
                )
            sources.setdefault(name, mapping.source)
    cutoff = options.cutoff
    if cutoff is not None and options.method is None:
        method = settings.setdefault("method", "butterworth")
        if method != "butterworth":
            where = f"{sources['method']} says {method}"
            raise OptionError(f"{{cutoff}} belongs to the Butterworth filter, and {where}: add {{method}} butterworth")
    method = named.get("method", settings.get("method", "kalman"))
    if method not in METHODS_OF_SETTING["cutoff"] and cutoff is not None:
        raise OptionError(f"{{cutoff}} belongs to {{method}} butterworth, not to {method}")
    # if the options name another method, the mapping file's settings of its own method are dropped
    settings = {name: value for name, value in settings.items() if method in METHODS_OF_SETTING.get(name, (method,))}
    return Processing(**{**settings, **named})


# ------------------------------------------------------------------------------------------------------------------
# Recordings of a loop for its frequency response, from a response file or from arrays.
# ------------------------------------------------------------------------------------------------------------------

ResponseSource = str | os.PathLike[str] | Mapping[str, Any] | Sequence[Mapping[str, Any]]
"""A response file, arrays by name (``t``, ``n``, ``u``, ``q``, (N,) each), or a list of these: realisations."""


@dataclass(frozen=True, eq=False)
class ResponseInput:
    """A ``response`` file or what it would say of arrays, the ``files`` read by role, and the hashes of arrays."""

    response: ResponseFile
    files: dict[str, Path]
    settings: dict[str, Any]


def response_input(data: ResponseSource) -> ResponseInput:
    """Find out how recordings of a loop are read; raises :class:`InputError` for a faulty file or arrays."""
    if isinstance(data, (str, os.PathLike)):
        response = load_response(data)
        files = {f"file {source.name}": Path(source.path) for source in response.files}
        if not response.input.file:  # every file is a recording
            _refuse_repetition({name: (path.resolve(),) for name, path in files.items()}, files)
        return ResponseInput(response, {"log": Path(data)} | files, {})
    recordings = [data] if isinstance(data, Mapping) or _is_data_frame(data) else list(data)
    sources, hashes = [], {}
    for k, recording in enumerate(recordings, start=1):
        name = f"recording{k}"
        if not isinstance(recording, Mapping):
            raise InputError(f"recording {k} is of type {type(recording).__name__}, not arrays by name")
        arrays = checked_arrays(recording, 1, name, allowed=("t", "n", "u", "q"), needed=("t", "u", "q"))
        hashes[name] = hash_of_arrays(arrays)
        columns = {key: values.ravel() for key, values in arrays.items()}
        sources.append(FileSource(name, Path(name), arrays=columns))
    if not sources:
        raise InputError("there is no recording")
    _refuse_repetition({name: (digest,) for name, digest in hashes.items()}, {})
    excited = ["n" in (source.arrays or {}) for source in sources]
    if any(excited) and not all(excited):
        raise InputError("some recordings have the excitation 'n' and some have not")
    u, q, n = (SignalColumn("", key) for key in ("u", "q", "n"))
    response = ResponseFile(tuple(sources), TimeSource(column="t"), u, q, n if all(excited) else None)
    return ResponseInput(response, {}, {"arrays": hashes})


# ------------------------------------------------------------------------------------------------------------------
# The recorded control loop as an input of a study: its controller file, and recordings that are only scored.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LoopInputs:
    """The ``controller`` of the recorded loop, None without one, and the recordings ``tests`` on which it is scored.

    ``files`` are the files read, by role.
    """

    controller: LoopController | None = None
    tests: RecordingInputs | None = None
    files: dict[str, Path] = field(default_factory=dict)

    def open(self) -> list[Recording]:
        """The test recordings."""
        return [] if self.tests is None else self.tests.open()


def read_loop(
    controller: Path | None, tests: Sequence[Path], spec: RobotSpec, recorded: RecordingInputs, skip_truncated: bool
) -> LoopInputs:
    """Read the ``controller`` file and the recordings ``tests``, which are scored but not fitted.

    Raises :class:`InputError` for a controller whose joints or inputs are not those of the recordings ``recorded`` and
    ``tests`` of the robot ``spec``, and for ``tests`` that are ``recorded``, which are fitted.
    """
    if controller is None:
        if tests:
            raise OptionError("{tests} scores the simulated loop: give its {controller}, too")
        return LoopInputs()
    loop = load_controller(controller)
    scored = None
    if tests:
        scored = recording_inputs(tests, spec, skip_truncated_line=skip_truncated, role="test")
        if shared := shared_recording(recorded, scored):
            raise OptionError(f"{shared} is fitted: {{tests}} are scored as recordings that were not", "tests")
    for source in (*recorded.sources, *(() if scored is None else scored.sources)):
        require_joints(loop, source.joints if isinstance(source, Log) else source.names)
        require_inputs(loop, {name for name in NEEDED if _has(source, name)})
    files = {} if scored is None else scored.files
    return LoopInputs(loop, scored, files | {"controller": controller})


def _has(source: LogMapping | Log, signal: str) -> bool:
    """Whether a recording holds a signal of the controller."""
    return getattr(source, signal) is not None if isinstance(source, Log) else source.has(signal)  # type: ignore[arg-type]
