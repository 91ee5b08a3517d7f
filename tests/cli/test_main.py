"""The command line: what it prints, what it writes, what it returns."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cli.golden_files import golden
from rrrgen.cli.commands import COMMANDS, FURTHER, GROUPS
from rrrgen.robot.file import bundled_names, load_spec

ROOT = Path(__file__).resolve().parents[2]

BAD = """schema: rrrgen/1
name: bad
convention: standrad
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {type: revolute, alpha: 0, a: 0,35, d: 0, theta: 0}
"""


def test_help_lists_every_command_with_examples_and_exit_codes(rrrgen):
    code, out, err = rrrgen("--help")
    assert (code, err) == (0, "")
    before, rest = out.split("Commands:\n")
    commands, after = rest.split("\n\n", 1)
    golden("help.txt", before + after)  # the list of commands is the table's own
    shown = [line.split()[0] for line in commands.splitlines() if line[2] != " "]
    assert shown == [path for path in COMMANDS if " " not in path and path not in FURTHER] + list(GROUPS)


def test_the_first_help_fits_24_lines_of_80_columns(rrrgen, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = rrrgen("--help")[1].splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80


def test_help_is_quick_because_nothing_heavy_is_imported():
    script = (
        "import sys; from rrrgen.cli.main import run; run(['--help']);"
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'sympy', 'numpy', 'casadi', 'scipy', 'jinja2', 'cffi',"
        " 'ruamel', 'joblib', 'matplotlib'}), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.stderr == "[]\n"


@pytest.mark.parametrize("command", [[sys.executable, "-m", "rrrgen"]])
def test_it_runs_as_a_module(command):
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == f"rrrgen, version {__import__('rrrgen').__version__}\n"
    assert done.returncode == 0


@pytest.mark.parametrize("command", ["generate pendulum -o model", "verify pendulum"])
def test_processes_end_without_a_word(command, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "rrrgen", *command.split()], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0
    assert done.stderr == ""  # for example of extensions that find leaks at the end


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["generat"], "No such command 'generat'. Did you mean 'generate'?"),
        (["gen"], "No such command 'gen'. Did you mean 'generate'?"),
        (["exite"], "No such command 'exite'. Did you mean 'experiment excite'?"),
        (["experiment", "exite"], "No such command 'exite'. Did you mean 'excite'?"),
        (["experiment", "frf"], "No such command 'frf'."),
        (["xyz"], "No such command 'xyz'."),
        (["generate"], "Missing argument 'ROBOT'."),
        (["generate", "rrr"], "Missing option '-o' / '--output'"),
        (["generate", "rrr", "-o", "x", "--real", "half"], "'half' is not one of 'double', 'float'"),
        (["show", "rrr", "--latex", "--json"], "give one of --latex and --json"),
        (["show", "rrr", "--program", "--latex"], "--program goes with --function and --json only"),
        (["show", "rrr", "--recorded"], "--recorded goes with --program"),
        (["show", "rrr", "--program", "-f", "gravit"], "no program 'gravit'; there are forward_kinematics, "),
        (["show", "rrr", "--entry", "1,1"], "--entry needs exactly one --function"),
        (["show", "pendulum", "-f", "gravity", "--entry", "2"], "'2' is none of the 1 entries of gravity"),
        (["show", "rrr", "-f", "mass_matrix", "--entry", "9,9"], "'9,9' is none of the 3 x 3 entries of mass_matrix"),
        (["show", "pendulum", "-f", "gravity", "--entry", "0"], "counted from 1"),
        (["show", "pendulum", "-f", "gravity", "--entry", "x"], "--entry"),
        (["new", "x", "--joints", "RQ"], "one letter per joint"),
    ],
)
def test_wrong_usage_returns_2_and_says_why(arguments, message, rrrgen):
    code, out, err = rrrgen(*arguments)
    assert code == 2
    assert message in err
    assert out == ""


def test_faulty_files_return_3_with_every_fault_at_its_place(rrrgen):
    Path("bad.yaml").write_text(BAD)
    for command in (["check", "bad.yaml"], ["show", "bad.yaml"], ["generate", "bad.yaml", "-o", "out"]):
        code, _, err = rrrgen(*command)
        assert code == 3
        assert "bad.yaml:3:13: error: " in err
        assert "did you mean" in err
        assert "bad.yaml:7:" in err
    assert not Path("out").exists(), "nothing is written"


@pytest.mark.parametrize("robot", ["no_such_robot", "missing.yaml", "."])
def test_robots_that_are_not_there_return_3(robot, rrrgen):
    code, out, err = rrrgen("show", robot)
    assert code == 3
    assert robot in err
    assert "Traceback" not in out + err


def test_check_as_json(rrrgen):
    Path("bad.yaml").write_text(BAD)
    code, out, err = rrrgen("check", "pendulum", "bad.yaml", "--json")
    assert code == 3
    assert err == ""
    good, bad = json.loads(out)
    assert good["ok"]
    assert good["summary"] == "pendulum, 1 joints, standard DH"
    assert not bad["ok"]
    assert {fault["line"] for fault in bad["faults"]} == {3, 7}


def test_robots_lists_all_and_tells_their_joints(rrrgen):
    code, out, _ = rrrgen("robots")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines() if line[0] != " "] == list(bundled_names())
    _, out, _ = rrrgen("robots", "--json")
    rows = {row["name"]: row for row in json.loads(out)}
    assert rows["stanford"]["joints"] == "RRPRRR"
    assert all(row["source"] for row in rows.values())


def test_show_prints_the_robot_back(rrrgen):
    code, out, _ = rrrgen("show", "pendulum")
    assert code == 0
    described, _, rest = out.partition("Operations of the emitted functions\n")
    golden("show_pendulum.txt", described)
    assert "  inverse_dynamics " in rest
    assert "M[1] = Izz1R" in rest


def test_show_a_program(rrrgen):
    code, out, _ = rrrgen("show", "planar2r", "-f", "gravity", "-f", "mass_matrix_nominal", "--program")
    assert code == 0
    gravity, mass = out.split("\n\n")
    assert gravity.startswith("gravity: Gravity torques.\n  g = dU/dq\n  in   q     (2)  rad  position")
    assert gravity.endswith("\n  operations: 6 mul, 4 add, 2 sincos")
    assert mass.startswith("mass_matrix_nominal: ")
    code, out, _ = rrrgen("show", "planar2r", "-f", "gravity", "--program", "--json")
    assert json.loads(out) == {"programs": {"gravity": [gravity + "\n"]}}


def test_show_programs_before_any_pass(rrrgen):
    code, out, _ = rrrgen("show", "planar2r", "-f", "inverse_dynamics", "--program", "--recorded")
    assert code == 0
    ways = out.split("\n\n")
    assert len(ways) == 2
    assert all(way.startswith("inverse_dynamics: Joint torques") for way in ways)
    assert rrrgen("show", "planar2r", "-f", "gravity_nominal", "--program", "--recorded")[0] == 2  # the passes make it


def test_show_as_latex_and_single_entries(rrrgen):
    code, out, _ = rrrgen("show", "planar2r", "-f", "gravity", "--latex")
    assert code == 0
    assert "\\begin{align*}" in out
    code, out, _ = rrrgen("show", "planar2r", "-f", "energy")
    assert code == 0
    assert re.findall(r"^energy\.(\w+)", out, re.M) == ["kinetic", "potential"]  # every result
    code, out, _ = rrrgen("show", "planar2r", "-f", "mass_matrix", "--entry", "1,2")
    assert code == 0
    assert "mass_matrix[1,2]" in out
    code, _, err = rrrgen("show", "pendulum", "-f", "forward_dynamics")
    assert code == 4
    assert "no closed form of 'forward_dynamics'" in err


def test_show_and_verify_write_the_html_report_and_touch_nothing_else(rrrgen):
    assert rrrgen("generate", "pendulum", "-o", "out", "--no-casadi-files")[0] == 0
    before = {path.name for path in Path("out").iterdir()}
    assert rrrgen("show", "pendulum", "--html", "out/pendulum.html")[0] == 0
    assert {path.name for path in Path("out").iterdir()} == before | {"pendulum.html"}
    shown = Path("out/pendulum.html").read_text(encoding="utf-8")
    assert "<math" in shown
    assert "Newton-Euler" not in shown
    code, out, _ = rrrgen("verify", "pendulum", "--backend", "numpy", "--samples", "5", "--html", "verified.html")
    assert (code, out.splitlines()[-1]) == (0, "pendulum: all comparisons pass (5 states, seed 0)")
    assert "Newton-Euler (built in)" in Path("verified.html").read_text(encoding="utf-8")
    code, _, err = rrrgen("show", "pendulum", "--html", "out/pendulum.html/report.html")
    assert code == 5
    assert "cannot write" in err


def test_show_as_json_holds_what_the_text_holds(rrrgen):
    code, out, _ = rrrgen("show", "planar2r", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["convention"] == "standard"
    assert len(content["joints"]) == 2
    assert len(content["base_parameters"]) == 6
    assert len(content["closed_forms"]["mass_matrix"]) == 2
    assert content["operations"]["inverse_dynamics"]["mul"] > 0


def test_generate_writes_checks_and_notices_changes(rrrgen):
    code, out, err = rrrgen("generate", "pendulum", "-o", "out", "--no-casadi-files")
    assert (code, err) == (0, "")
    assert "pendulum: 1 joints, 3 base parameters" in out
    names = sorted(str(path.relative_to("out")) for path in Path("out").rglob("*") if path.is_file())
    assert names == sorted([*json.loads(Path("out/manifest.json").read_text())["files"], "manifest.json"])
    assert rrrgen("generate", "pendulum", "-o", "out", "--check")[:2] == (0, "out is up to date\n")
    header = Path("out/pendulum.h")
    header.write_text(header.read_text().replace("PENDULUM_N 1", "PENDULUM_N 2"))
    before = header.read_text()
    code, out, _ = rrrgen("generate", "pendulum", "-o", "out", "--check")
    assert code == 1
    assert "-#define PENDULUM_N 2 /* joints */\n+#define PENDULUM_N 1 /* joints */\n" in out
    assert header.read_text() == before
    code, out, _ = rrrgen("generate", "pendulum", "-o", "out", "--check", "--json")
    assert code == 1
    assert json.loads(out)["up_to_date"] is False
    assert rrrgen("generate", "pendulum", "-o", "nowhere", "--check")[0] == 1
    assert not Path("nowhere").exists()


def test_generate_with_another_language(rrrgen, tmp_path):
    place = str(tmp_path / "pendulum")
    assert rrrgen("generate", "pendulum", "-o", place, "--with", "rust", "--no-casadi-files")[0] == 0
    assert "pub fn gravity" in (tmp_path / "pendulum/rust/src/lib.rs").read_text(encoding="utf-8")
    assert rrrgen("generate", "pendulum", "-o", place, "--with", "rust", "--check")[0] == 0
    code, out, _ = rrrgen("generate", "pendulum", "-o", place, "--check")
    assert code == 1
    assert "--- a/rust/src/lib.rs" in out
    code, _, err = rrrgen("generate", "pendulum", "-o", place, "--with", "fortran")
    assert code == 2
    assert "'fortran' is not known; allowed are " in err
    words = "control, controller, cpp, elastic, gravity, hessian, javascript, observer, points, rust, tensors, timing, "
    assert words + "trajectory" in err


def test_generate_as_json_with_messages_on_stderr(rrrgen):
    code, out, err = rrrgen("generate", "pendulum", "-o", "out", "--real", "float", "--json", "-v", "--no-casadi-files")
    assert code == 0
    content = json.loads(out)
    assert "pendulum.c" in content["files"]
    assert content["operations"]["gravity"]["sincos"] == 1
    assert re.search(r"\d+ files in [\d.]+ s", err)
    assert "typedef float pendulum_real;" in Path("out/pendulum.h").read_text()


def test_verify_prints_a_table_and_a_verdict(rrrgen):
    code, out, _ = rrrgen("verify", "pendulum", "--samples", 20, "--no-libraries", "--backend", "numpy")
    assert code == 0
    assert "all comparisons pass" in out
    code, out, _ = rrrgen("verify", "pendulum", "--samples", 20, "--no-libraries", "--json")
    assert code == 0
    assert json.loads(out)["ok"] is True


def test_verify_returns_1_when_the_model_is_wrong(rrrgen, monkeypatch):
    from rrrgen.runtime.model import Model

    original = Model.gravity
    monkeypatch.setattr(Model, "gravity", lambda *args, **options: -original(*args, **options))
    code, out, _ = rrrgen("verify", "pendulum", "--samples", 5, "--no-libraries", "--backend", "numpy")
    assert code == 1
    assert "FAIL" in out


def test_without_a_compiler_verify_returns_5_and_says_what_to_install(rrrgen, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("rrrgen.emit.c.compilers.is_installed", lambda module: False)  # of PyPI, zig
    code, _, err = rrrgen("verify", "pendulum")
    assert code == 5
    assert "apt install gcc" in err


@pytest.mark.parametrize("joints", ["R", "RP", "RRR", "PPP", "RRPRRR"])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_new_files_are_valid_and_checked(joints, convention, rrrgen):
    code, out, _ = rrrgen("new", "mine", "--joints", joints, "--convention", convention)
    assert code == 0
    assert "rrrgen check mine.yaml" in out
    spec = load_spec("mine.yaml")
    assert "".join("R" if joint.is_revolute else "P" for joint in spec.joints) == joints
    assert spec.convention == convention
    assert spec.faults == ()
    assert rrrgen("check", "--strict", "mine.yaml")[0] == 0


def test_new_copies_a_bundled_robot_and_overwrites_nothing(rrrgen):
    assert rrrgen("new", "arm", "--from", "ur5", "-o", "a.yaml")[0] == 0
    assert load_spec("a.yaml").name == "arm"
    code, _, err = rrrgen("new", "arm", "-o", "a.yaml")
    assert code == 3
    assert "--force overwrites" in err
    assert rrrgen("new", "arm", "-o", "a.yaml", "--force")[0] == 0
    assert load_spec("a.yaml").n == 3
    assert rrrgen("new", "class")[0] == 3
    assert rrrgen("new", "arm", "--from", "nothing")[0] == 3
    assert rrrgen("new", "arm", "-o", "new/folder/arm.yaml")[0] == 0
    assert load_spec("new/folder/arm.yaml").name == "arm"


def test_schema_accepts_the_bundled_robots(rrrgen):
    code, out, _ = rrrgen("schema")
    assert code == 0
    assert json.loads(out)["title"] == "rrrgen robot"


def test_more_samples_than_the_memory_holds_are_no_fault_of_rrrgen(rrrgen):
    code, _, err = rrrgen("verify", "pendulum", "--backend", "numpy", "--samples", 10**14)
    assert code == 5
    assert "the memory is too small: Unable to allocate " in err
    assert "Ask for fewer samples" in err


def test_interrupts_and_faults_of_our_own_are_told_apart(rrrgen, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    def broken(*_, **__):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("rrrgen.derive.derive_once", interrupted)
    code, out, err = rrrgen("show", "pendulum")
    assert (code, out, err.strip()) == (130, "", "interrupted")
    monkeypatch.setattr("rrrgen.derive.derive_once", broken)
    code, _, err = rrrgen("show", "pendulum")
    assert code == 70
    assert "internal fault of rrrgen, please report it: ZeroDivisionError: division by zero (in broken" in err
    assert "Traceback" not in err
    monkeypatch.setenv("RRRGEN_DEBUG", "1")
    assert "Traceback" in rrrgen("show", "pendulum")[2]


def test_a_closed_pipe_is_no_fault():
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "rrrgen", "schema"], stdout=writer, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    os.close(writer)
    assert done.stderr == ""
    assert done.returncode == 0


def test_shell_completion_offers_commands_and_robots(monkeypatch):
    environment = {**os.environ, "_RRRGEN_COMPLETE": "bash_complete", "COMP_CWORD": "2", "COMP_WORDS": "rrrgen show pe"}
    script = "from rrrgen.cli import main; main(prog_name='rrrgen')"
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, cwd=ROOT)
    assert "plain,pendulum" in done.stdout
