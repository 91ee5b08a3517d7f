"""Linear models of responses, against the exact discrete truth."""

import csv
import json

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import run
from rrrgen.lab.response.difference_models import armax, arx, fit_difference_model, free_run, plant_of_loop
from rrrgen.lab.response.estimation import estimate_one
from rrrgen.lab.response.modal_fit import _Lines, _residual, _slopes, fit_modes
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import ResponseModel
from samples.flexible_joint import CONTROLLER, MODES, PERIOD, flexible_joint, multisine, record

TWO_MODES = (np.array([2.6, -2.9, 1.78, -0.55]), np.array([0.5, -0.3, 0.1]))


def simulated(a, b, delay, u):
    y = np.zeros(len(u))
    for k in range(len(u)):
        y[k] = sum(c * y[k - i] for i, c in enumerate(a, 1) if k >= i)
        y[k] += sum(c * u[k - delay - j] for j, c in enumerate(b) if k >= delay + j)
    return y


@pytest.fixture(scope="module")
def swinging():
    """An open loop of two weakly damped modes with measurement noise: rows, and the truth."""
    rng = np.random.default_rng(3)
    a = np.zeros(0)
    denominator = np.ones(1)
    for w, damping in ((0.366, 0.006), (0.796, 0.005)):
        radius = np.exp(-damping * w)
        denominator = np.convolve(denominator, [1, -2 * radius * np.cos(w * np.sqrt(1 - damping**2)), radius**2])
    a = -denominator[1:]
    u = rng.standard_normal(1600)
    y = simulated(a, [1.0, 0.4, -0.8, 0.3, 0.2], 0, u)
    return ResponseRecording("arm", 1.0, u, u, y + 0.02 * y.std() * rng.standard_normal(len(y))), a


