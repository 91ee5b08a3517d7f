"""The user's own base parameters: accepted when they are a basis, else refused with the direction named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from rrrgen.base.errors import InputError
from rrrgen.derive import derive_model
from rrrgen.derive.parameters.base_parameters import base_set
from rrrgen.derive.parameters.user_basis import change_basis
from rrrgen.program import evaluate
from rrrgen.robot.file import bundled_path, load_spec, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.robot.spec import BasisSpec

TEXT = bundled_path("rrr").read_text(encoding="utf-8")
FILE = "arm.yaml"
ROUND_OFF = 1e-12  # relative; a change of basis adds a dozen roundings of 1e-16


@pytest.fixture(scope="module")
def own():
    """The compiler's own set of the bundled robot."""
    return base_set(build_model(load_spec("rrr")))


def line_of(name: str) -> str:
    return next(line for line in TEXT.splitlines() if line.startswith(f"  - {name} ="))


def refusal(text: str) -> list[str]:
    spec = loads_spec(text, FILE)
    with pytest.raises(InputError) as caught:
        derive_model(spec)
    assert caught.value.exit_code == 3
    return [str(fault) for fault in caught.value.faults]


def expect_one(text: str, *words: str) -> None:
    (message,) = refusal(text)
    for word in words:
        assert word in message, message


def place(text: str, name: str) -> str:
    number = next(k for k, line in enumerate(text.splitlines(), start=1) if line.startswith(f"  - {name} ="))
    return f"{FILE}:{number}:5"


def test_an_incomplete_basis_names_the_direction_that_nothing_covers():
    expect_one(
        TEXT.replace(line_of("p13") + "\n", ""),
        "incomplete (14 of 15 directions)",
        "nothing covers Jyy3R = Ixx3/2 - Iyy3/2 + Izz3/2",
    )


@pytest.mark.parametrize("left_out", range(15))
def test_the_direction_named_completes_the_basis(own, left_out):
    """Whatever is left out, what the message names is missing: with it the parameters are a basis again."""
    spec = load_spec("rrr")
    basis = spec.basis
    part = replace(
        basis,
        names=basis.names[:left_out] + basis.names[left_out + 1 :],
        expressions=basis.expressions[:left_out] + basis.expressions[left_out + 1 :],
        places=(),
    )
    with pytest.raises(InputError) as caught:
        change_basis(replace(spec, basis=part), own)
    (fault,) = caught.value.faults
    named, said = fault.message.split("nothing covers ")[1].split(" = ")
    expression = own.expressions()[own.names.index(named)]
    positive = expression.xreplace({s: -s for s in expression.free_symbols if str(s)[:3] in ("Ixy", "Ixz", "Iyz")})
    assert said == str(positive)  # in the signs of the file, which is where it is to be written
    whole = replace(part, names=(*part.names, "added"), expressions=(*part.expressions, positive))
    assert len(change_basis(replace(spec, basis=whole), own).inverse) == 15


def test_a_dependent_parameter_is_named_with_those_it_depends_on():
    double = TEXT.replace(line_of("p13"), line_of("p13").split("=")[0] + "= 3*(m2*(x2 + a2) + m3*a2) - 2*m3*y3")
    faults = refusal(double)
    text = "\n".join(faults)
    assert "incomplete (14 of 15 directions)" in text
    # the later of the parameters in the relation is the one that is reported
    assert f"{place(double, 'p14')}: error: basis: p14: depends linearly on p4, p13" in text


def test_an_extra_parameter_is_refused():
    extra = TEXT + "\n  - p16 = m3*(a3 + x3) + m2*y2\n"
    expect_one(extra, f"{place(extra, 'p16')}: error: basis: p16: depends linearly on p3, p15")


def test_a_part_without_effect_is_named():
    parts = [("Ixx1", "Ixx1"), ("2*m1*z1", "2*mz1"), ("Ixy1", "Ixy1"), ("Izz2 - Izz2 + m1", "m1")]
    for change, named in parts:
        text = TEXT.replace(line_of("p15"), f"  - p15 = m2*y2 + {change}")
        expect_one(text, place(text, "p15"), f"its part {named} has no effect on the dynamics")


def test_a_parameter_that_is_only_foreign_is_named():
    expect_one(TEXT + "\n  - p16 = Ixx1\n", "p16: its part Ixx1 has no effect")


