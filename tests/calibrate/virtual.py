"""Virtual measurements of an arm that is off its table: errors of geometry, noise, outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rrrgen.calibrate.geometry import Geometry, geometry_of, rigid, rotation
from rrrgen.calibrate.measurements import Measurements

NOISE, ANGLE_NOISE = 5e-5, 1e-4  # m, rad
ROWS, FRAMES = 5e-4, 5e-3  # m and rad, errors of rows, and of base and tool


def positions(spec, count: int, random) -> np.ndarray:
    lower = [-3.0 if j.limits.lower is None else j.limits.lower for j in spec.joints]
    upper = [3.0 if j.limits.upper is None else j.limits.upper for j in spec.joints]
    return random.uniform(lower, upper, (count, spec.n))


def off_the_table(spec, random, frames: float = FRAMES) -> tuple[Geometry, Geometry]:
    """The nominal geometry with a tool, and one that is off in every parameter."""
    found = geometry_of(spec)
    nominal = replace(found, tool=found.tool @ rigid([0.1, 0.05, 0.15, 0.3, 0, 0]))
    entries = nominal.entries()
    steps = [random.normal() * (ROWS if entry.place == "row" else frames) for entry in entries]
    return nominal, nominal.moved(entries, np.array(steps))


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
