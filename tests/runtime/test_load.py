"""Loading of models: precision, backends by name, two models of one name, threads."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import rrrgen
from emit.c_tools import IDENTITY
from emit.planar import IA_NOMINAL, planar_model
from rrrgen.runtime.load import load_model
from runtime.states import CALLS, arguments, close

SINGLE = 2e-6  # the same in float32


def test_a_float_model_computes_in_single_precision(model, states):
    single = load_model(planar_model(), IDENTITY, real="float")
    single.engine.prepare()
    for name in CALLS:
        result = getattr(single, name)(*arguments(name, states))
        close(result, getattr(model, name)(*arguments(name, states)), SINGLE)
    assert single.gravity([0, 0]).dtype == np.float32


def test_threads_may_share_a_model(model):
    q = np.random.default_rng(4).uniform(-2, 2, (20_000, 2))
    expected = model.mass_matrix(q)
    results = [None] * 4

    def work(k):
        results[k] = model.mass_matrix(q)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result in results:
        np.testing.assert_array_equal(result, expected)


def test_two_models_of_one_name_live_side_by_side(states):
    plain = load_model(planar_model("twin", drives=False), IDENTITY)
    driven = load_model(planar_model("twin"), IDENTITY)
    q = states[0]
    difference = driven.mass_matrix(q) - plain.mass_matrix(q)
    close(difference, np.broadcast_to(np.diag([float(x) for x in IA_NOMINAL]), (7, 2, 2)))


def test_backends_are_named_right():
    with pytest.raises(ValueError, match="'c' or 'numpy'"):
        load_model(planar_model(), IDENTITY, "fortran")
    with pytest.raises(ValueError, match="double only"):
        load_model(planar_model(), IDENTITY, "numpy", "float")
    with pytest.raises(ValueError, match="real must be 'double' or 'float', not 'half'"):
        rrrgen.compile("pendulum", real="half")
