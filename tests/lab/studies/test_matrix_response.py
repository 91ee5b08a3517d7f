"""The response of a whole arm as a function and a command, and the modes of its robot file beside the measured ones."""

from dataclasses import replace

import pytest

import rrrgen
from lab.response.shaken_arm import JOINTS, PERIOD, experiment
from lab.studies.commands import assert_same_files, printed_json
from rrrgen.robot.file import dumps
from samples.recordings import write_log

POSTURES = ((0.3, 0.8), (0.3, 2.0))


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """planar2r with the drives of the recordings."""
    spec = rrrgen.load_spec("planar2r")
    parts = zip(JOINTS.rotor_inertia, JOINTS.stiffness, JOINTS.damping, strict=True)
    text = dumps(spec)
    for name, (inertia, stiffness, damping) in zip(("q1", "q2"), parts, strict=True):
        drive = f"drive: {{inertia: {inertia}, stiffness: {stiffness}, damping: {damping}}}"
        text = text.replace(f"name: {name},", f"name: {name}, {drive},").replace(
            f"name: {name}\n", f"name: {name}\n    {drive}\n"
        )
    path = tmp_path_factory.mktemp("robot") / "elastic.yaml"
    path.write_text(text, newline="\n")
    assert rrrgen.load_spec(path).joints[1].drive.stiffness == JOINTS.stiffness[1]
    return path


def test_files_give_the_numbers_of_arrays_and_the_modes_of_the_robot_stand_beside(robot, tmp_path, capsys):
    logs = [experiment(posture, joint) for posture in POSTURES for joint in (0, 1)]
    arrays = [{"t": log.t, "q": log.q, "tau": log.tau} for log in logs]
    result = rrrgen.matrix_response(robot, arrays, period=PERIOD)
    assert result.trusted
    assert len(result) == 2
    assert len(result.elastic) == 4
    for row in result.elastic:
        assert row["deviation"] < 0.005
    assert "posture2: M(q) and stiffness give " in repr(result)
    over = result.to_json()["resonances_over_postures"]
    assert [len(mode["postures"]) for mode in over] == [2, 2]
    for number, log in enumerate(logs):
        write_log(tmp_path / f"{number}.csv", log)
    words = [word for number in range(4) for word in ("--log", tmp_path / f"{number}.csv")]
    command = ["response", "matrix", robot, *words, "--period", PERIOD, "-o", tmp_path / "run"]
    assert printed_json(capsys, *command) == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    assert (tmp_path / "run" / "figures" / "resonances.svg").exists()


def test_a_robot_without_elastic_joints_has_measured_resonances_alone():
    log = [experiment(POSTURES[0], joint) for joint in (0, 1)]
    result = rrrgen.matrix_response("planar2r", [replace(each, joints=("q1", "q2")) for each in log], period=PERIOD)
    assert result.elastic is None
    assert len(result[0].resonances) == 2
    assert result._repr_html_().count("<tr>") == 3


def test_the_period_is_needed():
    with pytest.raises(rrrgen.InputError, match="period is needed"):
        rrrgen.matrix_response("planar2r", experiment(POSTURES[0], 0))
