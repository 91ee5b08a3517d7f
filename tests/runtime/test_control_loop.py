"""Loops closed over the compiled functions: tracking, an external torque that is observed, parameters that adapt."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen

Ts = 1e-3
WIDTH = 0.02
FRICTION = np.array([2.0, 3.0, 0.0] * 3)  # viscous, coulomb, offset of each joint


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")


def desired(t):
    w = np.array([2.0, 3.0, 4.0])
    return 0.4 * np.sin(w * t), 0.4 * w * np.cos(w * t), -0.4 * w * w * np.sin(w * t)


def simulate(model, controller, seconds=1.0, beta=None, external=None):
    """The largest tracking error (n,) over the second half, with a tick of delay; ``controller(q, dq, t)`` -> tau."""
    beta = model.beta if beta is None else beta
    plant, friction = model.bind("forward_dynamics", beta), model.bind("smooth_friction")
    friction.inputs["friction"][:], friction.inputs["width"][:] = FRICTION, WIDTH
    q, dq, _ = desired(0.0)
    tau, errors = np.zeros(3), []
    for k in range(round(seconds / Ts)):
        t = k * Ts
        wanted = controller(q, dq, t, tau)
        for _ in range(4):
            outside = np.zeros(3) if external is None else external(q, t)
            ddq = plant(q, dq, tau - friction(dq) + outside)
            dq = dq + Ts / 4 * ddq
            q = q + Ts / 4 * dq
        tau = wanted
        errors.append(np.abs(q - desired(t + Ts)[0]))
    return np.max(errors[len(errors) // 2 :], axis=0)


def tick(model, law, q, dq, t, z, w=20.0, scale=1.0, **changes):
    kp, kd = scale * w * w * np.ones(3), scale * 2 * w * np.ones(3)
    options = {"friction": FRICTION, "width": WIDTH, "tau_max": np.full(3, 400.0), "Ts": Ts} | changes
    return getattr(model, law)(q, dq, *desired(t), kp, kd, np.zeros(3), z, **options)


def test_computed_torque_and_feedforward_beat_pd_with_gravity_and_friction(model):
    light = 0.5 * np.diag(model.mass_matrix(np.array([0.0, 0.0, 1.5])))  # diagonal gains that a tick of delay allows

    def error(law, scale=1.0):
        return simulate(model, lambda q, dq, t, tau: tick(model, law, q, dq, t, np.zeros(3), scale=scale).tau)

    pd = error("pd_gravity", light)
    assert np.max(pd) < 0.2
    assert np.max(error("computed_torque")) < np.max(pd) / 3
    assert np.max(error("feedforward", light)) < np.max(pd) / 3


def test_the_observer_reports_an_external_torque(model):
    push = np.array([4.0, -6.0, 2.0])
    state, seen = {}, []

    def controller(q, dq, t, tau):
        options = {"friction": FRICTION, "width": WIDTH}
        if not state:
            state["last"] = (*model.momentum_observer_start(q, dq, **options), np.zeros(3))
        p, u, r = state["last"]
        step = model.momentum_observer(
            q, dq, state.get("tau", np.zeros(3)), p_last=p, u_last=u, r_last=r, gain=50.0, Ts=Ts, **options
        )
        state["last"], state["tau"] = (step.p, step.u, step.r), tau
        seen.append(step.r)
        return tick(model, "computed_torque", q, dq, t, np.zeros(3)).tau

    simulate(model, controller, 0.8, external=lambda q, t: push if t > 0.5 else 0 * push)
    quiet, pushed = np.abs(seen[100:500]).max(), seen[-1]
    assert quiet < 0.5
    np.testing.assert_allclose(pushed, push, atol=0.5)
    half = next(k for k, r in enumerate(seen[500:]) if np.all(np.abs(r - push) < 0.5 * np.abs(push)))
    assert half <= 25  # ms: a lag with the pole 50/s takes 14


def test_adaptation_learns_a_payload(model):
    loaded = model.add_payload(3.0, (0.0, 0.0, 0.05))
    lam, k = np.full(3, 15.0), np.full(3, 40.0)

    def loop(gamma):
        beta = {"now": np.array(model.beta)}

        def controller(q, dq, t, tau):
            step = model.slotine_li(
                q, dq, *desired(t), lam, k, beta["now"], friction=FRICTION, width=WIDTH, tau_max=np.full(3, 400.0),
                gamma=np.full(15, gamma), beta_min=np.full(15, -50.0), beta_max=np.full(15, 50.0), Ts=Ts,
            )  # fmt: skip
            beta["now"] = step.beta_next
            return step.tau

        return simulate(model, controller, 3.0, loaded).max()

    assert loop(5.0) < 0.5 * loop(0.0)
