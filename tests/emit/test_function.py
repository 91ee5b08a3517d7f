"""CasADi functions against the reference evaluation of their programs, and the module that rebuilds them."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from emit.casadi_cases import arguments, as_matrices, call, every_shape, pendulum, random_program
from rrrgen.derive.parameters.listing import ParameterListing, PrintedParameter
from rrrgen.emit.casadi.function import function, smooth_sign
from rrrgen.emit.casadi.module import rebuild_module
from rrrgen.program import Builder, Port, evaluate

ca = pytest.importorskip("casadi")

# the same operations in the same order; sums of constants may be grouped differently and libm is shared, so a few units
# in the last place of the largest intermediate value
ROUND_OFF = 1e-13


def imported(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def assert_equal(got: list[np.ndarray], expected: tuple[np.ndarray, ...]) -> None:
    for one, other in zip(got, as_matrices(list(expected)), strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=ROUND_OFF, atol=ROUND_OFF)


@given(seed=st.integers(0, 2**32 - 1))
def test_function_equals_reference_evaluation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = random_program(rng)
    values = arguments(program, rng)
    assert_equal(call(function(program), values), evaluate(program, *values))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_rebuilt_module_equals_reference_evaluation(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    rng = np.random.default_rng(seed)
    programs = [(f"f{k}", random_program(rng)) for k in range(3)]
    path = tmp_path_factory.mktemp("module") / "robot_casadi.py"
    path.write_text(rebuild_module("robot", programs), encoding="utf-8")
    module = imported(path)
    assert list(module.FUNCTIONS) == ["f0", "f1", "f2"]
    for name, program in programs:
        values = arguments(program, rng)
        assert_equal(call(module.FUNCTIONS[name](), values), evaluate(program, *values))


def test_ports_keep_names_and_shapes() -> None:
    F = function(every_shape())
    assert [F.name_in(i) for i in range(F.n_in())] == ["q", "B", "k"]
    assert [F.name_out(i) for i in range(F.n_out())] == ["A", "c", "T"]
    assert [F.size_in(i) for i in range(3)] == [(3, 1), (2, 3), (1, 1)]
    assert [F.size_out(i) for i in range(3)] == [(2, 2), (1, 1), (4, 2)]
    assert all(F.sparsity_out(i).is_dense() for i in range(3))


def test_matrices_are_not_transposed() -> None:
    b = Builder()
    M = b.input(Port("M", (2, 3)))
    F = function(b.program("same", [(Port("N", (2, 3)), M)]))
    given_matrix = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(F(given_matrix).full(), given_matrix)


def test_select_hides_what_is_not_chosen() -> None:
    """An undefined value of the branch not taken does not reach the result."""
    b = Builder()
    x = b.input(Port("x", ()))[0]
    F = function(b.program("guarded", [(Port("y", ()), [b.select(x, b.sqrt(x), 0)])]))
    assert float(F(-1.0)) == 0.0
    assert float(F(4.0)) == 2.0


def test_smooth_sign_by_option_and_as_program() -> None:
    exact, smooth = function(pendulum()), function(pendulum(), smooth_sign=1e-2)
    by_program = function(smooth_sign(pendulum()))
    for dq in (-1.0, -0.004, 0.0, 0.3):
        expected = float(exact(0.2, 0.0, 1.0)) - (0.2 * dq + 0.3 * np.tanh(dq / 1e-2)) / 1.2
        assert float(smooth(0.2, dq, 1.0)) == pytest.approx(expected, rel=ROUND_OFF)
        assert float(by_program(0.2, dq, 1.0, 1e-2)) == pytest.approx(expected, rel=ROUND_OFF)
    at_rest = smooth.jacobian()(0.2, 0.0, 1.0, 0.0)[1]
    assert float(at_rest) == pytest.approx(-(0.2 + 0.3 / 1e-2) / 1.2, rel=ROUND_OFF)
    with pytest.raises(ValueError, match="positive"):
        function(pendulum(), smooth_sign=0.0)


def test_save_and_load(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    program = every_shape()
    function(program).save(str(tmp_path / "f.casadi"))
    values = arguments(program, rng)
    assert_equal(call(ca.Function.load(str(tmp_path / "f.casadi")), values), evaluate(program, *values))


def test_module_needs_nothing_but_casadi(tmp_path: Path) -> None:
    listing = ParameterListing('a "b" \\ ' * 30, (PrintedParameter("p1", "kg", sp.Symbol('a "b" \\'), None),))
    text = rebuild_module("robot", [("shapes", every_shape())], listing, ["a header line"])
    (tmp_path / "robot_casadi.py").write_text(text, encoding="utf-8")
    code = (
        "import sys, robot_casadi; robot_casadi.shapes(); assert not any(m.startswith('rrrgen') for m in sys.modules)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True, timeout=60)
    assert all(len(line) <= 120 for line in text.splitlines())


_TEXTS = """
import hashlib, sys
import numpy as np
from emit.casadi_cases import every_shape, pendulum, random_program
from rrrgen.emit.casadi.external import external_sources
from rrrgen.emit.casadi.function import smooth_sign
from rrrgen.emit.casadi.module import rebuild_module
rng = np.random.default_rng(1)
programs = [("shapes", every_shape()), ("fd", pendulum()), ("smooth", smooth_sign(pendulum()))]
programs += [(f"r{k}", random_program(rng)) for k in range(3)]
kinds = ("jac", "fwd1", "adj1", "fwd1_adj1")
texts = [rebuild_module("robot", programs), *external_sources("robot", [(n, p, kinds) for n, p in programs]).values()]
assert "casadi" not in sys.modules
print(hashlib.sha256("".join(texts).encode()).hexdigest())
"""


def test_texts_repeat_in_fresh_processes_and_need_no_casadi() -> None:
    here = Path(__file__).resolve()
    paths = os.pathsep.join([str(here.parents[1]), str(here.parents[2])])
    hashes = set()
    for seed in ("0", "4242"):
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": paths}
        done = subprocess.run(
            [sys.executable, "-c", _TEXTS], env=environment, check=True, capture_output=True, text=True, timeout=120
        )
        hashes.add(done.stdout.strip())
    assert len(hashes) == 1
