"""The playground in Chromium: first picture, dragging, faults, package, links, network cut, policy, three widths.

It needs the npm packages pyodide and playwright-core, which ``make playground`` fetches into build/npm.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import threading
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen import compile
from rrrgen.cli.main import cli
from rrrgen.cli.playground import POLICY, RUNTIME, build, compiler_files, server
from rrrgen.emit.html.playground import LARGEST, check, picture, precompute, results
from rrrgen.robot.robots import bundled_path

ROOT = Path(__file__).resolve().parents[3]
NPM = Path(os.environ.get("RRRGEN_NPM", ROOT / "build" / "npm" / "node_modules"))
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NODE = shutil.which("node")

UR5 = bundled_path("ur5").read_text(encoding="utf-8")


def missing() -> str:
    if CHROMIUM is None or NODE is None:
        return "needs Chromium and node"
    lacking = [name for name in ("pyodide", "playwright-core") if not (NPM / name).is_dir()]
    return f"needs the npm package {lacking[0]}: make playground" if lacking else ""


def test_table_cells_have_their_places_in_the_text() -> None:
    answer = check(UR5)
    assert answer["faults"] == []
    lines = UR5.split("\n")
    assert len(answer["joints"]) == 6
    for joint in answer["joints"]:
        for cell in joint.values():
            assert lines[cell["line"] - 1][cell["column"] - 1 :].startswith(cell["text"])
    assert answer["joints"][1]["a"]["text"] == "-0.425"


def test_faults_have_their_places() -> None:
    (fault,) = check(UR5.replace("a: -0.425", "a: -0.4x25"))["faults"]
    assert UR5.split("\n")[fault["line"] - 1].strip() == "a: -0.425"
    assert fault["severity"] == "error"
    assert check("")["faults"]
    assert check("[" * 50)["faults"]
    assert check("x" * (LARGEST + 1))["faults"][0]["message"] == f"the text is longer than {LARGEST} characters"
    assert not check(UR5 + "\n" * (LARGEST - len(UR5)))["faults"]


def test_a_visitor_who_leaves_during_an_answer_is_no_error(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "large").write_bytes(bytes(20_000_000))
    with server(tmp_path, 0) as service:
        service.daemon_threads = False  # the end waits for the answer
        threading.Thread(target=service.serve_forever).start()
        with socket.create_connection(service.server_address[:2]) as visitor:
            visitor.sendall(b"GET /large HTTP/1.0\r\n\r\n")
            visitor.recv(100)
        service.shutdown()
    assert capfd.readouterr().err == ""


def test_text_of_a_strangers_file_is_escaped() -> None:
    text = UR5.replace("name: ur5", 'name: ur5\nlicence: "<script>alert(1)</script>"', 1)  # an unknown key
    hostile = UR5.replace("description: Universal", "description: <img src=x onerror=alert(1)> Universal")
    for answer in (check(text), check(hostile), picture(hostile)):
        assert json.loads(json.dumps(answer)) == answer
    pages = results(hostile)
    assert pages.pop("dynamics").split("*/")[0].count("<img") == 1  # in the comment of a module that a worker runs
    assert "<img" not in "".join(pages.values())
    assert "<img" not in picture(hostile)["solvers"][""]


def test_closed_loops_are_derived_but_not_drawn() -> None:
    text = (ROOT / "examples" / "press" / "robot.yaml").read_text(encoding="utf-8")
    assert picture(text)["scene"] is None
    assert picture(text)["solvers"] == {}
    assert results(text)["base_parameters"].count("<tr><td") > 0


def test_every_named_tip_is_dragged() -> None:
    answer = picture((ROOT / "examples" / "trees" / "hand.yaml").read_text(encoding="utf-8"))
    assert set(answer["solvers"]) == {"finger", "thumb"}
    assert answer["family"].startswith("finger: planar arm RRR")


def test_the_archive_holds_what_the_compiler_imports() -> None:
    paths = {path for path, _ in compiler_files()}
    assert {"rrrgen/emit/package.py", "rrrgen/templates/c/header.h.j2", "sympy/__init__.py", "click/core.py"} <= paths
    assert not any(path.startswith(("rrrgen/lab/", "numpy", "cffi")) or "/tests/" in path for path in paths)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    if reason := missing():
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("playground")
    build(folder / "site", NPM / "pyodide", ["ur5", "rrr"])
    service = server(folder / "site", 0)
    threading.Thread(target=service.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{service.server_address[1]}/"
    script = Path(__file__).with_name("playground.mjs")
    command = [NODE, script, address, CHROMIUM, NPM / "playwright-core", folder]
    subprocess.run(command, check=True, timeout=600)
    service.shutdown()
    return json.loads((folder / "found.json").read_text(encoding="utf-8")), folder


def numbers(text: str) -> list[float]:
    return [float(part.replace("−", "-").rstrip("°,;")) for part in text.split() if part.strip("−°,;.0123456789") == ""]


def test_nothing_fails_and_nothing_leaves_the_page(found: tuple[dict[str, Any], Path]) -> None:
    answers, _ = found
    assert answers["errors"] == []
    assert answers["console"] == []  # a request that the policy blocks would be told here
    own = answers["link"].partition("#")[0]
    assert all(address.startswith((own, f"blob:{own}", "about:blank")) for address in answers["requests"])
    assert "unsafe-eval" not in POLICY.replace("wasm-unsafe-eval", "")


def test_the_first_picture_needs_no_compiler(found: tuple[dict[str, Any], Path]) -> None:
    first = found[0]["first"]
    assert (first["arm"], first["robot"], first["compiler"], first["hint"]) == ("ur5", "ur5", "", "Drag the ring.")
    assert first["configurations"] == 8


def test_no_width_scrolls_sideways(found: tuple[dict[str, Any], Path]) -> None:
    assert len(found[0]["widths"]) == 6
    assert set(found[0]["widths"].values()) == {0}


def test_the_tip_follows_the_pointer_and_the_keys(found: tuple[dict[str, Any], Path]) -> None:
    answers, _ = found
    dragged = answers["dragged"]
    np.testing.assert_allclose(np.subtract(dragged["to"], dragged["from"]), [48, 36], atol=1.0)
    assert numbers(dragged["tip"])[3:] == numbers(answers["first"]["tip"])[3:]  # the hand keeps its direction
    assert numbers(answers["lifted"])[2] > numbers(dragged["tip"])[2]
    assert answers["chosen"]["tip"] == answers["lifted"]
    assert answers["chosen"]["joints"] != dragged["joints"]
    assert "elbow" in answers["chosen"]["branch"]


def test_mass_matrix_and_gravity_follow_the_posture(found: tuple[dict[str, Any], Path]) -> None:
    model = compile("ur5")
    assert "mass_matrix_nominal" in found[0]["dynamics"]["note"]
    assert found[0]["moved"]["joints"] != found[0]["dynamics"]["joints"]
    for shown in (found[0]["dynamics"], found[0]["moved"]):
        q = np.deg2rad([numbers(text)[0] for text in shown["joints"]])  # to a tenth of a degree
        rows = np.array([numbers(" ".join(row[1:])) for row in shown["rows"]])
        np.testing.assert_allclose(rows[:, 1:], model.mass_matrix(q), atol=0.02)
        np.testing.assert_allclose(rows[:, 0], model.gravity(q), atol=0.1)


def test_a_fault_is_located_and_a_cell_changes_its_value_alone(found: tuple[dict[str, Any], Path]) -> None:
    answers, _ = found
    assert answers["fault"].startswith("8:")
    assert answers["faults"] == 0
    assert "alpha: -10, a: 0.45" in answers["text"]
    assert answers["text"].count("\n") == 12
    assert answers["parameters"] == 36
    assert answers["again"] == answers["text"]  # by its link
    assert answers["unreadable"].startswith("The link cannot be read: ")


def test_a_general_arm_shows_all_configurations(found: tuple[dict[str, Any], Path]) -> None:
    general = found[0]["general"]
    assert general["configurations"] > 1
    assert general["configurations"] % 2 == 0  # complex roots come in pairs
    assert len(set(general["joints"])) == general["configurations"]
    assert len(set(general["tips"])) == 1


def test_files_equal_those_of_the_command_line(found: tuple[dict[str, Any], Path]) -> None:
    answers, folder = found
    committed = ROOT / "generated" / "rrr"
    with zipfile.ZipFile(folder / "rrr.zip") as archive:
        names = archive.namelist()
        assert {"rrr.h", "rrr_ik.c", "manifest.json"} <= set(names)
        for name in names:
            assert archive.read(name) == (committed / name).read_bytes(), name
    assert answers["copied"] == "rrr.h is in the clipboard."


def test_modes_and_parts_of_the_controller_are_chosen(found: tuple[dict[str, Any], Path]) -> None:
    answers, _ = found
    assert {"rrr_controller.h", "rrr_controller.c", "rrr_controller.json"} <= set(answers["controller"])
    modes = [mode for mode in answers["modes"] if mode != "RRR_CONTROLLER_MODE_NAMES"]
    assert set(modes) == {f"RRR_CONTROLLER_MODE_{mode}" for mode in ("FREE", "GRAVITY", "COMPUTED_TORQUE")}


def test_the_page_opens_without_a_network(found: tuple[dict[str, Any], Path]) -> None:
    assert found[0]["offline"] == "ur5"


def test_markup_in_a_strangers_file_stays_text(found: tuple[dict[str, Any], Path]) -> None:
    assert found[0]["broken"] == ""


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_the_module_of_the_live_values(tmp_path: Path) -> None:
    """Mass matrix and gravity torques of the page against the compiled model; a robot without links has none."""
    assert results(bundled_path("ur5e").read_text(encoding="utf-8"))["dynamics"] == ""
    (tmp_path / "dynamics.mjs").write_text(results(UR5)["dynamics"], encoding="utf-8")
    q = np.linspace(-1.0, 1.5, 6)
    calls = f"[m.mass_matrix_nominal({q.tolist()}), m.gravity_nominal({q.tolist()})]"
    call = f"import('./dynamics.mjs').then((m) => console.log(JSON.stringify({calls})))"
    printed = subprocess.run([NODE, "-e", call], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    mass, gravity = json.loads(printed)
    model = compile("ur5")
    np.testing.assert_allclose(mass, model.mass_matrix(q), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(gravity, model.gravity(q), rtol=1e-12, atol=1e-14)


def test_bundled_robots_are_prepared() -> None:
    robot = precompute(bundled_path("rrr").read_text(encoding="utf-8"))
    assert robot["check"]["faults"] == []
    assert robot["picture"]["scene"]["name"] == "rrr"
    assert "shoulder" in robot["results"]["inverse_kinematics"]
    assert robot["results"]["base_parameters"].count("<tr><td") == 15
    assert robot["results"]["closed_forms"].count("<h3>") == 4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "rrr"], "--robot goes with --build"),
        (["--build", "RUNTIME", "--port", "3"], "--port has no effect with --build"),
        (["--build", "RUNTIME", "--robot", "foo"], "foo"),
    ],
)
def test_options_without_an_effect_and_unknown_robots_leave_no_folder(
    options: list[str], message: str, tmp_path: Path
) -> None:
    for name in RUNTIME:
        (tmp_path / name).touch()
    words = [str(tmp_path) if option == "RUNTIME" else option for option in options]
    done = CliRunner().invoke(cli, ["playground", str(tmp_path / "site"), *words])
    assert done.exit_code != 0
    assert message in done.output + str(done.exception)
    assert not (tmp_path / "site").exists()
