"""The controller as a Python class: parameters by name, modes and parts."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.errors import InputError


def test_parameters_are_checked_by_name(controller):
    for wrong, name in (
        ({"kp": np.nan}, r"kp\[0\]"),
        ({"dq_max": [1.0, 1.0, -1.0]}, r"dq_max\[2\]"),
        ({"Ts": 0.0}, "Ts"),
        ({"hold_ticks": -1}, "hold_ticks"),
        ({"q_min": 1.0, "q_max": 1.0}, r"q_min\[0\]"),
        ({"kd": 1000.0}, r"kd\[0\]"),
        ({"tip_kd": 1000.0}, r"tip_kd\[0\]"),
        ({"beta_min": 2.0, "beta_max": 1.0}, r"beta_min\[0\]"),
        ({"q_max": np.nan}, r"q_max\[0\]"),
        ({"dq_max": -np.inf}, r"dq_max\[0\]"),
        ({"beta": np.inf}, r"beta\[0\]"),
        ({"kpp": 1.0}, "did you mean 'kp'"),
        ({"hold_ticks": 1.5}, "hold_ticks must be a whole number, not 1.5"),
    ):
        with pytest.raises(ValueError, match=name):
            controller(**wrong)


def test_fields_of_a_tick_and_of_a_change_are_checked_by_name(controller):
    unit = controller()
    with pytest.raises(ValueError, match="q must be numbers, not 'x'"):
        unit.step(q="x")
    with pytest.raises(ValueError, match="sample must be a whole number"):
        unit.step(sample=0.5)
    for wrong, message in (
        ({"kpp": 1.0}, "did you mean 'kp'"),
        ({"hold_ticks": 10**12}, "hold_ticks must be from -2147483648 to 2147483647, not 1000000000000"),
        ({"threshold": "a"}, "threshold must be numbers, not 'a'"),
        ({"kp": [1.0, 2j, 3.0]}, "kp must be numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            unit.set(**wrong)


def test_it_shows_its_mode_and_those_that_it_has(rrr):
    shown = repr(rrr.controller("pd_gravity", modes=["gravity", "pd_gravity"]))
    assert shown.startswith("<Controller in mode 'pd_gravity', of ")


def test_unknown_modes_and_parts(rrr):
    with pytest.raises(InputError, match="did you mean 'computed_torque'"):
        rrr.controller(modes=["computed_torqe"])
    with pytest.raises(InputError, match="exclude"):
        rrr.controller(parts=["kalman", "differences"])
    assert rrr.controller(parts="kalman").description["parts"] == ["kalman"]


def test_a_refused_call_changes_nothing(controller):
    unit, rest = controller(), [0.0, 0.0, 0.0]
    unit.start(q=rest, dq=rest)
    tick = {"q": rest, "dq": rest, "q_d": rest}
    before = unit.step(**tick).tau.copy()
    for refused in (
        lambda: unit.set(kp=-3),
        lambda: unit.start(q=np.nan),
        lambda: unit.step(q=[1.0, 1.0, 1.0], mode="gravty"),
        lambda: unit.step(q=[1.0, 1.0, 1.0], foo=1),
        lambda: unit.run({}),
    ):
        with pytest.raises(ValueError, match=r"kp|finite|gravty|foo|at least one"):
            refused()
    assert unit.step().status == 0
    np.testing.assert_allclose(unit.step().tau, before, rtol=1e-3)
    unit.set(kd=41)
