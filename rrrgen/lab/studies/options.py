"""Options of a study, described once: a frozen dataclass from which Python and the command line take their options.

A field made by :func:`option` carries its meaning, unit, range and default; one made by :func:`group` holds options
that several studies share. Python checks its arguments by these fields, and ``rrrgen.cli.study_options`` makes the
options of a command from them. Nothing here imports NumPy, so that ``rrrgen --help`` stays fast.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from rrrgen.base.errors import InputError, with_names
from rrrgen.base.yamltext.suggestions import did_you_mean

if TYPE_CHECKING:
    from rrrgen.lab.experiment.experiment_file import Experiment


OptionsType = TypeVar("OptionsType", bound="StudyOptions")


class OptionError(InputError):
    """Options that have no meaning, or contradict each other.

    Names of options stand in braces in the ``template``: ``"{guard} needs {split}"``. Python shows the names, the
    command line its flags. ``option`` is the name of the one option that is wrong, if it is only one.
    """

    def __init__(self, template: str, option: str = "") -> None:
        self.template, self.option = template, option
        super().__init__(with_names(template))

    def __reduce__(self) -> tuple[type[OptionError], tuple[str, str]]:
        return OptionError, (self.template, self.option)


@dataclass(frozen=True)
class Description:
    """What is known of an option beside its type and default.

    ``meaning`` is a sentence for users, in which ``{name}`` stands for another option, ``unit`` that of the number,
    ``least`` and ``above`` bound it from below.
    ``flags`` are those of the command, from the name if empty; ``metavar`` stands for the value in its help. ``shown``
    says that the help names the default, ``command`` that the command has the option, ``recorded`` that its value is
    among the settings of ``run.json``.
    """

    meaning: str
    unit: str = ""
    least: float | None = None
    above: float | None = None
    flags: tuple[str, ...] = ()
    metavar: str | None = None
    shown: bool = False
    command: bool = True
    recorded: bool = True


def option(default: Any, meaning: str, **more: Any) -> Any:
    """A field of a dataclass of options, with its ``default`` and ``meaning``; ``more`` as in :class:`Description`."""
    return field(default=default, metadata={"option": Description(meaning, **more)})


def group(kind: type[StudyOptions]) -> Any:
    """A field that holds the options ``kind``, which several studies share; callers name its options as their own."""
    return field(default_factory=kind, metadata={"group": kind})


@dataclass(frozen=True)
class OptionField:
    """One option of a study, also inside a group: its name, type without None, default and description."""

    name: str
    kind: Any
    default: Any
    about: Description
    group: str = ""

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that are allowed, empty unless the type is a Literal or a tuple of one."""
        kind = self.item or self.kind
        return get_args(kind) if get_origin(kind) is Literal else ()

    @property
    def item(self) -> Any:
        """Type of an entry if the option holds several, otherwise None."""
        return get_args(self.kind)[0] if get_origin(self.kind) is tuple else None


class StudyOptions:
    """Base of the dataclasses of options; a value that an option does not allow raises :class:`OptionError`."""

    def __init_subclass__(cls) -> None:
        lines = []
        inherited = getattr(cls, "__dataclass_fields__", {})
        for name, value in {**inherited, **vars(cls)}.items():
            about = getattr(value, "metadata", {}).get("option")
            if about is not None:
                unit = f" ({about.unit})" if about.unit else ""
                meaning = with_names(about.meaning, lambda other: f"``{other}``")
                lines.append(f"- ``{name}``{unit}: {meaning} Default: ``{value.default!r}``.")
            elif "group" in getattr(value, "metadata", {}):
                lines.append(f"- ``{name}``: the options of :class:`{value.metadata['group'].__name__}`.")
        cls.__doc__ = "\n".join([cls.__doc__ or "", "", *lines])

    def __post_init__(self) -> None:
        faults = []
        for entry in option_fields(type(self)):
            if not entry.group:
                try:
                    object.__setattr__(self, entry.name, option_value(entry, getattr(self, entry.name)))
                except OptionError as error:
                    faults.append(error)
        if len(faults) == 1:
            raise faults[0]
        if faults:
            raise OptionError("\n".join(error.template for error in faults))

    def settings(self) -> dict[str, Any]:
        """The recorded options that are not in a group, by name: what ``run.json`` keeps of them."""
        fields = option_fields(type(self))
        return {entry.name: getattr(self, entry.name) for entry in fields if entry.about.recorded and not entry.group}


