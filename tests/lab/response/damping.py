"""Frequencies and dampings of resonances from simulated recordings of joints with known truth, over many draws.

    python tests/lab/response/damping.py --seeds 8 --jobs 2

Every case has three modes, another draw of their frequencies and dampings for every seed, and another excitation and
noise. Prints for every case how many modes are found, and how often frequency (limit .5 %) and damping (10 %) are
within their limits, with the errors in standard deviations. Exits with 1 if fewer than 95 % are.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rrrgen.lab.response.estimation import estimate_one
from rrrgen.lab.response.modal_fit import fit_modes
from samples.flexible_joint import flexible_joint, multisine, record

FREQUENCY, DAMPING, SHARE = 5e-3, 0.1, 0.95
CASES = {
    "multisine": {"excitation": "multisine", "disturbance": 0.3, "seconds": 20},
    "multisine, more noise": {"excitation": "multisine", "disturbance": 1.0, "seconds": 20},
    "noise": {"excitation": "noise", "disturbance": 0.3, "seconds": 20},
    "noise, weak excitation": {"excitation": "noise", "disturbance": 0.3, "seconds": 20, "rms": 2.0},
    "multisine, weak excitation": {"excitation": "multisine", "disturbance": 0.3, "seconds": 20, "rms": 2.0},
    "noise, weak modes": {"excitation": "noise", "disturbance": 0.3, "seconds": 20, "residue": 0.25},
    "noise, coarse encoder, long": {"excitation": "noise", "disturbance": 0.3, "seconds": 60, "resolution": 1e-4},
}


def run_case(name: str, seed: int) -> list[tuple[float, float, float, float]]:
    """Relative errors of frequency and damping, and these in deviations, per mode; infinite where it is not found."""
    case, rng = CASES[name], np.random.default_rng(1000 + seed)
    modes = tuple(
        (
            base * rng.uniform(0.9, 1.1),
            rng.uniform(0.008, 0.03),
            rng.uniform(0.25, 0.6) * float(case.get("residue", 1.0)),
        )
        for base in (28.0, 75.0, 125.0)
    )
    samples = 1000 * int(case["seconds"])
    rms = float(case.get("rms", 7.0))
    n = multisine(rng, samples, rms) if case["excitation"] == "multisine" else rms * rng.standard_normal(samples)
    joint, resolution = flexible_joint(modes), float(case.get("resolution", 1e-5))
    recording = record(rng, n, joint, disturbance=float(case["disturbance"]), resolution=resolution)
    found = fit_modes(estimate_one(recording)).resonances
    errors = []
    for frequency, damping, _ in modes:
        near = min(found, key=lambda each: abs(each.frequency - frequency), default=None)
        if near is None or abs(near.frequency / frequency - 1.0) > 0.05:
            errors.append((np.inf, np.inf, np.inf, np.inf))
            continue
        f, d = near.frequency - frequency, near.damping - damping
        errors.append((abs(f) / frequency, abs(d) / damping, abs(f) / near.frequency_std, abs(d) / near.damping_std))
    return errors


def main() -> int:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=8, help="recordings per case")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--case", action="append", choices=list(CASES), help="case to run; repeat for several")
    chosen, missed = parser.parse_args(), 0
    with ProcessPoolExecutor(chosen.jobs) as pool:
        for name in chosen.case or list(CASES):
            errors = np.array(list(pool.map(run_case, [name] * chosen.seeds, range(chosen.seeds))))
            f, d = errors[..., 0] <= FREQUENCY, errors[..., 1] <= DAMPING
            missed += min(f.mean(), d.mean()) < SHARE
            rms = np.sqrt(np.mean(np.where(np.isfinite(errors), errors, np.nan) ** 2, axis=(0, 1)))
            print(
                f"{name}: {np.isfinite(errors[..., 0]).sum()} of {f.size} modes found; frequency within limits "
                f"{f.sum()}, damping {d.sum()} (worst {100 * errors[..., 1].max():.1f} %); rms errors in deviations "
                f"{rms[2]:.2f}, {rms[3]:.2f}; recordings with all dampings within: {d.all(axis=1).sum()} of {len(d)}",
                flush=True,
            )
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
