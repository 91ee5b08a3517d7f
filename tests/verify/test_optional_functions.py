"""Functions of optional groups are compared with formulas over the reference: right ones pass, wrong ones are named."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rrrgen
from rrrgen.derive import derive_once
from rrrgen.verify import Report, verify

GROUPS = ("control", "elastic", "observer", "points", "tensors", "timing", "trajectory")


@cache
def model() -> rrrgen.Model:
    return rrrgen.compile("rrr", backend="numpy")


@cache
def names() -> frozenset[str]:
    plain = derive_once(model().spec, ("model",)).programs
    every = derive_once(model().spec, ("model", *GROUPS)).programs
    return frozenset(name.removesuffix("_nominal") for name in every if name not in plain)


def verified(subject, optional) -> Report:
    return verify(subject, samples=6, libraries=False, optional=optional)


def test_right_functions_pass_and_each_has_a_row():
    report = verified(model(), names())
    assert report.ok, report.to_text()
    compared = {row.function.split(":")[0].split(" ")[0] for row in report.rows}
    assert len(names()) > 25
    assert not names() - compared


@pytest.mark.parametrize("name", sorted(names()))
def test_a_wrong_function_is_named(name):
    class Wrong:
        def __getattr__(self, attribute):
            value = getattr(model(), attribute)
            if attribute != name:
                return value
            return lambda *states, **given: _wrong(value(*states, **given))

    report = verified(Wrong(), names())
    assert {row.function.split(":")[0].split(" ")[0] for row in report.failures} == {name}


def _wrong(result):
    if isinstance(result, tuple):
        first, *rest = result
        parts = (_wrong(first), *rest)
        return type(result)(*parts) if hasattr(result, "_fields") else parts
    return 1.001 * np.asarray(result) + 1e-3
