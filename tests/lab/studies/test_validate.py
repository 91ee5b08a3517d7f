"""Validation as a function: from arrays without files, with the numbers and the files of the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion, write_log

BARE = """
schema: rrrgen/1
name: bare
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {type: revolute, a: 0.4, alpha: 0, d: 0}
  - {type: revolute, a: 0.3, alpha: 0, d: 0}
"""


@pytest.fixture(scope="module")
def arrays():
    """A recording of planar2r: exact torques of its compiled model with a little noise."""
    t = np.arange(2000) / 200.0
    q, dq, ddq = fourier_motion(t, 2, seed=4)
    tau = rrrgen.compile("planar2r").inverse_dynamics(q, dq, ddq)
    return {"t": t, "q": q, "tau": tau + 0.01 * np.random.default_rng(1).normal(size=tau.shape)}


@pytest.fixture(scope="module")
def result(arrays):
    return rrrgen.validate("planar2r", arrays, decimate=4)


def test_arrays_give_the_numbers_of_the_command(arrays, result, tmp_path):
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    given = ["--log", str(tmp_path / "log.csv"), "-o", str(tmp_path / "run"), "--decimate", "4", "--json"]
    run = CliRunner().invoke(
        cli, ["experiment", "validate", "planar2r", *given], standalone_mode=False, catch_exceptions=False
    )
    assert run.return_value == 0, run.output
    own, wanted = result.to_json(), json.loads(run.stdout)
    own["repairs"][0].pop("recording"), wanted["repairs"][0].pop("recording")  # the name of the file
    assert own == wanted


def test_the_true_robot_passes_and_a_limit_below_the_noise_fails(arrays, result):
    assert result.passed
    strict = rrrgen.validate("planar2r", arrays, decimate=4, relative_error=1e-6)
    assert not strict.passed
    assert "FAILED" in repr(strict)
    for limit in (-3.0, 0.0, np.inf):
        with pytest.raises(rrrgen.InputError, match=r"^relative_error is "):
            rrrgen.validate("planar2r", arrays, decimate=4, relative_error=limit)


def test_a_robot_knows_what_it_was_fitted_to(arrays):
    pytest.importorskip("cvxpy")
    spec = rrrgen.identify("planar2r", arrays, decimate=4).spec
    check = rrrgen.validate(spec, arrays, decimate=4)
    assert check.common.share == pytest.approx(1.0)
    with pytest.raises(rrrgen.InputError, match="did you mean 'require_held_out'"):
        rrrgen.validate(spec, arrays, require_heldout=True)
    assert not rrrgen.validate(spec, arrays, decimate=4, require_held_out=True).passed


def test_a_result_saves_draws_and_shows_itself(result, tmp_path):
    assert result._repr_html_().count("<tr>") == 3
    assert result.plot().axes
    result.save(tmp_path)
    assert json.loads((tmp_path / "results" / "validation.json").read_text()) == result.to_json()
    assert (tmp_path / "figures" / "torques.svg").is_file()


def test_a_robot_without_links_has_nothing_to_score(arrays):
    spec = rrrgen.loads_spec(BARE)
    with pytest.raises(rrrgen.InputError, match="bare has no links"):
        rrrgen.validate(spec, arrays)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guard": 1}, "^guard keeps away from the borders of split: give a split, too"),
        ({"fitted_on": ["none", "v.csv"]}, "^fitted_on names recordings, and none"),
        ({"split": "first:0.6", "guard": 30}, "^no sample of q1, q2 is left to score .* or a smaller guard"),
        ({"split": "blocks:100"}, "^no sample of q1, q2 is left to score .*choose another split"),
        ({"cutoff": 0.05}, "^no row is left: a filter with a cut-off of 0.05 Hz needs more than the 9.99 s"),
    ],
)
def test_options_that_make_no_sense_are_refused(arrays, options, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.validate("planar2r", arrays, **options)
