"""Linear models of responses, against the exact discrete truth."""

import csv
import json

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import run
from rrrgen.lab.response.difference_models import fit_difference_model
from rrrgen.lab.response.estimation import estimate_one
from rrrgen.lab.response.modal_fit import fit_modes
from rrrgen.lab.response.response_file import ResponseRecording
from samples.flexible_joint import CONTROLLER, MODES, multisine, record


def write_loop(folder, recording):
    np.save(folder / "loop.npy", np.column_stack([recording.n, recording.u, recording.q]))
    c = ", ".join(repr(x) for x in CONTROLLER.numerator)
    (folder / "loop.yaml").write_text(
        "schema: rrrgen-response/1\nfiles: loop.npy\ntime: {rate: 1 kHz}\nexcitation: {column: 1}\ninput: {column: 2}\n"
        f"output: {{column: 3}}\ncontroller: {{numerator: [{c}]}}\n"
    )
    return str(folder / "loop.yaml")


@pytest.mark.usefixtures("no_figures")
def test_rows_of_a_closed_loop_are_fitted_and_the_others_test_the_model(tmp_path):
    rng = np.random.default_rng(2)
    log = write_loop(tmp_path, record(rng, multisine(rng, 16000)))
    assert run(["response", "model", log, "--fit-rows", "1:10000", "-o", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run/results/response_model.json").read_text())
    assert found["method"] == "modes"
    assert (found["fit"]["fitted_rows"], found["fit"]["scored_rows"]) == ([1, 10000], [10001, 16000])
    assert found["fit"]["held_out"]
    assert found["fit"]["value"] > 94.0
    for mode, (frequency, damping, _) in zip(found["resonances"], MODES, strict=True):
        assert mode["frequency"] == pytest.approx(frequency, rel=5e-3)
        assert mode["damping"] == pytest.approx(damping, rel=0.1)
    assert run(["response", "model", log, "--fit-rows", "1:99999", "-o", str(tmp_path / "no")]) == 3


@pytest.mark.usefixtures("no_figures")
def test_resonances_that_a_difference_equation_does_not_have_are_told(tmp_path, capsys):
    """Least squares of a joint that moves freely, with an encoder of 1e-5 rad: they are sure of no mode."""
    rng = np.random.default_rng(2)
    log = write_loop(tmp_path, record(rng, multisine(rng, 8000)))
    assert run(["response", "model", log, "--method", "arx", "-o", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run/results/response_model.json").read_text())
    certain = [mode["frequency"] for mode in found["resonances"] if not mode["uncertain"]]
    assert found["overlooked"][0]["frequency"] == pytest.approx(MODES[0][0], rel=5e-3)
    assert certain == []
    assert "not in the model: 28 " in capsys.readouterr().out


def write(folder, recording):
    with (folder / "log.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows(np.column_stack([recording.n, recording.u, recording.q]).tolist())
    text = "schema: rrrgen-response/1\nfiles: log.csv\ntime: {period: 1 s}\ninput: {column: 2}\noutput: {column: 3}\n"
    (folder / "response.yaml").write_text(text)
    return str(folder / "response.yaml")


@pytest.mark.filterwarnings("error:.*encountered:RuntimeWarning")
def test_command_writes_model_figure_and_c(swinging, tmp_path, capsys):
    log, out = write(tmp_path, swinging[0]), tmp_path / "run"
    assert run(["response", "model", log, "--method", "output_error", "--fit-rows", "1:800", "-o", str(out)]) == 0
    found = json.loads((out / "results/response_model.json").read_text())
    assert found["fit"]["value"] > 85.0
    assert found["overlooked"] == []
    assert "measured past" in found["fit"]["protocol"]
    assert {"a", "b", "delay", "resonances"} <= set(found)
    assert "response_model_step" in (out / "results/response_model.c").read_text()
    assert "resonance" in capsys.readouterr().out
    # the frequency response of the same recording leads to the same modes
    assert run(["response", "frf", log, "-o", str(tmp_path / "frf")]) == 0
    frf = str(tmp_path / "frf/results/frf.json")
    assert run(["response", "model", frf, "-o", str(tmp_path / "modes")]) == 0
    modes = json.loads((tmp_path / "modes/results/response_model.json").read_text())["resonances"]
    for mode, other in zip(modes, found["resonances"], strict=False):
        assert mode["frequency"] == pytest.approx(other["frequency"], rel=0.01)


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--fit-rows", "5:3"], 2, "no range of rows"),
        (["--fit-rows", "1:9999"], 3, "recording with rows 1:1600"),
        (["--fit-rows", "1:9"], 4, "too few"),
        (["--method", "indirect"], 3, "needs the controller"),
    ],
)
def test_what_cannot_be_fitted_is_refused(swinging, tmp_path, capsys, options, code, message):
    assert run(["response", "model", write(tmp_path, swinging[0]), *options, "-o", str(tmp_path / "run")]) == code
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_files_that_are_no_response_are_refused(tmp_path, capsys):
    (tmp_path / "frf.json").write_text("{}")
    assert run(["response", "model", str(tmp_path / "frf.json"), "-o", str(tmp_path / "run")]) == 3
    assert "no frequency response" in capsys.readouterr().err


def test_distrusted_response_and_still_signals_are_refused(swinging):
    rng = np.random.default_rng(3)
    rough = estimate_one(record(rng, multisine(rng, 8000), speed=0.05, friction=2.0))
    with pytest.raises(DerivationError, match="0 lines can be trusted"):
        fit_modes(rough)
    recording, _ = swinging
    with pytest.raises(DerivationError, match="is constant"):
        fit_difference_model(ResponseRecording("still", 1.0, recording.n, recording.u, 0 * recording.q))
    with pytest.raises(InputError, match="rows"):
        fit_difference_model(recording, (0, 5))
