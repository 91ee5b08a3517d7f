"""One signature per function: what a robot file states about drives and friction changes no list of arguments."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

from rrrgen.derive import derive_model
from rrrgen.derive.functions.table import GROUPS
from rrrgen.derive.optimizer import combine_programs
from rrrgen.emit.c.header_comments import prototype
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.description import programs_of
from rrrgen.program import evaluate
from rrrgen.robot.file import loads_spec

ARM = """
schema: rrrgen/1
name: arm
convention: standard
units: {length: m, angle: rad}
gravity: [0, 0, -9.81]
joints:
  - {type: revolute, alpha: pi/2, a: 0, d: 0.5STATED}
  - {type: revolute, alpha: 0, a: 0.4, d: 0STATED}
  - {type: revolute, alpha: 0, a: 0.3, d: 0}
links:
  - {mass: 3, com: [0, 0.1, 0], inertia: {about: com, xx: 0.1, yy: 0.1, zz: 0.1}}
  - {mass: 2, com: [-0.1, 0, 0.02], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
  - {mass: 1, com: [-0.1, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.01, zz: 0.01}}
"""
COUPLED = """
drives:
  joint_from_drive: [[1, 0, 0], [0, 1, 1/2], [0, 0, 1]]
  motors:
    - {name: m1, inertia: 0.2}
    - {name: m2, friction: {law: stribeck, stiction_excess: 0.5, coulomb: 1, viscous: 0.2, stribeck_speed: 0.1}}
    - {name: m3, inertia: 0.1}
"""
STATED = {
    "nothing": ("", ""),
    "drives and friction": (", drive: {inertia: 0.25}, friction: {viscous: 1, coulomb: 0.5}", ""),
    "coupled drives": ("", COUPLED),
}


@cache
def model(stated: str):
    """The model of an arm whose file states this much, all groups of functions, as recorded: quick, and the ports that
    signatures are printed from.
    """
    joint, more = STATED[stated]
    recorded = derive_model(loads_spec(ARM.replace("STATED", joint) + more), tuple(GROUPS))
    programs = {name: variants[0] for name, variants in recorded.alternatives.items()}
    return recorded.make_derived_model(
        programs | combine_programs("forward_dynamics", recorded.derivation, programs), ()
    )


def prototypes(stated: str) -> dict[str, str]:
    """The C prototype of every function, without the lengths of arrays."""
    listed = programs_of(model(stated))
    return {
        name: re.sub(r"\[(\w*RESTRICT )?\d+\]", "[]", prototype(each, Dialect("arm"))) for name, each in listed.items()
    }


@pytest.mark.parametrize("stated", list(STATED)[1:])
def test_what_a_file_states_changes_no_prototype(stated):
    plain, found = prototypes("nothing"), prototypes(stated)
    assert {name: found.get(name) for name in plain} == plain
    further = {"friction", "nominal_friction"} if "friction" in model(stated).programs else set()
    assert set(found) - set(plain) == further


@pytest.mark.parametrize("stated", ["drives and friction", "coupled drives"])
def test_drive_inertias_follow_the_base_parameters_everywhere(stated):
    """In phi, beta and the columns of the regressors, so that torques stay linear in one vector."""
    arm, rng = model(stated), np.random.default_rng(4)
    q, dq, ddq, v, a, e = rng.uniform(-2, 2, (6, 3))
    phi = rng.normal(size=30 + arm.beta_size - arm.b)

    def call(name, *values):
        return evaluate(arm.programs[name], *values)

    (beta,) = call("base_parameters", phi)
    assert beta.shape == (arm.beta_size,)
    assert np.array_equal(beta[arm.b :], phi[30:])
    (tau,), (Y,), (Ys,) = (
        call("inverse_dynamics", q, dq, ddq, beta),
        call("regressor", q, dq, ddq),
        call("standard_regressor", q, dq, ddq),
    )
    close(Y @ beta, tau)
    close(Ys @ phi, tau)
    close(call("regressor_transpose", q, dq, ddq, e)[0], e @ Y)
    (reference,) = call("reference_torque", q, dq, v, a, beta)
    close(call("reference_regressor_transpose", q, dq, v, a, e)[0] @ beta, e @ reference)
    (loaded,) = call("add_payload", 1.5, np.array([0.1, 0.2, 0.3]), 0.1 * np.eye(3), beta)
    assert np.array_equal(loaded[arm.b :], beta[arm.b :])


def close(found, expected):
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()
