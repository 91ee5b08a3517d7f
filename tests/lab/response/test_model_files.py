"""What `rrrgen response model` writes: postures, C of a step, the export to python-control; a measured arm."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from emit.c_tools import C99, CXX, compile_all, compiler
from rrrgen.base.errors import InputError
from rrrgen.cli.main import run
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.controller.filters import linear_step_program
from rrrgen.lab.response.resonances import modes_over_postures
from rrrgen.lab.response.response_model import Resonance, ResponseModel, read_response_models
from samples.flexible_joint import PERIOD, flexible_joint, multisine, record

DAISY = Path(__file__).resolve().parents[4] / "shared" / "data" / "daisy_robot_arm" / "robot_arm.dat"
POSTURES = {"up": ((28.0, 0.02, 0.3), (96.0, 0.02, 0.5)), "stretched": ((26.0, 0.03, 0.3), (82.0, 0.02, 0.6))}
DRIVER = """#include "response_model.h"
#include <stdio.h>

int main(void)
{
    response_model_real x[%(n)d] = {0}, x_next[%(n)d], y;
    double u;
    while (scanf("%%lf", &u) == 1) {
        response_model_step_up((response_model_real)u, x, &y, x_next);
        for (int i = 0; i < %(n)d; i++) x[i] = x_next[i];
        printf("%%.17g\\n", (double)y);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Recordings of two postures, and the results of both commands."""
    folder = tmp_path_factory.mktemp("postures")
    rng = np.random.default_rng(8)
    for name, modes in POSTURES.items():
        found = record(rng, multisine(rng, 10000), flexible_joint(modes))
        np.save(folder / f"{name}.npy", np.column_stack([found.n, found.u, found.q]))
    (folder / "log.yaml").write_text(
        "schema: rrrgen-response/1\nfiles: [up.npy, stretched.npy]\ntime: {rate: 1 kHz}\nexcitation: {column: 1}\n"
        "input: {column: 2}\noutput: {column: 3}\nrecordings: postures\n"
    )
    assert run(["response", "frf", str(folder / "log.yaml"), "-o", str(folder / "frf")]) == 0
    log = str(folder / "frf/results/frf.json")
    assert run(["response", "model", log, "-o", str(folder / "model")]) == 0
    return folder


def test_resonances_of_every_posture(recorded):
    found = json.loads((recorded / "model/results/response_model.json").read_text())
    assert [each["name"] for each in found["postures"]] == list(POSTURES)
    assert found["a"] == found["postures"][0]["a"]
    assert found["refused"] == {}
    modes = found["resonances_over_postures"]
    assert len(modes) == 2
    for number, mode in enumerate(modes):
        truth = {name: each[number] for name, each in POSTURES.items()}
        assert list(mode["postures"]) == list(POSTURES)
        for name, (frequency, damping, _) in truth.items():
            own = mode["postures"][name]
            assert own["frequency"] == pytest.approx(frequency, rel=5e-3)
            assert own["damping"] == pytest.approx(damping, rel=0.1)
            assert own["uncertain"] == []
            assert abs(own["frequency"] - frequency) < 4 * own["frequency_std"]
        assert mode["frequency"] == [
            min(each["frequency"] for each in mode["postures"].values()),
            pytest.approx(max(each["frequency"] for each in mode["postures"].values())),
        ]
    assert (recorded / "model/figures/resonances.png").is_file()
    assert (recorded / "model/figures/response_model.png").is_file()


@pytest.mark.usefixtures("no_figures")
def test_recordings_of_postures_need_no_frf_before(recorded, tmp_path):
    assert run(["response", "model", str(recorded / "log.yaml"), "-o", str(tmp_path / "run")]) == 0
    direct = json.loads((tmp_path / "run/results/response_model.json").read_text())
    before = json.loads((recorded / "model/results/response_model.json").read_text())
    assert direct["resonances_over_postures"] == before["resonances_over_postures"]


@pytest.mark.usefixtures("no_figures")
def test_a_posture_that_is_not_trusted_is_named(recorded, tmp_path, capsys):
    frf = json.loads((recorded / "frf/results/frf.json").read_text())
    frf["postures"][1]["verdict"]["findings"] = [
        {"kind": "friction", "measure": 9.0, "limit": 5.0, "message": "the velocity changes sign"}
    ]
    (tmp_path / "frf.json").write_text(json.dumps(frf))
    assert run(["response", "model", str(tmp_path / "frf.json"), "-o", str(tmp_path / "run")]) == 1
    assert "no model of stretched" in capsys.readouterr().out
    found = json.loads((tmp_path / "run/results/response_model.json").read_text())
    assert [each["name"] for each in found["postures"]] == ["up"]
    assert "changes sign" in found["refused"]["stretched"]


@pytest.mark.usefixtures("no_figures")
def test_modes_of_an_elastic_robot_stand_beside_the_measured_ones(recorded, tmp_path, capsys):
    (tmp_path / "elastic.yaml").write_text(
        "schema: rrrgen-experiment/1\n"
        "virtual_robot:\n  flexible_base: {frequency: 27.9 Hz, damping_ratio: 0.02}\n"
        "response: {joint: q1, postures: [[0, 0, 1.5], [0, 0, 0]]}\n"
    )
    log, elastic = str(recorded / "frf/results/frf.json"), str(tmp_path / "elastic.yaml")
    run_at = ["response", "model", log, "--robot", "rrr", "--experiment", elastic, "-o", str(tmp_path / "run")]
    assert run(run_at) == 0
    assert "M(q) and stiffness give 27.9 Hz" in capsys.readouterr().out
    rows = json.loads((tmp_path / "run/results/response_model.json").read_text())["elastic_model"]
    assert [row["posture"] for row in rows] == list(POSTURES)
    assert rows[0]["measured"]["frequency"] == pytest.approx(28.0, rel=1e-3)
    assert rows[0]["deviation"] == pytest.approx(28.0 / 27.9 - 1.0, abs=1e-4)
    assert run([*run_at[:5], "-o", str(tmp_path / "run")]) == 2
    assert "belong together" in capsys.readouterr().err
    assert run([*run_at[:3], "--joint", "q1", "-o", str(tmp_path / "run")]) == 2
    assert "--joint is of use with --robot" in capsys.readouterr().err
    (tmp_path / "elastic.yaml").write_text("schema: rrrgen-experiment/1\nresponse: {joint: q1}\n")
    assert run([*run_at, "--fresh"]) == 3
    assert "neither the joints nor the base are flexible" in capsys.readouterr().err


@pytest.mark.usefixtures("no_figures")
def test_the_joint_of_the_response_may_be_named_in_the_command(recorded, tmp_path, capsys):
    (tmp_path / "elastic.yaml").write_text(
        "schema: rrrgen-experiment/1\n"
        "virtual_robot: {flexible_base: {frequency: 27.9 Hz, damping_ratio: 0.02}}\n"
        "response: {postures: [[0, 0, 1.5], [0, 0, 0]]}\n"
    )
    log, elastic = str(recorded / "frf/results/frf.json"), str(tmp_path / "elastic.yaml")
    run_at = ["response", "model", log, "--robot", "rrr", "--experiment", elastic, "-o", str(tmp_path / "run")]
    assert run(run_at) == 3
    assert "names no joint" in capsys.readouterr().err
    assert run([*run_at, "--joint", "q9"]) == 3
    assert "q9" in capsys.readouterr().err
    assert run([*run_at, "--joint", "q1"]) == 0
    assert "M(q) and stiffness give 27.9 Hz" in capsys.readouterr().out


def test_modes_are_matched_by_frequency_and_kept_apart_where_they_differ():
    def model(name, *modes):
        return ResponseModel("", np.zeros(1), np.ones(1), 0, 1.0, tuple(Resonance(f, z) for f, z in modes), name=name)

    found = modes_over_postures([model("a", (28, 0.1), (90, 0.02)), model("b", (27, 0.1), (60, 0.02), (99, 0.02))])
    assert [list(each.resonances) for each in found] == [["a", "b"], ["b"], ["a", "b"]]
    assert found[2].frequencies.tolist() == [90, 99]
    assert modes_over_postures([model("rigid")]) == []


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize(("name", "flags"), [("gcc", C99), ("clang", C99), ("g++", CXX)])
def test_step_in_c_equals_python(recorded, tmp_path, name, flags, real):
    model = read_response_models(recorded / "model/results/response_model.json")[0]
    states = model.state_space()
    step = linear_step_program([states], PERIOD, "step_up", "the linear model of up")
    files = function_files("response_model", "a linear model", [step], real)
    if real == "double":
        written = (recorded / "model/results/response_model.c").read_text()
        body = files["response_model.c"].partition("{")[2].partition("}")[0]
        assert body in written
    for each, text in files.items():
        (tmp_path / each).write_text(text)
    (tmp_path / "driver.c").write_text(DRIVER % {"n": len(states.B)})
    program = compile_all(tmp_path, [compiler(name), *flags, "-O2", "-ffp-contract=off"])
    u = np.random.default_rng(0).standard_normal(1000)
    text = "\n".join(repr(float(value)) for value in u)
    told = subprocess.run([str(program)], input=text, capture_output=True, text=True, timeout=60)
    y, reference = np.array(told.stdout.split(), float), states.run(u)
    # round-off of 1000 steps with two integrators; in single precision without the cancellation of companion forms
    assert np.abs(y - reference).max() < (1e-12 if real == "double" else 1e-4) * np.abs(reference).max()


@pytest.mark.sweep
def test_python_control_has_the_same_response(recorded, tmp_path):
    file = recorded / "model/results/response_model.json"
    model = read_response_models(file)[1]
    # in a process of its own: beside these tests, "control" is a folder of tests
    code = (
        "import sys, json, numpy\n"
        "from rrrgen.base.errors import MissingExtraError\n"
        "from rrrgen.lab.response.response_model import read_response_models\n"
        "try:\n    G = read_response_models(sys.argv[1])[1].to_control()\n"
        "except MissingExtraError:\n    sys.exit(5)\n"
        "P = G(numpy.exp(2j * numpy.pi * numpy.linspace(1, 400, 50) * G.dt))\n"
        "print(json.dumps([G.dt, G.name, P.real.tolist(), P.imag.tolist()]))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], cwd=tmp_path, capture_output=True, text=True)
    if done.returncode == 5:
        pytest.skip("python-control is not installed (extra: response)")
    dt, name, real, imaginary = json.loads(done.stdout)
    assert (dt, name) == (PERIOD, "stretched")
    f = np.linspace(1.0, 400.0, 50)
    assert np.allclose(np.array(real) + 1j * np.array(imaginary), model.response(f), rtol=1e-5)


def test_files_that_are_no_model_are_refused(recorded, tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        read_response_models(tmp_path / "none.json")
    with pytest.raises(InputError, match="no response model"):
        read_response_models(recorded / "frf/results/frf.json")
    found = json.loads((recorded / "model/results/response_model.json").read_text())
    found["postures"][0]["sampling_period"] = 0
    (tmp_path / "model.json").write_text(json.dumps(found))
    with pytest.raises(InputError, match="sampling period"):
        read_response_models(tmp_path / "model.json")


@pytest.mark.skipif(not DAISY.exists(), reason="the recording of the flexible arm is not in ../shared/data")
def test_measured_arm_at_its_own_order(tmp_path, capsys):
    """DaISy: fitted on rows 1..512, scored on the others; the order is chosen within the former."""
    log = str(Path(__file__).resolve().parents[3] / "examples/flexible_arm/response.yaml")
    assert run(["response", "model", log, "--fit-rows", "1:512", "-o", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run/results/response_model.json").read_text())
    fit = found["fit"]
    assert fit["scored_rows"] == [513, 1024]
    assert fit["held_out"]
    assert fit["value"] >= 95.5
    assert fit["free_run_with_state_from_fitted_rows"] >= 95.5
    assert fit["free_run_from_zero_state"] >= 95.0
    assert f"{fit['free_run_from_zero_state']:.2f} %: free run from the state zero" in capsys.readouterr().out
    weak = [2 * np.pi * mode["frequency"] for mode in found["resonances"] if mode["damping"] < 0.01]
    assert weak == pytest.approx([0.365, 0.796], rel=5e-3)
