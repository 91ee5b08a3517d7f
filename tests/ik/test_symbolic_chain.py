"""Determinants of symbolic chains: singularities of the reference robot, and none that is not factored."""

from __future__ import annotations

import itertools

import sympy as sp

from rrrgen.emit.latex.inverse_kinematics import closed_form
from rrrgen.ik.singularities import FACTORED, _simplify
from rrrgen.robot.file import load_spec


def test_the_singularities_of_the_reference_robot_are_those_of_its_determinant():
    form = closed_form(load_spec("rrr"))
    a2, a3 = (sp.Symbol(name, real=True) for name in ("a2", "a3"))
    q2, q3 = (sp.Symbol(name, real=True) for name in ("q_2", "q_3"))
    found = {str(item.expression) for item in form.singularities}
    assert found == {str(sp.sin(q3)), str(a2 * sp.cos(q2) + a3 * sp.cos(q2 + q3))}


def test_constant_angles_are_added_to_the_joints():
    """They stood beside them, in thousands of terms."""
    form = closed_form(load_spec("piper"))
    elbow = form.singularities[0].expression
    assert str(elbow) == "a_4*sin(q_3 + theta_3) - d_4*cos(q_3 + theta_3)"


def test_long_determinants_of_irrational_constants_are_not_factored():
    """Which took more than an hour for three axes with twists of 0.7 rad on a base turned by 0.3 rad."""
    q = sp.symbols("q_2 q_3", real=True)
    powers = itertools.product(range(8), range(8))
    value = sp.Add(*(sp.cos(sp.Rational(i + 9 * j + 1, 10)) * sp.sin(q[0]) ** i * sp.cos(q[1]) ** j for i, j in powers))
    assert len(value.args) > FACTORED
    assert _simplify(value, list(q)) == value
