"""A simulated experiment as a function, with the recording of the command."""

import json
import re

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.studies.options import OptionError


@pytest.fixture(scope="module")
def motion():
    """A motion of planar2r around its zero pose, at rest at no instant."""
    return FourierTrajectory.from_coefficients(np.array([[0.1] * 2, [0.4, 0.3], [0.2, 0.5]]), 0.5)


@pytest.fixture(scope="module")
def result(motion):
    return rrrgen.simulate("planar2r", motion, torque_noise=0.01, seed=2)


def test_the_recording_of_the_command(motion, result, tmp_path, capsys):
    import json

    (tmp_path / "motion.json").write_text(json.dumps(motion.to_json()))
    words = ["--trajectory", tmp_path / "motion.json", "--torque-noise", 0.01, "--seed", 2]
    code, printed = printed_json(capsys, "experiment", "simulate", "planar2r", *words, "-o", tmp_path / "run")
    assert code == 0
    assert printed.pop("log") == str(tmp_path / "run/results/log.yaml")
    assert printed == result.to_json()
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))


def test_a_result_says_how_the_arm_follows(result):
    assert result.ok
    assert result.failures == ()
    assert "largest deviations from the motion" in repr(result)
    assert result._repr_html_().count("<tr>") == 3


def test_its_recording_is_followed_and_identified(motion, result):
    replayed = rrrgen.simulate("planar2r", reference=result.log, duration=1.0)
    assert len(replayed.log) == 1000
    found = rrrgen.identify("planar2r", result.log, consistent=False)
    model = rrrgen.compile("planar2r")
    truth = dict(zip(model.base_parameter_names, model.beta, strict=True))
    known = [name for name in found.names if name in truth]
    assert known
    # the noise of 0.01 N m is a thousandth of the torque
    assert [float(found[name]) for name in known] == pytest.approx([truth[name] for name in known], abs=0.05)


def test_its_recording_is_that_of_its_file(motion, tmp_path):
    """Recorded commands act half a period late, which the mapping file states and the recording in memory too."""
    from rrrgen.lab.data.recordings import load_stream, open_log
    from rrrgen.lab.data.uniform_stream import LogStream

    (tmp_path / "experiment.yaml").write_text(
        "schema: rrrgen-experiment/1\nvirtual_robot:\n  torque_record: command\n", encoding="utf-8"
    )
    result = rrrgen.simulate("planar2r", motion, experiment=tmp_path / "experiment.yaml")
    result.save(tmp_path / "run")
    saved = load_stream(LogStream(open_log(tmp_path / "run/results/log.yaml")))
    (read,), (given,) = (list(log.parts()) for log in (saved, result.log))
    assert given.late == read.late == 0.5
    np.testing.assert_allclose(given.tau, read.tau)


def test_options_that_make_no_sense_are_refused(motion, result):
    with pytest.raises(TypeError, match="motion is of type float, not a trajectory"):
        rrrgen.simulate("planar2r", 1.0)
    with pytest.raises(rrrgen.InputError, match=r"^the arm follows a motion or reference, not both"):
        rrrgen.simulate("planar2r", motion, reference=result.log)
    with pytest.raises(rrrgen.InputError, match="bandwidth is 0 Hz, but must be above 0 Hz"):
        rrrgen.simulate("planar2r", motion, bandwidth=0)
    with pytest.raises(rrrgen.InputError, match=r"cannot read nothing\.json"):
        rrrgen.simulate("planar2r", "nothing.json")


@pytest.mark.parametrize(("option", "fault"), [("torque_noise", "at least 0"), ("base_mode", "above 0|positive")])
def test_negative_noise_and_frequencies_are_refused(option: str, fault: str) -> None:
    with pytest.raises(OptionError, match=f"{option} is -1.*({fault})"):
        rrrgen.simulate("planar2r", **{option: -1.0})


@pytest.mark.parametrize(("shift", "beyond"), [(0.0, ["q1", "q3"]), (0.5, [])])
def test_a_writing_task_beyond_the_range_of_a_joint_is_a_warning(shift: float, beyond: list[str], tmp_path):
    """The joints of the gantry are x, y and z of the tip: x begins at 0, and z ends there; 2 cm stay free."""
    file, findings = tmp_path / "writing.yaml", []
    plane = f"{{x: [{shift - 0.1}, {shift + 0.12}], y: 0.2, z: [{-0.2 - shift / 5}, {0.1 - shift / 5}]}}"
    file.write_text(f"schema: rrrgen-experiment/1\nwriting: {{text: N, plane: {plane}}}\n", encoding="utf-8")
    rrrgen.simulate("gantry", experiment=file, duration=0.1, findings=findings.append)
    shown = [str(fault) for fault in findings if "writing task" in fault.message]
    assert [re.search(r"warning: the writing task moves joint (\w+)", text)[1] for text in shown] == beyond
    if beyond:
        assert re.search(r"to -0.0\d+ m, beyond its lower limit of 0 m", shown[0])
        assert re.search(r"to 0.08 m, beyond its upper limit of 0 m", shown[1])


def test_a_motion_of_an_arm_with_another_number_of_joints_is_refused(motion, tmp_path):
    with pytest.raises(rrrgen.InputError, match="the motion moves 2 joints, rrr has 3"):
        rrrgen.simulate("rrr", motion)
    (tmp_path / "excitation.json").write_text(json.dumps(motion.to_json()), encoding="utf-8")
    with pytest.raises(rrrgen.InputError, match=r"excitation\.json moves 2 joints, pendulum has 1"):
        rrrgen.simulate("pendulum", tmp_path / "excitation.json")
