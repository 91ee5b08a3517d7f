"""Plans of response experiments: read back, or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lab.design.bands import RATE, rrr
from rrrgen.base.errors import InputError
from rrrgen.lab.design.plan import ResponseDesign, ResponsePlan
from rrrgen.lab.design.response_design import design_response


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


def test_a_joint_without_room_or_speed_is_refused():
    with pytest.raises(InputError, match="room for 0 periods"):
        design_response(rrr(-0.05, 0.05), ResponsePlan("table"), RATE)
    with pytest.raises(InputError, match="lower the rms"):
        design_response(rrr(velocity=0.2), ResponsePlan("table"), RATE)