def option_fields(kind: type[StudyOptions]) -> tuple[OptionField, ...]:
    """All options of a dataclass, those of its groups in their places."""
    fields: list[OptionField] = []
    hints = get_type_hints(kind)
    for attribute in dataclasses.fields(kind):  # type: ignore[arg-type]
        if "group" in attribute.metadata:
            inner = option_fields(attribute.metadata["group"])
            fields += [dataclasses.replace(entry, group=attribute.name) for entry in inner]
        elif "option" in attribute.metadata:
            fields.append(
                OptionField(
                    attribute.name,
                    _without_none(hints[attribute.name]),
                    attribute.default,
                    attribute.metadata["option"],
                )
            )
    return tuple(fields)


def _without_none(hint: Any) -> Any:
    """The type ``X`` of a hint ``X | None``."""
    if get_origin(hint) not in (UnionType, Union):  # Literal | None is a Union, str | None a UnionType
        return hint
    (kind,) = (part for part in get_args(hint) if part is not NoneType)
    return kind


def with_changes(kind: type[OptionsType], options: OptionsType | None, changes: Mapping[str, Any]) -> OptionsType:
    """The ``options`` of a study, or its defaults, with single options changed.

    Raises :class:`OptionError` for an option that the study does not have, or a value that it does not allow.
    """
    if options is not None and not isinstance(options, kind):
        raise OptionError(f"options is of type {type(options).__name__}, not {kind.__name__}")
    chosen = kind() if options is None else options
    fields = {entry.name: entry for entry in option_fields(kind)}
    groups = {entry.group for entry in fields.values() if entry.group}
    unknown = [name for name in changes if name not in fields and name not in groups]
    if unknown:
        known = ", ".join(fields)
        lines = [f"there is no option '{name}'; {did_you_mean(name, fields)}".rstrip("; ") for name in unknown]
        raise OptionError("\n".join([*lines, f"the options are {known}"]))
    direct = {name: value for name, value in changes.items() if name in groups or not fields[name].group}
    for name in sorted(groups):
        inside = {key: value for key, value in changes.items() if key in fields and fields[key].group == name}
        if inside:
            direct[name] = dataclasses.replace(direct.get(name, getattr(chosen, name)), **inside)
    return dataclasses.replace(chosen, **direct)  # type: ignore[type-var]


def option_value(entry: OptionField, value: Any) -> Any:
    """The ``value`` of an option in its own type; raises :class:`OptionError` for one that is not allowed."""
    if value is None and entry.default is None:
        return None
    if entry.item is not None:
        return tuple(_single(entry, entry.item, member) for member in _entries(value))
    return _single(entry, entry.kind, value)


def _entries(value: Any) -> Iterable[Any]:
    """The entries of a repeatable option: of a list, of a mapping as ``NAME=VALUE``, or a single one.

    A text is a sequence of letters to Python, but one entry to the user.
    """
    if isinstance(value, Mapping):
        return [f"{name}={_number_text(number)}" for name, number in value.items()]
    if isinstance(value, (str, os.PathLike, Real)) or not isinstance(value, Iterable):
        return [value]
    return value


def _number_text(value: Any) -> str:
    """A number so that it reads back exactly, anything else as text."""
    return repr(float(value)) if isinstance(value, Real) else str(value)


