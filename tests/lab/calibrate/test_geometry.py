"""The geometry that is calibrated: that of the robot file, and mechanisms in the positions of their drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.calibrate.virtual import measure, off_the_table, positions
from rrrgen.base.errors import DerivationError
from rrrgen.lab.calibrate.estimation import calibrate
from rrrgen.lab.calibrate.geometry import geometry_of, rotation_vectors
from rrrgen.lab.calibrate.minimal_set import choose_poses
from rrrgen.lab.calibrate.robot_file import calibrated_spec
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters


@pytest.mark.parametrize("name", ["rrr", "panda", "scara"])
def test_geometry_is_that_of_the_robot_file(name):
    spec = load_spec(name)
    geometry, q = geometry_of(spec), np.random.default_rng(0).normal(size=(5, spec.n))
    reference = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)))
    np.testing.assert_allclose(geometry.forward(q), reference.forward_kinematics(q), atol=1e-14)
    entries = geometry.entries()
    J, step = geometry.jacobian(q, entries), np.random.default_rng(1).normal(size=len(entries)) * 1e-6
    after, before = geometry.with_step(entries, step).forward(q), geometry.with_step(entries, -step).forward(q)
    np.testing.assert_allclose((after - before)[:, :3, 3] / 2, J[:, :3] @ step, atol=1e-14)
    turned = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], 1, 2)
    np.testing.assert_allclose(rotation_vectors(turned) / 2, J[:, 3:] @ step, atol=1e-14)


# a wrist whose last drive turns two joints, a gear of 1/2, and parallel axes 2 and 3, which get an angle beta
COUPLED = """\
schema: rrrgen/1
name: coupled
convention: {convention}
units: {{angle: deg, length: m}}
gravity: [0, 0, -9.81]
joints:
  - {{name: j1, type: revolute, alpha: 90, a: 0, d: 0.4}}
  - {{name: j2, type: revolute, alpha: 0, a: 0.43, d: 0}}
  - {{name: j3, type: revolute, alpha: -90, a: 0.02, d: 0.1, follows: {{j3: 1, j2: -1}}, limits: {{lower: -100, upper: 100}}}}
  - {{name: j4, type: revolute, alpha: 90, a: 0, d: 0.43, follows: {{j4: 1/2}}}}
  - {{name: j5, type: revolute, alpha: -90, a: 0, d: 0}}
  - {{name: j6, type: revolute, alpha: 0, a: 0, d: 0.06, follows: {{j6: 1, j5: 1}}}}
  - {{name: twin, type: revolute, alpha: 70, a: 0.1, d: 0.05, follows: {{j6: -1}}, limits: {{lower: -60, upper: 60}}}}
"""  # noqa: E501


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_mechanism_is_calibrated_in_joint_positions(convention):
    spec, random = loads_spec(COUPLED.format(convention=convention)), np.random.default_rng(8)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 60, random)
    assert q.shape[1] == nominal.joints == 6
    found = calibrate(nominal, measure("pose", true, q, random))
    away = positions(spec, 300, random)
    error = np.linalg.norm((found.geometry.forward(away) - true.forward(away))[:, :3, 3], axis=1)
    before = np.linalg.norm((nominal.forward(away) - true.forward(away))[:, :3, 3], axis=1)
    assert error.mean() < 5e-5 < 1e-3 < before.mean()
    assert 0.7 < found.chi2_per_dof < 1.3
    told = loads_spec(dumps(calibrated_spec(spec, found.geometry, "measured")))
    assert told.mechanism.matrix == spec.mechanism.matrix
    assert [joint.limits for joint in told.joints] == [joint.limits for joint in spec.joints]
    reference = NewtonEuler(chain_of(told), np.zeros((len(told.rows), 10)))
    assert np.abs(reference.forward_kinematics(away) - found.geometry.forward(away)).max() < 1e-9


def test_poses_of_a_mechanism_keep_rows_that_follow_in_their_range():
    text = COUPLED.format(convention="standard").replace("{j6: -1}", "{j6: -1, j5: 1}")
    spec = loads_spec(text)
    q, gain = choose_poses(spec, geometry_of(spec), "pose", 20, 1)
    assert np.degrees(np.abs(q[:, 4] - q[:, 5])).max() <= 60
    assert gain > 1


PALLETISER = Path(__file__).resolve().parents[3] / "examples" / "palletiser" / "robot.yaml"


def test_the_chain_of_a_parallelogram_is_calibrated_in_positions_of_its_drives():
    spec, random = load_spec(PALLETISER), np.random.default_rng(8)
    nominal, true = off_the_table(spec, random)
    assert (nominal.n, nominal.joints) == (5, 4)
    q = positions(spec, 50, random)
    found = calibrate(nominal, measure("pose", true, q, random))
    assert {"a1", "a2", "a3", "beta2", "beta3"} <= {entry.name for entry in found.chosen.kept}
    assert "+1 a1" in found.chosen.left_out["a4"]  # the wrist stays level, so that its length looks like that of link 1
    away = positions(spec, 300, random)
    error = np.linalg.norm((found.geometry.forward(away) - true.forward(away))[:, :3, 3], axis=1)
    assert error.mean() < 5e-5
    told = loads_spec(dumps(calibrated_spec(spec, found.geometry, "measured")))
    assert (told.parents, told.tip_row, told.mechanism.matrix) == (spec.parents, spec.tip_row, spec.mechanism.matrix)
    reference = NewtonEuler(chain_of(told), nominal_parameters(told))
    assert np.abs(reference.forward_kinematics(away) - found.geometry.forward(away)).max() < 1e-9
    # crank and rod stay at the arm: with a table that is hardly off, all torques are those of the robot file
    same = geometry_of(spec)
    same = same.with_step(same.entries(), np.full(len(same.entries()), 1e-5))
    same = loads_spec(dumps(calibrated_spec(spec, same, "measured")))
    assert abs(float(same.joints[1].d)) > 1e3
    still = np.zeros_like(away)
    torques = [
        NewtonEuler(chain_of(each), nominal_parameters(each)).inverse_dynamics(away, still, away)
        for each in (spec, same)
    ]
    np.testing.assert_allclose(torques[1], torques[0], atol=1e-4 * np.abs(torques[0]).max())


def test_a_branch_that_cannot_follow_is_named():
    spec = load_spec(PALLETISER)
    geometry = geometry_of(spec)
    moved = geometry.with_step([entry for entry in geometry.entries() if entry.key == "beta"], np.full(2, 1e-3))
    modified = replace(spec, convention="modified")
    with pytest.raises(DerivationError, match="elbow branches off in a table of the modified convention"):
        calibrated_spec(modified, moved, "measured")
