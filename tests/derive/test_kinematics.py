"""Kinematics of random robots, as derived: the Jacobians of the links are the differences of their frames."""

from __future__ import annotations

import numpy as np
from hypothesis import Phase, given, settings

from oracles.random_robots import robots, to_yaml
from rrrgen.derive.functions.recording import FunctionBuilder, parametrize
from rrrgen.derive.functions.table import recorders
from rrrgen.derive.parameters.base_parameters import base_set
from rrrgen.program import evaluate
from rrrgen.robot.file import loads_spec
from rrrgen.robot.model import build_model

FINDING = (Phase.explicit, Phase.generate)

NAMES_OF_FRAMES = ("link_frames", "link_jacobians")


@settings(max_examples=12, phases=FINDING)
@given(robots(max_joints=6))
def test_link_jacobians_are_the_differences_of_the_link_frames(robot):
    model = build_model(loads_spec(to_yaml(robot)))
    parametrization = parametrize(base_set(model), None)
    frames, jacobians = (recorders(name)[0](FunctionBuilder(model, parametrization)) for name in NAMES_OF_FRAMES)
    rng, h = np.random.default_rng(robot.n), 1e-5
    q, dq = rng.uniform(-2, 2, (2, 5, robot.n))
    (T,), (ahead,), (behind,), (J,) = (
        evaluate(program, at)
        for program, at in ((frames, q), (frames, q + h * dq), (frames, q - h * dq), (jacobians, q))
    )
    rate = (ahead - behind) / (2 * h)
    W = rate[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2)
    twists = np.concatenate([rate[..., :3, 3], np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], -1)], -1)
    found = np.einsum("skij,sj->ski", J, dq)
    np.testing.assert_allclose(found, twists, atol=1e-7 * max(1.0, np.abs(twists).max()))
