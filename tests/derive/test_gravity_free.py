"""Robots without gravity: torques of gravity vanish, and so do the base parameters that only gravity would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from rrrgen.derive import prepare
from rrrgen.derive.functions.table import recorders
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import load_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of


@pytest.mark.parametrize("name", ["planar2r", "puma560"])
def test_a_robot_without_gravity_has_the_base_parameters_of_its_motion(name):
    spec = replace(load_spec(name), gravity=(sp.S.Zero,) * 3, basis=None)
    recorded, chain = prepare(spec), chain_of(spec)
    states = np.random.default_rng(1).uniform(-2, 2, (3, 40, spec.n))
    Y = NewtonEuler(chain, np.zeros((chain.links, 10))).standard_regressor(*states).reshape(-1, 10 * chain.links)
    sizes = np.linalg.svd(Y, compute_uv=False)
    names = recorded.compiler_basis.names
    assert len(names) == np.sum(sizes > 1e-9 * sizes[0])
    assert len(names) < len(prepare(replace(load_spec(name), basis=None)).compiler_basis.names)
    gravity = recorders("gravity")[0](recorded.recording())
    assert not np.any(evaluate(gravity, states[0, 0], np.ones(len(names)))[0])
