"""Drive gains as a function: from arrays without files, with the numbers of the command."""

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from lab.studies.test_estimate_payload import COM, MASS, recording
from rrrgen.lab.data.recordings import Log
from samples.recordings import write_log

GAINS = np.array([1.25, 0.8])


@pytest.fixture(scope="module")
def recordings():
    """Recordings without and with the payload, by drives that give more, or less, than they report."""
    found = [recording(carried) for carried in (False, True)]
    return [{**arrays, "tau": arrays["tau"] / GAINS} for arrays in found]


def test_arrays_give_the_numbers_of_the_command(recordings, tmp_path, capsys):
    result = rrrgen.estimate_drive_gains("planar2r", *recordings, mass=MASS, com=COM)
    words = ["--mass", MASS, "--com", *COM, "-o", tmp_path / "run"]
    for flag, arrays in zip(("--log", "--loaded"), recordings, strict=True):
        write_log(tmp_path / f"{flag}.csv", Log(joints=("q1", "q2"), **arrays))
        words += [flag, tmp_path / f"{flag}.csv"]
    assert printed_json(capsys, "experiment", "drive-gains", "planar2r", *words) == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    # the filters cost a permille of the torques
    assert result.values == pytest.approx(GAINS, rel=0.01)
    assert "q1: true torque" in repr(result)
    assert result["q2"].value == result.values[1]


def test_exchanged_recordings_are_told_by_the_name_of_the_argument(recordings):
    with pytest.raises(rrrgen.DerivationError, match="carries the payload in the recording loaded:"):
        rrrgen.estimate_drive_gains("planar2r", *recordings[::-1], mass=MASS, com=COM)


def test_one_recording_cannot_be_without_and_with_the_payload(recordings):
    with pytest.raises(rrrgen.InputError, match="loaded1 is given twice, without and with the payload"):
        rrrgen.estimate_drive_gains("planar2r", recordings[0], [dict(recordings[0])], mass=MASS, com=COM)


def test_torques_that_no_gains_explain_are_refused(recordings):
    degrees = [{**arrays, "q": np.degrees(arrays["q"])} for arrays in recordings]
    with pytest.raises(rrrgen.DerivationError, match="no gains explain the torques: "):
        rrrgen.estimate_drive_gains("planar2r", *degrees, mass=MASS, com=COM)


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        ({"mass": 0}, "^mass is 0 kg, but must be finite and above 0 kg"),
        ({"mass": np.inf}, "^mass is inf kg, but must be finite and above 0 kg"),
        ({"mass": 1, "com": [1, 2]}, r"^com has the shape \(2,\), not \(3,\)"),
        ({"mass": 1, "com": [np.nan, 0, 0]}, r"^com is \[nan, 0.0, 0.0\], not 3 finite numbers"),
        ({"mass": 1, "inertia": [1, 0.1, 0.1, 0, 0, 0]}, "^no body has this inertia: .* the triangle inequality"),
        ({"mass": 1, "com": COM, "inertia": [-1, -0.1, -0.1, 0, 0, 0]}, "^no body has this inertia: "),
    ],
)
def test_a_payload_that_is_none_is_refused(recordings, payload, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.estimate_drive_gains("planar2r", *recordings, **payload)
