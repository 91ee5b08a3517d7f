"""How often contact detection alarms without a contact, and how fast it sees 10 N, on many simulated arms.

    python tests/lab/contact/study.py panda [--gain 50] [--errors 3]

For each of several draws of the errors of the model, 200 s of motion give the thresholds, 780 s tell the false alarms
and 100 contacts the delays. Takes a minute.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rrrgen
from lab.contact.simulation import FRICTION, Arms, Ts, forces, ratios, visibility
from rrrgen.lab.contact import contact_thresholds, expected_detection, step_responses

ROBOTS = {
    "rrr": (FRICTION, [0, 0.5, 0.8]),
    "panda": ((0.5, 0.5, 0.0) * 7, [0, -0.5, 0, -1.8, 0, 1.5, 0.7]),
}


def delays(over):
    """First tick (count,) at which each of the signals ``over`` (N, count) is set; infinite where none is."""
    return np.where(over.any(axis=0), over.argmax(axis=0), np.inf)


def whitened(free, r):
    """One number for all joints, (N, count, 1): ``free`` and ``r`` weighted with the inverse covariance of ``free``."""
    joints = free.reshape(-1, free.shape[2])
    L = np.linalg.cholesky(joints.T @ joints / len(joints))
    return [np.linalg.norm(np.linalg.solve(L, each[..., None])[..., 0], axis=2)[..., None] for each in (free, r)]


def told(name, found):
    """Print median, 90 % quantile and largest of the delays ``found``, in ms."""
    quantiles = np.quantile(found, (0.5, 0.9, 1), method="higher")
    print(f"{name}: median {quantiles[0]:g}, 90 % {quantiles[1]:g}, largest {quantiles[2]:g} ms;", end=" ")
    print(f"later than 15 ms: {np.count_nonzero(found > 15)} of {len(found)}")


def main() -> None:
    """Train, leave alone, touch; print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=sorted(ROBOTS))
    parser.add_argument("--gain", type=float, default=50.0)
    parser.add_argument("--errors", type=int, default=3, help="draws of the errors of the model")
    chosen = parser.parse_args()
    model, (friction, q0) = rrrgen.compile(chosen.robot), ROBOTS[chosen.robot]
    F, gain = forces(100), chosen.gain
    both, alone, weighted, shares = [], [], [], []
    for errors in range(chosen.errors):
        arms = [Arms(model, 100, friction, seed=seed, gain=gain, q0=q0, errors=errors) for seed in (1, 2, 4)]
        free = arms[0].run(3.0)[1000:]
        found = contact_thresholds(list(free.transpose(1, 0, 2)), Ts, gain, 4 * 780.0)
        print("thresholds", np.round(found.levels, 3), "of changes", np.round(found.change_levels, 3))
        over = ratios(arms[1].run(8.8)[1000:], found, gain) > 1.0
        alarms = np.count_nonzero(np.diff(over.astype(int), axis=0) > 0)
        print(f"{alarms} alarms in {over.size * Ts:g} s without contact")
        r = arms[2].run(1.7, F, 1.5)[1000:]
        both.append(delays(ratios(r, found, gain)[500:] > 1.0))
        alone.append(delays((np.abs(r[500:]) > found.levels).any(axis=2)))
        free, z = whitened(free, r[500:])
        level = contact_thresholds(list(free.transpose(1, 0, 2)), Ts, gain, 4 * 780.0).levels[0]
        weighted.append(delays(z[..., 0] > level))
        poses, responses = (
            model.jacobian(arms[2].desired(1.5)[0]),
            step_responses([arms[2].matrices] * model.n, gain, 0.3),
        )
        shares.append(visibility(poses, F, found, responses, gain=gain))
        print("expected:", expected_detection(found, poses, responses, Ts, gain, 10.0).sentence())
    seen, share = np.concatenate(both), np.concatenate(shares)
    told("delays of 10 N", seen)
    told("by the residuals without their changes, same thresholds", np.concatenate(alone))
    told("by one threshold for the residuals, weighted with their inverse covariance", np.concatenate(weighted))
    late = np.sort(share[seen > 15]).round(2)
    print("largest signal of 15 ms without noise, over its threshold, of the late ones:", late)
    told(f"delays of the {np.count_nonzero(share > 1.25)} where that is above 1.25", seen[share > 1.25])


if __name__ == "__main__":
    main()
