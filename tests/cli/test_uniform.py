"""What is alike in every command: options, exit codes, standard input, tables, completion; and the first pages."""

from __future__ import annotations

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.shell_completion import ShellComplete

from rrrgen.cli.commands import COMMANDS, load_command
from rrrgen.cli.main import cli, run
from rrrgen.robot.file import bundled_path
from rrrgen.robot.file.fields import EMIT
from rrrgen.verify.report import Report, Row

ROOT = Path(__file__).resolve().parents[2]
INSTALLATION = (ROOT / "docs/installation.md").read_text(encoding="utf-8")
QUICK_START = (ROOT / "docs/quick-start.md").read_text(encoding="utf-8")

SHORT = {"--jobs": "-j", "--verbose": "-v", "--output": "-o", "--function": "-f"}
"""Options that have the same short name in every command."""


def commands() -> dict[str, click.Command]:
    return {path: load_command(path) for path in COMMANDS}


@pytest.fixture
def rrrgen(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "")

    def call(*arguments: object, stdin: bytes = b""):
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def test_options_of_one_name_have_one_short_name():
    seen = set()
    for name, command in commands().items():
        for option in command.params:
            for long in set(option.opts) & set(SHORT):
                seen.add(long)
                assert SHORT[long] in option.opts, f"{name} {long}"
    assert seen == set(SHORT)


def test_check_reads_the_standard_input(rrrgen):
    code, out, _ = rrrgen("check", "-", stdin=bundled_path("scara").read_bytes())
    assert (code, out) == (0, "-: ok (scara, 4 joints, standard DH)\n")
    code, out, err = rrrgen("check", "-", stdin=b"name: 5x\n")
    assert code == 3
    assert "<stdin>:1:7: error: " in err


def test_every_robot_may_come_from_the_standard_input(rrrgen):
    code, out, _ = rrrgen(
        "ik", "-", "--backend", "numpy", "--pose", "0.3 0.2 0", stdin=bundled_path("planar2r").read_bytes()
    )
    assert code == 0
    assert "q1 [rad]" in out


@pytest.mark.parametrize(
    "arguments",
    [
        ["generate", "pendulum", "-o", "file/below"],
        ["new", "arm", "-o", "file/arm.yaml"],
        ["show", "pendulum", "--html", "file/report.html"],
    ],
)
def test_output_that_cannot_be_written_is_no_bad_input(arguments, rrrgen):
    Path("file").write_text("")
    code, _, err = rrrgen(*arguments)
    assert code == 5
    assert "cannot write" in err
    assert arguments[-1].split("/")[0] in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("new arm --from ur5 --joints RR", "--joints: has no effect with --from"),
        ("calibrate ur5 --choose 9 --robust --json", "--robust, --json: has no effect with --choose"),
        ("calibrate ur5 --poses file.csv --kind height", "--kind: goes with --choose"),
        ("certify --check . --speed 3 -j 1", "--speed, --jobs: has no effect with --check"),
        ("certify rrr --check . -o here", "--output: has no effect with --check"),
        ("verify rrr --backend numpy --real float", "--real float belongs to --backend c"),
        ("response vibration --mode 9:.1 --rate 1000 -o v --band 1 2", "--band: chooses among the modes of MODEL"),
        ("response vibration model.json -o v --no-notch --peak 2", "--peak: describes notches, and none is designed"),
        ("response vibration model.json -o v --width .5 --peak 2", "--peak: has no effect with --width"),
        ("response vibration model.json -o v --band 60 10", "--band: 60 10 is in the reverse order"),
        ("response vibration model.json -o v --shaper none --tolerance .1", "--tolerance: is that of a shaper"),
    ],
)
def test_options_that_would_have_no_effect_are_refused(arguments, said, rrrgen):
    """They were ignored without a word."""
    code, out, err = rrrgen(*arguments.split())
    assert (code, out) == (2, "")
    assert said in " ".join(err.split())
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e999"])
def test_options_that_are_real_numbers_take_no_others(word, rrrgen):
    """A rate that is NaN passed for one above 0 and ended as an internal fault."""
    options = [option for command in commands().values() for option in command.params]
    numbers = [option for option in options if isinstance(option.type, click.types.FloatParamType)]
    assert len(numbers) > 40
    for option in numbers:
        with pytest.raises(click.BadParameter, match=r"is no finite number|not in the range"):
            option.type.convert(word, option, None)


def test_seeds_are_not_negative():
    """They ended as internal faults: NumPy takes none that is."""
    options = [option for command in commands().values() for option in command.params if "--seed" in option.opts]
    assert len(options) > 7
    for option in options:
        with pytest.raises(click.BadParameter, match="not in the range"):
            option.type.convert("-1", option, None)


def test_exit_codes_are_documented_alike():
    """Every exit code of an error, the check that fails, usage and the interrupt stand in the help and on the page."""
    from rrrgen.base import errors
    from rrrgen.cli.main import EVERYTHING, INTERRUPTED

    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.RrrgenError)]
    codes = {0, 1, 2, INTERRUPTED, *(kind.exit_code for kind in kinds)}
    listed = " ".join(re.search(r"[Ee]xit codes: ([^.]*)\.", EVERYTHING)[1].split())
    assert {int(number) for number in re.findall(r"(?:^|, )(\d+) ", listed)} == codes
    table = INSTALLATION
    assert {int(number) for number in re.findall(r"^\| (\d+) \|", table, re.M)} == codes


