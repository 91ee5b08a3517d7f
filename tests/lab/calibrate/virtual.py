"""Virtual measurements of an arm that is off its table: errors of geometry, noise, outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrrgen.lab.calibrate.geometry import Geometry, geometry_of, rigid, rotation
from rrrgen.lab.calibrate.measurements import Measurements
from rrrgen.robot.file import load_spec

NOISE, ANGLE_NOISE = 5e-5, 1e-4  # m, rad
ROWS, FRAMES = 5e-4, 5e-3  # m and rad, errors of rows, and of base and tool


def turned(name):
    """A robot with its base off the world frame and its tool off the axes."""
    found = geometry_of(load_spec(name))
    base = rigid([0.3, -0.2, 0.5, 0.2, 0.3, 0.1]) @ found.base
    return replace(found, base=base, tool=found.tool @ rigid([0.1, 0.05, 0.15, 0.3, 0, 0]))


def positions(spec, count: int, random) -> np.ndarray:
    lower = [-3.0 if j.limits.lower is None else j.limits.lower for j in spec.joints]
    upper = [3.0 if j.limits.upper is None else j.limits.upper for j in spec.joints]
    return random.uniform(lower, upper, (count, spec.n))


def off_the_table(spec, random, frames: float = FRAMES, gains: bool = False) -> tuple[Geometry, Geometry]:
    """The nominal geometry with a tool, and one that is off in every parameter; the gains too where they are asked."""
    found = geometry_of(spec)
    nominal = replace(found, tool=found.tool @ rigid([0.1, 0.05, 0.15, 0.3, 0, 0]))
    nominal = nominal.with_gains() if gains else nominal
    entries = nominal.entries()
    steps = [random.normal() * (ROWS if entry.place in ("row", "gain") else frames) for entry in entries]
    return nominal, nominal.with_step(entries, np.array(steps))


def measure(kind, true: Geometry, q, random, outliers: int = 0) -> Measurements:
    T = true.forward(q)
    shift = random.normal(size=(len(q), 3)) * NOISE
    shift[:outliers] += random.normal(size=(outliers, 3)) * 5e-3
    T[:, :3, 3] += shift
    for k, w in enumerate(random.normal(size=(len(q), 3)) * ANGLE_NOISE):
        T[k, :3, :3] = rotation(w) @ T[k, :3, :3]
    noise = random.normal(size=len(q)) * NOISE
    values = {"pose": T, "point": T[:, :3, 3], "distance": np.linalg.norm(true.forward(q)[:, :3, 3], axis=1) + noise}
    values["height"] = true.forward(q)[:, 2, 3] + noise
    return Measurements(kind, q, values[kind], NOISE, ANGLE_NOISE)


def touching(kind, true: Geometry, q, fixtures, random, lifts=(0.0,)) -> Measurements:
    """Measurements at positions near ``q`` where the tip touches one fixture after the other, at heights ``lifts``.

    ``fixtures`` are planes (normal, offset), points, or wires (anchor, zero). The positions are found by Gauss-Newton
    steps with a derivative by finite differences; then the measurements get noise, contacts by a shift of the joints.
    """
    number, lift = np.arange(len(q)) % len(fixtures), np.resize(lifts, len(q))

    def miss(x):
        p = true.forward(x)[:, :3, 3]
        if kind == "contact":
            return p - np.array(fixtures)[number]
        normals, offsets = (np.array(part)[number] for part in zip(*fixtures, strict=True))
        return (np.sum(normals * p, axis=1) - offsets - lift)[:, None]

    if kind == "wire":
        anchors, zeros = (np.array(part)[number] for part in zip(*fixtures, strict=True))
        values = (
            np.linalg.norm(true.forward(q)[:, :3, 3] - anchors, axis=1) + zeros + random.normal(size=len(q)) * NOISE
        )
    else:
        for noise in (0.0, NOISE):
            wanted = random.normal(size=miss(q).shape) * noise
            for _ in range(30):
                missing = wanted - miss(q)
                if np.sort(np.abs(missing).max(axis=1))[int(0.8 * len(q))] < 1e-10:
                    break
                steps = np.eye(q.shape[1]) * 1e-6
                J = np.stack([(miss(q + h) - miss(q - h)) / 2e-6 for h in steps], axis=2)
                q = q + np.clip(np.einsum("njc,nc->nj", np.linalg.pinv(J, rcond=1e-4), missing), -0.2, 0.2)
        near = np.abs(miss(q) - wanted).max(axis=1) < 1e-9
        q, number, values = q[near], number[near], lift[near]
    names = tuple(f"f{k}" for k in range(len(fixtures)))
    return Measurements(kind, q, values, NOISE, ANGLE_NOISE, fixture=number, names=names)
