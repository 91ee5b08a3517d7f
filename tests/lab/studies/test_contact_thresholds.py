"""Thresholds of contact detection as a function: from arrays without files, with the numbers of the command."""

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from lab.studies.test_estimate_payload import recording
from rrrgen.lab.data.recordings import Log
from samples.recordings import write_log


@pytest.fixture(scope="module")
def arrays():
    return recording(carried=False)


def test_arrays_give_the_numbers_of_the_command(arrays, tmp_path, capsys):
    result = rrrgen.contact_thresholds("planar2r", arrays, block=0.2, force=5)
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    words = ["--block", 0.2, "--force", 5, "--log", tmp_path / "log.csv", "-o", tmp_path / "run"]
    assert printed_json(capsys, "experiment", "contact-thresholds", "planar2r", *words) == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    assert (tmp_path / "run/results/planar2r_contact.h").is_file()
    assert len(result.levels) == len(result.change_levels) == 2
    assert np.all(np.array(result.levels) > result.findings.covariance.deviations)
    assert "5 N at the tip" in repr(result)
    assert result._repr_html_().count("<tr>") == 3


def test_residuals_as_large_as_the_torques_get_a_note(arrays):
    sound = rrrgen.contact_thresholds("planar2r", arrays, block=0.2)
    assert "note: " not in repr(sound)
    assert max(sound.findings.shares) < 0.1
    wrong = rrrgen.contact_thresholds("planar2r", arrays | {"tau": arrays["tau"] * [1.0, -1.0]}, block=0.2)
    assert "note: the torques of q2 are not explained: " in repr(wrong)


def test_a_tuning_that_is_none_is_refused(arrays, tmp_path):
    (tmp_path / "tuning.json").write_text("{}")
    with pytest.raises(rrrgen.InputError, match="is no tuning of a Kalman filter"):
        rrrgen.contact_thresholds("planar2r", arrays, tuning=tmp_path / "tuning.json")
    with pytest.raises(rrrgen.InputError, match="force is 0 N, but must be above 0 N"):
        rrrgen.contact_thresholds("planar2r", arrays, force=0)


def test_a_robot_without_links_is_refused_before_anything_is_written(arrays, tmp_path):
    bare = replace(rrrgen.load_spec("planar2r"), links=None)
    with pytest.raises(rrrgen.InputError, match="no links"):
        rrrgen.contact_thresholds(bare, arrays, folder=tmp_path / "run")
    assert not (tmp_path / "run").exists()
