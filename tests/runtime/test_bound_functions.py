"""Bound functions take values and parameters as plain calls do, of one state; scalars, statuses and loops."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import rrrgen

BACKENDS = ("c", "numpy")
NAN = float("nan")


@pytest.fixture(scope="module", params=BACKENDS)
def arm(request):
    return rrrgen.compile("planar2r", backend=request.param)


Q = np.array([0.3, 0.4])


# -- parameters ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "spoil",
    [lambda beta: beta[:2], lambda beta: 7.0, lambda beta: np.ones(9), lambda beta: beta + 0j, lambda beta: beta > 0],
    ids=["short", "scalar", "long", "complex", "boolean"],
)
def test_parameters_are_refused_as_by_a_plain_call(arm, spoil):
    beta = spoil(arm.beta)
    with pytest.raises((ValueError, TypeError)) as expected:
        arm.inverse_dynamics(Q, Q, Q, beta)
    with pytest.raises(type(expected.value)) as caught:
        arm.bind("inverse_dynamics", beta=beta)
    assert str(caught.value) == str(expected.value)


def test_parameters_of_several_states_or_without_use_are_refused(arm):
    with pytest.raises(ValueError, match=r"inverse_dynamics: beta of a bound function is that of one state.*\(3,\)"):
        arm.bind("inverse_dynamics", beta=np.tile(arm.beta, (3, 1)))
    with pytest.raises(ValueError, match="jacobian takes no base parameters"):
        arm.bind("jacobian", beta=arm.beta)


def test_parameters_may_be_lists_and_are_copied(arm):
    given = 2.0 * arm.beta
    f, g = arm.bind("inverse_dynamics", beta=given), arm.bind("inverse_dynamics", beta=given.tolist())
    nominal = arm.inverse_dynamics(Q, Q, Q)
    given[:] = NAN
    np.testing.assert_allclose(f(Q, Q, Q), 2.0 * nominal, rtol=1e-13)  # torques are linear in the parameters
    np.testing.assert_allclose(g(Q, Q, Q), 2.0 * nominal, rtol=1e-13)


# -- values ----------------------------------------------------------------------------------------------------------


def test_more_values_than_inputs_are_refused(arm):
    with pytest.raises(TypeError, match=r"inverse_dynamics takes at most 3 values \(q, dq, ddq\), got 4"):
        arm.bind("inverse_dynamics")(Q, Q, Q, 2.0 * arm.beta)


@pytest.mark.parametrize(
    ("value", "kind", "text"),
    [
        (0.3, ValueError, r"dq must have shape \(2,\).*got \(\)"),
        (np.ones(1), ValueError, r"dq must have shape \(2,\).*got \(1,\)"),
        (np.ones((2, 1)), ValueError, r"dq must have shape \(2,\).*got \(2, 1\)"),
        (np.ones((1, 2)), ValueError, r"dq of a bound function is that of one state.*\(1,\)"),
        (None, TypeError, "dq must be given"),
        (["1", "2"], TypeError, "dq must hold real numbers"),
        (Q + 0j, TypeError, "dq must hold real numbers"),
        (np.ma.masked_array(Q, [True, False]), TypeError, "dq is a masked array"),
    ],
)
def test_values_have_the_shape_and_kind_of_their_input(arm, value, kind, text):
    f = arm.bind("inverse_dynamics")
    with pytest.raises(kind, match=f"inverse_dynamics: {text}"):
        f(Q, value)


def test_lists_whole_numbers_and_strides_are_converted(arm):
    f = arm.bind("inverse_dynamics")
    wanted = arm.inverse_dynamics([1.0, 2.0], [3.0, 4.0], [5.0, 6.0])
    np.testing.assert_array_equal(f([1, 2], np.array([[3.0, 0.0], [4.0, 0.0]])[:, 0], np.float32([5.0, 6.0])), wanted)
    np.testing.assert_array_equal(f([1.0, 2.0]), wanted)  # the others keep their values


# -- scalars and statuses --------------------------------------------------------------------------------------------


def test_scalars_are_read_at_each_call():
    """The quintic passes the middle of its way at half its duration, at 15/8 of the mean speed."""
    f = rrrgen.compile("rrr").bind("quintic")
    start, end = np.array([0.1, -0.2, 0.3]), np.array([1.1, 0.8, -0.7])
    zero = np.zeros(3)
    for duration in (2.0, 4.0):
        q = f(duration / 2, duration, start, zero, zero, end)
        np.testing.assert_allclose(q, (start + end) / 2, atol=1e-14)
        np.testing.assert_allclose(f.outputs["dq_d"], 15 / 8 * (end - start) / duration, atol=1e-14)
    f.inputs["t"][...] = 4.0
    np.testing.assert_allclose(f(), end, atol=1e-14)


@pytest.mark.parametrize("real", ["double", "float"])
def test_scalars_in_front_of_other_inputs(real):
    model = rrrgen.compile("rrr", real=real)
    com, inertia = np.array([0.0, 0.1, 0.2]), np.diag([1e-2, 2e-2, 3e-2])
    f = model.bind("add_payload", beta=model.beta)
    wanted = rrrgen.compile("rrr", backend="numpy").add_payload(1.5, com, inertia)
    np.testing.assert_allclose(f(1.5, com, inertia), wanted, rtol=1e-13 if real == "double" else 1e-6)


def test_functions_without_scalars_and_with_plain_codes_are_called_directly():
    """No line of Python stands between ``run`` and C."""
    model = rrrgen.compile("planar2r")
    for name in ("inverse_dynamics", "forward_dynamics"):
        assert not hasattr(model.bind(name).run, "__code__")


LINKAGES = Path(__file__).resolve().parents[2] / "examples/linkages"


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_status_is_the_documented_code_and_the_error_names_its_failure(backend):
    model = rrrgen.compile(LINKAGES / "five_bar.yaml", backend=backend)
    g = model.bind("closed_loops")
    g.inputs["q"][:] = 0.0
    *_, status = model.closed_loops(np.zeros(2), with_status=True)
    assert g.run() == 2 == status
    with pytest.raises(ValueError, match="cannot be assembled") as plain:
        model.closed_loops(np.zeros(2))
    with pytest.raises(type(plain.value)) as bound:
        g()
    assert str(bound.value) == str(plain.value)


# -- loops that Newton's method solves -------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=BACKENDS)
def six_bar(request):
    return rrrgen.compile(LINKAGES / "six_bar.yaml", backend=request.param)


def test_a_bound_function_has_the_passive_joints_of_its_model(six_bar):
    state = [0.2], [1.0], [0.0]
    at = six_bar.at_loops(six_bar.loop_positions([0.2]))
    wanted = six_bar.inverse_dynamics(*state)
    bound = at.bind("inverse_dynamics")
    np.testing.assert_allclose(bound(*state), wanted, rtol=1e-12)
    free = six_bar.bind("inverse_dynamics")
    assert abs(free(*state)[0] - wanted[0]) > 0.1, "it stays at the start of the file"
    free.inputs["loop_q"][:] = at.bind("jacobian").inputs["loop_q"]
    np.testing.assert_allclose(free(*state), wanted, rtol=1e-12)


def test_passive_joints_of_several_states_or_of_another_number_are_refused(six_bar):
    one = six_bar.loop_positions([0.2])
    with pytest.raises(ValueError, match=r"loop_q of a bound function is that of one state"):
        six_bar.at_loops(np.stack([one, one])).bind("inverse_dynamics")
    with pytest.raises(ValueError, match=r"loop_q must have shape"):
        six_bar.at_loops(one[:2]).bind("inverse_dynamics")


def test_a_model_at_positions_of_loops_is_pickled(six_bar):
    at = six_bar.at_loops(six_bar.loop_positions([0.2]))
    copied = pickle.loads(pickle.dumps(at))
    for q in ([0.2], [0.1]):
        state = q, [1.0], [0.0]
        np.testing.assert_array_equal(copied.inverse_dynamics(*state), at.inverse_dynamics(*state))


@pytest.mark.parametrize("q", [[1.0, 2.0], [[1.0, 2.0]], 1.0], ids=["two", "batch", "scalar"])
def test_a_wrong_shape_of_q_is_said_before_loops_are_followed(six_bar, q):
    with pytest.raises(ValueError, match=r"inverse_dynamics: q must have shape \(1,\) or \(\.\.\., 1\), got"):
        six_bar.inverse_dynamics(q, [1.0], [0.0])
    with pytest.raises(ValueError, match=r"loop_positions: q must have shape \(1,\) or \(\.\.\., 1\), got"):
        six_bar.loop_positions(q)
