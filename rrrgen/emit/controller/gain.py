"""Gain of the gradient estimator ``p_next = p - gain Y' (Y p - tau)``: its stability bound along a motion, its default.

The gain is ``alpha Ts`` of (14.23), with the sampling period Ts in s; Y is the regressor, p the estimated parameters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.programs import Regression
from rrrgen.program import evaluate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

USUAL_SHARE = 0.1
"""Share of the bound that averages the torque noise and still converges within some cycles of an exciting motion."""


def gain_bound(regression: Regression, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> float:
    """Largest stable gain along a motion: ``2 / max_k |Y(q_k, dq_k, ddq_k)|_2^2``, spectral norms of the regressor.

    ``q``, ``dq``, ``ddq`` (N, n) are joint positions, velocities and accelerations, rad (m), per s and per s^2. Raises
    :class:`InputError` if Y is zero or not finite all along the motion. Source: (14.23).
    """
    import numpy as np

    motion: list[Any] = [np.asarray(part, dtype=float) for part in (q, dq, ddq)]
    Y = evaluate(regression.rows, *motion, np.zeros_like(motion[0]), 0.0)[0]
    largest = float(np.max(np.linalg.norm(Y, 2, axis=(-2, -1))))
    if not 0.0 < largest < np.inf:
        raise InputError("the motion does not load the parameters: there is no gain for it")
    return 2.0 / largest**2


def chosen_gain(stated: float | None, bound: float | None) -> float:
    """Gain to use: the ``stated`` one, or a tenth of the ``bound`` of :func:`gain_bound` if none is stated.

    Raises :class:`InputError` for a stated gain that is not between 0 and the bound, or if both are None.
    """
    if stated is None and bound is None:
        raise InputError("the gradient estimator needs a gain: state one, or a motion from which it is chosen")
    if bound is not None and stated is not None and not 0.0 < stated < bound:
        raise InputError(
            f"the gradient estimator is unstable along this motion: alpha Ts = {stated:.4g} is not below "
            f"2/max |Y|^2 = {bound:.4g}; a tenth of it, {USUAL_SHARE * bound:.4g}, averages the noise"
        )
    return stated if stated is not None else USUAL_SHARE * float(bound or 0.0)
