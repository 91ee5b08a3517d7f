"""What a bare number means: units of the file, SI elsewhere, and no guess where it could mean two things."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from rrrgen.base.errors import InputError
from rrrgen.robot.file import RobotSpec, dumps, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

ROW = "{type: revolute, alpha: ALPHA, a: A, d: 0, theta: 0}"
PRISMATIC = "{type: prismatic, alpha: 0, a: 300, d: D, theta: THETA, limits: {lower: 10, upper: 900, velocity: 250}}"


def robot(
    alpha: str = "90", a: str = "250", d: str = "100", theta: str = "0", parameters: str = "{}", **more: str
) -> str:
    rows = [
        ROW.replace("ALPHA", alpha).replace("A,", f"{a},"),
        PRISMATIC.replace("D,", f"{d},").replace("THETA", theta),
    ]
    lines = [
        "schema: rrrgen/1",
        "name: r",
        "convention: standard",
        f"units: {more.pop('units', '{angle: deg, length: mm}')}",
    ]
    lines += ["gravity: [0, 0, -9.81]", f"parameters: {parameters}", "joints:", *(f"  - {row}" for row in rows)]
    lines += [f"{key}: {value}" for key, value in more.items()]
    return "\n".join(lines) + "\n"


IN_METRES = {
    "a: 300": "a: 0.3",
    "lower: 10": "lower: 0.01",
    "upper: 900": "upper: 0.9",
    "velocity: 250": "velocity: 0.25",
}


def in_metres(text: str) -> str:
    for millimetres, metres in IN_METRES.items():
        text = text.replace(millimetres, metres)
    return text


def load(**changes: str) -> RobotSpec:
    return loads_spec(robot(**changes))


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


def test_file_in_metres_that_says_millimetres() -> None:
    with pytest.raises(InputError, match=r"longest length of the robot is 0\.9 mm"):
        loads_spec(in_metres(robot(a="0.25", d="0.1")))
    assert load(a="0.25").joints[0].a == sp.Rational(25, 100000)


def test_lengths_do_not_depend_on_the_angle_unit() -> None:
    text = robot(a="L1", units="{angle: deg, length: m}", parameters="{L1: 0.3}", d="0.1")
    assert loads_spec(in_metres(text)).joints[0].a == sp.Symbol("L1", real=True)


def test_an_unlikely_value_is_accepted_with_its_unit() -> None:
    spec = load(alpha="1.5708 deg")
    assert float(spec.joints[0].alpha) == pytest.approx(1.5708 * 3.141592653589793 / 180, rel=1e-15)
    far = loads_spec(in_metres(robot(alpha="90 rad", a="439 m", d="0.1", units="{angle: rad, length: m}")))
    assert (far.joints[0].alpha, far.joints[0].a) == (90, 439)


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


def test_the_centre_of_mass_follows_the_units_of_the_file() -> None:
    link = "{mass: 1, com: [COM], inertia: {about: com, xx: 1, yy: 1, zz: 1}}"
    both = f"[{link}, {link}]".replace("COM", "4, -180, 0.1 m", 1).replace("COM", "0, 0, 2")
    spec = loads_spec(robot(links=both))
    assert spec.links[0].com == (sp.Rational(4, 1000), sp.Rational(-18, 100), sp.Rational(1, 10))
    assert spec.links[1].com[2] == sp.Rational(2, 1000)
    assert loads_spec(dumps(spec)).links == spec.links


def test_lengths_below_a_millimetre_are_mentioned_once() -> None:
    (fault,) = loads_spec(robot(a="0.3", d="0.5")).faults
    assert "a of joint 1 is 0.3 mm, d of joint 2 is 0.5 mm" in fault.message
    assert not loads_spec(robot(a="1", d="0")).faults


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_sign_turns_the_joint_around(convention: str, joint: int) -> None:
    rows = [
        "{type: revolute, alpha: 90, a: 300, d: 100, theta: 20}",
        "{type: prismatic, alpha: -60, a: 50, d: 70, theta: 10}",
        "{type: revolute, alpha: 90, a: 30, d: 80, theta: 0}",
    ]
    link = (
        "{mass: 2, com: [10, 20, 30], inertia: {about: com, xx: 0.1, yy: 0.2, zz: 0.25, xy: 0.01, xz: 0.02, yz: 0.03}}"
    )
    text = robot(links=f"[{link}, {link}, {link}]", tool="{translation: [10, 20, 30], rpy: [10, 20, 30]}")
    head = text.split("joints:")[0].replace("standard", convention) + "joints:\n"
    tail = text[text.index("links:") :]
    signed = [row.replace("}", ", sign: -1}") if k == joint else row for k, row in enumerate(rows)]
    plain, turned = (loads_spec(head + "".join(f"  - {row}\n" for row in each) + tail) for each in (rows, signed))
    assert not turned.faults
    assert [each.sign for each in turned.joints] == [-1 if k == joint else 1 for k in range(3)]
    assert loads_spec(dumps(turned)) == turned
    q = np.random.default_rng(0).normal(size=(3, 3))
    signs = np.array([-1 if k == joint else 1 for k in range(3)])
    there, here = (NewtonEuler(chain_of(s), nominal_parameters(s)) for s in (plain, turned))
    np.testing.assert_allclose(here.forward_kinematics(q), there.forward_kinematics(q * signs), atol=1e-14)
    expected = there.inverse_dynamics(q * signs, q * signs, q * signs) * signs
    np.testing.assert_allclose(here.inverse_dynamics(q, q, q), expected, atol=1e-12)
