"""Accuracy of the momentum observer with an exact model and exact states, beside its first-order form.

    python tests/lab/contact/observer.py panda

Torques are held over each period, as a controller does; nothing touches the arm, so that all of r is error. The
first-order form is r = K (p - sum of Ts (tau + u + r)), with the integral by Euler's rule.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rrrgen
from lab.contact.simulation import FRICTION, WIDTH, Arms, Ts

ROBOTS = {
    "rrr": (FRICTION, [0, 0.5, 0.8]),
    "panda": ((0.5, 0.5, 0.0) * 7, [0, -0.5, 0, -1.8, 0, 1.5, 0.7]),
}


def motion(model, friction, q0, count=20, seconds=0.5, seed=0):
    """States (N, count, n) of ``count`` arms at the ticks, and the torques (N, count, n) held from each to the next."""
    arms = Arms(model, count, friction, seed=seed, q0=q0)
    options = {"friction": arms.friction, "width": WIDTH}
    q, dq, _ = arms.desired(0.0)
    rows = []

    def rates(q, dq, tau):
        return dq, model.forward_dynamics(q, dq, tau - model.smooth_friction(dq, **options))

    for k in range(round(seconds / Ts)):
        wanted = arms.desired(k * Ts)
        ddq = wanted[2] + arms.pole**2 * (wanted[0] - q) + 2 * arms.pole * (wanted[1] - dq)
        tau = model.inverse_dynamics(q, dq, ddq) + model.smooth_friction(wanted[1], **options)
        rows.append((q, dq, tau))
        h = Ts / 2
        for _ in range(2):  # Runge-Kutta of fourth order
            v1, a1 = rates(q, dq, tau)
            v2, a2 = rates(q + h / 2 * v1, dq + h / 2 * a1, tau)
            v3, a3 = rates(q + h / 2 * v2, dq + h / 2 * a2, tau)
            v4, a4 = rates(q + h * v3, dq + h * a3, tau)
            q = q + h / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
            dq = dq + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return tuple(np.array(part) for part in zip(*rows, strict=True))


def estimates(model, friction, q, dq, tau, gain):
    """The estimates (N, count, n) of the emitted observer."""
    options = {"friction": np.array(friction), "width": WIDTH}
    p, u = model.momentum_observer_start(q[0], dq[0], **options)
    r, found = np.zeros_like(p), []
    for k in range(1, len(q)):
        step = model.momentum_observer(
            q[k], dq[k], tau[k - 1], p_last=p, u_last=u, r_last=r, gain=gain, Ts=Ts, **options
        )
        p, u, r = step.p, step.u, step.r
        found.append(r)
    return np.array(found)


def first_order(model, friction, q, dq, tau, gain):
    """The estimates (N, count, n) of the first-order form."""
    states = model.momentum_observer_start(q, dq, friction=np.array(friction), width=WIDTH)
    total, r, found = np.zeros_like(q[0]), np.zeros_like(q[0]), []
    for k in range(1, len(q)):
        total = total + Ts * (tau[k - 1] + states.u[k - 1] + r)
        r = gain * (states.p[k] - states.p[0] - total)
        found.append(r)
    return np.array(found)


def main() -> None:
    """Print root mean squares and largest errors for several poles."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=sorted(ROBOTS))
    chosen = parser.parse_args()
    model, (friction, q0) = rrrgen.compile(chosen.robot), ROBOTS[chosen.robot]
    recorded = motion(model, friction, q0)
    for gain in (20.0, 50.0, 200.0, 500.0, 2500.0):
        told = []
        for form in (estimates, first_order):
            with np.errstate(all="ignore"):
                r = form(model, friction, *recorded, gain)
            told.append(f"rms {np.sqrt(np.mean(r**2)):.2g}, largest {np.max(np.abs(r)):.2g} N m")
        print(f"K T = {gain * Ts:g}: {told[0]}; first-order form: {told[1]}")


if __name__ == "__main__":
    main()
