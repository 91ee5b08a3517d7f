"""A linear drive under a cascade, simulated independently of the package: recordings with known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

PERIOD = 1e-3
MASS, OFFSET = 95.0, -3.0
KP, KV, GAIN, LIMIT = 160.0, 240.0, 35.0, 10.0
TRUTH = {
    **{"m1R": MASS, "viscous_p1": 200.0, "viscous_n1": 220.0, "coulomb_p1": 20.0, "coulomb_n1": 24.0},
    **{"excess1": 6.0, "decay_speed1": 0.02},
}

DAHL = {"coulomb1": 20.0, "viscous1": 210.0, "presliding1": 2e-5}

ROBOT = """
schema: rrrgen/1
name: slider
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: slide, type: prismatic, alpha: 90, a: 0, d: 0, theta: 0, friction: {viscous: 0, coulomb: 0}}
"""
CONTROLLER = f"""
schema: rrrgen-controller/1
rate: 1 kHz
joints:
  - name: slide
    signals:
      averaged: {{average: position, over: 2}}
      speed: {{difference: averaged}}
      wanted: {{sum: {{reference: {KP}, position: -{KP}}}}}
      volts: {{sum: {{wanted: {KV}, speed: -{KV}}}}}
      late: {{delayed: volts, by: 1}}
      limited: {{limit: late, to: {LIMIT}}}
      force: {{sum: {{limited: {GAIN}}}}}
      total: {{sum: {{force: 1, feedforward: 1}}}}
    torque: force
    acts: total
"""
LOG = f"""
schema: rrrgen-log/1
files: NAME.csv
time: {{column: t, unit: s}}
joints:
  - name: slide
    position: {{column: q, unit: m}}
    reference: {{column: r, unit: m}}
    torque: {{column: volts, unit: V, constant: {GAIN} N/V}}
    feedforward: {{column: pulses, unit: N}}
"""


def friction(v: float) -> float:
    s, speed = np.sign(v), abs(v)
    viscous, coulomb = (200.0, 20.0) if v > 0 else (220.0, 24.0)
    return float(s * (viscous * speed + coulomb + 6.0 * np.exp(-speed / 0.02)))


def bent(s: float, travel: float) -> float:
    """Direction of Dahl's friction after a travel, in lengths of presliding."""
    return float(np.sign(travel) + (s - np.sign(travel)) * np.exp(-abs(travel)))


def reference(samples: int, seed: int) -> np.ndarray:
    """Strokes of random length with ramps of the speed, some after a rest."""
    rng = np.random.default_rng(seed)
    ddq, k, sign = np.zeros(samples), 100, 1.0
    while k < samples - 700:
        ramp, cruise = int(rng.integers(50, 160)), int(rng.integers(50, 300))
        ddq[k : k + ramp] += sign * 0.8
        ddq[k + ramp + cruise : k + 2 * ramp + cruise] -= sign * 0.8
        k, sign = k + 2 * ramp + cruise + (150 if rng.random() < 0.5 else 1), -sign
    return np.cumsum(np.cumsum(ddq)) * PERIOD**2


def record(
    folder: Path,
    name: str,
    seed: int,
    seconds: float = 5.0,
    pulses: bool = False,
    resolution: float = 5e-8,
    presliding: float = 0.0,
) -> Path:
    """Write the recording ``name`` of a simulated drive to ``folder``; returns its mapping file.

    With ``presliding`` (m), friction is Dahl's, of DAHL, instead of the asymmetric one.
    """
    samples, steps = round(seconds / PERIOD), 10
    r = reference(samples, seed)
    force = np.zeros(samples)
    if pulses:
        for k in range(500, samples, 900):
            force[k : k + 200] = 15.0 if k % 1800 < 900 else -15.0
    q, v, s, average, last, command = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    rows = np.zeros((samples, 5))
    for k in range(samples):
        reading = round(q / resolution) * resolution
        volts = min(LIMIT, max(-LIMIT, command))
        rows[k] = k * PERIOD, reading, r[k], volts, force[k]
        before, average, last = average, 0.5 * (reading + last), reading
        command = KV * (KP * (r[k] - reading) - (average - before) / PERIOD)
        acting, h = GAIN * volts + force[k], PERIOD / steps
        for _ in range(steps if presliding else 0):
            q, s = q + 0.5 * h * v, bent(s, 0.5 * h * v / presliding)
            v += h * (acting - DAHL["coulomb1"] * s - DAHL["viscous1"] * v) / MASS
            q, s = q + 0.5 * h * v, bent(s, 0.5 * h * v / presliding)
        for _ in range(0 if presliding else steps):
            if v == 0.0 and -30.0 <= acting <= 26.0:
                continue
            direction = v or acting
            after = v + h * (acting - friction(direction if v else np.copysign(1e-12, direction))) / MASS
            after = 0.0 if v * after < 0.0 else after
            q, v = q + 0.5 * h * (v + after), after
    np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="t,q,r,volts,pulses", comments="", fmt="%.10g")
    path = folder / f"{name}.yaml"
    path.write_text(LOG.replace("NAME", name))
    return path


def write_drive(folder: Path) -> tuple[Path, Path]:
    """Robot file and controller file of the drive."""
    robot, controller = folder / "robot.yaml", folder / "controller.yaml"
    robot.write_text(ROBOT)
    controller.write_text(CONTROLLER)
    return robot, controller