def test_the_gradient_of_the_search_for_modes_is_exact():
    rng = np.random.default_rng(1)
    frequency = np.linspace(1.0, 200.0, 90)
    P = flexible_joint().response(frequency) * (1.0 + 0.01 * rng.standard_normal(90))
    lines = _Lines(np.exp(-2j * np.pi * frequency * PERIOD), P, 1.0 / (0.01 * np.abs(P)), PERIOD)
    for modes, integrators in ((np.log([28.3, 0.021, 95.0, 0.03]), 2), (np.log([40.0, 0.6]), 0)):

        def cost(at, integrators=integrators):
            return 0.5 * float(np.sum(_residual(lines, at, 2, integrators) ** 2))

        gradient = _slopes(lines, modes, 2, integrators).T @ _residual(lines, modes, 2, integrators)
        steps = 1e-6 * np.eye(len(modes))
        numeric = [(cost(modes + step) - cost(modes - step)) / 2e-6 for step in steps]
        assert np.allclose(gradient, numeric, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


def test_modes_of_a_joint_in_closed_loop():
    rng = np.random.default_rng(2)
    model = fit_modes(estimate_one(record(rng, multisine(rng, 12000))))
    assert len(model.resonances) == len(MODES)
    for found, (frequency, damping, _) in zip(model.resonances, MODES, strict=True):
        assert found.frequency == pytest.approx(frequency, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.1)
        assert abs(found.frequency - frequency) < 4 * found.frequency_std
        assert abs(found.damping - damping) < 4 * found.damping_std
    lines = np.linspace(0.5, 150, 300)
    assert np.quantile(np.abs(model.response(lines) / flexible_joint().response(lines) - 1), 0.9) < 0.03
    assert (len(model.a), model.delay) == (6, 2)


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


def test_difference_equations_of_a_closed_loop_are_judged_by_what_they_can_tell():
    """The joint integrates: its free run drifts, short runs and the loop from n to q do not."""
    rng = np.random.default_rng(5)
    recording = record(rng, multisine(rng, 3000))
    direct = fit_difference_model(recording, (1, 2000), "arx")
    assert "free runs of 50 samples" in direct.fit["protocol"]
    assert direct.fit["value"] > 80.0
    loop = fit_difference_model(recording, (1, 2000), "indirect", CONTROLLER)
    assert "state that the fitted rows lead to" in loop.fit["protocol"]
    assert loop.fit["value"] > 80.0


def test_difference_equation_is_chosen_on_rows_left_out(swinging):
    recording, a = swinging
    model = fit_difference_model(recording, (1, 800))
    assert model.fit["scored_rows"] == [801, 1600]
    assert model.fit["held_out"]
    assert model.fit["free_run_with_state_from_fitted_rows"] > 97.5  # 2 % of noise
    assert model.fit["value"] > 85.0  # the noise of four outputs rings on
    assert model.method == "output_error"
    assert np.allclose(model.a, a, atol=0.01)
    for found, (w, damping) in zip(model.resonances, ((0.366, 0.006), (0.796, 0.005)), strict=True):
        assert 2 * np.pi * found.frequency == pytest.approx(w, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.1)
        assert abs(found.damping - damping) < 4 * found.damping_std


def test_reported_score_is_that_of_the_written_equation(swinging):
    recording, _ = swinging
    model = fit_difference_model(recording, (1, 800), "arx")
    y = recording.q.copy()
    for k in range(800, 1600):
        y[k] = sum(c * y[k - i] for i, c in enumerate(model.a, 1))
        y[k] += sum(c * recording.u[k - model.delay - j] for j, c in enumerate(model.b))
    q = recording.q[800:]
    score = 100 * (1 - np.linalg.norm(q - y[800:]) / np.linalg.norm(q - q.mean()))
    assert model.fit["value"] == pytest.approx(score, abs=1e-9)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_least_squares_are_exact_without_noise(delay):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(60)
    b = [1.0, -0.4, 0.3, 0.2, 0.1][: 4 if delay else 5]
    y = simulated(TWO_MODES[0], b, delay, u)
    found = arx(u, y, 0, 60, 4, delay)
    assert np.allclose(found.a, TWO_MODES[0], atol=1e-9)
    assert np.allclose(found.b, b, atol=1e-9)
    assert np.allclose(free_run(found, u, y, 20, 60), y[20:], atol=1e-8)


def test_armax_is_right_where_arx_is_biased():
    """Noise through C/A: least squares on y take it for dynamics."""
    rng = np.random.default_rng(4)
    a, b, c = np.array([1.5, -0.8]), np.array([1.0, 0.5]), np.array([1.0, -0.9, 0.3])
    u, e = rng.standard_normal((2, 2000))
    noise = simulated(a, c, 0, 0.8 * e)
    y = simulated(a, b, 1, u) + noise
    plain = arx(u, y, 0, len(u), 2, 1)
    found = armax(plain, u, y, 0, len(u))
    assert np.abs(plain.a - a).max() > 5 * np.abs(found.a - a).max()
    assert np.abs(np.concatenate([found.a - a, found.b - b])).max() < 0.06


def test_subspace_models_have_the_same_modes(swinging):
    pytest.importorskip("nfoursid", reason="nfoursid is not installed (extra: response)")
    recording, _ = swinging
    model = fit_difference_model(recording, (1, 400), "subspace")
    assert model.method == "subspace"
    assert model.fit["free_run_with_state_from_fitted_rows"] > 95.0
    weak = [mode for mode in model.resonances if mode.damping < 0.01]
    for found, (w, damping) in zip(weak, ((0.366, 0.006), (0.796, 0.005)), strict=True):
        assert 2 * np.pi * found.frequency == pytest.approx(w, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.2)
        assert abs(found.damping - damping) < 4 * found.damping_std
    long = ResponseRecording("long", 1.0, *(np.tile(x, 3) for x in (recording.n, recording.u, recording.q)))
    with pytest.raises(DerivationError, match="choose up to 3000"):
        fit_difference_model(long, (1, 4000), "subspace")
    with pytest.raises(DerivationError, match="too few for subspace"):
        fit_difference_model(recording, (1, 20), "subspace")


def test_plant_follows_from_the_loop_and_its_controller():
    P = ResponseModel("", np.array([1.8, -0.9]), np.array([0.02, 0.01]), 1, PERIOD)
    f = np.array([1.0, 30.0, 200.0])
    N, D = np.array(CONTROLLER.numerator), np.array(CONTROLLER.denominator)
    closed = np.convolve(P.denominator, D)
    added = np.convolve(N, P.numerator)
    size = max(len(closed), len(added))
    closed = np.pad(closed, (0, size - len(closed))) + np.pad(added, (0, size - len(added)))
    a, b = plant_of_loop(-closed[1:], np.convolve(P.b, D), P.delay, CONTROLLER)
    assert np.allclose(ResponseModel("", a, b, P.delay, PERIOD).response(f), P.response(f))


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


def test_a_damping_that_is_hardly_known_says_so():
    """Five seconds with an encoder of 2e-4 rad: the deviations tell that the recording is too short."""
    rng = np.random.default_rng(6)
    noise = 7.0 * rng.standard_normal(5000)
    short = fit_modes(estimate_one(record(rng, noise, disturbance=0.3, resolution=2e-4)))
    assert any("damping" in mode.uncertain for mode in short.resonances)
