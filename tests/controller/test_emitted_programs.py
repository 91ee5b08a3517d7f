"""Friction and the exciting trajectory as emitted C: equal to the NumPy reference to round-off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from robot.friction.examples import EXAMPLES, SPEEDS
from rrrgen.base.errors import InputError
from rrrgen.emit.controller.fourier_series import fixed_fourier_program, fourier_program
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.program import Program, count_operations, evaluate
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel
from rrrgen.robot.friction.programs import (
    friction_columns_program,
    friction_program,
    friction_rate_program,
    friction_step_program,
)

# Another order of the same operations, other libm: some units in the last place of the largest term.
ROUND_OFF = 1e-13


def trajectory(N: int = 20) -> FourierTrajectory:
    rng = np.random.default_rng(4)
    return FourierTrajectory(rng.normal(size=3), rng.normal(size=(3, N)), rng.normal(size=(3, N)), 0.1)


class Emitted:
    """The programs of this half as one C file, called state by state."""

    def __init__(self, programs: list[Program]) -> None:
        from rrrgen.emit.c.header_comments import function_name
        from rrrgen.emit.c.language import Dialect
        from rrrgen.emit.c.robot_files import header_and_sources
        from rrrgen.robot.identity import identify
        from rrrgen.runtime.build import build_extension

        model = rrrgen.compile("planar2r")
        self.programs = {program.name: program for program in programs}
        dialect = Dialect(model.spec.name, "double")
        sources = header_and_sources(
            replace(model.derived, programs=self.programs, beta_nominal=None), identify(model.spec), dialect
        )
        self.symbols = {name: function_name(program, dialect) for name, program in self.programs.items()}
        declared = [self._declaration(name) for name in self.programs]
        self.ffi, self.lib = build_extension(sources, "\n".join(declared), "planar2r_more")

    def _declaration(self, name: str) -> str:
        program = self.programs[name]
        inputs = [f"double {p.name}" if p.shape == () else f"const double *{p.name}" for p in program.inputs]
        outputs = [f"double *{p.name}" for p in program.data_outputs]
        return f"{'int' if program.status else 'void'} {self.symbols[name]}({', '.join([*inputs, *outputs])});"

    def call(self, name: str, *values) -> list[np.ndarray]:
        """``values`` are states (N, ...) or constants; returns one (N, *shape) per output."""
        program = self.programs[name]
        arrays = [np.asarray(value, dtype=float) for value in values]
        varying = [a.ndim > len(p.shape) for a, p in zip(arrays, program.inputs, strict=True)]
        N = next(a.shape[0] for a, varies in zip(arrays, varying, strict=True) if varies)
        results = [np.empty((N, *port.shape)) for port in program.data_outputs]
        function = getattr(self.lib, self.symbols[name])
        for k in range(N):
            state = [np.ascontiguousarray(a[k] if varies else a) for a, varies in zip(arrays, varying, strict=True)]
            inputs = [
                s.item() if port.shape == () else self.ffi.from_buffer("double[]", s)
                for s, port in zip(state, program.inputs, strict=True)
            ]
            function(*inputs, *(self.ffi.from_buffer("double[]", r[k]) for r in results))
        return results


@pytest.fixture(scope="module")
def compiled() -> Emitted:
    path = trajectory()
    return Emitted(
        [
            *(friction_program(law, 2) for law in LAWS.values()),
            *(friction_columns_program(law, 2) for law in LAWS.values() if law.columns),
            friction_step_program(LAWS["lugre"], 2),
            friction_rate_program(LAWS["lugre"], 2),
            fourier_program(3, 20),
            fixed_fourier_program(path.q0.tolist(), path.a.tolist(), path.b.tolist(), path.base_frequency),
        ]
    )


@pytest.mark.parametrize("name", list(LAWS))
def test_friction_in_c(compiled, name: str) -> None:
    friction = FrictionModel(LAWS[name], np.array(EXAMPLES[name]))
    speeds = np.column_stack([SPEEDS, -0.3 * SPEEDS])
    loads = (20.0 * np.sin(np.arange(speeds.size)).reshape(speeds.shape),) if friction.has_load else ()
    (tau,) = compiled.call(f"friction_{name}", speeds, friction.parameters, *loads)
    expected = friction.torque(speeds, load=loads[0] if loads else 0.0)
    assert np.abs(tau - expected).max() <= ROUND_OFF * np.abs(expected).max()
    assert tau[0, 0] == expected[0, 0]  # at rest, sgn(0) = 0
    if friction.law.columns is not None:
        (Y,) = compiled.call(f"friction_columns_{name}", speeds)
        assert np.array_equal(Y, friction.columns(speeds))


def test_lugre_in_c(compiled) -> None:
    friction = FrictionModel(LAWS["lugre"], np.array(EXAMPLES["lugre"]))
    rng = np.random.default_rng(0)
    dq, z = rng.normal(size=(200, 2)), 1e-4 * rng.normal(size=(200, 2))
    for got, expected in (
        (compiled.call("friction_step_lugre", dq, z, friction.parameters, 1e-3), friction.step(z, dq, 1e-3)),
        (
            compiled.call("friction_rate_lugre", dq, z, friction.parameters),
            (friction.rate(z, dq), friction.state_torque(z, dq)),
        ),
    ):
        for mine, reference in zip(got, expected, strict=True):
            assert np.abs(mine - reference).max() <= 1e-12 * np.abs(reference).max()


def test_trajectory_in_c(compiled) -> None:
    path = trajectory()
    t = np.linspace(0.0, 10.0, 1001)
    rows = path.coefficients.T
    for got in (
        compiled.call("fourier_trajectory", t, path.base_frequency, rows),
        compiled.call("exciting_trajectory", t),
        evaluate(fourier_program(3, 20), t, np.full(1001, 0.1), np.broadcast_to(rows, (1001, *rows.shape))),
    ):
        for values, expected in zip(got, path.evaluate(t), strict=True):
            assert np.abs(values - expected).max() <= ROUND_OFF * np.abs(expected).max()


def test_trajectory_takes_bounded_work() -> None:
    """One sine and one cosine, and a fixed number of products per harmonic and joint."""
    count = count_operations(fourier_program(3, 20))
    assert count.sincos == 1
    assert count.mul <= 20 * (4 + 3 * 6) + 10
    with pytest.raises(InputError):
        fixed_fourier_program([0.0], [[1.0, 2.0]], [[1.0]], 0.1)
