"""What is written is what is read: dumps and loads_spec are inverse."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rrrgen.robot.file import (
    BasisSpec,
    DriveSpec,
    FixedTransform,
    FrictionSpec,
    JointSpec,
    Limits,
    LinkSpec,
    RobotSpec,
    bundled_names,
    dumps,
    load_spec,
    loads_spec,
)
from rrrgen.robot.file.writer import number_text, quote
from rrrgen.robot.spec import parameter_symbol


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_robots_survive(name: str) -> None:
    spec = load_spec(name)
    text = dumps(spec)
    assert loads_spec(text) == spec
    assert dumps(loads_spec(text)) == text


_angles = st.one_of(
    st.fractions(-2, 2, max_denominator=12).map(lambda f: sp.Rational(f.numerator, f.denominator) * sp.pi),
    st.fractions(-400, 400, max_denominator=1000).map(lambda f: sp.Rational(f.numerator, f.denominator)),
)
_lengths = st.one_of(
    st.fractions(-50, 50, max_denominator=9).map(lambda f: sp.Rational(f.numerator, f.denominator)),
    st.decimals(-3, 3, places=5).map(lambda d: sp.Rational(str(d))),
    st.sampled_from([sp.sqrt(2) / 7, parameter_symbol("L1"), -2 * parameter_symbol("L1") + parameter_symbol("L2")]),
    st.just(parameter_symbol("k") / 50),
)
_positive = st.floats(1e-6, 1e4)
_signed = st.floats(-40, 40)
_rational = st.decimals(-2, 2, places=6).map(lambda d: sp.Rational(str(d)))
_maybe = lambda values: st.none() | values  # noqa: E731


@st.composite
def _joints(draw: st.DrawFn, number: int) -> JointSpec:
    lower = draw(_maybe(_signed))
    upper = draw(_maybe(st.floats(40.5, 90)))
    limits = Limits(lower, upper, draw(_maybe(_positive)), draw(_maybe(_positive)), draw(_maybe(_positive)))
    friction = draw(_maybe(st.builds(FrictionSpec, _maybe(_positive), _maybe(_positive), _maybe(_signed))))
    drive = draw(
        _maybe(st.builds(DriveSpec, _maybe(_positive), _maybe(_positive), _maybe(_positive), _maybe(_positive)))
    )
    kind = draw(st.sampled_from(["revolute", "prismatic"]))
    alpha, theta = draw(_angles), draw(_angles)
    return JointSpec(f"axis_{number}", kind, alpha, draw(_lengths), draw(_lengths), theta, limits, friction, drive)


@st.composite
def _links(draw: st.DrawFn) -> LinkSpec:
    com = tuple(draw(_rational) for _ in range(3))
    inertia = tuple(draw(_rational) for _ in range(6))
    about, products = draw(st.sampled_from(["com", "origin"])), draw(st.sampled_from(["tensor", "positive"]))
    return LinkSpec(abs(draw(_rational)), com, inertia, about, products)


@st.composite
def specs(draw: st.DrawFn) -> RobotSpec:
    n = draw(st.integers(1, 4))
    s = sp.sqrt(3) / 2
    turned = (s, sp.Rational(-1, 2), sp.S.Zero, sp.Rational(1, 2), s, sp.S.Zero, sp.S.Zero, sp.S.Zero, sp.S.One)
    tool = draw(
        st.sampled_from([FixedTransform(), FixedTransform(turned, (parameter_symbol("L1"), sp.S.Zero, sp.pi / 9))])
    )
    symbols = [parameter_symbol(f"{stem}1") for stem in ("m", "Ixx", "Ixy", "mx")]
    expressions = (symbols[0] * parameter_symbol("L1") ** 2 + symbols[1], symbols[2] - 2 * symbols[3])
    basis = BasisSpec(("pa", "pb"), expressions, draw(st.sampled_from(["tensor", "positive"])))
    text = st.text(st.characters(codec="utf-8", exclude_characters="\r"), max_size=20).map(str.strip)
    return RobotSpec(
        name="robot_1",
        convention=draw(st.sampled_from(["standard", "modified"])),
        gravity=tuple(draw(_rational) for _ in range(3)),
        parameters={"L1": draw(_rational) + 3, "L2": sp.sqrt(2), "k": sp.Rational(7, 3), "phi1": sp.pi / 7},
        joints=tuple(draw(_joints(i)) for i in range(1, n + 1)),
        links=draw(_maybe(st.tuples(*[_links()] * n))),
        base=tool,
        tool=tool,
        basis=draw(_maybe(st.just(basis))),
        angle_unit=draw(st.sampled_from(["rad", "deg"])),
        length_unit=draw(st.sampled_from(["m", "mm"])),
        description=draw(text),
        source=draw(text),
        parameter_units={"L1": "mm", "L2": "m", "k": "one", "phi1": "deg"},
    )


@given(specs())
def test_any_spec_survives(spec: RobotSpec) -> None:
    assert loads_spec(dumps(spec)) == spec


def test_identified_robot_with_float_numbers() -> None:
    """Numbers that came out of an estimation are floats; they are written with the digits that name them."""
    spec = load_spec("planar2r")
    assert spec.links is not None
    link = dataclasses.replace(spec.links[0], mass=sp.Float(4.0125), com=(sp.Float(-0.1), sp.S.Zero, sp.Rational(0.1)))
    read = loads_spec(dumps(dataclasses.replace(spec, links=(link, spec.links[1])))).links
    assert read is not None
    assert (read[0].mass, read[0].com[0], read[0].com[2]) == (
        sp.Rational(321, 80),
        sp.Rational(-1, 10),
        sp.Rational(0.1),
    )


@given(st.floats(-1e6, 1e6, allow_subnormal=False))
def test_numbers_are_written_exactly(value: float) -> None:
    exact = sp.Rational(value)
    if abs(value) > 1e-12 or not value:
        assert sp.Rational(number_text(exact)) == exact


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (sp.Rational(7, 20), "0.35"),
        (sp.Rational(-1, 1000), "-0.001"),
        (sp.Integer(12), "12"),
        (sp.Rational(1, 3), "1/3"),
        (sp.pi / 2, "pi/2"),
        (sp.S.Zero, "0"),
    ],
)
def test_text_of_numbers(value: sp.Expr, text: str) -> None:
    assert number_text(value) == text


def test_quoted_text_is_one_line() -> None:
    assert quote('a "b"\n\\c\u2028') == '"a \\"b\\"\\u000a\\\\c\\u2028"'


ROUND_OFF = 1e-15  # products of cosines of magnitude 1


@pytest.mark.parametrize("angles", [(0.3, 0.0, 0.0), (0.0, -1.1, 0.0), (0.4, -0.7, 2.1)])
def test_rpy_turns_about_the_fixed_axes(angles: tuple[float, float, float]) -> None:
    text = dumps(dataclasses.replace(load_spec("pendulum"), tool=FixedTransform())) + f"tool: {{rpy: {list(angles)}}}\n"
    R = np.array(loads_spec(text).tool.rotation, dtype=float).reshape(3, 3)
    assert np.allclose(R, Rotation.from_euler("xyz", angles).as_matrix(), rtol=0, atol=ROUND_OFF)


def test_rotation_matrix_is_read_row_by_row() -> None:
    text = (
        dumps(load_spec("pendulum"))
        + "tool: {rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]], translation: [0.1, 0, 0]}\n"
    )
    T = np.array(loads_spec(text).tool.matrix().tolist(), dtype=float)
    assert np.array_equal(T, [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def test_steiner() -> None:
    """A point mass has no inertia about itself and m (r^T r 1 - r r^T) about the origin."""
    m, r = sp.Rational(5, 2), (sp.Rational(1, 2), sp.Rational(-1, 3), sp.Rational(2))
    about_origin = LinkSpec(m, r, (sp.S.Zero,) * 6, "com").inertia_about_origin()
    R = sp.Matrix(r)
    expected = m * (R.dot(R) * sp.eye(3) - R * R.T)
    assert about_origin == tuple(expected[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
