"""Do the standard deviations of the closed-loop estimate hold? Many recordings that differ in their noise alone.

    python tests/lab/closed_loop/coverage.py --seeds 20

Prints for every friction law and length the share of the 95 % intervals that hold the true value, and for every
parameter its errors in standard deviations. Exits with 1 if a share leaves 85 to 99 %.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from rrrgen.lab.closed_loop.refinement import closed_loop_estimate
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.identify.identification import Options, identify
from samples.disturbed_arm import FRICTION, DisturbedArm

BOUNDS = (0.85, 0.99)


def deviations(arm: DisturbedArm, seeds: Iterable[int], seconds: float) -> tuple[list[str], np.ndarray]:
    """Names of the estimated parameters, and their errors in standard deviations, (seeds, parameters)."""
    errors, names = [], []
    options = Options(consistent=False, poses=1)
    for seed in seeds:
        log = arm.record(seed, seconds)
        found = identify(arm.model, [log], Processing("differences", decimate=10), options)
        loop = closed_loop_estimate(found, [log], arm.controller, options).identification
        assert loop.parametrisation is not None
        truth = loop.parametrisation.contract(arm.theta[: len(loop.columns)])
        own = ((loop.estimate.x - truth) / loop.estimate.std).tolist()
        names = list(loop.estimate.names)
        for surface, std in (
            () if loop.friction is None else zip(loop.friction.surfaces, loop.friction.std, strict=True)
        ):
            for name, value, spread in zip(surface.definition.shapes, surface.shapes, std, strict=True):
                own.append(np.log(value / arm.theta[arm.names.index(f"{name}{surface.owner}")]) / spread)
                names.append(f"{name}{surface.owner}")
        errors.append(own)
    return names, np.array(errors)


def covered(errors: np.ndarray) -> float:
    """Share of the errors within 1.96 standard deviations."""
    return float(np.mean(np.abs(errors) < 1.96))


def main() -> int:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="recordings per case")
    chosen, missed = parser.parse_args(), 0
    for law in FRICTION:
        arm = DisturbedArm(law)
        for seconds in (4.0, 10.0):
            names, errors = deviations(arm, range(chosen.seeds), seconds)
            share = covered(errors)
            missed += not BOUNDS[0] <= share <= BOUNDS[1]
            rms = np.sqrt(np.mean(errors**2, axis=0))
            told = ", ".join(f"{name} {value:.2f}" for name, value in zip(names, rms, strict=True))
            print(f"{law}, {seconds:g} s: 95 % intervals hold {100 * share:.1f} %; rms errors in deviations: {told}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
