"""Whether the covariances of the estimators are honest: squared errors over what the covariance predicts, 1 if it is.

    python tests/lab/contact/consistency.py rrr

The Kalman filter is judged on the motion it assumes and in the loop of many simulated arms (:mod:`contact.simulation`);
force and wrench of a contact with the covariance that 100 s of other motions without contact give, for several draws of
the errors of the model. Takes a minute.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rrrgen
from lab.contact.simulation import RESOLUTION, Arms, Ts, forces
from lab.contact.study import ROBOTS
from rrrgen.lab.contact import first_order_lag, residual_covariance
from rrrgen.lab.data.kalman import kalman_matrices, kalman_step

QUANTILES = {1: 3.841, 2: 5.991, 3: 7.815, 6: 12.592}  # 95 % of chi-squared


def normalised(errors, covariance):
    """The squares e' P^-1 e of ``errors`` (..., m) for ``covariance`` (..., m, m)."""
    return np.einsum("...i,...i->...", errors, np.linalg.solve(covariance, errors[..., None])[..., 0])


def told(name, squares, freedom):
    """Print mean square over its expectation, and how many are inside the 95 % region."""
    inside = np.mean(squares < QUANTILES[freedom])
    print(f"{name}: mean {squares.mean() / freedom:.2f}, inside 95 %: {100 * inside:.0f} %")


def as_assumed(matrices, var_eta, var_xi):
    """Innovations and errors of the filter on 200 joints with the white jerk and the white noise that it assumes."""
    rng, x = np.random.default_rng(0), np.zeros((200, 3))
    state, e, errors = np.zeros((200, 3)), [], []
    for k in range(2000):
        y = x[:, 0] + rng.normal(size=200) * var_eta**0.5
        innovation = y - state[:, 0]
        state, seen = kalman_step(matrices.E, matrices.k, state, y, np.zeros((200, 3)))
        if k > 500:
            e.append(innovation)
            errors.append(seen - x)
        x = x @ matrices.E.T + matrices.g * rng.normal(size=(200, 1)) * var_xi**0.5
    return np.array(e), np.array(errors)


def the_filter(matrices, var_eta, var_xi, arms):
    """Print the ratios for the Kalman filter, as it assumes and in the loop of ``arms``."""
    e, errors = as_assumed(matrices, var_eta, var_xi)
    told("Kalman filter as assumed, innovations (NIS)", e**2 / (matrices.innovation * var_eta), 1)
    told("Kalman filter as assumed, states (NEES)", normalised(errors, matrices.updated * var_eta), 3)
    seen, truth = np.array(arms.seen)[1000:], np.array(arms.truth)[1000:]
    innovation = (np.array(arms.readings)[1000:] - seen[..., 0]) / (1 - matrices.k[0])
    told("in the loop, innovations (NIS)", innovation**2 / (matrices.innovation * var_eta), 1)
    told("in the loop, q and dq (NEES)", normalised(seen[..., :2] - truth, matrices.updated[:2, :2] * var_eta), 2)


def the_loads(model, free, r, touched, F):
    """Print the ratios for loads F on ``touched`` arms with residuals ``r``, by the covariance of ``free`` arms."""
    alone, poses = free.residuals[1000:], np.array(free.seen)[1000::10, ..., 0]
    each = [model.jacobian(q) for q in poses.transpose(1, 0, 2)]
    covariance = residual_covariance(np.concatenate(list(alone[::10].transpose(1, 0, 2))), np.concatenate(each))
    print(f"rms of the residuals {np.round(covariance.deviations, 3)}, enlarged by {covariance.enlarged:.2f}")
    seen = np.array(touched.seen)[..., 0]
    J = model.jacobian(seen)
    lagged = first_order_lag(J - J[0], np.exp(-touched.gain * Ts)) + J[0]
    found = model.external_force(J[1600:], r[1600:], np.diag(alone.var(axis=(0, 1))))
    told("force of a contact (NEES), by the deviations of the residuals alone", normalised(found.F - F, found.P), 3)
    for name, place in (("J of this tick", J), ("J low-passed like r", lagged)):
        found = model.external_force(place[1600:], r[1600:], covariance.matrix)
        told(f"force of a contact (NEES), {name}", normalised(found.F - F, found.P), 3)
        print(f"  median error of 10 N: {np.median(np.linalg.norm(found.F - F, axis=-1)):.2g} N")
        if model.n >= 6:
            found = model.external_wrench(place[1600:], r[1600:], covariance.matrix)
            told("  as a wrench (NEES)", normalised(found.F - np.hstack([F, 0 * F]), found.P), 6)


def main() -> None:
    """Print the ratios for the filter and for the force."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=sorted(ROBOTS))
    parser.add_argument("--errors", type=int, default=3, help="draws of the errors of the model")
    chosen = parser.parse_args()
    var_eta, var_xi = RESOLUTION**2 / 12, 300.0**2
    matrices = kalman_matrices(Ts, var_eta, var_xi)
    model, (friction, q0) = rrrgen.compile(chosen.robot), ROBOTS[chosen.robot]
    for errors in range(chosen.errors):
        free, touched = (Arms(model, 50, friction, seed=seed, q0=q0, errors=errors) for seed in (2, 4))
        free.residuals = free.run(3.0)
        if not errors:
            the_filter(matrices, var_eta, var_xi, free)
        F = forces(50)
        the_loads(model, free, touched.run(2.5, F, 1.5), touched, F)


if __name__ == "__main__":
    main()
