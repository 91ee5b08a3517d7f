"""Values are read exactly, within bounds, and never executed."""

from __future__ import annotations

import builtins
import math
from fractions import Fraction
from pathlib import Path

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.expressions import ExpressionError, Name, exact_number, parse_expression
from rrrgen.base.yamltext.units import QUANTITIES, UNITS, FileUnits, find_unit

A2, L = sp.Symbol("a2", real=True), sp.Symbol("L", real=True)
NAMES = {"a2": Name(A2), "L": Name(L, UNITS["m"].dimension)}


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("0.35", sp.Rational(7, 20)),
        ("1e-3", sp.Rational(1, 1000)),
        ("0.1", sp.Rational(1, 10)),
        (".5", sp.Rational(1, 2)),
        ("5.", sp.Integer(5)),
        ("-2.50E+2", sp.Integer(-250)),
        ("+3", sp.Integer(3)),
        ("0.30000000000000000000000000001", sp.Rational(30000000000000000000000000001, 10**29)),
        ("pi/2", sp.pi / 2),
        ("-pi", -sp.pi),
        ("2*pi - 1/3", 2 * sp.pi - sp.Rational(1, 3)),
        ("2**-3", sp.Rational(1, 8)),
        ("2**(1/2)", sp.sqrt(2)),
        ("4**0.5", sp.Integer(2)),
        ("sqrt(3)/2", sp.sqrt(3) / 2),
        ("sin(pi/6)", sp.Rational(1, 2)),
        ("cos(pi/4)", sp.sqrt(2) / 2),
        ("sin(1)", sp.sin(1)),
        ("a2", A2),
        ("-a2/2 + 3*(a2 - 1)", sp.Rational(5, 2) * A2 - 3),
        ("2 - 3 - 4", sp.Integer(-5)),
        ("2/3/4", sp.Rational(1, 6)),
        ("2**3**2", sp.Integer(512)),
        ("-2**2", sp.Integer(-4)),
        ("1\n + 2", sp.Integer(3)),
    ],
)
def test_values_are_exact(text: str, exact: sp.Expr) -> None:
    assert parse_expression(text, NAMES).expr == exact


@given(st.integers(-(10**12), 10**12), st.integers(0, 25), st.integers(-20, 20))
def test_decimals_equal_pythons_fractions(mantissa: int, digits: int, exponent: int) -> None:
    text = f"{abs(mantissa)}".rjust(digits + 1, "0")
    text = f"{text[: len(text) - digits]}.{text[len(text) - digits :]}e{exponent}"
    value = exact_number(text)
    assert Fraction(int(value.p), int(value.q)) == Fraction(text)


# trees of the grammar, evaluated independently with Fractions
_NUMBERS = st.fractions(-5, 5, max_denominator=7).map(lambda f: (f"({f.numerator}/{f.denominator})", f))
_TREES = st.recursive(
    _NUMBERS,
    lambda inner: st.builds(
        lambda a, op, b: (f"({a[0]}{op}{b[0]})", {"+": a[1] + b[1], "-": a[1] - b[1], " * ": a[1] * b[1]}[op]),
        inner,
        st.sampled_from(["+", "-", " * "]),
        inner,
    ),
    max_leaves=12,
)


@given(_TREES)
def test_arithmetic_is_that_of_fractions(tree: tuple[str, Fraction]) -> None:
    text, expected = tree
    value = parse_expression(text).expr
    assert Fraction(int(value.p), int(value.q)) == expected


@pytest.mark.parametrize("name", UNITS)
def test_every_unit_is_read_with_and_without_a_blank(name: str) -> None:
    assert parse_expression(f"2 {name}").unit is UNITS[name]
    assert parse_expression(f"2{name}").unit is UNITS[name]
    assert parse_expression(f"(1 + 1){name}").expr == 2


@pytest.mark.parametrize(
    ("spelling", "name"),
    [("°", "deg"), ("N m", "N*m"), ("Nm", "N*m"), ("N·m", "N*m"), ("kg m2", "kg*m^2"), ("kg*m**2", "kg*m^2"),
     ("rad/s2", "rad/s^2"), ("degrees", "deg"), ("µm", "um"), ("kg m²", "kg*m^2")],
)  # fmt: skip
def test_other_spellings_of_units(spelling: str, name: str) -> None:
    assert find_unit(spelling) is UNITS[name]


# the factor to SI, from the definitions of the units
SI = {"deg": math.pi / 180, "mrad": 1e-3, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "in": 0.0254, "deg/s": math.pi / 180,
      "rpm": 2 * math.pi / 60, "deg/s^2": math.pi / 180, "mm/s": 1e-3, "mm/s^2": 1e-3, "g": 1e-3, "kg*mm^2": 1e-6,
      "kg*cm^2": 1e-4, "g*cm^2": 1e-3 * 1e-4, "N*mm": 1e-3}  # fmt: skip
