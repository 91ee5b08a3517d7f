"""Rule: recorded speeds that are not the derivatives of the positions: units, signs, exchanged columns, the clock."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.motion import LAG, Motion

AGREES = 0.2  # relative difference below which two speeds agree, since drives delay and filter them
SHAPE = 0.8  # squared correlation above which two curves differ by a factor only
TURN = 180.0 / math.pi
FACTORS = (TURN, 1.0 / TURN, 30.0 / math.pi, math.pi / 30.0, 1e3, 1e-3)


def recorded_speed(motion: Motion) -> Iterator[Cause]:
    """Report recorded speeds that are not the derivatives of the recorded positions."""
    if motion.part.dq is None or len(motion.part) <= 2 * LAG:
        return
    own = motion.speeds()
    sums = np.cumsum(np.vstack([np.zeros(own.shape[1]), motion.part.dq]), axis=0)
    # the same mean over LAG steps, by trapezoids
    told = (sums[LAG + 1 :] - sums[: -LAG - 1] - 0.5 * (motion.part.dq[:-LAG] + motion.part.dq[LAG:])) / LAG
    ratio, shape = _slopes(own, told)
    wrong = [i for i in range(len(ratio)) if shape[i] >= SHAPE and abs(ratio[i] - 1.0) > AGREES]
    near = {i: _nearest(ratio[i]) for i in wrong}
    everywhere = {near[i] for i in wrong} if len(wrong) == len(ratio) else set()
    if everywhere in ({1e3}, {1e-3}):
        factor = 1.0 / everywhere.pop()
        yield motion.words.clock(factor).because(_ratios(motion.words, wrong, ratio))
        return
    for i in wrong:
        if ratio[i] < 0.0 and abs(ratio[i] + 1.0) <= AGREES:
            found = motion.words.wrong_sign(["position", "velocity"], i)
        else:
            found = motion.words.wrong_unit("velocity", [i], 1.0 / (near[i] or ratio[i]))
        yield found.because(_ratios(motion.words, [i], ratio))
    yield from _exchanged(motion, own, told, shape)


def _slopes(x: Array, y: Array) -> tuple[Array, Array]:
    """Least-squares slope of ``y = slope x`` and squared correlation, for each column."""
    xy, xx, yy = np.sum(x * y, axis=0), np.sum(x * x, axis=0), np.sum(y * y, axis=0)
    some = (xx > 0.0) & (yy > 0.0)
    slope = np.divide(xy, xx, out=np.ones(len(xx)), where=some)
    return slope, np.divide(xy**2, xx * yy, out=np.zeros(len(xx)), where=some)


def _nearest(ratio: float) -> float:
    """The conversion factor between two known units that is nearest to ``ratio``; 0 if none agrees within AGREES."""
    return next((factor for factor in FACTORS if abs(ratio / factor - 1.0) <= AGREES), 0.0)


def _ratios(words: Wording, joints: list[int], ratio: Array) -> str:
    told = ", ".join(f"{words.joints[i]} {ratio[i]:.4g}" for i in joints)
    return f"recorded speed over the derivative of the position: {told} (should be 1)"


def _exchanged(motion: Motion, own: Array, told: Array, shape: Array) -> Iterator[Cause]:
    """Report pairs of joints whose recorded speeds are exchanged.

    ``own`` (N, n) are the derivatives of the positions, ``told`` (N, n) the recorded speeds, ``shape`` (n,) the squared
    correlation of the two at each joint.
    """
    for i in range(len(shape)):
        for k in range(i + 1, len(shape)):
            if shape[i] < 1.0 - SHAPE and shape[k] < 1.0 - SHAPE:
                _, cross = _slopes(own[:, [i, k]], told[:, [k, i]])
                if np.all(cross >= SHAPE):
                    pair = f"{motion.words.joints[i]} and {motion.words.joints[k]}"
                    yield motion.words.swapped("velocity", i, k).because(
                        f"the recorded speeds of {pair} follow the position of the other one "
                        f"(squared correlations {cross[0]:.2f} and {cross[1]:.2f}; of their own "
                        f"{shape[i]:.2f} and {shape[k]:.2f})"
                    )
