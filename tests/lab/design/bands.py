"""The band and the rate of response experiments."""

from __future__ import annotations

from functools import cache

import rrrgen

RATE, SAMPLES, BAND = 1000.0, 2000, (0.5, 200.0)


@cache
def rrr(lower=None, upper=None, velocity=None):
    text = (
        "schema: rrrgen/1\nname: turntable\nconvention: standard\nunits: {angle: rad, length: m}\n"
        "gravity: [0, 0, -9.81]\njoints:\n"
        "  - {name: table, type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0, limits: {torque: 20, "
        + (f"lower: {lower}, upper: {upper}, " if lower is not None else "")
        + (f"velocity: {velocity}, " if velocity is not None else "")
        + "acceleration: 100}, drive: {encoder_resolution: 1e-4}}\n"
        "links:\n  - {mass: 4, com: [-0.1, 0, 0], inertia: {about: com, xx: 0.1, yy: 0.1, zz: 0.2}}\n"
    )
    return rrrgen.compile(rrrgen.loads_spec(text), backend="numpy")
