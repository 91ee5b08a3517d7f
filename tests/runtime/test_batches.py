"""Batches: states in the lanes of vector registers, and several threads, give what single states give."""

from dataclasses import replace

import numpy as np
import pytest

import rrrgen

ROUND_OFF = 1e-12  # relative to the largest entry: the lanes repeat the scalar arithmetic
FLOAT_ROUND_OFF = 1e-4
FUNCTIONS = {
    "inverse_dynamics": 3,
    "mass_matrix": 1,
    "forward_dynamics": 3,
    "inverse_dynamics_derivatives": 3,
    "forward_dynamics_derivatives": 3,
    "regressor": 3,
    "forward_kinematics": 1,
    "kinematics": 1,
    "dynamics_terms": 2,
    "coriolis_matrix": 2,
    "energy": 2,
}


def states(n: int, count: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-3, 3, (3, count, n))


def rows(result, count: int) -> np.ndarray:
    """All results of ``count`` states side by side."""
    parts = result if isinstance(result, tuple) else (result,)
    return np.concatenate([np.reshape(part, (count, -1)) for part in parts], axis=1)


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.sweep(but=[f"{function}-{('double', 'float')[k % 2]}" for k, function in enumerate(FUNCTIONS)])
def test_batches_equal_single_states(function, real):
    model = rrrgen.compile("rrr", real=real)
    arguments = states(model.n, 37)[: FUNCTIONS[function]]  # not a multiple of any simd
    evaluate = getattr(model, function)
    batch = rows(evaluate(*arguments), 37)
    single = np.concatenate([rows(evaluate(*(a[k] for a in arguments)), 1) for k in range(37)])
    tolerance = ROUND_OFF if real == "double" else FLOAT_ROUND_OFF
    assert np.max(np.abs(batch - single)) <= tolerance * np.max(np.abs(single))


@pytest.mark.parametrize("name", ["T", "q"])
def test_a_robot_may_be_called_as_an_argument_is(name):
    """The type ``T_simd`` of the robot T was hidden by the lanes of the pose T: `verify` ended in a compiler error."""
    model = rrrgen.compile(replace(rrrgen.load_spec("pendulum"), name=name))
    q = states(1, 9)[0]
    named = rrrgen.compile("pendulum").kinematics(q)
    assert np.array_equal(rows(model.kinematics(q), 9), rows(named, 9))


def test_an_input_may_have_a_name_of_one_letter():
    """The gains k of Slotine and Li's law: the loop over states has its own variable."""
    model, rng = rrrgen.compile("rrr"), np.random.default_rng(3)
    motion, gain = rng.uniform(-1, 1, (5, 5, 3)), rng.uniform(1, 2, (5, 3))
    adapting = {
        "gamma": np.ones(15),
        "beta_min": -9 * np.ones(15),
        "beta_max": 9 * np.ones(15),
        "width": 0.1,
        "Ts": 1e-3,
    }
    batch = rows(model.slotine_li(*motion, gain, 2 * gain, model.beta, **adapting), 5)
    for k in range(5):
        single = rows(model.slotine_li(*motion[:, k], gain[k], 2 * gain[k], model.beta, **adapting), 1)
        assert np.max(np.abs(batch[k] - single)) <= ROUND_OFF * np.max(np.abs(single))


def test_angles_outside_the_kernels_range_and_nan_stay_in_their_lane():
    model = rrrgen.compile("rrr")
    q = states(3, 32)[0]
    q[5, 1], q[7, 2] = 3e8, np.nan
    g = model.gravity(q)
    reference = rrrgen.compile("rrr", backend="numpy").gravity(q)
    assert np.isnan(g[7]).any()
    assert np.isfinite(np.delete(g, 7, axis=0)).all()
    np.testing.assert_allclose(np.delete(g, 7, axis=0), np.delete(reference, 7, axis=0), atol=1e-12)


def test_an_indefinite_mass_matrix_is_reported_in_its_lane_only():
    model = rrrgen.compile("rrr")
    q, dq, tau = states(3, 24)
    beta = np.tile(model.beta, (24, 1))
    beta[9] = -beta[9]
    ddq, status = model.forward_dynamics(q, dq, tau, beta, with_status=True)
    assert np.flatnonzero(status).tolist() == [9]
    assert not ddq[9].any()
    assert np.isfinite(ddq).all()


def test_threads_share_a_batch_without_changing_it():
    model = rrrgen.compile("rrr")
    q, dq, ddq = states(3, 10_001)
    alone = model.inverse_dynamics(q, dq, ddq[0])
    model.threads = 3
    try:
        shared = model.inverse_dynamics(q, dq, ddq[0])
    finally:
        model.threads = 1
    assert np.max(np.abs(shared - alone)) <= ROUND_OFF * np.max(np.abs(alone))
    with pytest.raises(ValueError, match="at least 1"):
        model.threads = 0
    for count in (2.5, 2.0, "2", None, True):
        with pytest.raises(TypeError, match="threads must be a whole number, at least 1, not"):
            model.threads = count
    model.threads = np.int64(2)
    assert model.threads == 2
    model.threads = 1


def test_a_state_gives_the_same_numbers_anywhere_in_a_batch():
    """The last states of a batch, too few to fill a register, are computed like the others."""
    model = rrrgen.compile("rrr")
    arguments = states(model.n, 37)
    whole = model.inverse_dynamics(*arguments)
    for start, stop in ((0, 16), (0, 17), (3, 23), (14, 37)):
        part = model.inverse_dynamics(*(a[start:stop] for a in arguments))
        assert np.array_equal(part, whole[start:stop])
