"""The design of an excitation as a function, with the numbers and the files of the command."""

import json

import pytest

import rrrgen
from lab.studies.commands import printed_json

pytest.importorskip("casadi")
OPTIONS = {"harmonics": 2, "starts": 1, "duration": 4}


@pytest.fixture(scope="module")
def result():
    return rrrgen.excite("planar2r", **OPTIONS)


@pytest.mark.usefixtures("no_figures")
def test_the_numbers_and_files_of_the_command(result, tmp_path, capsys):
    words = [word for name, value in OPTIONS.items() for word in (f"--{name}", value)]
    assert printed_json(capsys, "experiment", "excite", "planar2r", *words, "-o", tmp_path / "run") == (
        0,
        result.to_json(),
    )
    result.save(tmp_path / "saved")
    for name in ("excitation.json", "excitation.csv"):
        run, saved = (tmp_path / folder / "results" / name for folder in ("run", "saved"))
        assert run.read_bytes() == saved.read_bytes()
    settings = json.loads((tmp_path / "saved/run.json").read_text())["settings"]
    assert settings["cycle"] == OPTIONS["duration"]


def test_a_result_prints_and_draws_itself(result):
    assert result.trajectory.period == pytest.approx(4)
    assert result.check.feasible
    assert repr(result).startswith("condition number")
    assert result._repr_html_().count("<tr>") == 2
    assert result.plot("motion").axes


def test_options_override_the_experiment_file(tmp_path):
    (tmp_path / "experiment.yaml").write_text("schema: rrrgen-experiment/1\nseed: 3\nperiod: 2 ms\n")
    options = rrrgen.ExciteOptions(experiment=tmp_path / "experiment.yaml", harmonics=4, rate=100)
    chosen = options.of_file(2)
    assert (chosen.seed, chosen.period, chosen.excitation["harmonics"]) == (3, 0.01, 4)


def test_an_unknown_option_is_refused():
    with pytest.raises(rrrgen.InputError, match="did you mean 'harmonics'"):
        rrrgen.excite("planar2r", harmonic=3)


def test_drives_that_are_too_weak_are_named(tmp_path):
    """The bundled pendulum needs 6 N m to hold its weight sideways, and its drive gives 5 N m."""
    limits = "excitation: {limits: {speed: 10, acceleration: 100}}\n"  # without the torque, which a robot file has too
    (tmp_path / "experiment.yaml").write_text(f"schema: rrrgen-experiment/1\n{limits}")
    result = rrrgen.excite("pendulum", experiment=tmp_path / "experiment.yaml", harmonics=1, starts=1, duration=4)
    (sentence,) = result.overloads
    assert "its drive gives 5 N m: state `torque` among the limits" in sentence
    assert sentence in result.lines()
    assert rrrgen.excite("planar2r", **OPTIONS).overloads == ()
