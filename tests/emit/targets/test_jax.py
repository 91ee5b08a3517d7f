"""The JAX module equals the emitted C, alone, in batches, in both precisions, and can be differentiated."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from pages.test_pages import blocks
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec

jax = pytest.importorskip("jax")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "sockets.md"
GROUPS = ("control", "observer", "points", "trajectory")


@pytest.fixture(autouse=True)
def double_precision():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


def imported(folder, robot, groups=()):
    """The exported module of a bundled robot."""
    for name, text in export_robot(load_spec(robot), "jax", options=ExportOptions(further=groups)).files.items():
        (folder / name).write_text(text)
    specification = importlib.util.spec_from_file_location(f"{robot}_jax", folder / f"{robot}_jax.py")
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


def states(n, count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (3, count, n))


def worst(value, expected):
    """The largest deviation, in units of the largest element."""
    return np.max(np.abs(np.asarray(value) - expected)) / np.max(np.abs(expected))


@pytest.mark.sweep
def test_hessian_of_jax_is_that_of_the_emitted_function(tmp_path):
    module, model = imported(tmp_path, "planar2r", ("hessian",)), rrrgen.compile("planar2r", backend="numpy")
    q, dq, ddq = states(model.n, 1)[:, 0]
    weights = np.array([0.3, -0.7])
    with jax.disable_jit():
        x = np.concatenate([q, dq, ddq])
        found = jax.hessian(lambda x: weights @ module.inverse_dynamics_nominal(x[:2], x[2:4], x[4:]))(x)
        gradient, Hqq, Hvq, Haq, Hvv = module.inverse_dynamics_hessian_nominal(q, dq, ddq, weights)
    expected = model.inverse_dynamics_hessian(q, dq, ddq, weights)
    assert worst(found, expected.H) < 1e-14
    assert worst(gradient, expected.gradient) < 1e-14
    upper = np.triu_indices(2)
    for block, own in (
        (Hqq, expected.H[:2, :2][upper]),
        (Hvv, expected.H[2:4, 2:4][upper]),
        (Hvq, expected.H[2:4, :2]),
        (Haq, expected.H[4:, :2]),
    ):
        assert np.max(np.abs(np.asarray(block) - own)) < 1e-14 * np.max(np.abs(expected.H))


@pytest.mark.parametrize("robot", ["rrr", "scara"])
@pytest.mark.sweep(but=["rrr"])
def test_batches_equal_the_compiled_c(tmp_path, robot):
    module, model = imported(tmp_path, robot), rrrgen.compile(robot)
    q, dq, ddq = states(model.n, 20)
    tau = jax.vmap(module.inverse_dynamics_nominal)(q, dq, ddq)
    assert tau.dtype == np.float64
    assert worst(tau, model.inverse_dynamics(q, dq, ddq)) < 1e-14
    assert worst(jax.vmap(module.mass_matrix_nominal)(q), model.mass_matrix(q)) < 1e-14
    assert worst(jax.vmap(module.forward_kinematics)(q), model.forward_kinematics(q)) < 1e-14
    with jax.disable_jit():  # compiling the many elements of a regressor takes seconds
        assert worst(module.regressor(q[0], dq[0], ddq[0]), model.regressor(q[0], dq[0], ddq[0])) < 1e-14
    answer = jax.vmap(module.forward_dynamics_nominal)(q, dq, tau)
    assert worst(answer.ddq, model.forward_dynamics(q, dq, np.asarray(tau))) < 1e-11
    assert worst(answer.ddq, ddq) < 1e-10
    assert not np.any(answer.status)


def test_every_function_equals_the_reference_evaluation(tmp_path):
    """All functions of all groups, refused input included, against the programs that they are printed from."""
    from rrrgen.derive import derive
    from rrrgen.emit.description import programs_of
    from rrrgen.program import evaluate

    module = imported(tmp_path, "planar2r", GROUPS)
    programs = programs_of(derive(load_spec("planar2r"), groups=("model", *GROUPS)))
    rng = np.random.default_rng(3)
    for name, program in programs.items():
        for spoilt in (False, True) if program.inputs else (False,):
            values = [rng.uniform(0.5, 1.5, port.shape) for port in program.inputs]
            if spoilt:
                values[0] = np.full(program.inputs[0].shape, np.nan)
            with jax.disable_jit():
                answer = getattr(module, name)(*values)
            results = answer if isinstance(answer, tuple) else (answer,)
            with np.errstate(all="ignore"):
                expected = evaluate(program, *values)
            expected = expected if isinstance(expected, tuple) else (expected,)
            for result, wanted in zip(results, expected, strict=True):
                np.testing.assert_allclose(result, wanted, rtol=1e-11, atol=1e-11, err_msg=name)


def test_precision_is_that_of_the_arguments(tmp_path):
    module, model = imported(tmp_path, "rrr"), rrrgen.compile("rrr")
    q, dq, ddq = states(3, 20).astype(np.float32)
    tau = jax.vmap(module.inverse_dynamics_nominal)(q, dq, ddq)
    assert tau.dtype == np.float32
    assert worst(tau, model.inverse_dynamics(*(x.astype(float) for x in (q, dq, ddq)))) < 1e-6


def test_derivatives_are_those_of_the_model(tmp_path):
    module, model = imported(tmp_path, "rrr"), rrrgen.compile("rrr")
    (q,), (dq,), (ddq,) = states(3, 1)
    expected = model.inverse_dynamics_derivatives(q, dq, ddq)
    for mode in (jax.jacfwd, jax.jacrev):
        dtau_dq, dtau_dv = mode(module.inverse_dynamics_nominal, argnums=(0, 1))(q, dq, ddq)
        assert worst(dtau_dq, expected.dtau_dq) < 1e-13
        assert worst(dtau_dv, expected.dtau_dv) < 1e-13
    slope = jax.grad(lambda beta: module.energy(q, dq, beta).kinetic)(np.asarray(module.BETA_NOMINAL))
    assert np.all(np.isfinite(slope))


def test_mechanisms_and_gravity_as_an_input(tmp_path):
    module = imported(tmp_path, "rrr", ("gravity",))
    assert (tmp_path / "rrr_any_gravity_jax.py").exists()
    with pytest.raises(ValueError, match=r"q must have shape \(3,\), not \(2, 3\); batches are for jax.vmap"):
        module.gravity_nominal(np.zeros((2, 3)))


def test_the_code_on_the_page_runs(tmp_path, monkeypatch):
    imported(tmp_path, "rrr")
    (code,) = [text for text in blocks(PAGE.read_text(encoding="utf-8"), "python") if "rrr_jax" in text]
    names = {}
    exec(code, names)
    assert names["tau"].shape == (1000, 3)
    assert names["stiffness"].shape == (3, 3)
    assert names["status"] == 0
