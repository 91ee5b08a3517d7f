"""Laws of friction: printed formulas, columns of linear parameters, mappings, and faults by name."""

from __future__ import annotations

import numpy as np
import pytest

from robot.friction.examples import EXAMPLES, SPEEDS, model, retyped
from rrrgen.base.errors import InputError
from rrrgen.program import evaluate
from rrrgen.robot.friction.laws import LAWS, neural_law
from rrrgen.robot.friction.models import NUMPY, FrictionModel, coulomb_viscous
from rrrgen.robot.friction.programs import friction_columns_program


@pytest.mark.parametrize("name", list(LAWS))
def test_laws_equal_the_printed_formulas(name: str) -> None:
    friction = model(name)
    loads = 30.0 * np.cos(np.arange(2 * len(SPEEDS))).reshape(-1, 2)
    speeds = np.column_stack([SPEEDS, SPEEDS[::-1]])
    got = friction.torque(speeds, load=loads)
    expected = np.array(
        [
            [retyped(name, v, p, load) for v, p, load in zip(*row, strict=True)]
            for row in zip(speeds, [EXAMPLES[name]] * len(SPEEDS), loads, strict=True)
        ]
    )
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.all(np.isfinite(got))


@pytest.mark.parametrize("name", ["coulomb_viscous", "asymmetric"])
def test_linear_laws_are_columns_times_parameters(name: str) -> None:
    friction = model(name)
    speeds = np.column_stack([SPEEDS, 0.3 - SPEEDS])
    Y = friction.columns(speeds)
    assert Y.shape == (len(SPEEDS), 2, 2 * friction.parameters.shape[1])
    assert np.abs(Y @ friction.parameters.ravel() - friction.torque(speeds)).max() <= 1e-13 * 300
    program = friction_columns_program(friction.law, 2)
    (recorded,) = evaluate(program, speeds)
    assert np.array_equal(recorded, Y)
    assert len(friction.names) == Y.shape[-1]
    assert np.all(Y[:, 0, friction.parameters.shape[1] :] == 0.0)


@pytest.mark.parametrize("name", list(LAWS))
def test_separable_laws_are_factors_times_linear_parameters(name: str) -> None:
    law, p = LAWS[name], EXAMPLES[name][0]
    linear, shapes = law.split(p)
    assert law.join(linear, shapes) == pytest.approx(tuple(p), rel=1e-14)
    factors = law.factors(NUMPY, SPEEDS, np.sign(SPEEDS), shapes)
    if law.has_load:  # the factor of a load is left to the caller
        assert law.linear[-1].name == "load_ratio"
        linear = linear[:-1]
    got = sum(factor * value for factor, value in zip(factors, linear, strict=True)) + 0.0 * SPEEDS
    assert got == pytest.approx([retyped(name, v, p) for v in SPEEDS], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.columns is None])
def test_nonlinear_laws_have_no_columns(name: str) -> None:
    with pytest.raises(InputError, match="not linear"):
        model(name).columns([0.0, 0.0])
    with pytest.raises(InputError, match="not linear"):
        friction_columns_program(LAWS[name], 2)


@pytest.mark.parametrize("name", list(LAWS))
def test_mapping_round_trip(name: str) -> None:
    friction = model(name)
    again = FrictionModel.from_mapping(friction.to_json())
    assert again.law.name == name
    assert np.array_equal(again.parameters, friction.parameters)


def test_more_neural_units() -> None:
    friction = FrictionModel(neural_law(5), np.arange(1.0, 12.0)[None, :])
    assert FrictionModel.from_mapping(friction.to_json()).parameters.shape == (1, 11)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"law": "stribek"}, "not one of"),
        ({"law": "stribeck", "joints": [{"coulomb": 1.0}]}, "stribeck_speed"),
        ({"law": "coulomb_viscous", "joints": [{"coulom": 1.0}]}, "unknown 'coulom'"),
        ({"law": "coulomb_viscous", "joints": []}, "one mapping per joint"),
        ({"law": "stribeck", "joints": [{"coulomb": 1.0, "stribeck_speed": -1.0}]}, "must be positive"),
    ],
)
def test_faults_are_named(data: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrictionModel.from_mapping(data)


def test_coulomb_viscous_shorthand() -> None:
    friction = coulomb_viscous([0.1, 0.2], [1.0, 2.0])
    assert np.allclose(friction.torque([2.0, -2.0]), [1.2, -2.4])
    assert friction.passivity_margin().tolist() == [0.0, 0.0]
