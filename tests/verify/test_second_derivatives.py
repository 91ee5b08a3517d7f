"""verify --hessians accepts right second derivatives and rejects wrong ones."""

from __future__ import annotations

from functools import cache

import pytest

import rrrgen
from derive.test_floating_base import TRUNK
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.verify import Report, verify


@cache
def model() -> rrrgen.Model:
    return rrrgen.compile("planar2r", backend="numpy")


@cache
def afloat() -> rrrgen.Model:
    text = dumps(load_spec("pendulum")).replace("joints:\n", f"{TRUNK}joints:\n")
    return rrrgen.compile(loads_spec(text), backend="numpy")


def failures(report: Report) -> set[str]:
    return {row.function for row in report.rows if not row.ok}


def verified(subject) -> Report:
    return verify(subject, samples=8, libraries=False, hessians=True)


def test_right_second_derivatives_pass():
    report = verified(model())
    assert report.ok, report.to_text()
    asked = {row.function for row in report.rows}
    assert {"forward_dynamics_hessian: v' H v", "mass_matrix_derivatives: dM/dq vq"} <= asked
    assert not any("hessian" in row.function for row in verify(model(), samples=2, libraries=False).rows)


def test_second_derivatives_that_vanish_pass():
    """The torques of three slides are linear in their states: differences of them are rounding and nothing else."""
    report = verified(rrrgen.compile("gantry", backend="numpy"))
    assert report.ok, report.to_text()


@pytest.mark.parametrize(
    "name",
    [
        "inverse_dynamics_hessian",
        "inverse_dynamics_hessian_product",
        "forward_dynamics_hessian",
        "mass_matrix_derivatives",
    ],
)
def test_wrong_ones_are_named(name):
    assert blamed(model, name) == {name}


def test_right_ones_on_a_floating_base_pass():
    report = verified(afloat())
    assert report.ok, report.to_text()
    assert sum(row.function.startswith("floating_inverse_dynamics_hessian") for row in report.rows) == 6


@pytest.mark.parametrize("name", ["floating_inverse_dynamics_hessian", "floating_inverse_dynamics_hessian_product"])
def test_wrong_ones_on_a_floating_base_are_named(name):
    assert blamed(afloat, name) == {name}


def blamed(right, name):
    """The functions that verification of the model ``right()`` blames where the function ``name`` is wrong."""

    class Wrong:
        def __getattr__(self, attribute):
            value = getattr(right(), attribute)
            if attribute != name:
                return value
            return lambda *states, **given: _scaled(value(*states, **given))

    return {function.split(":")[0] for function in failures(verified(Wrong()))}


def _scaled(result):
    if isinstance(result, tuple):
        return type(result)(*(1.001 * part for part in result))
    return 1.001 * result
