"""The fit of a linear model as a function: from responses and arrays, with the numbers of the command."""

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from samples.flexible_joint import MODES, flexible_joint, multisine, record


@pytest.fixture(scope="module")
def recording():
    rng = np.random.default_rng(8)
    found = record(rng, multisine(rng, 8000), flexible_joint())
    return {"t": 1e-3 * np.arange(len(found.q)), "n": found.n, "u": found.u, "q": found.q}


@pytest.fixture(scope="module")
def response(recording):
    return rrrgen.frequency_response(recording)


@pytest.fixture(scope="module")
def result(response):
    return rrrgen.fit_response(response)


@pytest.mark.usefixtures("no_figures")
def test_a_response_gives_the_numbers_and_files_of_the_command(response, result, tmp_path, capsys):
    response.save(tmp_path / "response")
    log = tmp_path / "response/results/frf.json"
    assert printed_json(capsys, "response", "model", log, "-o", tmp_path / "run") == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    again = rrrgen.fit_response(log, folder=tmp_path / "run")  # the same run
    assert again.run.settings == {"fit_rows": None, "method": "auto", "real": "double"}


def test_the_resonances_are_the_true_ones(result):
    for mode, (frequency, damping, _) in zip(result[0].resonances, MODES, strict=True):
        assert abs(mode.frequency - frequency) < 4 * mode.frequency_std
        assert abs(mode.damping - damping) < 4 * mode.damping_std
    assert "resonance 28" in repr(result)
    assert result._repr_html_().count("<tr>") == 1 + len(MODES)
    assert result.plot().axes


def test_single_responses_are_taken(response, result):
    assert rrrgen.fit_response(response[0]).to_json() == result.to_json()


def test_rows_are_fitted_and_the_others_score_the_model(recording):
    result = rrrgen.fit_response(recording, fit_rows="1:4000")
    assert result[0].fit["scored_rows"] == [4001, 8000]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fit_rows": "9:2"}, "'9:2' is no range of rows"),
        ({"method": "arx"}, "^a frequency response has no rows, and takes method modes"),
        ({"robot": "rrr"}, "^robot and experiment belong together"),
    ],
)
def test_options_that_make_no_sense_are_refused(response, options, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.fit_response(response, **options)
