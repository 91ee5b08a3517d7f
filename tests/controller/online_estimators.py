"""How fast the online estimators of the RRR converge, and whether they burst after a rest: the figures of Fig. 14.12.

    python tests/controller/online_estimators.py

13 parameters from zero, motion by the Kalman filter from encoders of 1e-5 rad, torque noise .2/.1/.05 N m. Least
squares: 6 s of motion, 10 s of rest under friction that the model lacks, the motion again; the limits are a torque
error of 1 % within 5 s, no more than 2 % after the rest, .2 % at the end. Gradient at a tenth of its bound: 40 s of
motion, 1 % within 25 s. Several draws of the torque noise. Exits with 1 if a limit is missed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from controller.test_online_estimators import (
    FIXED,
    PERIOD,
    SIGMA,
    compiled,
    kalman_motion,
    motion,
    relative_torque_error,
    rows,
)
from rrrgen.emit.controller.online_estimators import EstimatorSettings, gain_bound, regression
from rrrgen.runtime.online_estimators import online_estimator

EVERY = 50  # samples between two evaluations of the torque error


def recording(seconds: float, rest: tuple[float, float], seed: int) -> tuple[np.ndarray, ...]:
    """Filtered q, dq, ddq and noisy torques at 1 kHz; the arm rests from ``rest[0]`` to ``rest[1]`` seconds."""
    model, t = compiled("rrr"), PERIOD * np.arange(round(seconds / PERIOD))
    moving = (t < rest[0]) | (t >= rest[1])
    reference = motion(3, np.where(t < rest[0], t, np.where(moving, t - rest[1] + rest[0], rest[0])))
    reference = (reference[0], *(part * moving[:, None] for part in reference[1:]))
    tau = model.inverse_dynamics(*reference) + np.random.default_rng(seed).normal(size=(len(t), 3)) * SIGMA
    tau[~moving] += [1.5, 0.8, 0.4]
    jerk = np.abs(np.diff(reference[2][:5000], axis=0)).max(axis=0) / PERIOD
    return (*kalman_motion(np.round(reference[0] / 1e-5) * 1e-5, reference, jerk), tau)


def history(kind: str, settings: EstimatorSettings, samples: tuple[np.ndarray, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Instants, and the relative torque errors of the estimates at them."""
    model, errors = compiled("rrr"), []
    estimator = online_estimator(model, kind, settings, FIXED)
    for k in range(0, len(samples[0]), EVERY):
        estimator.update(*(part[k : k + EVERY] for part in samples))
        errors.append(relative_torque_error(model, estimator))
    return PERIOD * EVERY * (1 + np.arange(len(errors))), np.array(errors)


def below(t: np.ndarray, errors: np.ndarray, limit: float) -> float:
    """The instant from which the error stays below ``limit``; infinite if it never does."""
    above = np.flatnonzero(errors > limit)
    return float(t[0]) if not len(above) else (float(t[above[-1] + 1]) if above[-1] + 1 < len(t) else float("inf"))


def main() -> int:
    """Run the study and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="draws of the torque noise")
    seeds, missed = parser.parse_args().seeds, 0
    for forgetting in (1.0, 0.999):
        settings = EstimatorSettings((0.0,) * 13, noise=rows(np.diag(SIGMA**2)), forgetting=forgetting)
        for seed in range(seeds):
            t, errors = history("rls", settings, recording(26.0, (6.0, 16.0), seed))
            moved, late, tail = below(t[t <= 6.0], errors[t <= 6.0], 0.01), max(errors[t > 6.0]), max(errors[t > 24.0])
            missed += moved > 5.0 or late > 0.02 or tail > 0.002
            told = f"largest from the rest on {100 * late:.2f} %, in the last 2 s {100 * tail:.3f} %"
            print(f"rls, forgetting {forgetting:g}, noise {seed}: below 1 % after {moved:.2f} s, {told}", flush=True)
    bound = gain_bound(regression(compiled("rrr").derived, FIXED), *motion(3, np.linspace(0.0, 10.0, 1000)))
    for seed in range(seeds):
        samples = recording(40.0, (40.0, 40.0), seed)
        t, errors = history("gradient", EstimatorSettings((0.0,) * 13, gain=0.1 * bound), samples)
        missed += not below(t, errors, 0.01) <= 25.0
        told = ", ".join(f"{100 * limit:g} % after {below(t, errors, limit):.1f} s" for limit in (0.05, 0.01))
        print(f"gradient, noise {seed}: below {told}; in the last 2 s {100 * max(errors[t > 38.0]):.2f} %", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