@pytest.mark.parametrize(
    ("expression", "complaint"),
    [
        ("m2*m3", "not a multiple of one inertial parameter"),
        ("m2*y3", "not a multiple of one inertial parameter"),
        ("m2**2", "is not linear in the parameters of a link"),
        ("sin(Izz3)", "is not linear in the parameters of a link"),
        ("m2*y2 + 1", "the term 1 is not a multiple of one inertial parameter"),
        ("y2", "not a multiple of one inertial parameter"),
        ("m2*y2/x2", "is not linear in the parameters of a link"),
    ],
)
def test_a_nonlinear_parameter_is_refused(expression, complaint):
    text = TEXT.replace(line_of("p15"), f"  - p15 = {expression}")
    expect_one(text, place(text, "p15"), "basis: p15:", complaint)


def test_a_length_that_is_not_in_the_geometry_is_refused():
    text = TEXT.replace("parameters: {a2", "parameters: {rho: 2, a2").replace(line_of("p15"), "  - p15 = rho*m2*y2")
    expect_one(text, "p15:", "rho does not occur in the geometry")


def test_every_fault_is_reported_at_once():
    text = TEXT.replace(line_of("p15"), "  - p15 = m2*m3").replace(line_of("p4"), "  - p4 = y3")
    faults = refusal(text)
    assert len(faults) == 2
    assert "p4" in faults[0]
    assert "p15" in faults[1]


def test_names_order_and_units_are_the_users():
    derived = derive_model(load_spec("rrr"))
    assert derived.derivation.parametrization.names == tuple(f"p{k}" for k in range(1, 16))
    units = {p.name: p.unit for p in derived.base_parameters}
    assert units["p3"] == units["p14"] == "kg m"
    assert units["p7"] == units["p13"] == "kg m^2"


def test_an_own_basis_in_tensor_signs_gives_the_identity(own):
    """The compiler's own expressions, written as the user's, change nothing; scaled and reversed they scale back."""
    spec = load_spec("rrr")
    expressions = own.expressions()
    basis = BasisSpec(own.names, tuple(expressions), "tensor")
    change = change_basis(replace(spec, basis=basis), own)
    assert sp.Matrix(change.inverse) == sp.eye(15)
    turned = BasisSpec(own.names[::-1], tuple(3 * e for e in expressions[::-1]), "tensor")
    change = change_basis(replace(spec, basis=turned), own)
    assert sp.Matrix(change.inverse) == sp.Matrix(15, 15, lambda r, c: sp.Rational(int(r + c == 14), 3))


def test_signs_of_products_change_the_parameters_not_the_torques():
    """The same arm with the basis in tensor signs: p6 = 2 (a3 m3 y3 - Ixy3) there, and the torques are the same."""
    spec = load_spec("rrr")
    flipped = {s: -s for e in spec.basis.expressions for s in e.free_symbols if str(s)[:3] in ("Ixy", "Ixz", "Iyz")}
    expressions = tuple(e.xreplace(flipped) for e in spec.basis.expressions)
    tensor = replace(spec, basis=BasisSpec(spec.basis.names, expressions, "tensor"))
    one, two = derive_model(spec), derive_model(tensor)
    assert one.beta_nominal == two.beta_nominal
    assert np.allclose(one.base_projection, two.base_projection, rtol=ROUND_OFF)
    rng = np.random.default_rng(5)
    state = [rng.normal(size=3) for _ in range(3)]
    torques = [
        evaluate(d.alternatives["inverse_dynamics"][0], *state, np.array(d.beta_nominal, dtype=float))[0]
        for d in (one, two)
    ]
    assert np.max(np.abs(torques[0] - torques[1])) <= ROUND_OFF * np.max(np.abs(torques[0]))


def test_a_basis_over_symbolic_lengths_is_inverted_exactly():
    derived = derive_model(load_spec("rrr"))
    S = sp.Matrix(
        15, 15, lambda r, c: _expression(derived.derivation.basis_change.forward[r][c])
    )  # user = S own, over the constants
    product = (S * sp.Matrix(derived.derivation.basis_change.inverse)).applyfunc(lambda v: sp.cancel(sp.expand(v)))
    assert product == sp.eye(15)


def _expression(value) -> sp.Expr:
    from rrrgen.program.polynomials import to_expression

    return to_expression(value)
