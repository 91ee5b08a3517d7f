"""How often contact detection alarms without a contact, and how fast it sees 10 N, on many simulated arms.

    python tests/contact/study.py panda [--gain 50]

200 s of motion give the thresholds, 780 s tell the false alarms, 100 contacts the delays. Takes a minute.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rrrgen
from contact.simulation import FRICTION, Arms, Ts, visibility
from rrrgen.contact.residuals import step_responses
from rrrgen.contact.thresholds import contact_thresholds, expected_detection

ROBOTS = {
    "rrr": (FRICTION, [0, 0.5, 0.8]),
    "panda": ((0.5, 0.5, 0.0) * 7, [0, -0.5, 0, -1.8, 0, 1.5, 0.7]),
}


def main() -> None:
    """Train, leave alone, touch; print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("robot", choices=sorted(ROBOTS))
    parser.add_argument("--gain", type=float, default=50.0)
    chosen = parser.parse_args()
    model, (friction, q0) = rrrgen.compile(chosen.robot), ROBOTS[chosen.robot]
    arms = [Arms(model, 100, friction, seed=seed, gain=chosen.gain, q0=q0) for seed in (1, 2, 4)]
    found = contact_thresholds(list(arms[0].run(3.0)[1000:].transpose(1, 0, 2)), Ts, 4 * 780.0)
    print("thresholds", np.round(found.levels, 3))
    over = (np.abs(arms[1].run(8.8)[1000:]) > found.levels).any(axis=2)
    print(f"{np.count_nonzero(np.diff(over.astype(int), axis=0) > 0)} alarms in {over.size * Ts:g} s without contact")
    F = np.random.default_rng(3).normal(size=(100, 3))
    F *= 10.0 / np.linalg.norm(F, axis=1, keepdims=True)
    over = (np.abs(arms[2].run(1.6, F, 1.5)[1500:]) > found.levels).any(axis=2)
    delays = np.where(over.any(axis=0), over.argmax(axis=0), 1000)
    print("delays of 10 N, ms: median, 90 %, largest", np.quantile(delays, (0.5, 0.9, 1)))
    print(f"later than 15 ms: {np.count_nonzero(delays > 15)} of {len(delays)}")
    poses = model.jacobian(arms[2].desired(1.5)[0])
    responses = step_responses([arms[2].matrices] * model.n, chosen.gain, 0.3)
    share = visibility(poses, F, found.levels, responses[15])
    late = [f"{ratio:.2f}" for ratio in np.sort(share[delays > 15])]
    print(f"after 15 ms, {100 * responses[15, 0]:.0f} % of a torque is seen; over the threshold, where late: {late}")
    print(
        f"delays of the {np.count_nonzero(share > 1.25)} with a ratio above 1.25: at most {delays[share > 1.25].max()}"
    )
    print("expected:", expected_detection(found.levels, poses, responses, Ts, 10.0).sentence())


if __name__ == "__main__":
    main()
