"""Checks a trajectory on the sampling grid of the controller: condition number, singular values and all limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rrrgen.lab.design.fourier_series import Floats, FourierTrajectory, intersample_peak_factor
from rrrgen.lab.design.problem import LEAST_SINE, ExcitationProblem

CHUNK = 2000
"""Number of samples evaluated together; bounds the memory for robots with many columns."""


@dataclass(frozen=True)
class LimitUse:
    """Peak of one limited quantity relative to its limit.

    ``quantity`` is its name, ``index`` the joint, tip axis, follower or loop in the limits, from 0. ``use`` is 1 at the
    limit and above 1 beyond it; ``instant`` (s) is the time of the peak.
    """

    quantity: str
    index: int
    use: float
    instant: float


@dataclass(frozen=True)
class ExcitationCheck:
    """Measures of excitation of one trajectory, and how far it uses the limits, at ``samples`` times of one cycle.

    W is the weighted regressor, stacked over the times. ``condition`` is its condition number, the largest over the
    smallest singular value (after (14.20)); ``frobenius_condition`` is ``|W|_F |W^+|_F``; ``log_determinant`` is
    ``log det(W' W / samples)``; ``singular_values`` (b,) are those of W divided by the square root of ``samples``.
    ``limits`` holds the peak of every limited quantity.
    """

    samples: int
    condition: float
    frobenius_condition: float
    log_determinant: float
    singular_values: tuple[float, ...]
    limits: tuple[LimitUse, ...]

    @property
    def worst_use(self) -> float:
        """Largest use of any limit: 1 at the limit, above 1 beyond it; 0 without limits."""
        return max((limit.use for limit in self.limits), default=0.0)

    @property
    def feasible(self) -> bool:
        """Whether every limit is met at every time of the grid."""
        return self.worst_use <= 1.0

    def to_json(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        return {
            "samples": self.samples,
            "condition": self.condition,
            "frobenius_condition": self.frobenius_condition,
            "log_determinant": self.log_determinant,
            "singular_values": list(self.singular_values),
            "feasible": self.feasible,
            "limits": [vars(limit) for limit in self.limits],
        }


class ProblemFunctions:
    """The CasADi functions of an excitation problem (regressor, torque, tip, loops), over many points in time."""

    def __init__(self, problem: ExcitationProblem) -> None:
        import casadi

        self.problem = problem
        self.regressor = casadi.Function.deserialize(problem.regressor)
        self.torque = None if problem.torque is None else casadi.Function.deserialize(problem.torque)
        self.tip = None if problem.tip is None else casadi.Function.deserialize(problem.tip)
        self.loops = None if problem.loops is None else casadi.Function.deserialize(problem.loops)

    @staticmethod
    def over(function: Any, *columns: Floats) -> Floats:
        """Evaluate ``function`` at m points in time: every argument is (m, k), the result (m, rows, cols).

        ``rows`` and ``cols`` are the shape of one value of the function.
        """
        m = columns[0].shape[0]
        values = np.asarray(function.map(m)(*(c.T for c in columns)).full())
        rows, cols = function.size_out(0)
        return np.ascontiguousarray(values.reshape(rows, m, cols).transpose(1, 0, 2))

    def weighted_regressor(self, q: Floats, dq: Floats, ddq: Floats) -> Floats:
        """Weighted regressor (n m, b), stacked over m states; ``q``, ``dq``, ``ddq`` are (m, n).

        Rows are multiplied by the weights of the joints, columns by the scales of the parameters.
        """
        problem = self.problem
        Y = self.over(self.regressor, q, dq, ddq)
        if problem.row_weights is not None:
            Y = Y * np.asarray(problem.row_weights)[:, None]
        if problem.column_scales is not None:
            Y = Y * np.asarray(problem.column_scales)
        return Y.reshape(-1, problem.columns)

    def turns_freely(self) -> list[bool]:
        """For each joint, whether a whole turn of it leaves everything as it is and no position limit forbids it.

        So it is for a revolute joint without position limits that no limited row of a mechanism follows.
        """
        problem, limits = self.problem, self.problem.limits
        n = problem.joints
        q, dq, ddq = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 4, n))
        lower, upper = limits.row("position_lower", n), limits.row("position_upper", n)
        every = (self.regressor, self.torque, self.tip, self.loops)
        functions = [(function, (q, dq, ddq)[: function.n_in()]) for function in every if function]
        return [
            not (math.isfinite(lower[k]) or math.isfinite(upper[k]))
            and not any(follower.factors[k] for follower in limits.followers)
            and all(
                np.allclose(
                    self.over(function, x[0] + 2.0 * np.pi * np.eye(n)[k], *x[1:]), self.over(function, *x), atol=1e-9
                )
                for function, x in functions
            )
            for k in range(n)
        ]

    def is_assembled(self, q: Floats, sine: float = LEAST_SINE) -> NDArray[np.bool_]:
        """Mask (m,) of ``q`` (m, n) at which all closed loops are assembled, with a ``sine`` between bars or more."""
        if self.loops is None:
            return np.ones(len(q), bool)
        return np.asarray(np.min(self.over(self.loops, q)[:, :, 0], axis=1) >= sine**2)

    def triangular(self, q: Floats, dq: Floats, ddq: Floats) -> Floats:
        """Triangular factor R (b, b) of the QR decomposition of the weighted regressor, stacked over m states (m, n).

        R has the same singular values as the stacked regressor; it is computed in chunks, in bounded memory.
        """
        R: Floats = np.zeros((0, self.problem.columns))
        for k in range(0, q.shape[0], CHUNK):
            part = slice(k, k + CHUNK)
            R = np.asarray(
                np.linalg.qr(np.vstack([R, self.weighted_regressor(q[part], dq[part], ddq[part])]), mode="r")
            )
        return R


class LimitedQuantity(NamedTuple):
    """One limited quantity ``name`` over m points in time: its ``use`` (m,) is 1 at the limit.

    ``joint`` is the number of the joint, or of the axis of the tip position, from 0. ``polynomial`` is true if the
    quantity is the absolute value of a trigonometric polynomial of the degree of the trajectory, so that its maximum
    between samples is bounded.
    """

    name: str
    joint: int
    use: Floats
    polynomial: bool


def limited_quantities(functions: ProblemFunctions, trajectory: FourierTrajectory, t: Floats) -> list[LimitedQuantity]:
    """All limited quantities of ``trajectory`` at the times ``t`` (m,), s, for every joint and tip axis."""
    limits, n = functions.problem.limits, functions.problem.joints
    q, dq, ddq = trajectory.evaluate(t)
    quantities: list[LimitedQuantity] = []
    for name, values in (("speed", dq), ("acceleration", ddq)):
        quantities += _below(name, values, limits.row(name, n), polynomial=True)
    quantities += _between(
        "position", q, limits.row("position_lower", n), limits.row("position_upper", n), polynomial=True
    )
    if limits.followers:
        factors = np.array([follower.factors for follower in limits.followers])
        quantities += _between("follower", q @ factors.T, *limits.follower_range(), polynomial=True)
    if functions.torque is not None and limits.torque is not None:
        quantities += _below(
            "torque", functions.over(functions.torque, q, dq, ddq)[:, :, 0], limits.row("torque", n), False
        )
    if functions.tip is not None and (limits.box_lower is not None or limits.box_upper is not None):
        tip = functions.over(functions.tip, q)[:, :, 0]
        quantities += _between("tip", tip, limits.row("box_lower", 3), limits.row("box_upper", 3), polynomial=False)
    if functions.loops is not None:
        squares = functions.over(functions.loops, q)[:, :, 0]
        k = squares.shape[1]
        quantities += _between("loop", squares, (LEAST_SINE**2,) * k, (math.inf,) * k, polynomial=False)
    return quantities


def _below(name: str, values: Floats, bounds: tuple[float, ...], polynomial: bool) -> list[LimitedQuantity]:
    columns = enumerate(zip(values.T, bounds, strict=True))
    return [LimitedQuantity(name, i, np.abs(v) / b, polynomial) for i, (v, b) in columns if np.isfinite(b)]


def _between(
    name: str, values: Floats, lower: tuple[float, ...], upper: tuple[float, ...], polynomial: bool
) -> list[LimitedQuantity]:
    """Use of lower and upper bounds by ``values`` (m, joints), for each joint that has a bound.

    With two bounds the use is the distance from their middle divided by half the range; with one bound it is 1 at the
    bound and 0 one unit (rad or m) inside.
    """
    quantities = []
    for i, (v, low, high) in enumerate(zip(values.T, lower, upper, strict=True)):
        if np.isfinite(low) and np.isfinite(high):
            quantities.append(LimitedQuantity(name, i, np.abs(2.0 * v - low - high) / (high - low), polynomial))
        elif np.isfinite(high):
            quantities.append(LimitedQuantity(name, i, 1.0 + v - high, False))
        elif np.isfinite(low):
            quantities.append(LimitedQuantity(name, i, 1.0 + low - v, False))
    return quantities


def check_trajectory(
    problem: ExcitationProblem, trajectory: FourierTrajectory, samples: int | None = None
) -> ExcitationCheck:
    """Check a trajectory on ``samples`` equispaced times of one cycle (by default those of the controller).

    The uses of speed, acceleration and position limits are multiplied by ``1/cos(pi N/M)`` for N harmonics and M
    samples, so that they are bounds *between* the samples too.
    """
    functions = ProblemFunctions(problem)
    M = samples or problem.samples_per_period
    t = np.arange(M) * (trajectory.period / M)
    factor = intersample_peak_factor(trajectory.harmonics, M)
    limits = []
    for name, i, use, polynomial in limited_quantities(functions, trajectory, t):
        peak = int(np.argmax(use))
        limits.append(LimitUse(name, i, float(use[peak] * (factor if polynomial else 1.0)), float(t[peak])))
    sigma = np.linalg.svd(functions.triangular(*trajectory.evaluate(t)), compute_uv=False) / np.sqrt(M)
    smallest = max(float(sigma[-1]), np.finfo(float).tiny)
    return ExcitationCheck(
        samples=M,
        condition=float(sigma[0]) / smallest,
        frobenius_condition=float(np.linalg.norm(sigma) * np.linalg.norm(1.0 / np.maximum(sigma, smallest))),
        log_determinant=float(2.0 * np.sum(np.log(np.maximum(sigma, smallest)))),
        singular_values=tuple(float(s) for s in sigma),
        limits=tuple(limits),
    )
