"""Excitation for frequency responses: lines, crest factor, speed, quantisation, strokes."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.design.plan import ResponseDesign, ResponsePlan
from rrrgen.lab.design.response_design import design_response
from rrrgen.lab.design.signals import SIGNALS, excitation_signal

RATE, SAMPLES, BAND = 1000.0, 2000, (0.5, 200.0)


def lines(signal):
    amplitude = np.abs(np.fft.rfft(signal))
    return np.flatnonzero(amplitude > 1e-3 * amplitude.max()), amplitude


@cache
def rrr(lower=None, upper=None, velocity=None):
    text = (
        "schema: rrrgen/1\nname: turntable\nconvention: standard\nunits: {angle: rad, length: m}\n"
        "gravity: [0, 0, -9.81]\njoints:\n"
        "  - {name: table, type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0, limits: {torque: 20, "
        + (f"lower: {lower}, upper: {upper}, " if lower is not None else "")
        + (f"velocity: {velocity}, " if velocity is not None else "")
        + "acceleration: 100}, drive: {encoder_resolution: 1e-4}}\n"
        "links:\n  - {mass: 4, com: [-0.1, 0, 0], inertia: {about: com, xx: 0.1, yy: 0.1, zz: 0.2}}\n"
    )
    return rrrgen.compile(rrrgen.loads_spec(text), backend="numpy")


@pytest.mark.parametrize("kind", SIGNALS)
def test_signals_have_their_band_and_unit_rms(kind):
    signal = excitation_signal(kind, BAND, SAMPLES, RATE, np.random.default_rng(1))
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(1.0)
    assert abs(np.mean(signal)) < 1e-12
    excited, amplitude = lines(signal)
    inside = (excited >= 1) & (excited <= 400)
    if kind == "swept_sine":
        assert np.sum(amplitude[1:401] ** 2) > 0.98 * np.sum(amplitude**2)
        assert np.abs(signal).max() < 1.5
    else:
        assert inside.all()
    if kind == "multisine":
        assert np.array_equal(excited, np.arange(1, 401))
        assert np.allclose(amplitude[1:401], amplitude[1])
        assert np.abs(signal).max() < 3.3
    if kind == "odd_multisine":
        assert np.all(excited % 2 == 1)
        assert len(excited) == 150  # of 200 odd lines one in four is left out
        groups = np.setdiff1d(np.arange(1, 400, 2), excited).reshape(-1) // 8
        assert np.array_equal(groups, np.arange(50))


def test_the_draw_is_the_one_with_the_smallest_peak():
    one = [np.abs(excitation_signal("multisine", BAND, 500, RATE, np.random.default_rng(k))).max() for k in range(5)]
    assert max(one) < 3.0


@pytest.mark.parametrize("band", [(0.0, 10.0), (20.0, 10.0), (1.0, 500.0), (10.0, 11.0)])
def test_bands_that_cannot_be_are_refused(band):
    with pytest.raises(InputError, match="band"):
        excitation_signal("multisine", band, SAMPLES, RATE, np.random.default_rng(0))


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


def test_a_design_reads_back_from_its_file():
    for signal in ("multisine", "noise"):
        plan = ResponsePlan("table", signal=signal, period=0.5, band=(4.0, 100.0), periods=3, realisations=2)
        design = design_response(rrr(), plan, RATE, seed=4)
        again = ResponseDesign.from_json(json.loads(json.dumps(design.to_json())))
        for one, other in zip(design.runs, again.runs, strict=True):
            assert np.array_equal(one.n, other.n)
            assert (one.name, one.start, one.speed, one.settle) == (other.name, other.start, other.speed, other.settle)
        assert (again.kp, again.kd, again.signal_period) == (design.kp, design.kd, design.signal_period)
        assert not np.allclose(design.runs[0].n, design.runs[1].n)
    for damaged in ({}, [], {**design.to_json(), "runs": []}, {**design.to_json(), "kp": None}):
        with pytest.raises(InputError):
            ResponseDesign.from_json(damaged)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"joint": "elbow"}, "no joint 'elbow': it has table"),
        ({"speed": 0.5}, "quantisation repeats; take 0.5"),
        ({"period": 0.0015}, "whole number of samples"),
        ({"periods": 1}, "2 periods at least"),
        ({"signal": "square"}, "the signal is one of"),
        ({"rms": -1.0}, "rms"),
        ({"speed": -1.0}, "positive"),
        ({"postures": ((0.0, 1.0),)}, "2 joint positions"),
        ({"bandwidth": (0.0, 6.0)}, "bandwidths"),
    ],
)
def test_plans_that_cannot_be_are_refused(changes, reason):
    with pytest.raises(InputError, match=reason):
        design_response(rrr(), ResponsePlan(**{"joint": "table", **changes}), RATE)


def test_standing_joints_stay_in_their_range():
    text = (
        "schema: rrrgen/1\nname: elbow\nconvention: standard\nunits: {angle: rad, length: m}\ngravity: [0, 0, -9.81]\n"
        "joints:\n"
        "  - {name: turn, type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0}\n"
        "  - {name: bend, type: revolute, alpha: 0, a: 0.2, d: 0, theta: 0, limits: {lower: -3, upper: -0.5}}\n"
    )
    model = rrrgen.compile(rrrgen.loads_spec(text), backend="numpy")
    assert design_response(model, ResponsePlan("turn"), RATE).runs[0].start == (0.0, -1.75)
    with pytest.raises(InputError, match="posture 1 has joint bend at 0\\.1, outside"):
        design_response(model, ResponsePlan("turn", postures=((0.0, 0.1),)), RATE)


def test_a_joint_without_room_or_speed_is_refused():
    with pytest.raises(InputError, match="room for 0 periods"):
        design_response(rrr(-0.05, 0.05), ResponsePlan("table"), RATE)
    with pytest.raises(InputError, match="lower the rms"):
        design_response(rrr(velocity=0.2), ResponsePlan("table"), RATE)
