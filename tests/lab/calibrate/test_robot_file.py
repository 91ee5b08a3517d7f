"""The robot file of a calibrated arm: its geometry, its bodies, its tools."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from lab.calibrate.virtual import measure, off_the_table, positions
from rrrgen.lab.calibrate.estimation import calibrate
from rrrgen.lab.calibrate.geometry import geometry_of
from rrrgen.lab.calibrate.minimal_set import minimal_set
from rrrgen.lab.calibrate.robot_file import calibrated_spec
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.robot.spec import FixedTransform
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters


@pytest.mark.parametrize("name", ["puma560", "ur10e", "stanford"])
def test_the_robot_file_has_the_calibrated_geometry_and_the_same_bodies(name):
    spec, random = load_spec(name), np.random.default_rng(6)
    geometry = geometry_of(spec)
    entries = minimal_set(geometry, "pose").kept
    moved = geometry.with_step(entries, random.normal(size=len(entries)) * 1e-3)
    again = loads_spec(dumps(calibrated_spec(spec, moved, "test")))
    q = positions(spec, 20, random)
    found = NewtonEuler(chain_of(again), nominal_parameters(again))
    np.testing.assert_allclose(found.forward_kinematics(q), moved.forward(q), atol=2e-11)
    assert again.source == "test"
    same = loads_spec(dumps(calibrated_spec(spec, geometry, "test")))
    before = NewtonEuler(chain_of(spec), nominal_parameters(spec))
    still = np.zeros_like(q)
    expected = before.inverse_dynamics(q, still, q)
    after = NewtonEuler(chain_of(same), nominal_parameters(same)).inverse_dynamics(q, still, q)
    np.testing.assert_allclose(after, expected, atol=1e-9 * np.abs(expected).max())
    close = found.inverse_dynamics(q, still, q)  # bodies stay with their joints: torques change as little as the table
    np.testing.assert_allclose(close, expected, atol=0.03 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["scara", "rrr", "ur10e"])
def test_other_tools_stay_at_the_last_link(name):
    """Where the last axes are nearly parallel, the last link frame moves far along them."""
    T = FixedTransform(FixedTransform().rotation, (sp.Rational(1, 10), sp.S.Zero, sp.Symbol("length", real=True)))
    spec = load_spec(name)
    parameters = {**spec.parameters, "length": sp.Rational(1, 5)}
    spec = replace(
        spec, tools={"gripper": T}, parameters=parameters, parameter_units={**spec.parameter_units, "length": "m"}
    )
    true = off_the_table(spec, np.random.default_rng(4))[1]
    told = loads_spec(dumps(calibrated_spec(spec, replace(true, tool=geometry_of(spec).tool), "test")))
    q = positions(spec, 20, np.random.default_rng(5))
    before, after = (
        NewtonEuler(chain_of(replace(each, tool=each.tools["gripper"])), np.zeros((spec.n, 10)))
        for each in (spec, told)
    )
    moved = after.forward_kinematics(q)[:, :3, 3] - before.forward_kinematics(q)[:, :3, 3]
    assert 1e-4 < np.abs(moved).max() < 0.03  # the errors of base and rows, and no more


@pytest.mark.parametrize("name", ["ur10e", "puma560"])
def test_a_calibrated_arm_is_calibrated_again(name):
    """Common perpendiculars far away leave the parameters as certain as those of the nominal table."""
    spec, random = load_spec(name), np.random.default_rng(9)
    nominal, true = off_the_table(spec, random)
    measured = measure("pose", true, positions(spec, 40, random), random)
    first = calibrate(nominal, measured)
    told = loads_spec(dumps(calibrated_spec(spec, first.geometry, "once")))
    assert max(abs(float(joint.d)) for joint in told.joints) > 10
    again = calibrate(geometry_of(told), measured)
    assert [entry.name for entry in again.chosen.kept] == [entry.name for entry in first.chosen.kept]
    assert np.abs(again.change).max() < 1e-8
    assert again.deviation.max() < 2 * first.deviation.max()
    twice = loads_spec(dumps(calibrated_spec(told, again.geometry, "twice")))
    q, still = positions(spec, 20, random), np.zeros((20, spec.n))
    models = [NewtonEuler(chain_of(each), nominal_parameters(each)) for each in (told, twice)]
    np.testing.assert_allclose(*(each.forward_kinematics(q) for each in models), atol=1e-7)
    torques = [each.inverse_dynamics(q, still, q) for each in models]
    np.testing.assert_allclose(*torques, atol=1e-6 * np.abs(torques[0]).max())
