"""What a bare number means: units of the file, SI elsewhere, and no guess where it could mean two things."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from robot.file.units_file import in_metres, load, robot
from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters


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
