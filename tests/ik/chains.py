"""Random chains with one special structure each: generic in everything else."""

from __future__ import annotations

from itertools import permutations, product
from math import pi

import numpy as np

from ik.robots import h

KINDS = ("RRR", "RPR", "PRR", "RRP", "RPP", "PPR", "PRP")
"""Planar triples: revolute axes along the normal, prismatic ones across it."""


def generic(n: int, seed: int) -> list[np.ndarray]:
    """alpha, a, d, theta without special values."""
    rng = np.random.default_rng(seed)
    lengths = [rng.uniform(0.08, 0.5, n).round(3) * rng.choice([-1, 1], n) for _ in range(2)]
    return [rng.uniform(0.3, 1.2, n).round(3) * rng.choice([-1, 1], n), *lengths, rng.uniform(-2, 2, n).round(3)]


def rows(types: str, parameters: list[np.ndarray]) -> list:
    return [(t, *(float(x) for x in values)) for t, values in zip(types, zip(*parameters, strict=True), strict=True)]


def position(types: str, seed: int = 0) -> list:
    return rows(types, generic(len(types), seed))


def spherical(k: int, others: str, seed: int = 0) -> list:
    """Axes k, k+1, k+2 through one point; ``others`` are the types of the remaining joints."""
    alpha, a, d, theta = generic(6, seed)
    a[k] = a[k + 1] = d[k + 1] = 0.0
    return rows(others[:k] + "RRR" + others[k:], [alpha, a, d, theta])


def planar(k: int, kind: str, others: str, seed: int = 0) -> list:
    """Joints k, k+1, k+2 move in a plane; antiparallel axes occur."""
    alpha, a, d, theta = generic(6, seed)
    rng = np.random.default_rng(seed + 1)
    for i in range(2):
        pair = kind[i : i + 2]
        if pair == "RR":
            alpha[k + i] = (0.0, pi)[rng.integers(2)]
        elif "R" in pair:
            alpha[k + i] = (h, -h)[rng.integers(2)]
    if "PP" in kind:
        theta[k + 1] = h
    if kind == "RPR":
        theta[k + 1] = 0.0
    return rows(others[:k] + kind + others[k:], [alpha, a, d, theta])


def scara(types: str, seed: int = 0) -> list:
    """Three parallel revolute axes and one prismatic one, the rest generic."""
    alpha, a, d, theta = generic(len(types), seed)
    alpha[:3] = (0.0, pi, 0.0)
    return rows(types, [alpha, a, d, theta])


def every_structure() -> list[tuple[str, str, list]]:
    """Name, family and rows of every structure that six joints or fewer can have here."""
    found = []
    for n in (1, 2, 3):
        family = "position" if n == 3 else "point"
        found += [(f"position {t}", family, position(t)) for t in map("".join, product("RP", repeat=n))]
    for k in range(4):
        for t in map("".join, product("RP", repeat=3)):
            found.append((f"spherical {k} {t}", "spherical", spherical(k, t)))
    for k in range(4):
        for kind in KINDS:
            for t in ("RRR", "PRR", "RPR", "RRP"):
                # three turns are needed: the plane gives one, the others must give two that tilt it
                found.append((f"planar {k} {kind} {t}", "parallel", planar(k, kind, t)))
    for t in sorted({"".join(p) for p in permutations("RRRPPP")}):
        found.append((f"orientation {t}", "orientation", position(t, 3)))
    found += [(f"scara {t}", "lift", scara(t)) for t in ("RRPR", "RRRP", "PRRR", "RPRR")]
    found += [(f"scara {t}", "parallel", scara(t, 2)) for t in ("RRRPRR", "RRPRRR", "RPRRRR", "PRRRRR")]
    return found
