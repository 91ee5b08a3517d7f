"""Canonical frames: the same poses as the rows they came from, in either convention, and offsets that slid away."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from hypothesis import HealthCheck, given, settings

from oracles import newton_euler as oracle
from oracles.random_robots import robots_with_states, to_yaml
from rrrgen.robot.file import bundled_names, load_spec, loads_spec
from rrrgen.robot.model.canonical_frames import RobotModel, build_model
from rrrgen.robot.model.exact_transforms import IDENTITY, cosine_sine, normal_form

ROUND_OFF = 1e-12  # relative: a product of some twenty rotations and lengths of the order of one


def constant(transform) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = np.array(transform.R.evalf(30), dtype=float)
    T[:3, 3] = np.array(transform.p.evalf(30), dtype=float).ravel()
    return T


def poses(model: RobotModel, q: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """The user's link frames and the tip, through the canonical chain."""
    T, frames = np.eye(4), []
    for joint, frame, value in zip(model.joints, model.link_frames, q, strict=True):
        motion = np.eye(4)
        if joint.revolute:
            c, s = np.cos(value + float(joint.theta)), np.sin(value + float(joint.theta))
            motion[:2, :2] = [[c, -s], [s, c]]
        else:
            motion[2, 3] = value
        T = T @ constant(joint.before) @ motion
        frames.append(T @ constant(frame))
    return frames, T @ constant(model.tip)


@settings(deadline=None, max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(robots_with_states())
def test_the_canonical_chain_moves_as_the_rows_do(drawn):
    robot, q, _, _ = drawn
    model = build_model(loads_spec(to_yaml(robot)))
    frames, tip = poses(model, q)
    size = 1.0 + np.abs(oracle.forward_kinematics(robot, q)).max()
    assert np.abs(tip - oracle.forward_kinematics(robot, q)).max() <= ROUND_OFF * size
    for own, expected in zip(frames, oracle.frames(robot, q).links, strict=True):
        assert np.abs(own - expected).max() <= ROUND_OFF * size


@pytest.mark.parametrize("name", bundled_names())
def test_joints_of_a_block_lie_in_one_plane_and_the_last_leads_on_from_the_plane_of_the_next_offset(name):
    model = build_model(load_spec(name))
    for block in model.blocks:
        leads_on = block[-1] + 1 < model.n
        for i in block[1:]:
            joint = model.joints[i]
            assert joint.parallel
            assert joint.before.R == IDENTITY
            if leads_on and i == block[-1]:
                assert model.joints[i + 1].before.p[2] == 0, (name, i)
            else:
                assert joint.before.p[2] == 0, (name, i)
    assert [i for block in model.blocks for i in block] == list(range(model.n))


def test_the_reference_robot_has_one_block_of_two_and_one_offset_between():
    model = build_model(load_spec("rrr"))
    assert model.blocks == ((0,), (1, 2))
    a2, a3, d1, d2, d3 = (sp.Symbol(name, real=True) for name in ("a2", "a3", "d1", "d2", "d3"))
    assert [list(joint.before.p) for joint in model.joints] == [[0, 0, d1], [0, 0, 0], [a2, 0, 0]]
    assert list(model.tip.p) == [a3, 0, d2 + d3]


def test_right_angles_are_exact_and_others_stay_functions():
    assert cosine_sine(sp.pi / 2) == (0, 1)
    assert cosine_sine(sp.pi / 3) == (sp.Rational(1, 2), sp.sqrt(3) / 2)
    c, s = cosine_sine(sp.pi / 5)
    assert c.func is sp.cos
    assert s.func is sp.sin


def test_every_angle_has_a_cosine_and_a_sine():
    """The squares of some are sums with a root: that of 22.5 degrees ended as an internal fault."""
    for k in range(240):
        c, s = (value.replace(sp.UnevaluatedExpr, sp.N) for value in cosine_sine(k * sp.pi / 120))
        angle = k * math.pi / 120
        assert (float(c), float(s)) == pytest.approx((math.cos(angle), math.sin(angle)), abs=4e-15)


def test_squares_of_a_sine_vanish_against_those_of_the_cosine():
    x = sp.Symbol("x", real=True)
    assert normal_form(sp.sin(x) ** 2 + sp.cos(x) ** 2 - 1) == 0
    assert normal_form(sp.sin(x) ** 3 - sp.sin(x) * (1 - sp.cos(x) ** 2)) == 0
