"""Friction that depends on the load: simulated by the virtual robot, identified back, written, scored again."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.friction_choice import LawChoice
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.results import identified_spec
from rrrgen.lab.identify.validation import robot_model, validate_recordings
from rrrgen.lab.plant.friction import Friction
from rrrgen.lab.plant.integration import RigidIntegrator
from rrrgen.lab.plant.plant import make_plant
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.robot.friction.models import robot_friction
from samples.recordings import fourier_motion

ARM = """schema: rrrgen/1
name: geared
convention: standard
units: {{angle: rad, length: m}}
gravity: [0, -9.81, 0]
joints:
  - {{name: a, type: revolute, alpha: 0, a: 0.4, d: 0, friction: {a}, drive: {{inertia: 0.05}}}}
  - {{name: b, type: revolute, alpha: 0, a: 0.3, d: 0, friction: {b}}}
links:
  - {{mass: 3, com: [-0.2, 0, 0], inertia: {{about: com, xx: 0.01, yy: 0.04, zz: 0.05}}}}
  - {{mass: 2, com: [-0.15, 0.01, 0], inertia: {{about: com, xx: 0.01, yy: 0.02, zz: 0.02}}}}
"""
LINEAR = "{viscous: 0, coulomb: 0}"
TRUTH = ARM.format(
    a="{law: load_dependent, coulomb: 1.5, viscous: 0.8, load_ratio: 0.12, offset: 0.2}",
    b="{law: load_dependent, coulomb: 0.4, viscous: 0.3, load_ratio: 0.07}",
)
PERIOD = 2e-3
PROCESSING = Processing("logged", decimate=10)


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile(loads_spec(ARM.format(a=LINEAR.replace("}", ", offset: 0}"), b=LINEAR)), backend="numpy")


@pytest.fixture(scope="module")
def log():
    """The virtual robot under computed torque along a motion with many reversals; torques with noise."""
    truth = rrrgen.compile(loads_spec(TRUTH))
    friction = robot_friction(truth.spec)
    integrator = RigidIntegrator(make_plant(truth, friction=Friction(friction)), 1)
    t = PERIOD * np.arange(3000)
    wanted = fourier_motion(t, 2, 3, base=1 / 3, size=0.45)
    state = np.concatenate([wanted[0][0], wanted[1][0]])
    rows = []
    for q, dq, ddq in zip(*wanted, strict=True):
        u = ddq + 100.0 * (q - state[:2]) + 20.0 * (dq - state[2:])
        tau = truth.inverse_dynamics(state[:2], state[2:], u)
        tau = tau + truth.friction(dq, tau)
        after = integrator.advance(state, tau, PERIOD)
        net = tau - integrator.plant.friction.torque_in_direction(state[2:], np.sign(state[2:]), tau)
        rows.append([state, truth.forward_dynamics(state[:2], state[2:], net), tau])
        state = after
    states, ddq, tau = (np.array(each) for each in zip(*rows, strict=True))
    tau = tau + 0.02 * np.random.default_rng(0).normal(size=tau.shape)
    return Log(("a", "b"), t, states[:, :2], tau, dq=states[:, 2:], ddq=ddq, period=PERIOD)


@pytest.mark.sweep
def test_the_law_is_chosen_and_its_parameters_are_those_simulated(arm, log):
    options = Options(
        friction=LawChoice.parse(["auto"], arm.spec), correlated=False, poses=2, split=Split.parse("first:0.7")
    )
    found = identify(arm, [log], PROCESSING, options)
    assert [surface.law for surface in found.friction.surfaces] == ["load_dependent", "load_dependent"]
    values = dict(zip(found.consistent.names, found.consistent.theta, strict=True))
    wanted = {"coulomb1": 1.5, "viscous1": 0.8, "load_ratio1": 0.12, "off1": 0.2}
    wanted |= {"coulomb2": 0.4, "viscous2": 0.3, "load_ratio2": 0.07}
    for name, value in wanted.items():
        assert values[name] == pytest.approx(value, rel=0.05), name
    assert found.consistent_held_out["relative_error"] < 0.01
    linear = next(each for each in found.friction.table if each.law == "coulomb_viscous")
    assert linear.held_out > 3 * min(each.held_out for each in found.friction.table)

    spec = loads_spec(dumps(identified_spec(arm.spec, found.consistent, surfaces=found.friction.surfaces)))
    result = validate_recordings(robot_model(rrrgen.compile(spec, backend="numpy")), [log], PROCESSING)
    assert result.relative_error < 0.01
    again = identify(rrrgen.compile(spec, backend="numpy"), [log], PROCESSING, Options(correlated=False, poses=2))
    assert [surface.law for surface in again.friction.surfaces] == ["load_dependent", "load_dependent"]


def test_a_function_without_the_load_is_told_what_is_missing():
    robot = rrrgen.compile(loads_spec(TRUTH), backend="numpy")
    with pytest.raises(ValueError, match="friction needs tau_load: a friction law of this robot depends on the load"):
        robot.friction([0.1, 0.2])


@pytest.mark.parametrize(
    ("ratio", "message"), [("-0.1", "load_ratio of joint 1 is -0.1"), ("1", "load_ratio of joint 1 is 1")]
)
def test_ratios_that_no_gear_has_are_refused(ratio, message):
    with pytest.raises(InputError) as caught:
        loads_spec(ARM.format(a=f"{{law: load_dependent, coulomb: 1, load_ratio: {ratio}}}", b=LINEAR))
    assert message in caught.value.faults[0].message
