"""Options of a study: described once, checked in Python, and the same on the command line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import click
import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.options import (
    OptionError,
    PreprocessingOptions,
    StudyOptions,
    group,
    option,
    option_fields,
    with_changes,
)


@dataclass(frozen=True)
class Shared(StudyOptions):
    """Options of a group."""

    cutoff: float | None = option(None, "Frequency; implies {kind} low.", unit="Hz", above=0)


@dataclass(frozen=True)
class Sample(StudyOptions):
    """Options of a study that does not exist."""

    filters: Shared = group(Shared)
    kind: Literal["low", "high"] | None = option(None, "Which pass.")
    count: int = option(3, "How many.", least=1, flags=("-n", "--count"), shown=True)
    known: tuple[str, ...] = option((), "Known values.", metavar="NAME=VALUE")
    files: tuple[Path, ...] = option((), "Files.", flags=("--file",))
    strict: bool = option(True, "Be strict.")
    quick: bool = option(False, "Be quick.")
    inner: int = option(7, "Python only.", command=False)


def test_changes_reach_the_options_of_a_group():
    changed = with_changes(Sample, Sample(count=4), {"cutoff": 5, "kind": "low"})
    assert changed == Sample(filters=Shared(cutoff=5.0), count=4, kind="low")


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("my2=0", ("my2=0",)),
        (["my2=0", "mx1=2"], ("my2=0", "mx1=2")),
        ({"my2": 0, "mx1": np.float64(0.1)}, ("my2=0.0", "mx1=0.1")),
    ],
)
def test_one_text_is_one_entry_and_a_mapping_gives_name_and_value(given, kept):
    assert Sample(known=given).known == kept


def test_numbers_of_numpy_are_numbers():
    assert Sample(count=np.int64(2), strict=np.bool_(False)) == Sample(count=2, strict=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cout": 2}, "no option 'cout'; did you mean 'count'"),
        ({"kind": "hihg"}, "kind is 'hihg'; did you mean 'high'"),
        ({"count": 0}, "count is 0, but must be at least 1"),
        ({"count": 2.5}, "count is 2.5, not a whole number"),
        ({"count": True}, "count is True, not a whole number"),
        ({"cutoff": 0}, "cutoff is 0 Hz, but must be above 0 Hz"),
        ({"cutoff": float("nan")}, "cutoff is nan, not a finite number"),
        ({"strict": "no"}, "strict is 'no', not True or False"),
        ({"files": [3]}, "files is 3, not the path of a file"),
    ],
)
def test_values_that_are_not_allowed_are_refused(changes, message):
    with pytest.raises(OptionError, match=message) as caught:
        with_changes(Sample, None, changes)
    assert isinstance(caught.value, ValueError)


def test_all_faults_are_told_at_once():
    with pytest.raises(OptionError) as caught:
        Sample(count=0, strict=2)
    assert str(caught.value).splitlines() == ["count is 0, but must be at least 1", "strict is 2, not True or False"]


def test_options_of_another_study_are_refused():
    with pytest.raises(OptionError, match="Shared, not Sample"):
        with_changes(Sample, Shared(), {})


@click.command()
@click_options(Sample)
def command(options):
    if options.quick:
        raise OptionError("{quick} needs {count}, and {unknown}")
    if "x" in options.known:
        raise OptionError("'x' is not NAME=VALUE", "known")
    click.echo(repr(options))


def test_a_command_makes_the_same_options():
    given = ["-n", "2", "--known", "a=1", "--known", "b=2", "--file", "f", "--no-strict", "--cutoff", "3"]
    result = CliRunner().invoke(command, given)
    wanted = with_changes(
        Sample, None, {"count": 2, "known": {"a": "1", "b": "2"}, "files": "f", "strict": False, "cutoff": 3}
    )
    assert result.output.strip() == repr(wanted)


def test_help_says_what_the_fields_say():
    text = CliRunner().invoke(command, ["--help"]).output
    for part in (
        "--kind [low|high]",
        "--cutoff HZ",
        "implies --kind low",
        "-n, --count",
        "default: 3",
        "--strict / --no",
    ):
        assert part in text
    assert "inner" not in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--quick"], "Error: --quick needs --count, and unknown"),
        (["--known", "x"], "Invalid value for --known: 'x' is not NAME=VALUE"),
        (["--count", "0"], "0 is not in the range x>=1"),
    ],
)
def test_a_command_shows_flags(arguments, message):
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == 2
    assert message in result.output


def test_the_docstring_lists_every_option():
    for entry in option_fields(rrrgen.IdentifyOptions):
        assert entry.group or f"``{entry.name}``" in rrrgen.IdentifyOptions.__doc__


def test_low_speeds_are_not_negative():
    assert PreprocessingOptions(low_speed=(0.0, 0.1)).low_speed == (0.0, 0.1)
    with pytest.raises(OptionError, match="low_speed is -1, but must be at least 0"):
        PreprocessingOptions(low_speed=(0.1, -1))
