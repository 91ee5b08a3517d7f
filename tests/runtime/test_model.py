"""The compiled model as Python sees it: values, shapes, strides, kinds of numbers, errors, parameters, bound calls."""

from __future__ import annotations

import numpy as np
import pytest

from emit.planar import BETA_NOMINAL, projection
from runtime.states import CALLS, arguments, close

SHAPES = {
    "forward_kinematics": (4, 4),
    "link_frames": (2, 4, 4),
    "jacobian": (6, 2),
    "link_jacobians": (2, 6, 2),
    "jacobian_dot_dq": (6,),
    "mass_matrix": (2, 2),
    "coriolis_matrix": (2, 2),
    "regressor": (2, 6),
    "regressor_transpose": (6,),
    "standard_regressor": (2, 20),
    "identification_regressor": (2, 12),
}


@pytest.mark.parametrize("name", CALLS)
def test_every_function_equals_the_reference_for_states_and_batches(name, model, reference, states):
    batch = arguments(name, states)
    expected = getattr(reference, name)(*batch)
    result = getattr(model, name)(*batch)
    close(result, expected)
    if name != "energy":
        assert result.shape == (7, *SHAPES.get(name, (2,)))
        close(getattr(model, name)(*(x[3] for x in batch)), np.asarray(expected)[3])
        grid = getattr(model, name)(*(np.stack([x, x]) for x in batch))
        close(grid, np.stack([expected, expected]))


def test_one_value_serves_a_whole_batch_and_leading_dimensions_broadcast(model, states):
    q, dq, _, _ = states
    close(model.inverse_dynamics(q, dq[0], np.zeros(2)), [model.inverse_dynamics(x, dq[0], [0, 0]) for x in q])
    grid = model.coriolis(q[:, None], dq[None, :])
    assert grid.shape == (7, 7, 2)
    close(grid[2, 5], model.coriolis(q[2], dq[5]))
    close(model.coriolis(q[:1], dq), [model.coriolis(q[0], x) for x in dq])


def test_any_strides_orders_and_alignments_are_read_right(model, states):
    q, dq, _, _ = states
    expected = model.coriolis(q, dq)
    wide = np.zeros((7, 5))
    wide[:, 1::2] = q
    packed = np.zeros(7, dtype=np.dtype([("flag", "i1"), ("q", "f8", 2)], align=False))
    packed["q"] = q
    frozen = q.copy()
    frozen.setflags(write=False)
    for other in (
        np.asfortranarray(q),
        wide[:, 1::2],
        q[::-1][::-1],
        packed["q"],
        frozen,
        q.astype(">f8"),
        q.tolist(),
        np.moveaxis(np.moveaxis(q, 0, 1).copy(), 0, 1),
    ):
        np.testing.assert_array_equal(model.coriolis(other, dq), expected)
    np.testing.assert_array_equal(model.coriolis(q[::-2], dq[::-2]), expected[::-2])


def test_integers_and_single_precision_are_converted(model):
    close(model.gravity([1, 2]), model.gravity([1.0, 2.0]))
    close(model.gravity(np.array([1, 2], dtype=np.uint8)), model.gravity([1.0, 2.0]))
    q = np.array([0.1, 0.2], dtype=np.float32)
    close(model.gravity(q), model.gravity(q.astype(float)))
    assert model.gravity(q).dtype == np.float64


@pytest.mark.parametrize(
    "bad",
    [
        np.array([1 + 1j, 2]),
        np.array([1, None]),
        np.array(["1", "2"]),
        np.array([True, False]),
        np.ma.masked_array([1.0, 2.0], [True, False]),
        [object(), object()],
        np.array([1, 2], dtype="timedelta64[s]"),
    ],
)
def test_other_kinds_of_numbers_are_refused(bad, model):
    with pytest.raises(TypeError, match=r"gravity: q "):
        model.gravity(bad)


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (0,), (2, 0), (5, 1)])
def test_wrong_shapes_are_refused_with_what_is_expected(shape, model):
    with pytest.raises(
        ValueError, match=r"gravity: q must have shape \(2,\) or \(..., 2\), got .*joint positions \[rad\]"
    ):
        model.gravity(np.zeros(shape))


def test_batches_that_do_not_fit_and_ragged_lists_are_refused(model):
    with pytest.raises(
        ValueError, match=r"coriolis: the leading dimensions do not fit each other: q \(3,\), dq \(4,\)"
    ):
        model.coriolis(np.zeros((3, 2)), np.zeros((4, 2)))
    with pytest.raises(ValueError, match="no rectangular array"):
        model.gravity([[1, 2], [3]])
    with pytest.raises(ValueError, match="beta must have shape"):
        model.gravity([0, 0], np.zeros(5))


def test_empty_batches_give_empty_results(model):
    assert model.mass_matrix(np.zeros((0, 2))).shape == (0, 2, 2)
    assert model.mass_matrix(np.zeros((3, 0, 2))).shape == (3, 0, 2, 2)
    assert model.forward_dynamics(*np.zeros((3, 0, 2))).shape == (0, 2)


def test_a_mass_matrix_that_is_not_positive_definite_is_reported(model, states):
    q, dq, _, tau = states
    beta = np.tile(np.array(model.beta), (7, 1))
    beta[4] *= -1
    with pytest.raises(np.linalg.LinAlgError, match="1 of 7 states, the first at flat index 4"):
        model.forward_dynamics(q, dq, tau, beta)
    ddq, status = model.forward_dynamics(q, dq, tau, beta, with_status=True)
    assert status.tolist() == [0, 0, 0, 0, 1, 0, 0]
    assert np.isfinite(ddq).all()
    with pytest.raises(np.linalg.LinAlgError):
        model.forward_dynamics(q[0], dq[0], tau[0], -model.beta)


def test_nan_goes_through_and_is_not_called_ok(model):
    assert np.isnan(model.gravity([np.nan, 0])).all()
    _, status = model.forward_dynamics([0.0, np.nan], [0, 0], [0, 0], with_status=True)
    assert status == 1


def test_what_the_model_says_about_itself(model):
    assert model.n == 2
    assert model.base_parameter_names == ("b1", "b2", "b3", "b4", "b5", "b6")
    assert str(model.base_parameters[0]) == "Izz1 + m2/4"
    np.testing.assert_array_equal(model.beta, [float(x) for x in BETA_NOMINAL])
    np.testing.assert_array_equal(model.base_projection, np.array(projection(), dtype=float))
    assert repr(model) == "<rrrgen.Model planar: RR, 6 base parameters>"
    with pytest.raises(ValueError, match="read-only"):
        model.beta[0] = 1  # the compiled nominal functions would not see it
