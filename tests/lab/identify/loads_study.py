"""Payloads and drive gains of two arms with known truth, from recordings that share nothing with the package.

    python tests/lab/identify/loads_study.py --seeds 3

A 6R arm with gravity and a SCARA with a prismatic joint follow a motion of 30 s under PD control in Pinocchio, with
Dahl friction, encoders of 2e-6 at the joint and torque noise of 2 % of the RMS torque. Prints for every value the root
mean square of its error and of its error in standard deviations. Exits with 1 if a determined value is off by more than
five of its deviations and by more than 1 % of its size (1 mm, 1 % of mass times size squared), or a gain by 2 %.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rrrgen
from oracles.newton_euler import Link
from rrrgen.base.errors import DerivationError
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.drive_gains import identify_gains
from rrrgen.lab.identify.payload import NAMES, identify_payload
from rrrgen.lab.identify.rows import standard_of
from rrrgen.robot.file import loads_spec
from samples.recorded_arm import SCARA, SIX, Arm, link, reference, simulate, write

NOISE, SECONDS = 0.02, 30.0
FAR, SHARE, GAIN = 5.0, 0.01, 0.02
HELD = (0.03, -0.02, 0.12)


@dataclass(frozen=True)
class Case:
    """An arm, its payload, and what differs from the file: friction, joints that stand, encoder, stated payload."""

    arm: Arm
    payload: Link
    friction: float = 1.0
    still: tuple[int, ...] = ()
    resolution: float = 2e-6
    grows: float = 1.0
    stated: float = 1.0


PAYLOADS = {
    "6R, 2 kg": Case(SIX, link(2.0, HELD, 0.08)),
    "6R, 2 kg, encoders of 1e-4": Case(SIX, link(2.0, HELD, 0.08), resolution=1e-4),
    "6R, 10 kg": Case(SIX, link(10.0, (0.02, 0.05, 0.15), 0.12)),
    "6R, 0.1 kg": Case(SIX, link(0.1, (0.0, 0.01, 0.05), 0.03)),
    "6R, 2 kg far from the flange": Case(SIX, link(2.0, (0.25, 0.1, 0.3), 0.08)),
    "6R, friction in the file 40 % too low": Case(SIX, link(2.0, HELD, 0.08), friction=0.6),
    "6R, Stribeck friction": Case(replace(SIX, excess=0.4 * SIX.coulomb), link(2.0, HELD, 0.08)),
    "6R, joint 6 stands": Case(SIX, link(2.0, HELD, 0.08), still=(5,)),
    "6R, wrist stands": Case(SIX, link(2.0, HELD, 0.08), still=(3, 4, 5)),
    "SCARA, 1.5 kg": Case(SCARA, link(1.5, (0.04, -0.02, 0.06), 0.05)),
    "SCARA, joint 4 stands": Case(SCARA, link(1.5, (0.04, -0.02, 0.06), 0.05), still=(3,)),
}
HEAVY, AXIAL = link(5.0, (0.05, -0.02, 0.12), 0.1), link(3.0, (0.0, 0.0, 0.06), 1e-4)
GAINS = {
    "6R, 5 kg": Case(SIX, HEAVY),
    "6R, 1 kg": Case(SIX, link(1.0, (0.05, -0.02, 0.12), 0.1)),
    "6R, friction grows 30 % with the payload": Case(SIX, HEAVY, grows=1.3),
    "6R, joint 6 stands": Case(SIX, HEAVY, still=(5,)),
    "6R, mass stated 5 % too high": Case(SIX, HEAVY, stated=1.05),
    "SCARA, 3 kg": Case(SCARA, link(3.0, (0.08, -0.02, 0.06), 0.08)),
    "SCARA, payload on the last axis": Case(SCARA, AXIAL),
}
TRUE_GAINS = np.array([0.8, 1.2, -0.8, 1.2, 1.25, 0.83])
"""True over recorded torque; that of joint 3 also has the wrong sign."""


def values(body: Link) -> np.ndarray:
    """Mass, centre of mass and tensor (xx, yy, zz, xy, xz, yz) of a body (10,)."""
    return np.array([body.mass, *body.com, *body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])


def payload_case(name: str, case: Case, seeds: int, folder: Path) -> bool:
    """Print the errors of a payload; whether they are too large."""
    model = rrrgen.compile(loads_spec(case.arm.yaml(friction=case.friction)))
    motion = reference(case.arm, 1, SECONDS, case.still)
    q, tau = simulate(case.arm.carrying(case.payload), *motion, case.resolution)
    noise, ones = NOISE * np.sqrt(np.mean(tau**2, axis=0)), np.ones(case.arm.robot.n)
    truth, errors, spreads = values(case.payload), [], []
    for seed in range(seeds):
        log = write(folder, "log", case.arm, q, tau, noise, ones, seed)
        found = identify_payload(model, [LogStream(open_log(log))], Processing())
        errors.append(found.values - truth)
        spreads.append(found.std)
    error, spread = np.sqrt(np.mean(np.square(errors), axis=0)), np.mean(spreads, axis=0)
    size = max(float(np.linalg.norm(case.payload.com)), 0.1)
    tolerance = SHARE * np.array([truth[0], *[max(0.1, size)] * 3, *[truth[0] * size**2] * 6])
    known = np.array([value not in found.undetermined for value in NAMES])
    off = known & (error > FAR * spread) & (error > tolerance)
    print(f"payload, {name}: torque error {found.error_without:.1%} without it, {found.error_with:.2%} with it")
    for k, value in enumerate(NAMES):
        end = "  OFF" if off[k] else "" if known[k] else "  marked as not determined"
        print(f"  {value:5} {truth[k]:9.3g}, error {error[k]:8.1e}, {error[k] / spread[k]:5.2f} deviations{end}")
    return bool(np.any(off))


def gains_case(name: str, case: Case, seeds: int, folder: Path) -> bool:
    """Print the errors of drive gains; whether they are too large for a payload that is rightly stated."""
    arm, n = case.arm, case.arm.robot.n
    model = rrrgen.compile(loads_spec(arm.yaml(links=0.7)))
    motion, gains = reference(arm, 1, SECONDS, case.still), TRUE_GAINS[:n]
    carrying = replace(arm.carrying(case.payload), viscous=case.grows * arm.viscous, coulomb=case.grows * arm.coulomb)
    both = [simulate(each, *motion) for each in (arm, carrying)]
    noise, body = NOISE * np.sqrt(np.mean(both[0][1] ** 2, axis=0)), values(case.payload)
    phi, errors, spreads = case.stated * standard_of(body[0], body[1:4], body[4:]), [], []
    for seed in range(seeds):
        logs = [write(folder, f"log{k}", arm, *both[k], noise, gains, 2 * seed + k) for k in (0, 1)]
        empty, loaded = ([LogStream(open_log(log))] for log in logs)
        found = identify_gains(model, empty, loaded, phi, Processing())
        errors.append(found.gain / gains - 1.0)
        spreads.append(np.abs(found.std / gains))
    error, spread = np.sqrt(np.mean(np.square(errors), axis=0)), np.mean(spreads, axis=0)
    off = found.determined & (error > GAIN) & (error > FAR * spread) & (case.stated == 1.0)
    print(f"gains, {name}: torque error {found.fallen_from:.1%} with gains of 1, {found.relative_error:.2%} with these")
    for j in range(n):
        end = "  OFF" if off[j] else "" if found.determined[j] else "  marked as not determined"
        print(f"  {gains[j]:5.2f}, error {error[j]:8.2%}, {error[j] / spread[j]:5.2f} deviations{end}")
    return bool(np.any(off))


def main() -> int:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3, help="recordings per case, with other noise")
    parser.add_argument("--case", action="append", help="case to run, by its name; repeat for several")
    chosen, missed = parser.parse_args(), 0
    with tempfile.TemporaryDirectory() as folder:
        for cases, judge in ((PAYLOADS, payload_case), (GAINS, gains_case)):
            for name, case in cases.items():
                if chosen.case and name not in chosen.case:
                    continue
                try:
                    missed += judge(name, case, chosen.seeds, Path(folder))
                except DerivationError as error:
                    print(f"{name}: refused, {error}")
                    missed += 1
                sys.stdout.flush()
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