ROUND_OFF = 1e-15  # relative; both sides are one product of doubles


@pytest.mark.parametrize("name", UNITS)
def test_factors_to_si(name: str) -> None:
    assert float(UNITS[name].si()) == pytest.approx(SI.get(name, 1.0), rel=ROUND_OFF)


def test_every_unit_measures_a_quantity_and_every_quantity_has_its_si_unit() -> None:
    dimensions = {quantity.dimension for quantity in QUANTITIES.values()}
    assert {unit.dimension for unit in UNITS.values()} == dimensions
    for quantity in QUANTITIES.values():
        assert UNITS[quantity.si_unit].dimension == quantity.dimension
        assert UNITS[quantity.si_unit].si() == 1


def test_units_of_a_file_reach_rates_but_not_torques() -> None:
    units = FileUnits("deg", "mm")
    names = {key: units.of(quantity).name for key, quantity in QUANTITIES.items()}
    assert names["angle"] == names["joint angle"] == "deg"
    assert (names["angular speed"], names["angular acceleration"]) == ("deg/s", "deg/s^2")
    assert (names["length"], names["speed"], names["acceleration"]) == ("mm", "mm/s", "mm/s^2")
    assert (names["torque"], names["inertia"], names["angular damping"]) == ("N*m", "kg*m^2", "N*m*s")
    assert (names["angular stiffness"], names["stiffness"]) == ("N*m/rad", "N/m")


def test_dimensions_are_followed() -> None:
    assert parse_expression("2*L", NAMES).dimension == UNITS["m"].dimension
    assert parse_expression("sqrt(L**2 + L*L)", NAMES).dimension == UNITS["m"].dimension
    assert parse_expression("L/L", NAMES).dimension is None
    assert parse_expression("L + 3", NAMES).adds_bare_number
    assert not parse_expression("3*L + 0", NAMES).adds_bare_number
    assert parse_expression("2*a2", NAMES).open_names == {"a2"}
    with pytest.raises(ExpressionError, match="cannot be added"):
        parse_expression("L + L**2", NAMES)
    with pytest.raises(ExpressionError, match="sin of a length"):
        parse_expression("sin(L)", NAMES)


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("1 + x9", 4),
        ("a2 * (3 + )", 10),
        ("1 + 2,5", 5),
        ("3 $ 4", 2),
        ("a2**99", 4),
        ("2 + tan(3)", 4),
        ("7 furlong", 2),
    ],
)
def test_offset_of_the_fault(text: str, offset: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text, NAMES)
    assert caught.value.offset == offset


MARK = "executed"
PAYLOADS = [
    "__import__('pathlib').Path('{mark}').touch()",
    "open('{mark}', 'w')",
    "exec(\"open('{mark}', 'w')\")",
    "eval(\"open('{mark}', 'w')\")",
    "(lambda: open('{mark}', 'w'))()",
    "[open('{mark}', 'w') for _ in [1]][0]",
    "sqrt(open('{mark}', 'w'))",
    "sqrt.__globals__",
    "().__class__.__bases__[0].__subclasses__()",
    "f'{{open(1)}}'",
    "a2.__class__",
    "(x := 1)",
    "a2 if 1 else 2",
    "a2 and open",
    "print(1)",
    "sin(*a2)",
    "sin(x=a2)",
    "'a' * 3",
    "1j",
    "True",
    "None",
    "...",
    "1 < 2",
    "~1",
    "7 // 2",
    "7 % 2",
    "1 << 99",
    "not a2",
    "a2 @ a2",
]


@pytest.mark.parametrize("payload", PAYLOADS)
def test_code_is_refused_and_not_executed(payload: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark = tmp_path / MARK

    def forbidden(*_: object) -> None:
        raise AssertionError("text was executed")

    monkeypatch.setattr(builtins, "eval", forbidden)
    monkeypatch.setattr(builtins, "exec", forbidden)
    monkeypatch.setattr(sp, "sympify", forbidden)
    with pytest.raises(InputError):
        parse_expression(payload.format(mark=mark), NAMES)
    assert not mark.exists()


def _outcome(text: str) -> sp.Expr | InputError:
    try:
        return parse_expression(text, NAMES).expr
    except InputError as error:
        return error


@given(st.text(max_size=40) | st.text(alphabet="0123456789.e+-*/() apisqrtncodegm2L,^", max_size=30))
def test_garbage_raises_only_input_errors(text: str) -> None:
    outcome = _outcome(text)
    if isinstance(outcome, InputError):
        assert outcome.exit_code == 3
        assert 0 <= outcome.faults[0].column <= len(text) + 1
    else:
        assert isinstance(outcome, sp.Expr)
