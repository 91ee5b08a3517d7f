"""Bound calls: in place, and without a compiler too."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.states import close


def test_bound_calls_compute_the_same_in_place(model, states):
    q, dq, ddq, tau = (x[0] for x in states)
    f = model.bind("inverse_dynamics")
    f.inputs["q"][:], f.inputs["dq"][:], f.inputs["ddq"][:] = q, dq, ddq
    result = f()
    close(result, model.inverse_dynamics(q, dq, ddq))
    assert result is f()
    assert result is f.outputs["tau"]
    close(f(-q, dq), model.inverse_dynamics(-q, dq, ddq))
    g = model.bind("gravity", beta=2 * model.beta)
    close(g(q), 2 * model.gravity(q))
    g.inputs["beta"][:6] = model.beta  # the drive inertias follow
    close(g(), model.gravity(q))
    h = model.bind("forward_dynamics", beta=-model.beta)
    with pytest.raises(np.linalg.LinAlgError):
        h(q, dq, tau)
    assert h.run() == 1
    with pytest.raises(TypeError):
        f.inputs["q"] = q  # another array would go unseen
    with pytest.raises(
        ValueError, match=r"no function 'inverse_dynamic'; did you mean 'inverse_dynamics'\? there are "
    ):
        model.bind("inverse_dynamic")


def test_bound_calls_work_without_a_compiler_too(reference, model, states):
    q, dq, ddq, tau = (x[0] for x in states)
    close(reference.bind("inverse_dynamics")(q, dq, ddq), model.inverse_dynamics(q, dq, ddq))
    f = reference.bind("forward_dynamics", beta=-model.beta)
    with pytest.raises(np.linalg.LinAlgError):
        f(q, dq, tau)