def test_the_help_of_generate_fits_one_screen_and_the_long_one_describes_every_option(rrrgen, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    short, whole = (rrrgen("generate", flag)[1] for flag in ("--help", "--help-all"))
    assert len(short.splitlines()) <= 44
    flags = {
        max(option.opts, key=len) for option in load_command("generate").params if isinstance(option, click.Option)
    }
    assert all(re.search(rf"^  (?:-\w, )?{flag}\b", whole, re.M) for flag in flags)
    assert all(flag in short.replace("-\n  ", "-") for flag in flags)
    assert all(re.search(rf"^  {word} +\S", short, re.M) for word in EMIT)


def test_words_after_commas_are_completed():
    (context,) = [ShellComplete(cli, {}, "rrrgen", "_RRRGEN_COMPLETE")]
    words = ["generate", "rrr", "--with"]
    assert [item.value for item in context.get_completions(words, "control,gra")] == ["control,gravity"]
    every = {item.value for item in context.get_completions(words, "rust,")}
    assert {"rust,cpp", "rust,urdf"} <= every
    assert "rust,rust" not in every


def test_targets_are_completed():
    found = ShellComplete(cli, {}, "rrrgen", "_RRRGEN_COMPLETE").get_completions(["export", "rrr", "--to"], "m")
    assert [item.value for item in found] == ["matlab", "mjcf"]


def test_functions_are_completed():
    (context,) = [ShellComplete(cli, {}, "rrrgen", "_RRRGEN_COMPLETE")]
    found = [item.value for item in context.get_completions(["show", "rrr", "-f"], "mass")]
    assert found == ["mass_matrix"]
    every = {item.value for item in context.get_completions(["show", "rrr", "-f"], "")}
    assert {"forward_dynamics", "inverse_kinematics", "regressor"} <= every


def test_the_table_of_solutions_names_joints_and_units(rrrgen):
    code, out, _ = rrrgen(
        "ik", "scara", "--backend", "numpy", "--no-limits", "--pose", "0.4 0.1 0.25 3.141592653589793 0 0.3"
    )
    assert code == 0, out
    head, *rows = out.splitlines()[1:]
    names = re.findall(r"(\w+) \[(rad|m)\]", head)
    assert [unit for _, unit in names] == ["rad", "rad", "m", "rad"]
    ends = [match.end() for match in re.finditer(r"\]", head)]
    for row in rows:
        assert [match.end() for match in re.finditer(r"-?\d+\.\d{6}", row)] == ends  # numbers end below their heading


def test_the_verification_folds():
    rows = tuple(
        Row(f"function_{k}", "Robotics Toolbox for Python", "nominal and random", 200, 1e-15, 1e-11) for k in range(3)
    )
    rows = (
        *rows,
        replace(rows[0], note="40 solutions of 10 targets by 64 starts; the search found 40 of 40"),
    )
    missing = (
        "Robotics Toolbox",
        "not installed (pip install roboticstoolbox-python): No module named roboticstoolbox",
    )
    report = Report("arm", 200, 0, rows, (missing,))
    wide, narrow = (report.to_text(width).splitlines() for width in (None, 80))
    assert max(map(len, wide)) > 100
    assert max(map(len, narrow)) <= 80
    words = sorted(word for line in wide for word in line.split() if not word.startswith("-"))
    assert words == sorted(word for line in narrow for word in line.split() if not word.startswith("-"))


@pytest.mark.parametrize(
    "command", [["robots"], ["show", "scara"], ["generate", "pendulum", "-o", "out"]], ids=" ".join
)
def test_lines_keep_to_the_terminal(command, rrrgen, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    code, out, _ = rrrgen(*command)
    assert code == 0
    text, *_closed_forms = out.split("\nforward_kinematics (")  # equations are broken where they are laid out
    assert max(len(line) for line in text.splitlines()) <= 100


def test_the_quick_start_speaks_of_one_robot():
    """The file that is shown is the one that the commands and the C name."""
    (named,) = re.findall(r"^name: (\w+)$", QUICK_START, re.M)
    shown = set(re.findall(r"\belbow\d\b", QUICK_START, re.I))
    assert {word.lower() for word in shown} == {named}


def test_the_page_of_installation_lists_every_extra():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extra in set(project["optional-dependencies"]) - {"test", "bench"}:
        assert re.search(rf"^\| `{extra}` \|", INSTALLATION, re.M), extra
    assert "pip install" in INSTALLATION


def test_the_main_job_installs_no_extra():
    """``make`` needs the core dependencies alone; ``make test`` installs what tests need."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    needed = re.search(r"^rrr: (\w+)", text, re.M)
    assert needed
    recipe = re.search(rf"^\$\({needed[1].upper()}\):.*?\n((?:\t.*\n)+)", text, re.M)
    assert recipe
    assert "[" not in recipe[1]
    assert "-e ." in recipe[1]
