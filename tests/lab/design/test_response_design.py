"""Excitation for frequency responses: lines, crest factor, speed, quantisation, strokes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from lab.design.bands import RATE, rrr
from rrrgen.base.errors import InputError
from rrrgen.lab.design.plan import ResponsePlan
from rrrgen.lab.design.response_design import design_response

TWO = """schema: rrrgen/1
name: elbow
convention: standard
units: {{angle: rad, length: m}}
gravity: [0, 0, -9.81]
joints:
  - {{name: turn, type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0, limits: {first}}}
  - {{name: bend, type: revolute, alpha: 0, a: 0.2, d: 0, theta: 0, limits: {second}}}
"""


def test_the_joint_never_turns_and_quantisation_never_repeats():
    design = design_response(rrr(), ResponsePlan("table"), RATE)
    (run,) = design.runs
    s = 2j * np.pi * np.fft.rfftfreq(len(run.n), 1e-3)
    added = np.fft.irfft(np.fft.rfft(run.n) * s / (s**2 + design.kd[0] * s + design.kp[0]), len(run.n))
    assert run.speed > 1.4 * np.abs(added).max()
    steps = run.speed * 2.0 / 1e-4
    assert all(abs(m * steps - round(m * steps)) > 0.05 for m in range(1, 8))
    assert len(run.n) == 24000
    assert run.settle == 4000
    inertia = rrr().mass_matrix(np.zeros(1))[0, 0]
    assert np.abs(run.n).max() * inertia <= 0.4 * 20.0 + 1e-9
    q, dq, ddq = design.reference(run, np.array([0.0, 1.0]))
    assert np.allclose(q[1] - q[0], run.speed)
    assert np.allclose(dq, run.speed)
    assert not ddq.any()


def test_strokes_stay_in_the_range_and_hold_whole_periods():
    for signal in ("multisine", "noise"):
        plan = ResponsePlan(
            "1", signal=signal, period=1.0, band=(2.0, 100.0), periods=9, settle=1, rms=1.0, speed=0.20003
        )
        design = design_response(rrr(-0.5, 0.6), plan, RATE)
        assert len(design.runs) == 3
        for k, run in enumerate(design.runs):
            path = design.reference(run, 1e-3 * np.arange(len(run.n)))[0][:, 0]
            assert path.min() > -0.5
            assert path.max() < 0.6
            assert np.sign(run.speed) == (-1.0) ** k
            assert len(run.n) == 4000
        assert np.allclose(design.runs[0].n, design.runs[1].n) == (signal == "multisine")


@pytest.mark.parametrize(("lower", "upper"), [(None, 0.5), (-0.5, None), (0.3, None), (None, -0.3)])
def test_a_joint_with_one_limit_moves_on_its_free_side(lower: float | None, upper: float | None):
    """A joint with an upper limit alone, at 0.524 rad, was driven to 7.94 rad."""
    sides = {"lower": lower, "upper": upper}
    limits = "{" + ", ".join(f"{side}: {value}" for side, value in sides.items() if value is not None) + "}"
    model = rrrgen.compile(rrrgen.loads_spec(TWO.format(first=limits, second="{}")), backend="numpy")
    plan = ResponsePlan("turn", rms=1.0, speed=1.0000019)
    for run in design_response(model, plan, RATE).runs:
        path = 1e-3 * np.arange(len(run.n)) * run.speed + run.start[0]
        assert np.ptp(path) > 20.0
        assert upper is None or path.max() < upper
        assert lower is None or path.min() > lower


def test_standing_joints_stay_in_their_range():
    text = TWO.format(first="{}", second="{lower: -3, upper: -0.5}")
    model = rrrgen.compile(rrrgen.loads_spec(text), backend="numpy")
    assert design_response(model, ResponsePlan("turn"), RATE).runs[0].start == (0.0, -1.75)
    with pytest.raises(InputError, match="posture 1 has joint bend at 0\\.1, outside"):
        design_response(model, ResponsePlan("turn", postures=((0.0, 0.1),)), RATE)


@pytest.mark.parametrize(
    ("stated", "fault"),
    [
        ({"speed": 2.99003}, "moves at 2.99, .* its limit is 3"),
        ({"rms": 30.0}, "of its torque, whose limit is 20"),
    ],
)
def test_a_stated_speed_or_rms_beyond_the_limits_is_refused(stated: dict[str, float], fault: str):
    """The joint has the inertia 0.361 kg m^2, and the limits 20 N m, 100 rad/s^2 and 3 rad/s."""
    model = rrr(velocity=3.0)
    plan = ResponsePlan("table", band=(5.0, 100.0), rms=2.0, speed=2.00003)
    assert design_response(model, plan, RATE).runs
    with pytest.raises(InputError, match=f"joint 1 .*{fault}"):
        design_response(model, replace(plan, **stated), RATE)
    accelerated = rrrgen.compile(
        rrrgen.loads_spec(TWO.format(first="{acceleration: 50}", second="{}")), backend="numpy"
    )
    with pytest.raises(InputError, match=r"joint 1 .*of its acceleration, whose limit is 50"):
        design_response(accelerated, ResponsePlan("turn", rms=30.0), RATE)
