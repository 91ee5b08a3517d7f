"""Instrumental variables from the simulated loop: a check whether noise in the motion biases least squares.

The instruments are the regressor along the simulated motion, which follows the measured motion but is free of its
noise (Janot, Vandanjon and Gautier 2014). Both motions pass through the same reconstruction and filters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.closed_loop.loop import Run
from rrrgen.lab.closed_loop.loop_recording import LoopRecording
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.regression import least_squares
from rrrgen.lab.estimate.tsqr import Rows, factor_blocks
from rrrgen.lab.identify.bias import LIKE, BiasCheck, Paired, compare, position_difference
from rrrgen.lab.identify.identification import Identification
from rrrgen.lab.identify.observations import Observations, RowMaker
from rrrgen.lab.identify.options import Options


def simulated_bias_check(
    found: Identification,
    recordings: Sequence[LoopRecording],
    runs: Sequence[Run],
    joints: Sequence[str],
    options: Options,
) -> BiasCheck | None:
    """Compare the least-squares estimate ``found`` with the instrumental-variable estimate from simulated ``runs``.

    ``runs`` holds one simulated loop for each of ``recordings``. Returns None if the simulated motion is too far from
    the measured one to serve as an instrument.
    """
    assert found.regressor is not None
    assert found.parametrisation is not None
    far = max(
        position_difference(own.q[own.warm :], run.q[own.warm :]) for own, run in zip(recordings, runs, strict=True)
    )
    if far > LIKE:
        return None
    regressor, chosen = found.regressor, found.parametrisation
    maker = RowMaker(regressor, found.processing, len(regressor.columns), options.known, regressor.sliding)
    pairs: list[Paired] = []
    measured: list[Rows] = []
    for recording, run in zip(recordings, runs, strict=True):
        own = slice(recording.warm, None, recording.stride)
        logs = [_log(recording, q, own, joints) for q in (recording.q, run.q)]
        for a, b in zip(*(Observations((log,), maker) for log in logs), strict=True):
            fitted = found.split.fitted(a.t, *recording.span)
            use = a.use & b.use & fitted[:, None]
            pairs.append(Paired(a.W, b.W, a.tau, use))
            measured.append(Rows(a.t, a.W, a.tau, use, a.segment))
    factors = chosen.transform(factor_blocks(measured))
    x = least_squares(factors, chosen.structure.names, found.estimate.weights).x
    return compare(found, x, pairs)


def _log(recording: LoopRecording, q: Array, own: slice, joints: Sequence[str]) -> Log:
    period = recording.period * recording.stride
    t = recording.t[own]
    return Log(tuple(joints), t, q[own], recording.tau[own], period=period, valid=np.asarray(recording.valid[own]))
