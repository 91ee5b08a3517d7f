"""Rule: an implausible mass of the arm reveals a wrong unit of all torques, or of time.

A common factor on all torques changes no relative error: it multiplies every parameter. It shows in the mass that the
torques imply, once by gravity and once by inertia. A wrong clock leaves the mass by gravity unchanged and multiplies
that by inertia by the square of its factor.

If the robot file has links, the mass is compared with theirs; a ratio above 31.6, the geometric mean of 1 and 1000,
counts as a factor of 1000. Without links the mass over the cube of the reach is judged: it is 5 to 60 kg/m^3 for arms
from the Puma 560 to the Staubli TX40, and 0.01 to 1000 is accepted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.derive.parameters.physical_links import SMALLEST_LENGTH
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.sample import Sample
from rrrgen.lab.identify.diagnosis.trial import AllTerms

BETWEEN = 1000.0**0.5
DENSITY = (0.01, 1000.0)  # kg/m^3, accepted range: toy models are lighter than industrial arms, nothing is heavier
SQUARED = 1000.0  # ratio of the masses by inertia and by gravity, between 1 and 1000^2, above which the clock is wrong
POSES = 60  # poses of the recording at which gravity and inertia are compared
LEVEL = 1e-6  # gravity torque over inertia torque of the same mass, below which gravity acts on no joint


def gravity_and_inertia(regressor: AllTerms, sample: Sample, theta: Array) -> tuple[Array, Array]:
    """Gravity torques and diagonal of the mass matrix at K <= POSES poses of the recording, (K, n) each.

    They follow from the parameters ``theta`` (p,); drive inertia is included.
    """
    q = sample.q[np.linspace(0, len(sample.q) - 1, min(POSES, len(sample.q))).astype(int)]
    beta, zero = theta[: len(regressor.model.base_parameter_names)], np.zeros_like(q)
    g = np.asarray(regressor.model.regressor(q, zero, zero)) @ beta
    M = np.empty_like(g)
    for i in range(sample.n):
        unit = zero.copy()
        unit[:, i] = 1.0
        M[:, i] = (np.asarray(regressor.model.regressor(q, zero, unit)) @ beta - g)[:, i]
    return g, M + regressor.inertia(theta)


def magnitude(spec: Any, regressor: AllTerms, sample: Sample, theta: Array, words: Wording) -> Iterator[Cause]:
    """Report a wrong unit of all torques, or a wrong clock, if the masses implied by ``theta`` are implausible."""
    g, M = gravity_and_inertia(regressor, sample, theta)
    nominal = getattr(regressor.model, "beta", None)
    if nominal is not None:
        inertia = [0.0 if j.drive is None or j.drive.inertia is None else float(j.drive.inertia) for j in spec.joints]
        known = np.zeros(len(theta))
        known[: len(nominal)] = nominal
        g0, M0 = gravity_and_inertia(regressor, sample, known)
        yield from _against_links(g, M, g0, M0 + np.asarray(inertia), words)
    else:
        yield from _against_reach(spec, g, M, sample, words)


def _against_links(g: Array, M: Array, g0: Array, M0: Array, words: Wording) -> Iterator[Cause]:
    pull = float(np.sqrt(np.sum(g0**2)))
    by_gravity = float(np.sqrt(np.sum(g**2))) / pull if pull > 0.0 else np.nan
    # sums over joints, dominated by the heavy ones: in a wrist, unstated drive inertia may exceed that of the links
    like = np.array(words.revolute) if any(words.revolute) else np.ones(len(words.joints), bool)
    total, own = float(np.sum(np.abs(np.mean(M, axis=0))[like])), float(np.sum(np.mean(M0, axis=0)[like]))
    if not (total > 0.0 and own > 0.0):
        return
    by_inertia = total / own
    told = f"inertia {by_inertia:.3g} times that of the robot file's links"
    told += "" if np.isnan(by_gravity) else f", gravity torques {by_gravity:.3g} times theirs"
    each = np.abs(np.mean(M, axis=0)) / np.maximum(np.mean(M0, axis=0), np.finfo(float).tiny)
    off = [i for i, ratio in enumerate(each) if not 1.0 / BETWEEN <= ratio <= BETWEEN]
    joints = off or list(range(len(each)))
    yield from _judged(by_gravity, by_inertia, (1.0 / BETWEEN, BETWEEN), told, joints, words)


def _against_reach(spec: Any, g: Array, M: Array, sample: Sample, words: Wording) -> Iterator[Cause]:
    """Judge the mass of an arm whose file has no links: mass at full reach divided by the cube of the reach, kg/m^3.

    ``g`` and ``M`` (K, n) are the gravity torques and the diagonal of the mass matrix.
    """
    if spec.mechanism is not None:
        return  # in a tree, the links that a joint carries do not follow from the order of the DH rows
    # an offset d along the first axis does not add to the distance from it
    sizes = [abs(a) if i == 0 else max(abs(a), abs(d)) for i, (_, _, a, d, _) in enumerate(spec.dh_table())]
    travel = np.ptp(sample.q, axis=0)
    own = np.array([size if words.revolute[i] else max(size, travel[i]) for i, size in enumerate(sizes)])
    reach = np.maximum(np.cumsum(own[::-1])[::-1], SMALLEST_LENGTH)
    turning = np.array(words.revolute)
    if not turning.any() or float(np.sum(own)) <= SMALLEST_LENGTH:
        return
    arm = np.where(turning, reach, 1.0)
    pull = float(np.linalg.norm([float(v) for v in spec.gravity]))
    by_gravity = float(np.max(_rms(g) / arm)) / pull if pull > 0.0 else 0.0
    by_inertia = float(np.max(np.abs(np.mean(M, axis=0)) / arm**2))
    volume = float(reach[0]) ** 3
    told = f"the inertia is that of {by_inertia:.3g} kg at a reach of {reach[0]:.3g} m"
    upright = by_gravity > LEVEL / SQUARED * by_inertia
    told += f", the gravity torques that of {by_gravity:.3g} kg" if upright else ""
    gravity = by_gravity / volume if upright else np.nan
    yield from _judged(gravity, by_inertia / volume, DENSITY, told, range(len(words.joints)), words)


def _judged(
    gravity: float, inertia: float, allowed: tuple[float, float], told: str, joints: Sequence[int], words: Wording
) -> Iterator[Cause]:
    """Report a wrong torque unit of ``joints``, or a wrong clock, from the masses implied by gravity and inertia.

    ``gravity`` and ``inertia`` are these masses, divided by the expected mass or by the cube of the reach (kg/m^3);
    ``gravity`` is NaN if gravity acts on no joint. The clock is wrong if they differ by more than SQUARED, the torques
    if they lie outside the range ``allowed``. ``told`` is the evidence in words.
    """
    low, high = allowed
    if np.isnan(gravity):
        clock = inertia > SQUARED * high or inertia < low / SQUARED
    else:
        clock = inertia > SQUARED * gravity or inertia < gravity / SQUARED
    if clock:
        faster = inertia > (high if np.isnan(gravity) else gravity)
        yield words.clock(1e-3 if faster else 1e3).because(told)
        return
    size = inertia if np.isnan(gravity) else gravity
    if size > high or size < low:
        yield words.wrong_unit("torque", joints, 1e-3 if size > high else 1e3).because(told)


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))
