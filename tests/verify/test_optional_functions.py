"""Functions of optional groups are compared with formulas over the reference: right ones pass, wrong ones are named."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.derive.functions.table import functions_for
from rrrgen.robot.file import load_spec
from rrrgen.verify import Report, checks, verify

GROUPS = ("control", "elastic", "observer", "points", "tensors", "timing", "trajectory")


@cache
def model() -> rrrgen.Model:
    return rrrgen.compile("rrr", backend="numpy")


@cache
def names() -> frozenset[str]:
    """Of the functions of optional groups; nothing is derived for them, since pytest asks in every process."""
    spec = load_spec("rrr")
    plain = {function.name for function in functions_for(spec, ("model",))}
    every = {function.name for function in functions_for(spec, ("model", *GROUPS))}
    return frozenset(name.removesuffix("_nominal") for name in every - plain)


def verified(subject, optional, samples=6) -> Report:
    return verify(subject, samples=samples, libraries=False, optional=optional)


def test_right_functions_pass_and_each_has_a_row():
    report = verified(model(), names())
    assert report.ok, report.to_text()
    compared = {row.function.split(":")[0].split(" ")[0] for row in report.rows}
    assert len(names()) > 25
    assert not names() - compared


@pytest.mark.parametrize("name", sorted(names()))
def test_a_wrong_function_is_named(name, monkeypatch):
    """At two states, one alone and one as a batch; inverse kinematics calls no optional function and is left out."""
    monkeypatch.setattr(checks, "check_inverse_kinematics", lambda *args, **options: None)

    class Wrong:
        def __getattr__(self, attribute):
            value = getattr(model(), attribute)
            if attribute != name:
                return value
            return lambda *states, **given: _wrong(value(*states, **given))

    report = verified(Wrong(), names(), samples=2)
    assert {row.function.split(":")[0].split(" ")[0] for row in report.failures} == {name}


def _wrong(result):
    if isinstance(result, tuple):
        first, *rest = result
        parts = (_wrong(first), *rest)
        return type(result)(*parts) if hasattr(result, "_fields") else parts
    return 1.001 * np.asarray(result) + 1e-3
