"""Friction of one joint estimated from simulated recordings with known truth: laws, encoders, noise, delay, seeds.

    python tests/lab/friction/study.py --seeds 3 --jobs 2

Prints for every case the law chosen, the largest error of each parameter over the seeds beside its limit, and how many
reported standard deviations the errors amount to. The simulation is that of the tests and shares nothing with the
package. Exits with 1 if a law or a limit is missed.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.estimation import estimate_friction
from rrrgen.lab.friction.joint_recording import joint_data
from samples.stick_slip_joint import COARSE, Joint, record

LIMITS = {"inertia": 0.01, "coulomb": 0.02, "viscous": 0.05, "stiction_excess": 0.1, "stribeck_speed": 0.1}
LIMITS |= {"coulomb_p": 0.02, "coulomb_n": 0.02, "viscous_p": 0.05, "viscous_n": 0.05, "gravity": 0.01}
ATTRIBUTES = {"stiction_excess": "excess", "stribeck_speed": "speed", "coulomb_p": "coulomb", "viscous_p": "viscous"}

STRIBECK = Joint("stribeck")
LIGHT = Joint("stribeck", inertia=0.004, gravity=0.05, coulomb=0.04, excess=0.02, viscous=0.008)
CASES: dict[str, tuple[Joint, dict[str, object]]] = {
    "stribeck": (STRIBECK, {}),
    "stribeck, torque noise": (STRIBECK, {"torque_noise": 0.02}),
    "stribeck, centred torque": (STRIBECK, {"centred": True, "torque_noise": 0.01}),
    "stribeck, delay of 2 samples": (STRIBECK, {"delay": 2}),
    "stribeck, coarse encoder": (STRIBECK, {"resolution": COARSE}),
    "stribeck, no gravity": (Joint("stribeck", gravity=0.0), {}),
    "stribeck, small excess": (Joint("stribeck", excess=0.1, speed=0.15), {}),
    "stribeck, heavy": (Joint("stribeck", inertia=0.8, gravity=12.0, coulomb=4.0, excess=2.0, viscous=1.5), {}),
    "coulomb_viscous": (Joint("coulomb_viscous", angle=0.7), {"torque_noise": 0.01}),
    "asymmetric": (Joint("asymmetric", coulomb_n=0.45, viscous_n=0.2), {}),
    "neural": (Joint("tanh"), {}),
    "lugre": (Joint("lugre"), {}),
    "lugre, stiff": (Joint("lugre", sigma0=1e5, sigma1=60.0), {"finer": 5}),
    "stribeck, 500 Hz": (STRIBECK, {"period": 2e-3}),
    "stribeck, 4 kHz": (STRIBECK, {"period": 2.5e-4, "substeps": 4}),
    "stribeck, gravity at an angle": (Joint("stribeck", angle=1.1), {"torque_noise": 0.01}),
    "stribeck, torque with an offset": (STRIBECK, {"offset": 0.05}),
    "stribeck, prismatic": (Joint("stribeck", gravity=0.0), {"offset": 0.3, "coefficients": 1}),
    "coulomb_viscous, prismatic": (Joint("coulomb_viscous", gravity=0.0), {"offset": 0.3, "coefficients": 1}),
    "asymmetric, 2 kHz, coarse": (
        Joint("asymmetric", coulomb_n=0.5, viscous_n=0.15),
        {"period": 5e-4, "resolution": COARSE},
    ),
    "stribeck, fast motion alone": (STRIBECK, {"motion": "fast"}),
    "stribeck, plain sines": (STRIBECK, {"motion": "sines"}),
    "asymmetric, plain sines": (Joint("asymmetric", coulomb_n=0.5, viscous_n=0.15), {"motion": "sines"}),
    "stribeck, six decimals": (STRIBECK, {"decimals": 6}),
    "stribeck, no gravity, offset": (Joint("stribeck", gravity=0.0), {"offset": 0.05}),
    "coulomb_viscous, no gravity, offset": (Joint("coulomb_viscous", gravity=0.0), {"offset": 0.05}),
    "stribeck, 5 kHz, light": (LIGHT, {"period": 2e-4, "substeps": 3}),
    "lugre, 500 Hz": (Joint("lugre"), {"period": 2e-3, "substeps": 20}),
    "neural, 500 Hz, no gravity": (Joint("tanh", gravity=0.0), {"period": 2e-3, "substeps": 20}),
    "lugre, soft, no gravity": (Joint("lugre", sigma0=5e3, sigma1=10.0, gravity=0.0), {}),
}


def plain_sines(duration: float, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference t, q, dq of a fast sum of two sines, then of one slow sine: as one moves a joint without a design."""
    t = np.arange(round(duration / period)) * period
    half = duration / 2.0
    fast = 0.3 * np.sin(2 * np.pi * 0.7 * t) + 0.1 * np.sin(2 * np.pi * 2.3 * t)
    q = np.where(t < half, fast, fast[np.searchsorted(t, half)] + 0.4 * np.sin(2 * np.pi * 0.1 * (t - half)))
    return t, q, np.gradient(q, period)


