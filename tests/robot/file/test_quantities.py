"""Quantities of a robot file: numbers in its units, explicit units, parameters."""

from __future__ import annotations

import pytest
import sympy as sp

from robot.file.units_file import in_metres, load, robot
from rrrgen.base.errors import InputError
from rrrgen.robot.file import loads_spec


def message(**changes: str) -> str:
    with pytest.raises(InputError) as caught:
        load(**changes)
    return str(caught.value)


def test_bare_numbers_are_in_the_units_of_the_file() -> None:
    spec = load(tool="{translation: [0, 0, 107], rpy: [0, 0, 45]}")
    assert (spec.angle_unit, spec.length_unit) == ("deg", "mm")
    assert spec.joints[0].alpha == sp.pi / 2
    assert spec.joints[0].a == sp.Rational(1, 4)
    assert spec.joints[1].d == sp.Rational(1, 10)
    assert spec.joints[1].limits.lower == pytest.approx(0.010, rel=1e-15)
    assert spec.joints[1].limits.velocity == 0.25
    assert spec.tool.translation[2] == sp.Rational(107, 1000)
    assert spec.tool.rotation[0] == sp.sqrt(2) / 2


def test_explicit_units_win() -> None:
    spec = load(alpha="pi/2 rad", a="0.25 m", d="10 cm", theta="1/4 rad")
    assert spec.joints[0].alpha == sp.pi / 2
    assert (spec.joints[0].a, spec.joints[1].d) == (sp.Rational(1, 4), sp.Rational(1, 10))
    assert spec.joints[1].theta == sp.Rational(1, 4)


def test_parameters_carry_their_unit() -> None:
    spec = load(
        a="L1 - 2*L2",
        alpha="phi1",
        d="k*200",
        parameters="{L1: 300 mm, L2: 25 mm, phi1: 90 deg, k: 0.5 one, L3: L1 + L2}",
    )
    symbols = {name: sp.Symbol(name, real=True) for name in spec.parameters}
    assert spec.parameters["L3"] == sp.Rational(325, 1000)
    assert spec.joints[0].a == symbols["L1"] - 2 * symbols["L2"]
    assert spec.joints[1].d == symbols["k"] / 5
    assert spec.dh_table()[0][1:3] == pytest.approx((1.5707963267948966, 0.25), rel=1e-15)
    assert spec.parameter_units == {"L1": "mm", "L2": "mm", "phi1": "deg", "k": "one", "L3": "m"}


def test_bare_parameters_are_si_in_si_files() -> None:
    text = robot(a="L1", alpha="0.3", d="L1/2 + 0.1", units="{angle: rad, length: m}", parameters="{L1: 0.5}")
    spec = loads_spec(in_metres(text))
    assert spec.nominal(spec.joints[1].d) == sp.Rational(35, 100)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"a": "L1", "parameters": "{L1: 300}"}, "5:14: error: the parameter 'L1' has no unit"),
        ({"alpha": "t", "parameters": "{t: 90}"}, "'t' has no unit, and bare values of this file are in deg"),
        ({"a": "L1 + 30", "parameters": "{L1: 300 mm}"}, "adds a bare number to a parameter"),
        ({"alpha": "pi/2"}, "uses pi, but bare values of this file are in deg"),
        ({"a": "300*cos(30)"}, "takes the sine or cosine of a bare number"),
        ({"alpha": "L1", "parameters": "{L1: 300 mm}"}, "alpha of joint 1 is an angle, but this is a length"),
        ({"a": "L1*L1", "parameters": "{L1: 300 mm}"}, "a of joint 1 is a length, but this is a value in m^2"),
        ({"a": "L1", "parameters": "{L1: 300 mm, S: L1*L1}"}, "parameter S is a value in m^2"),
        ({"parameters": "{L1: 300 mm, L2: L1 + 3}"}, "adds a bare number to a parameter with a unit"),
        ({"alpha": "1.5708"}, "alpha of joint 1 is 1.5708 deg"),
        ({"links": "[{mass: 1, com: [0, -0.18, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}, {}]"}, "-0.18 m, or"),
    ],
)  # fmt: skip
def test_ambiguous_values_are_refused(changes: dict[str, str], expected: str) -> None:
    assert expected.replace("5:14", "6:14") in message(**changes)


def test_links_and_gravity_may_use_parameters_at_their_nominal_values() -> None:
    links = "[{mass: 2*k, com: [-L1/2, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 200000 kg*mm^2}}, " + (
        "{mass: 500 g, com: [0, 12 mm, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}]"
    )
    spec = load(a="L1", parameters="{L1: 300 mm, k: 3 one}", links=links)
    assert spec.links is not None
    assert spec.links[0].mass == 6
    assert spec.links[0].com[0] == sp.Rational(-15, 100)
    assert spec.links[0].inertia[2] == sp.Rational(2, 10)
    assert (spec.links[1].mass, spec.links[1].com[1]) == (sp.Rational(1, 2), sp.Rational(12, 1000))
