"""The compiled integrator of a rigid plant against that in NumPy: sliding, stops, sticking, added inertia."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.lab.plant import experiment
from rrrgen.lab.plant.compiled import CompiledRigidIntegrator, compiled_rigid_integrator
from rrrgen.lab.plant.experiment import VirtualRobot
from rrrgen.lab.plant.friction import Friction, MotorFriction
from rrrgen.lab.plant.integration import RigidIntegrator
from rrrgen.lab.plant.plant import FlexibleBase, make_plant
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel, MixedFriction, coulomb_viscous

ROBOT = """
schema: rrrgen/1
name: driven
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0.5, d: 0, theta: 0, drive: {inertia: 0.2}}
  - {name: b, type: revolute, alpha: 0, a: 0.4, d: 0, theta: 0, drive: {inertia: 0.1}}
links:
  - {mass: 2, com: [-0.2, 0, 0], inertia: {about: com, products: tensor, xx: 0.01, yy: 0.02, zz: 0.02}}
  - {mass: 1, com: [-0.2, 0, 0], inertia: {about: com, products: tensor, xx: 0.01, yy: 0.02, zz: 0.02}}
"""
MIXED = Friction(
    MixedFriction(
        [
            FrictionModel(LAWS["stribeck"], np.array([[1.0, 3.0, 0.5, 0.1]])),
            FrictionModel(LAWS["load_dependent"], np.array([[1.0, 0.3, 0.1]])),
        ],
        [0.3, -0.2],
    )
)


@cache
def model():
    return rrrgen.compile(rrrgen.loads_spec(ROBOT))


@pytest.mark.parametrize(
    ("friction", "added"),
    [(MIXED, None), (MIXED, [1e3, 0.0]), (None, None)],
    ids=["friction", "a locked joint", "no friction"],
)
def test_stops_and_sticking_as_in_numpy(friction, added) -> None:
    plant = make_plant(model(), friction=friction, drive_inertia=added)
    compiled, reference = compiled_rigid_integrator(plant, 2), RigidIntegrator(plant, 2)
    got = expected = plant.initial_state([0.3, -0.4], [0.8, -1.5])
    states, directions = [], []
    for k in range(400):
        load = model().gravity(expected[:2])
        tau = load + np.array([9.0, 4.0]) * np.sin(2 * np.pi * 1e-3 * k * np.array([3.0, 7.0])) ** 3
        got, expected = compiled.advance(got, tau, 1e-3), reference.advance(expected, tau, 1e-3)
        states.append(expected)
        directions.append(reference.direction)
        assert np.abs(got - expected).max() < 1e-11 * (1 + np.abs(expected).max())
    if friction is not None:
        slides = np.sign(directions)
        for sign in (-1.0, 0.0, 1.0):
            assert (slides[:, 1] == sign).sum() > 5
        assert ((slides == 0.0).sum(axis=1) == 1).any()  # one joint moves while the other is stuck
    assert np.ptp(np.array(states)[:, 1]) > 0.02


def test_a_long_experiment_is_integrated_in_c(monkeypatch) -> None:
    robot, start = VirtualRobot(make_plant(model(), friction=MIXED)), np.zeros(4)
    assert isinstance(robot._integrator(start, experiment.WORTH_BUILDING), CompiledRigidIntegrator)
    assert isinstance(robot._integrator(start, 10), RigidIntegrator)


def test_a_mass_matrix_that_is_not_positive_definite_is_refused() -> None:
    beta = np.array(model().beta)
    plant = make_plant(model(), beta=-beta, friction=MIXED, drive_inertia=[-1.0, -1.0])
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        compiled_rigid_integrator(plant, 2).advance(np.array([0.1, 0.2, 1.0, 1.0]), np.ones(2), 1e-3)


def test_what_is_not_compiled() -> None:
    assert compiled_rigid_integrator(make_plant(rrrgen.compile("planar2r", backend="numpy")), 2) is None
    motors = Friction(MotorFriction(None, coulomb_viscous([1.0, 0.5], [2.0, 1.0]), np.eye(2)))
    assert compiled_rigid_integrator(make_plant(model(), friction=motors), 2) is None
    assert compiled_rigid_integrator(make_plant(model(), base=FlexibleBase(20.0)), 2) is None
