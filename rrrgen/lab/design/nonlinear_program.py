"""The nonlinear program of an exciting trajectory in CasADi: smooth objectives, limits, and exact derivatives.

The condition number is a quotient of extreme eigenvalues, which is not differentiable where they cross, and at the
optimum several of them coincide. It is approximated from above with the norms ``|A|_p = (tr A^p)^(1/p)``:
``(|A|_p |A^-1|_p)^(1/2)`` is smooth and tends to the condition number as p grows.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rrrgen.lab.design.check import ProblemFunctions
from rrrgen.lab.design.fourier_series import Floats, FourierTrajectory, fourier_basis
from rrrgen.lab.design.problem import LEAST_SINE, ExcitationProblem

MARGIN = 1e-3
"""Fraction by which every limit is tightened, to allow for the tolerance of the solver."""

REGULARISATION = 1e-6
"""Share of the mean eigenvalue of the first information matrix that is added to all eigenvalues in the log-determinant.
"""


class Constraints:
    """Constraint values, scaled to [-1, 1], with their bounds."""

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.lower: list[float] = []
        self.upper: list[float] = []

    def limit(self, value: Any, low: float, high: float) -> None:
        """Add the constraint ``low <= value <= high``, tightened by MARGIN; one of the bounds may be infinite."""
        if np.isfinite(low) and np.isfinite(high):
            centre, half = 0.5 * (low + high), 0.5 * (high - low)
            bottom, top = MARGIN - 1.0, 1.0 - MARGIN
        else:
            centre = low if np.isfinite(low) else high
            half = max(abs(centre), 1.0)
            bottom, top = (MARGIN, np.inf) if np.isfinite(low) else (-np.inf, -MARGIN)
        self.values.append((value - centre) / half)
        self.lower += [bottom] * value.numel()
        self.upper += [top] * value.numel()

    def vanish(self, value: Any) -> None:
        """Add the constraint ``value = 0``."""
        self.values.append(value)
        self.lower.append(0.0)
        self.upper.append(0.0)


class ExcitationProgram:
    """Nonlinear program of an excitation ``problem``, built with CasADi symbols.

    Its variables ``x`` are the Fourier coefficients of the trajectory, joint by joint, scaled by the speed limits. They
    lie between ``lower`` and ``upper``, which are infinite but for the middle of the motion of a joint that neither has
    two position limits nor turns freely.
    """

    def __init__(self, problem: ExcitationProblem) -> None:
        import casadi

        self.problem = problem
        self.functions = ProblemFunctions(problem)
        self.n, self.N = problem.joints, problem.harmonics
        speed = np.asarray(problem.limits.row("speed", self.n))
        scale = np.where(np.isfinite(speed), speed, 1.0)
        self.size = 1 + 2 * self.N
        self.x = casadi.MX.sym("x", self.n * self.size)
        X = casadi.reshape(self.x, self.size, self.n)
        self.factors = np.vstack([np.ones(self.n), np.tile(scale, (2 * self.N, 1))])
        self.X = X * casadi.DM(self.factors)
        low, high = problem.limits.middles(self.n)
        sides = (problem.limits.row(f"position_{side}", self.n) for side in ("lower", "upper"))
        limited = [np.isfinite(row) for row in sides]
        self.lower, self.upper = np.full(self.x.numel(), -np.inf), np.full(self.x.numel(), np.inf)
        for k, free in enumerate(self.functions.turns_freely()):
            if not free and not (limited[0][k] and limited[1][k]):
                self.lower[k * self.size], self.upper[k * self.size] = low[k], high[k]
        period = 1.0 / problem.base_frequency
        grid = np.arange(problem.design_samples) * (period / problem.design_samples)
        self.information = self._information(grid)

    def motion(self, t: Floats) -> tuple[Any, Any, Any]:
        """Symbolic q, dq, ddq at the times ``t``, each (n, m)."""
        import casadi

        f0 = self.problem.base_frequency
        q, dq, ddq = (casadi.mtimes(casadi.DM(fourier_basis(t, self.N, f0, k)), self.X).T for k in range(3))
        return q, dq, ddq

    def _information(self, grid: Floats) -> Any:
        """Symbolic mean of the information matrix ``Y' Y`` (b, b) over the times ``grid`` (s), lower triangle only."""
        import casadi

        problem, b = self.problem, self.problem.columns
        q, dq, ddq = (casadi.SX.sym(name, self.n) for name in ("q", "dq", "ddq"))
        Y = casadi.densify(self.functions.regressor(q, dq, ddq))
        if problem.row_weights is not None:
            Y = casadi.diag(casadi.DM(problem.row_weights)) @ Y
        if problem.column_scales is not None:
            Y = Y @ casadi.diag(casadi.DM(problem.column_scales))
        gram = casadi.densify(casadi.mtimes(Y.T, Y))
        pairs = [(i, j) for j in range(b) for i in range(j, b)]
        lower = casadi.Function("gram", [q, dq, ddq], [casadi.vertcat(*[gram[i, j] for i, j in pairs])])
        packed = casadi.sum2(lower.map(grid.size)(*self.motion(grid))) / grid.size
        place = np.zeros((b, b), dtype=int)
        for k, (i, j) in enumerate(pairs):
            place[i, j] = place[j, i] = k
        return casadi.reshape(packed[place.ravel().tolist()], b, b)

    def objective(self, stage: str, p: int, mean_eigenvalue: float) -> Any:
        """Symbolic objective to minimize: that of ``stage`` "logdet", "cond" or "sigma_min".

        ``p`` is the exponent of the norms ``|A|_p`` that make it smooth; ``mean_eigenvalue`` is that of the information
        matrix at the start, to which the regularisation of "logdet" is relative.
        """
        import casadi

        A, b = self.information, self.problem.columns
        if stage == "logdet":
            S = casadi.SX.sym("A", b, b)
            factor = casadi.chol(S + REGULARISATION * mean_eigenvalue * casadi.SX.eye(b))
            half = casadi.Function("half_logdet", [S], [casadi.sum1(casadi.log(casadi.diag(factor)))])
            return -half(A) / b
        inverse = _log_norm(casadi.inv(A), p)
        return 0.5 * inverse if stage == "sigma_min" else 0.5 * (_log_norm(A, p) + inverse)

    def constraints(self, imposed: dict[tuple[str, int], set[int]]) -> Constraints:
        """Constraints of the program: every limit at some sample numbers, then rest at the ends of a cycle if asked.

        ``imposed`` maps (name of the quantity, joint or axis) to the sample numbers at which its limit is imposed.
        """
        problem, n = self.problem, self.n
        limits = problem.limits
        bounds = {
            "position": (limits.row("position_lower", n), limits.row("position_upper", n)),
            "tip": (limits.row("box_lower", 3), limits.row("box_upper", 3)),
            "follower": limits.follower_range(),
        }
        if self.functions.loops is not None:
            loops = self.functions.loops.numel_out(0)
            bounds["loop"] = ((LEAST_SINE**2,) * loops, (np.inf,) * loops)
        for name in ("speed", "acceleration", "torque"):
            row = limits.row(name, n)
            bounds[name] = (tuple(-v for v in row), row)
        collected = Constraints()
        step = 1.0 / (problem.base_frequency * problem.samples_per_period)
        for (name, i), chosen in sorted(imposed.items()):
            if not chosen:
                continue
            t = np.array(sorted(chosen)) * step
            low, high = (row[i] for row in bounds[name])
            collected.limit(self._quantity(name, i, t), low, high)
        if problem.at_rest:
            self._rest(collected)
        return collected

    def _quantity(self, name: str, i: int, t: Floats) -> Any:
        """Symbolic values (m,) of the limited quantity ``name`` of joint or axis ``i`` at the times ``t`` (m,), s."""
        import casadi

        order = {"position": 0, "speed": 1, "acceleration": 2, "follower": 0}.get(name)
        if order is not None:  # linear in the variables: a constant sparse Jacobian
            basis = fourier_basis(t, self.N, self.problem.base_frequency, order)
            parts = enumerate(self.problem.limits.followers[i].factors) if name == "follower" else [(i, 1.0)]
            rows = casadi.DM(t.size, self.x.numel())
            for k, factor in parts:
                rows[:, k * self.size : (k + 1) * self.size] = factor * basis * self.factors[:, k]
            return casadi.mtimes(casadi.sparsify(rows), self.x)
        q, dq, ddq = self.motion(t)
        function = {"torque": self.functions.torque, "tip": self.functions.tip, "loop": self.functions.loops}[name]
        assert function is not None  # an ExcitationProblem with such a limit and no function cannot be built
        return function.map(t.size)(*((q, dq, ddq) if name == "torque" else (q,)))[i, :].T

    def _rest(self, collected: Constraints) -> None:
        """Add the constraints for rest at start and end of a cycle: dq(0) = sum a_j = 0, ddq(0) = sum w_j b_j = 0.

        a_j and b_j are the Fourier coefficients of a joint, w_j the angular frequency of harmonic j.
        """
        import casadi

        order = casadi.DM(np.arange(1, self.N + 1) / self.N)
        for i in range(self.n):
            first = i * self.size + 1
            a, b = self.x[first : first + self.N], self.x[first + self.N : first + 2 * self.N]
            collected.vanish(casadi.sum1(a))
            collected.vanish(casadi.dot(order, b))

    def trajectory(self, x: Floats) -> FourierTrajectory:
        """The trajectory for the values ``x`` of the program's variables."""
        X = x.reshape(self.n, self.size).T * self.factors
        return FourierTrajectory.from_coefficients(X, self.problem.base_frequency)

    def variables(self, trajectory: FourierTrajectory) -> Floats:
        """Values of the program's variables for a ``trajectory``; the inverse of :meth:`trajectory`."""
        return np.asarray((trajectory.coefficients / self.factors).T.ravel())


def _log_norm(A: Any, p: int) -> Any:
    """Logarithm of the norm ``|A|_p = (tr A^p)^(1/p)`` for ``p`` a power of two.

    A is squared repeatedly and scaled to trace 1 after each squaring, which avoids overflow.
    """
    import casadi

    trace = casadi.trace(A)
    power, value, exponent = A / trace, casadi.log(trace), 1
    while exponent < p:
        power = casadi.mtimes(power, power)
        exponent *= 2
        trace = casadi.trace(power)
        power = power / trace
        value = value + casadi.log(trace) / exponent
    return value
