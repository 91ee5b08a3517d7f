"""Elastic joints as a function: from arrays without files, with the numbers of the command."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from lab.identify.test_elastic_joints import DAMPING, ROTOR, STIFFNESS, recorded
from lab.studies.commands import assert_same_files, printed_json
from rrrgen.lab.plant.plant import FlexibleJoints
from samples.recordings import write_log

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


def test_arrays_give_the_numbers_of_the_command(tmp_path, capsys):
    log = recorded(2.0, FlexibleJoints(ROTOR, STIFFNESS, DAMPING))
    result = rrrgen.estimate_elastic_joints("planar2r", {"t": log.t, "q": log.q, "tau": log.tau}, bandwidth=40)
    write_log(tmp_path / "log.csv", log)
    command = ["experiment", "elastic-joints", "planar2r", "--log", tmp_path / "log.csv", "-o", tmp_path / "run"]
    assert printed_json(capsys, *command, "--bandwidth", 40) == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    for k, joint in enumerate(("q1", "q2")):
        assert float(result[f"stiffness_{joint}"]) == pytest.approx(STIFFNESS[k], rel=0.02)
        assert float(result[f"rotor_inertia_{joint}"]) == pytest.approx(ROTOR[k], rel=0.02)
    assert "drive: {inertia: " in repr(result)
    assert result._repr_html_().count("<tr>") == 13


def test_torques_that_are_not_explained_give_no_lines_to_write(tmp_path, capsys):
    """Degrees read as radians gave a stiffness of 229 +- 30 where it is 9000, a line to write, and the exit code 0."""
    log = recorded(1.5, FlexibleJoints(ROTOR, STIFFNESS, DAMPING))
    write_log(tmp_path / "log.csv", replace(log, q=np.degrees(log.q)))
    command = ["experiment", "elastic-joints", "planar2r", "--log", tmp_path / "log.csv", "-o", tmp_path / "run"]
    code, found = printed_json(capsys, *command, "--bandwidth", 40)
    assert code == 1
    (note,) = found["notes"]
    assert " are not explained: " in note
    result = rrrgen.estimate_elastic_joints("planar2r", tmp_path / "log.csv", bandwidth=40)
    assert not result.trusted
    assert "drive: {inertia: " not in repr(result)


def test_positions_at_the_motors_are_not_those_at_the_links():
    log = recorded(0.2, FlexibleJoints(ROTOR, STIFFNESS, DAMPING))
    arrays = {"t": log.t, "q": log.q, "tau": log.tau}
    with pytest.raises(rrrgen.InputError, match="link1 is given twice, as the positions at the motors and"):
        rrrgen.estimate_elastic_joints("planar2r", arrays, links=arrays)


def test_robots_of_other_kinds_are_refused():
    t = np.arange(100) * 1e-3
    still = {"t": t, "q": np.zeros((100, 1)), "tau": np.zeros((100, 1))}
    with pytest.raises(rrrgen.InputError, match="press has closed loops: elastic joints are estimated where"):
        rrrgen.estimate_elastic_joints(EXAMPLES / "press" / "robot.yaml", still)
