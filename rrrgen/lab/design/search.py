"""One start of the search for an exciting trajectory: a pure function of (problem, seed).

From a poor start (cond > 1e8) the gradient of the condition number is useless, so a regularised log-determinant is
maximised first. Limits are imposed at a few times; if the grid of the controller then shows a violation, its peak is
added to these times and IPOPT continues (the exchange method of semi-infinite programming).
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.lab.design.check import ExcitationCheck, ProblemFunctions, check_trajectory, limited_quantities
from rrrgen.lab.design.fourier_series import Floats, FourierTrajectory
from rrrgen.lab.design.nonlinear_program import MARGIN, ExcitationProgram
from rrrgen.lab.design.problem import LEAST_SINE, ExcitationProblem

EXCHANGES = 8
"""Largest number of repetitions of the last stage with the violated points in time added."""

NEAREST = "nearest"
"""The last stage, where the others leave a limit violated: the nearest motion, by its coefficients, that meets all."""

HOLDING_TRIALS = 200
"""Number of random configurations among which a start looks for one that the drives hold easily."""

HALVINGS = 12
"""Largest number of times that the amplitude of a start is halved to meet the limits of torques and closed loops."""

DRAWS_OF_LOOPS = 50
"""Largest number of times that configurations are drawn to find some in which closed loops are assembled."""

LARGEST_SHRINKING = 0.03
"""A trajectory that exceeds a limit by more than this is reported as infeasible instead of being scaled down."""

GROWTH = (2.0, 1.3, 1.1)
"""Factors by which a motion is enlarged one after the other."""

SAME_CONDITION = 1e-6
"""Relative difference of two condition numbers that is round-off."""

STAGES: dict[str, tuple[tuple[str, int], ...]] = {
    "cond": (("logdet", 0), ("cond", 4), ("cond", 16), ("cond", 64)),
    "frobenius": (("logdet", 0), ("cond", 1)),
    "sigma_min": (("logdet", 0), ("sigma_min", 8), ("sigma_min", 64)),
    "logdet": (("logdet", 0),),
}
"""Objectives in the order they are minimised, with the exponent p of their norms."""


# ------------------------------------------------------------------------------------------------------------------
# Makes Ctrl-C end work in CasADi: an interruption that its solver or its Python code swallows is raised again.
#
# IPOPT takes an interruption for a failed evaluation and goes on from another point. The Python code of CasADi catches
# every exception in some places (``vertcat`` and the conversion of arrays, for instance), the interruption among them.
# ------------------------------------------------------------------------------------------------------------------


@contextmanager
def reraised_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C was pressed in it, even if its code swallowed that.

    The previous signal handler is still called at once. Has no effect outside the main thread, which alone receives
    signals, or if the signal is ignored or handled outside Python. Blocks may be nested; also usable as a decorator.
    """
    before: Any = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    heard = False

    def remember(number: int, frame: Any) -> None:
        nonlocal heard
        heard = True
        before(number, frame)

    signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        try:
            signal.signal(signal.SIGINT, before)
        except BaseException:  # a signal that waited is handled before the handler is replaced: replace it again
            signal.signal(signal.SIGINT, before)
            raise
        if heard:
            raise KeyboardInterrupt


# ------------------------------------------------------------------------------------------------------------------
# The search from random starts.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class StartResult:
    """Result of the search from one start.

    ``seed`` is that of the start, ``trajectory`` the result with its ``check`` on the controller's sampling grid.
    ``history`` holds for each stage its name and the objective, iteration by iteration; ``start_condition`` is the
    condition number at the start.
    """

    seed: int
    trajectory: FourierTrajectory
    check: ExcitationCheck
    history: tuple[tuple[str, tuple[float, ...]], ...]
    start_condition: float

    @property
    def score(self) -> tuple[bool, float]:
        """Sorting key: feasible trajectories first, then small condition numbers."""
        return (not self.check.feasible, self.check.condition)

    def objective(self, name: str) -> tuple[bool, float]:
        """Sorting key for the objective ``name`` of an experiment file: feasible trajectories first, the best first.

        The value is one to minimise: condition numbers as they are, ``logdet`` and ``sigma_min`` with the sign changed.
        """
        sigma = np.asarray(self.check.singular_values)
        value = {
            "cond": self.check.condition,
            "frobenius": self.check.frobenius_condition,
            "logdet": -self.check.log_determinant,
            "sigma_min": -float(sigma[-1]),
        }[name]
        return (not self.check.feasible, value)