def _single(entry: OptionField, kind: Any, value: Any) -> Any:
    name = f"{{{entry.name}}}"
    if entry.choices:
        if value not in entry.choices:
            hint = did_you_mean(str(value), entry.choices)
            allowed = " ".join(filter(None, (hint, f"there are {', '.join(entry.choices)}")))
            raise OptionError(f"{name} is {value!r}; {allowed}", entry.name)
        return value
    if kind is bool:
        # numpy.bool_ is no Integral and no bool, but compares as one
        if not any(value is boolean for boolean in (True, False)) and type(value).__name__ not in ("bool", "bool_"):
            raise OptionError(f"{name} is {value!r}, not True or False", entry.name)
        return bool(value)
    if kind is Path:
        if not isinstance(value, (str, os.PathLike)):
            raise OptionError(f"{name} is {value!r}, not the path of a file", entry.name)
        return Path(value)
    if kind is str:
        if not isinstance(value, str):
            raise OptionError(f"{name} is {value!r}, not a text", entry.name)
        return value
    what, wanted = (Integral, "a whole number") if kind is int else (Real, "a finite number")
    if not isinstance(value, what) or isinstance(value, bool) or not math.isfinite(value):
        raise OptionError(f"{name} is {value!r}, not {wanted}", entry.name)
    least, above, unit = entry.about.least, entry.about.above, f" {entry.about.unit}".rstrip()
    if least is not None and value < least:
        raise OptionError(f"{name} is {value:g}{unit}, but must be at least {least:g}{unit}", entry.name)
    if above is not None and value <= above:
        raise OptionError(f"{name} is {value:g}{unit}, but must be above {above:g}{unit}", entry.name)
    return kind(value)


# ------------------------------------------------------------------------------------------------------------------
# Options of the preprocessing of recordings, which several studies share.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MotionOptions(StudyOptions):
    """How the motion is reconstructed from recorded positions; None: as the mapping file says."""

    method: Literal["butterworth", "kalman", "kalman_filter", "differences", "logged"] | None = option(
        None, "How speeds and accelerations are obtained from the positions; default kalman, a smoother."
    )
    cutoff: float | None = option(
        None,
        "Cut-off frequency of the Butterworth filter; implies {method} butterworth if no method is named.",
        unit="Hz",
        above=0,
    )


@dataclass(frozen=True)
class PreprocessingOptions(MotionOptions):
    """How recordings are processed before parameters are estimated; None: as the mapping file says."""

    decimate: int | None = option(
        None,
        "Decimation factor k: low-pass filter, then keep every k-th row; default: from the bandwidth of the motion.",
        least=1,
        metavar="K",
    )
    low_speed: tuple[float, ...] | None = option(
        None, "Rows of a joint below this speed are left out, rad/s (m/s), one number a joint.", least=0, command=False
    )


# ------------------------------------------------------------------------------------------------------------------
# Options of designed and simulated experiments, which override the sections of an experiment file.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ExperimentOptions(StudyOptions):
    """What every experiment takes from its file or from options."""

    experiment: Path | None = option(
        None,
        "Experiment file: limits, objective, writing task, virtual robot, control; other options override it.",
        metavar="FILE",
        recorded=False,
    )
    rate: float | None = option(None, "Sampling rate of the controller; default 1000.", unit="Hz", above=0)
    seed: int | None = option(None, "Seed for all random numbers; default 0.", least=0, recorded=False)

    def of_file(self, joints: int) -> Experiment:
        """The experiment file, or the defaults, for a robot of ``joints`` joints, with what the options override."""
        from dataclasses import replace

        from rrrgen.lab.experiment.experiment_file import Experiment, load_experiment

        experiment = Experiment() if self.experiment is None else load_experiment(self.experiment, joints)
        return replace(
            experiment,
            seed=experiment.seed if self.seed is None else self.seed,
            period=experiment.period if self.rate is None else 1.0 / self.rate,
        )

    def files(self) -> dict[str, Path]:
        """The experiment file by its role."""
        return {} if self.experiment is None else {"experiment": self.experiment}