def fast_multisine(duration: float, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reference t, q, dq of 0.05-4 Hz without slow reversals: the law is told by the reversals alone."""
    t = np.arange(round(duration / period)) * period
    f = np.arange(0.05, 4.0, 0.05)
    phases = np.random.default_rng(7).uniform(0.0, 2 * np.pi, len(f))
    dq = 1.2 * np.sqrt(2.0 / len(f)) * np.cos(2 * np.pi * f * t[:, None] + phases).sum(axis=1) * np.minimum(t, 1.0)
    return t, np.cumsum(dq) * period, dq


MOTIONS = {"sines": plain_sines, "fast": fast_multisine}


def run_case(name: str, seed: int) -> tuple[str, dict[str, float], dict[str, float]]:
    """The law chosen, relative errors and errors in standard deviations of the true law's parameters."""
    truth, options = CASES[name]
    offset = options.get("offset", 0.0)
    coefficients = options.get("coefficients", 0 if truth.gravity == 0.0 else 2)
    recorded = {key: value for key, value in options.items() if key not in ("offset", "coefficients", "decimals")}
    if "motion" in options:
        recorded["motion"] = MOTIONS[str(options["motion"])](40.0, float(options.get("period", 1e-3)))
    found = record(truth, seed=seed, **recorded)
    q = np.round(found["q"], options.get("decimals", 12))
    data = joint_data(Log(("q",), found["t"], q[:, None], found["tau"][:, None] + offset), "q")
    estimate = estimate_friction(data, coefficients, seed=seed)
    law = {"tanh": "neural"}.get(truth.law, truth.law)
    model = next(each for each in estimate.laws if each.name == law)
    relative, deviations = {}, {}
    for parameter, value in model.values.items():
        actual = getattr(truth, ATTRIBUTES.get(parameter, parameter), None)
        taken_up = parameter == "gravity" and offset  # the joint's equation has no offset: gravity takes it up
        if actual and parameter != "delay" and not taken_up:
            relative[parameter] = abs(value / actual - 1.0)
            deviations[parameter] = abs(value - actual) / model.std[parameter]
    return estimate.chosen.name, relative, deviations


def main() -> int:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="recordings per case")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--case", action="append", choices=list(CASES), help="case to run; repeat for several")
    chosen = parser.parse_args()
    names, missed = chosen.case or list(CASES), 0
    with ProcessPoolExecutor(chosen.jobs) as pool:
        runs = {name: [pool.submit(run_case, name, seed) for seed in range(chosen.seeds)] for name in names}
        for name, futures in runs.items():
            results = [each.result() for each in futures]
            law = {"tanh": "neural"}.get(CASES[name][0].law, CASES[name][0].law)
            right = sum(each[0] == law for each in results)
            print(f"{name}: {right} of {len(results)} times {law}; chosen: {', '.join(each[0] for each in results)}")
            missed += len(results) - right
            for parameter in results[0][1]:
                error = max(each[1][parameter] for each in results)
                deviations = np.sqrt(np.mean([each[2][parameter] ** 2 for each in results]))
                limit = LIMITS.get(parameter)
                missed += limit is not None and error > limit
                told = "" if limit is None else f"  limit {100 * limit:g} %{'  MISSED' if error > limit else ''}"
                print(f"  {parameter:<16} {100 * error:7.3f} %  {deviations:5.1f} deviations{told}", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