def random_start(problem: ExcitationProblem, seed: int) -> FourierTrajectory:
    """A random trajectory within all limits but a box of the tip and those of followers, reproducible from ``seed``.

    It moves about the middle of the position limits, or where holding the arm there takes more than half of the torque
    limits, about the configuration of ``HOLDING_TRIALS`` random ones that is held most easily, and with closed loops
    about one in which they are assembled. Its amplitude is halved until torques and loops meet their limits.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0x52525247]))
    n, N = problem.joints, problem.harmonics
    a, b = rng.normal(size=(2, n, N))
    if problem.at_rest:
        weights = np.arange(1, N + 1) / N
        a -= a.mean(axis=1, keepdims=True)
        b -= (b @ weights)[:, None] * weights / (weights @ weights)
    low, high = (np.asarray(problem.limits.row(f"position_{side}", n)) for side in ("lower", "upper"))
    bounded = np.isfinite(high - low)
    middle = np.where(bounded, 0.5 * (np.where(bounded, low, 0.0) + np.where(bounded, high, 0.0)), 0.0)
    q0 = np.where(bounded, middle, rng.uniform(-np.pi, np.pi, n))
    limited = problem.limits.torque is not None
    if limited and _holding(problem, q0[None])[0] > 0.5:
        drawn = rng.uniform(np.where(bounded, low, -np.pi), np.where(bounded, high, np.pi), (HOLDING_TRIALS, n))
        q0 = drawn[int(np.argmin(_holding(problem, drawn)))]
    functions = ProblemFunctions(problem)
    if not functions.is_assembled(q0[None], 2.0 * LEAST_SINE)[0]:
        drawn = np.asarray(_draw_configurations(functions, rng, HOLDING_TRIALS), float)
        q0 = drawn[int(np.argmin(_holding(problem, drawn))) if limited else 0]
    trajectory = FourierTrajectory(q0, a, b, problem.base_frequency)
    q, dq, ddq = trajectory.evaluate(np.arange(20 * N) * (trajectory.period / (20 * N)))
    gains = np.full(n, np.inf)
    for values, bound in (
        (q - q0, np.where(bounded, np.minimum(q0 - low, high - q0), np.inf)),
        (dq, np.asarray(problem.limits.row("speed", n))),
        (ddq, np.asarray(problem.limits.row("acceleration", n))),
    ):
        gains = np.minimum(gains, bound / np.abs(values).max(axis=0))
    gains = problem.start_amplitude * np.where(np.isfinite(gains), gains, 1.0)
    for _ in range(HALVINGS):
        trajectory = FourierTrajectory(q0, a * gains[:, None], b * gains[:, None], problem.base_frequency)
        motion = trajectory.evaluate(_cycle(problem, trajectory))
        moderate = not limited or _torque_use(problem, *motion).max() <= 1.0
        if moderate and functions.is_assembled(motion[0]).all():
            break
        gains = 0.5 * gains
    return trajectory


def _cycle(problem: ExcitationProblem, trajectory: FourierTrajectory) -> Floats:
    """The points in time of one cycle at which the objective is evaluated, (design_samples,), s."""
    return np.asarray(np.arange(problem.design_samples) * (trajectory.period / problem.design_samples))


def _torque_use(problem: ExcitationProblem, q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """The torques over their limits, (m,): the largest of all joints at m states (m, n)."""
    functions = ProblemFunctions(problem)
    torques = functions.over(functions.torque, q, dq, ddq)[:, :, 0]
    return np.asarray(np.max(np.abs(torques) / np.asarray(problem.limits.row("torque", problem.joints)), axis=1))


def _holding(problem: ExcitationProblem, q: Floats) -> Floats:
    """The torques that hold the arm at ``q`` (m, n) over their limits, (m,): the largest of all joints."""
    return _torque_use(problem, q, np.zeros_like(q), np.zeros_like(q))


@reraised_interrupts()
def solve_start(problem: ExcitationProblem, seed: int) -> StartResult:
    """Search from the random start of ``seed``; a pure function of its arguments, so that it can run on any machine.

    Raises InputError if the columns of the regressor are linearly dependent at random states.
    """
    with reraised_interrupts():
        program = ExcitationProgram(problem)
    _require_independent_columns(program.functions, seed)
    trajectory = random_start(problem, seed)
    start = check_trajectory(problem, trajectory, problem.design_samples)
    imposed = _initial_limits(program, trajectory)
    eigenvalue = float(np.mean(np.square(start.singular_values)))
    history: list[tuple[str, tuple[float, ...]]] = []
    for stage, p in STAGES[problem.objective]:
        trajectory = _solve(program, stage, p, eigenvalue, trajectory, imposed, history)
        _exchange(program, trajectory, imposed)
    stage, p = STAGES[problem.objective][-1]
    for _ in range(EXCHANGES):
        limits = check_trajectory(problem, trajectory).limits
        if all(limit.use <= 1.0 + MARGIN for limit in limits if limit.quantity != "torque"):
            break
        trajectory = _solve(program, stage, p, eigenvalue, trajectory, imposed, history)
        _exchange(program, trajectory, imposed)
    trajectory = _within_limits(problem, trajectory)
    for _ in range(EXCHANGES):
        if check_trajectory(problem, trajectory).feasible:
            break
        _exchange(program, trajectory, imposed, torques=True)
        trajectory = _solve(program, NEAREST, 0, eigenvalue, trajectory, imposed, history)
    trajectory = _turned_back(program.functions, _up_to_limits(problem, trajectory))
    return StartResult(seed, trajectory, check_trajectory(problem, trajectory), tuple(history), start.condition)


def _require_independent_columns(functions: ProblemFunctions, seed: int) -> None:
    problem = functions.problem
    rng = np.random.default_rng(seed)
    states = rng.uniform(-2.0, 2.0, (3, 10 * problem.columns, problem.joints))
    if problem.loops is not None:
        states[0] = _draw_configurations(functions, rng, len(states[0]))
    sigma = np.linalg.svd(functions.weighted_regressor(*states), compute_uv=False)
    rank = int(np.sum(sigma > sigma[0] * problem.columns * 1e-11))
    if rank < problem.columns:
        raise InputError(
            f"excitation: the regressor has {problem.columns} columns but rank {rank}, and no trajectory excites the "
            "rest; if axes are nearly but not exactly parallel or perpendicular, such as 1.5708 for pi/2, write their "
            "angles exactly, otherwise use the base regressor"
        )


def _draw_configurations(functions: ProblemFunctions, rng: np.random.Generator, count: int) -> Floats:
    """Random configurations (count, n) within the position limits in which all closed loops are away from dead points.

    Raises InputError where there are none.
    """
    problem = functions.problem
    low, high = (np.asarray(row) for row in problem.limits.middles(problem.joints))
    kept: Floats = np.empty((0, problem.joints))
    for _ in range(DRAWS_OF_LOOPS):
        q = rng.uniform(low, high, (max(count, HOLDING_TRIALS), problem.joints))
        kept = np.concatenate([kept, q[functions.is_assembled(q, 2.0 * LEAST_SINE)]], dtype=float)
        if len(kept) >= count:
            return kept[:count]
    raise InputError(
        "excitation: no configuration was found in which all closed loops are assembled, away from dead points; state "
        "position limits of the joints in which they are"
    )


def _initial_limits(program: ExcitationProgram, trajectory: FourierTrajectory) -> dict[tuple[str, int], set[int]]:
    """Initial sample numbers at which limits are imposed, for every (quantity, joint or axis).

    There are two per cycle of the highest harmonic, but none for torques, whose derivatives cost most: the motion that
    the other limits allow is moved as little as the torques ask for, in the stage NEAREST. Closed loops have all those
    of the objective, which a dead point between two of them would raise without limit.
    """
    problem = program.problem
    counts = {"torque": 0, "loop": problem.design_samples}
    quantities = limited_quantities(program.functions, trajectory, np.zeros(1))

    def sample_numbers(name: str) -> set[int]:
        count = min(counts.get(name, 2 * program.N), problem.samples_per_period)
        return {int(k) for k in np.linspace(0, problem.samples_per_period, count, endpoint=False)}

    return {(q.name, q.joint): sample_numbers(q.name) for q in quantities}


@reraised_interrupts()
def _exchange(
    program: ExcitationProgram,
    trajectory: FourierTrajectory,
    imposed: dict[tuple[str, int], set[int]],
    torques: bool = False,
) -> None:
    """Impose violated limits at more points in time: at the local maxima of the violation on the controller's grid.

    ``imposed`` (quantity, joint or axis) -> sample numbers is changed in place; torques are left out without
    ``torques``. Times a twelfth of a cycle of the highest harmonic before and after each are added too; otherwise
    the peak would merely move to a neighbouring point in time.
    """
    M = program.problem.samples_per_period
    beside = max(1, M // (12 * program.N))
    t = np.arange(M) * (trajectory.period / M)
    for name, i, use, _ in limited_quantities(program.functions, trajectory, t):
        if name == "torque" and not torques:
            continue
        peaks = (use >= np.roll(use, 1)) & (use >= np.roll(use, -1)) & (use > 1.0 - MARGIN)
        imposed[name, i].update(int(k + d) % M for k in np.flatnonzero(peaks) for d in (-beside, 0, beside))


@reraised_interrupts()  # the solver takes Ctrl-C for a failed evaluation and would return a perturbed result
def _solve(
    program: ExcitationProgram,
    stage: str,
    p: int,
    eigenvalue: float,
    trajectory: FourierTrajectory,
    imposed: dict[tuple[str, int], set[int]],
    history: list[tuple[str, tuple[float, ...]]],
) -> FourierTrajectory:
    """Run IPOPT on one stage from ``trajectory``, with exact gradient and limited-memory Hessian; returns the result.

    ``stage`` names the objective, or is NEAREST for the least change of the trajectory; ``p`` is the exponent of its
    norms, ``eigenvalue`` the mean eigenvalue of the information matrix at the start; limits are imposed at
    ``imposed``. The objective of every iteration is appended to ``history``.
    """
    import casadi

    constraints = program.constraints(imposed)
    linear = program.problem.limits.torque is None and program.problem.tip is None and program.problem.loops is None
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,  # a step too far is shortened
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.hessian_approximation": "limited-memory",
        "ipopt.limited_memory_max_history": 6,
        "ipopt.max_iter": program.problem.max_iterations,
        "ipopt.tol": 1e-4,
        "ipopt.acceptable_tol": 1e-3,
        "ipopt.mu_init": 1e-1 if stage == "logdet" else 1e-3,
        "ipopt.jac_d_constant": "yes" if linear else "no",
        "ipopt.jac_c_constant": "yes",
    }
    start = program.variables(trajectory)
    objective = casadi.sumsqr(program.x - start) if stage == NEAREST else program.objective(stage, p, eigenvalue)
    nlp = {"x": program.x, "f": objective, "g": casadi.vertcat(*constraints.values)}
    solver = casadi.nlpsol("excitation", "ipopt", nlp, options)
    solution = solver(x0=start, lbx=program.lower, ubx=program.upper, lbg=constraints.lower, ubg=constraints.upper)
    statistics = solver.stats()
    if statistics["return_status"] == "User_Requested_Stop":
        raise KeyboardInterrupt  # the result of an interrupted search must not be used
    path = tuple(float(v) for v in statistics.get("iterations", {}).get("obj", ()))
    history.append((f"{stage}{p or ''}", path))
    x = np.asarray(solution["x"]).ravel()
    return program.trajectory(x) if np.all(np.isfinite(x)) else trajectory


def _up_to_limits(problem: ExcitationProblem, trajectory: FourierTrajectory) -> FourierTrajectory:
    """Scale a motion that is far from every limit up about q0, as long as it meets them and is no worse conditioned.

    The condition number compares parameters with one another. Where the size of the motion does not change it, as with
    one parameter, the solver leaves the motion as small as it happens to be, and noise and friction at rest decide.
    """
    check = check_trajectory(problem, trajectory)
    for gain in GROWTH:
        while check.worst_use * gain < 1.0:
            larger = FourierTrajectory(
                trajectory.q0, trajectory.a * gain, trajectory.b * gain, trajectory.base_frequency
            )
            tried = check_trajectory(problem, larger)
            if not tried.feasible or tried.condition > check.condition * (1.0 + SAME_CONDITION):
                break
            trajectory, check = larger, tried
    return trajectory


def _turned_back(functions: ProblemFunctions, trajectory: FourierTrajectory) -> FourierTrajectory:
    """Turn back by whole turns the joints without position limits whose motion the solver has moved farther than pi."""
    turns = np.where(functions.turns_freely(), np.round(trajectory.q0 / (2.0 * np.pi)), 0.0)
    if not turns.any():
        return trajectory
    return replace(trajectory, q0=trajectory.q0 - 2.0 * np.pi * turns)


def _within_limits(problem: ExcitationProblem, trajectory: FourierTrajectory) -> FourierTrajectory:
    """Scale the motion about q0 down to remove the small violations that the solver may leave.

    A limit that is not symmetric about q0 needs more than its excess: the reduction is doubled until all limits hold.
    """
    excess = check_trajectory(problem, trajectory).worst_use - 1.0
    if not 0.0 < excess < LARGEST_SHRINKING:
        return trajectory
    shrinking = excess * (1.0 + 1e-9)
    while shrinking < 2.0 * LARGEST_SHRINKING:
        gain = 1.0 - shrinking
        smaller = FourierTrajectory(trajectory.q0, trajectory.a * gain, trajectory.b * gain, trajectory.base_frequency)
        if check_trajectory(problem, smaller).feasible:
            return smaller
        shrinking *= 2.0
    return trajectory
