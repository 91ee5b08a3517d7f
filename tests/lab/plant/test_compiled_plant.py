"""The compiled plant against the equations in NumPy and the stiff solver."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.lab.plant.compiled import compiled_integrator, fastest_rate, plant_program
from rrrgen.lab.plant.friction import Friction, MotorFriction
from rrrgen.lab.plant.integration import StiffIntegrator
from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints, RigidBody, make_plant
from rrrgen.program import evaluate
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel, MixedFriction, coulomb_viscous

JOINTS = FlexibleJoints((0.2, 0.1), (2e4, 1e4), (20.0, 10.0))
BASE = FlexibleBase(20.0, 28.0, 0.1)
COULOMB = coulomb_viscous([1.0, 0.5], [2.0, 1.0])
LUGRE = FrictionModel(LAWS["lugre"], np.array([[1e4, 30.0, 0.3, 1.0, 0.4, 0.1], [2e4, 20.0, 0.2, 0.5, 0.2, 0.1]]))


MIXED = MixedFriction([coulomb_viscous([1.0], [2.0]), FrictionModel(LAWS["lugre"], LUGRE.parameters[1:])], [0.3, -0.2])
LOADED = FrictionModel(LAWS["load_dependent"], np.array([[1.0, 0.5, 0.2], [0.4, 0.3, 0.1]]))
LOADED_DAHL = MixedFriction(
    [
        FrictionModel(LAWS["dahl_load_dependent"], np.array([[0.3, 1.0, 0.4, 0.1, 0.2, 0.1, 1e-3]])),
        FrictionModel(LAWS["load_dependent"], LOADED.parameters[1:]),
    ],
    [0.3, -0.2],
)


@cache
def model():
    return rrrgen.compile("planar2r")


@pytest.mark.parametrize(
    "friction",
    [None, COULOMB, LUGRE, MIXED, LOADED, LOADED_DAHL],
    ids=["none", "coulomb", "lugre", "mixed", "loaded", "loaded dahl"],
)
@pytest.mark.parametrize(
    ("joints", "base"), [(JOINTS, None), (None, BASE), (JOINTS, BASE)], ids=["joints", "base", "both"]
)
def test_the_program_holds_the_equations_of_the_plant(friction, joints, base):
    plant = make_plant(model(), friction=friction and Friction(friction), joints=joints, base=base)
    program, derivative = plant_program(plant), plant.state_derivative()
    rng = np.random.default_rng(1)
    for _ in range(5):
        state = plant.initial_state(rng.normal(size=2), rng.normal(size=2))
        state = state + 1e-3 * rng.normal(size=state.size)
        tau = rng.normal(size=2)
        rates, failed = evaluate(program, state, tau)
        expected = derivative(state, 0.0, tau)
        assert np.abs(rates - expected).max() <= 1e-11 * np.abs(expected).max()
        assert not failed


@pytest.mark.parametrize(("friction", "tolerance"), [(COULOMB, 1e-6), (LUGRE, 1e-4)], ids=["coulomb", "lugre"])
def test_its_motion_is_that_of_the_stiff_solver(friction, tolerance):
    """The bristles of LuGre have a kink at each change of direction, which costs an explicit method its order."""
    plant = make_plant(model(), friction=Friction(friction), joints=JOINTS, base=BASE)
    state = other = plant.initial_state([0.3, -0.5], [0.5, 0.0])
    compiled, stiff = compiled_integrator(plant, state, 1e-3), StiffIntegrator(plant, 1e-10)
    for k in range(50):
        tau = np.array([10.0 * np.sin(0.2 * k), 4.0 * np.cos(0.3 * k)])
        state, other = compiled.advance(state, tau, 1e-3), stiff.advance(other, tau, 1e-3)
    assert np.abs(state - other).max() <= tolerance * np.abs(other).max()


def test_what_has_no_program_or_is_too_stiff_is_left_to_the_stiff_solver():
    rigid = make_plant(model())
    assert compiled_integrator(rigid, rigid.initial_state([0, 0], [0, 0]), 1e-3) is None
    motors = Friction(MotorFriction(None, COULOMB, np.eye(2)))
    coupled = make_plant(model(), friction=motors, base=BASE)
    assert plant_program(coupled) is None
    stiff = make_plant(model(), joints=FlexibleJoints((1e-6, 1e-6), (1e8, 1e8), (1.0, 1.0)))
    state = stiff.initial_state([0, 0], [0, 0])
    assert fastest_rate(stiff, state) > 1e6
    assert compiled_integrator(stiff, state, 1e-3) is None
    assert RigidBody(model(), drive_inertia=[0.1, 0.1]).forward_dynamics_program() is None
