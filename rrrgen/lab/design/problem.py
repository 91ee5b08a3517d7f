"""The optimisation problem of an exciting trajectory: regressor, measure of excitation, and limits.

A problem is plain data (its CasADi functions are serialised), so that it can be hashed, sent to another machine and
solved there: the result of a start is a pure function of (problem, seed).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

from rrrgen.base.errors import Fault, InputError
from rrrgen.robot.model.mechanism import FollowerLimits

Objective = Literal["cond", "logdet", "frobenius", "sigma_min"]
OBJECTIVES: tuple[str, ...] = get_args(Objective)

LEAST_SINE = 0.1
"""Least sine between the bars of a closed loop along a motion: the forces in the bars grow with its reciprocal."""


@dataclass(frozen=True)
class ExcitationLimits:
    """Limits on the motion, one entry per joint; None where there is no limit.

    ``speed``, ``acceleration`` and ``torque`` bound absolute values (rad/s or m/s, their rates, N m or N);
    ``position_lower`` and ``position_upper`` bound q; ``box_lower`` and ``box_upper`` (3,) bound the tip, base frame,
    m, with ``None`` for a free coordinate. ``followers`` bound those rows of a mechanism's Denavit-Hartenberg table
    whose displacement depends on several joint positions.
    """

    position_lower: tuple[float | None, ...] | None = None
    position_upper: tuple[float | None, ...] | None = None
    speed: tuple[float | None, ...] | None = None
    acceleration: tuple[float | None, ...] | None = None
    torque: tuple[float | None, ...] | None = None
    box_lower: tuple[float | None, ...] | None = None
    box_upper: tuple[float | None, ...] | None = None
    followers: tuple[FollowerLimits, ...] = ()

    def row(self, name: str, size: int) -> tuple[float, ...]:
        """The limit called ``name`` as ``size`` numbers: inf where there is none, -inf for a lower bound."""
        values: Sequence[float | None] | None = getattr(self, name)
        free = -math.inf if name.endswith("lower") else math.inf
        return tuple(free if v is None else float(v) for v in (values if values is not None else [None] * size))

    def middles(self, size: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper bounds of the middle of a motion, ``size`` each: the position limits where a joint has two.

        Else it is a range of 2 pi (rad or m), beside the one limit or about zero: without it a motion could go
        anywhere.
        """
        bounds = zip(self.row("position_lower", size), self.row("position_upper", size), strict=True)
        low, high = zip(*(_range_of_middle(*interval) for interval in bounds), strict=True)
        return low, high

    def follower_range(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper position limits of the ``followers``, joints that follow others; -inf and inf for none."""
        low = tuple(-math.inf if follower.lower is None else follower.lower for follower in self.followers)
        return low, tuple(math.inf if follower.upper is None else follower.upper for follower in self.followers)


def _range_of_middle(low: float, high: float) -> tuple[float, float]:
    if math.isfinite(low):
        return low, high if math.isfinite(high) else low + 2.0 * math.pi
    return (high - 2.0 * math.pi, high) if math.isfinite(high) else (-math.pi, math.pi)


@dataclass(frozen=True)
class ExcitationProblem:
    """The optimisation problem of (14.24): Fourier coefficients for which the stacked regressor is well conditioned.

    The motion has ``harmonics`` multiples of ``base_frequency`` (Hz) and, if ``at_rest``, stands still at the ends of a
    cycle. ``regressor`` is a serialised CasADi function (q, dq, ddq) -> Y (n, b); ``torque`` one (q, dq, ddq) -> (n,)
    and ``tip`` one q -> (3,), needed only where the torque or the tip is limited; ``loops`` is one q -> (k,), the
    squared sines between the bars of k closed loops, negative where they cannot be assembled, which stay above the
    square of :data:`LEAST_SINE`; None without loops. ``row_weights`` (n,) multiply the
    rows of Y (1/standard deviation of each joint's torque), ``column_scales`` (b,) its columns (expected parameter
    sizes): the condition number depends on units, and these make the choice of units explicit. ``objective`` is
    evaluated at ``design_samples`` times of a cycle, limits are checked every ``sample_period`` (s). A random start
    uses the share ``start_amplitude`` of the limits; the solver makes at most ``max_iterations`` in each stage.
    """

    joints: int
    columns: int
    regressor: str
    limits: ExcitationLimits
    harmonics: int = 15
    base_frequency: float = 0.1
    objective: Objective = "cond"
    at_rest: bool = False
    torque: str | None = None
    tip: str | None = None
    loops: str | None = None
    row_weights: tuple[float, ...] | None = None
    column_scales: tuple[float, ...] | None = None
    sample_period: float = 1e-3
    design_samples: int = 0
    max_iterations: int = 80
    start_amplitude: float = 0.9
    format: int = field(default=1, init=False)  # part of the digest: a new number invalidates the checkpoints before it

    def __post_init__(self) -> None:
        faults = [Fault("excitation", 0, 0, message) for message in _faults(self)]
        if faults:
            raise InputError(faults)
        if self.design_samples == 0:
            # Trapezoidal sums of a smooth periodic integrand converge exponentially once the top harmonic is sampled
            # several times per cycle; ten is enough for three digits of the condition number.
            object.__setattr__(self, "design_samples", max(10 * self.harmonics, 100))

    def to_json(self) -> dict[str, Any]:
        """All fields as plain data for JSON; :meth:`digest` is the hash of this data."""
        return asdict(self)

    def digest(self) -> str:
        """SHA-256 of the whole problem with its functions, which identifies it in checkpoints."""
        return hashlib.sha256(json.dumps(self.to_json(), sort_keys=True).encode()).hexdigest()

    @property
    def samples_per_period(self) -> int:
        """Number of controller samples per period, the grid on which a trajectory is checked."""
        return round(1.0 / (self.base_frequency * self.sample_period))


def excitation_problem(
    regressor: Any, limits: ExcitationLimits, *, torque: Any = None, tip: Any = None, loops: Any = None, **settings: Any
) -> ExcitationProblem:
    """Build a problem from CasADi functions ``regressor`` and ``torque`` of (q, dq, ddq), ``tip`` and ``loops`` of q.

    ``settings`` are the fields of :class:`ExcitationProblem`. Raises InputError, listing every fault.
    """
    rows, columns = regressor.size_out(0)
    if regressor.n_in() != 3 or any(regressor.numel_in(k) != rows for k in range(3)):
        raise InputError(f"excitation: the regressor must map (q, dq, ddq), each ({rows},), to ({rows}, b)")
    return ExcitationProblem(
        joints=rows,
        columns=columns,
        regressor=regressor.serialize(),
        limits=limits,
        torque=None if torque is None else torque.serialize(),
        tip=None if tip is None else tip.serialize(),
        loops=None if loops is None else loops.serialize(),
        **settings,
    )


def _faults(problem: ExcitationProblem) -> list[str]:
    n, limits = problem.joints, problem.limits
    faults = []
    bounds = asdict(limits)
    del bounds["followers"]
    for name, values in bounds.items():
        size = 3 if name.startswith("box") else n
        if values is not None and len(values) != size:
            faults.append(f"limit '{name}' has {len(values)} entries, needs {size}")
        bounds_size = name in ("speed", "acceleration", "torque")
        if values is not None and bounds_size and any(v is not None and not v > 0.0 for v in values):
            faults.append(f"limit '{name}' must be positive")
    for lower, upper, size in (("position_lower", "position_upper", n), ("box_lower", "box_upper", 3)):
        pairs = zip(limits.row(lower, size), limits.row(upper, size), strict=False)
        if any(low >= high for low, high in pairs):
            faults.append(f"'{lower}' must lie below '{upper}'")
    if limits.torque is not None and problem.torque is None:
        faults.append("torque limits need a torque function: a model with nominal parameters")
    if (limits.box_lower is not None or limits.box_upper is not None) and problem.tip is None:
        faults.append("a Cartesian box needs a tip function")
    if limits.speed is None and limits.acceleration is None and limits.torque is None:
        faults.append("limit the speed, the acceleration or the torque: nothing else bounds the motion")
    if problem.objective not in OBJECTIVES:
        faults.append(f"objective '{problem.objective}' is not one of {', '.join(OBJECTIVES)}")
    if problem.harmonics < (2 if problem.at_rest else 1) or not problem.base_frequency > 0.0:
        faults.append("at least one harmonic (two to start at rest) of a positive base frequency is needed")
    if problem.samples_per_period <= 2 * problem.harmonics:
        faults.append(
            f"{problem.samples_per_period} samples per period alias {problem.harmonics} harmonics: "
            f"more than {2 * problem.harmonics} are needed"
        )
    if 0 < problem.design_samples <= 2 * problem.harmonics:
        faults.append(f"{problem.design_samples} design samples alias {problem.harmonics} harmonics")
    return faults
