"""What is verified: a compiled model, and the random states and parameters at which it is compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import DerivationError
from rrrgen.verify.references.closed_loops import LoopSolver
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, is_physical, nominal_parameters
from rrrgen.verify.report import Check, Collector, Tolerances

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

ANGLE_RANGE, STROKE, SPEED, ACCELERATION = np.pi, 0.5, 3.0, 10.0
"""States are uniform in plus or minus these: rad, m, rad/s or m/s, rad/s^2 or m/s^2. Joint limits are ignored."""


class SplitCalls:
    """A model whose functions evaluate half of the states one by one and the rest as a batch.

    Single states run the emitted functions themselves, batches the loops over vector registers: both are verified.
    """

    def __init__(self, model: Model) -> None:
        self._model = model

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._model, name)
        return self._split(value) if callable(value) else value

    @staticmethod
    def _split(function: Any) -> Any:
        def evaluate(*states: Array, **given: Any) -> Any:
            half = len(states[0]) // 2
            batch = function(*(state[half:] for state in states), **given)
            single = [function(*(state[k] for state in states), **given) for k in range(half)]
            return SplitCalls._join(single, batch) if single else batch

        return evaluate

    @staticmethod
    def _join(single: list[Any], batch: Any) -> Any:
        """The results of single states before those of a ``batch``; tuples part by part."""
        if not isinstance(batch, tuple):
            return np.concatenate([np.stack(single), batch])
        parts = [SplitCalls._join(list(row), rest) for row, rest in zip(zip(*single, strict=True), batch, strict=True)]
        return type(batch)(*parts) if hasattr(batch, "_fields") else tuple(parts)


@dataclass(frozen=True)
class States:
    """N random states ``q``, ``dq``, ``ddq`` (N, n), and vectors ``e`` (N, n) for products with transposed matrices."""

    q: Array
    dq: Array
    ddq: Array
    e: Array

    @property
    def count(self) -> int:
        """The number N of states."""
        return len(self.q)

    def at(self, chosen: NDArray[np.bool_]) -> States:
        """The states for which the mask ``chosen`` (N,) is true."""
        return States(self.q[chosen], self.dq[chosen], self.ddq[chosen], self.e[chosen])

    def first(self, count: int) -> States:
        """The first ``count`` states, or all if there are fewer."""
        return States(self.q[:count], self.dq[:count], self.ddq[:count], self.e[:count])

    def round_to(self, dtype: type[np.floating[Any]]) -> States:
        """The states rounded to the precision of ``dtype``, as float64."""
        return States(*(part.astype(dtype).astype(np.float64) for part in (self.q, self.dq, self.ddq, self.e)))


def draw_states(chain: NumericRobot, count: int, rng: np.random.Generator) -> States:
    """Draw ``count`` random states with positions over the whole range of every joint.

    Closed loops are assembled at all of them, away from dead points. Raises DerivationError where none are found.
    """
    span = np.where(chain.angles, ANGLE_RANGE, STROKE)
    shape = (count, chain.n)
    q = rng.uniform(-1, 1, shape) * span
    return States(
        _replace_unassembled(chain, q, span, rng) if chain.loops else q,
        rng.uniform(-SPEED, SPEED, shape),
        rng.uniform(-ACCELERATION, ACCELERATION, shape),
        rng.uniform(-1, 1, shape),
    )


SINE = 0.5
"""Least sine between the bars of a loop at drawn states: differences with a step need room up to the dead point, where
positions have the slope of a square root. Halved while few positions reach it."""


def _replace_unassembled(chain: NumericRobot, q: Array, span: Array, rng: np.random.Generator) -> Array:
    """Replace the positions ``q`` (N, n) at which a loop is open or near a dead point by others in ``span`` (n,)."""
    loops = LoopSolver(chain, NewtonEuler(chain.spanning_tree(), np.zeros((chain.links, 10))))
    kept, count, least = np.empty((0, chain.n)), len(q), SINE
    for _ in range(60):
        x, solved = loops.solve(q)
        kept = np.concatenate([kept, q[solved & (loops.sines(x).min(axis=1) > least)]])
        if len(kept) >= count:
            return kept[:count]
        least = least if len(kept) > count // 20 else least / 2
        q = rng.uniform(-1, 1, (max(count, 50), chain.n)) * span
    raise DerivationError(f"{chain.name}: no positions found at which the closed loops are assembled")


@dataclass(frozen=True)
class InertialParameters:
    """One set of inertial parameters: standard ones for the references, base ones for the model.

    They are ``phi`` (n, 10) and ``beta`` (b,); ``beta`` is None where the model uses its own nominal base parameters.
    ``label`` names the set in the report.
    """

    label: str
    phi: Array
    beta: Array | None

    @property
    def physical(self) -> bool:
        """Whether all links are physical, so that M(q) > 0 must hold."""
        return is_physical(self.phi)


def random_parameters(n: int, rng: np.random.Generator) -> Array:
    """Standard parameters (n, 10) of ``n`` random clouds of point masses: no entry is zero, and M(q) > 0."""
    rows = np.empty((n, 10))
    for row in rows:
        weights = rng.uniform(0.1, 1.0, 8)
        points = rng.normal(0.0, 0.15, (8, 3)) + rng.normal(0.0, 0.15, 3)
        second = np.einsum("k,ki,kj->ij", weights, points, points)
        tensor = np.trace(second) * np.eye(3) - second
        row[0], row[1:4] = weights.sum(), weights @ points
        row[4:] = [tensor[place] for place in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return rows


def parameter_sets(model: Model, rng: np.random.Generator) -> tuple[InertialParameters, ...]:
    """Parameter sets to compare with: the nominal ones if the robot file has links, and a random physical set."""
    phi = random_parameters(len(model.spec.rows), rng)
    sets = [InertialParameters("random", phi, np.asarray(model.base_projection) @ phi.ravel())]
    nominal = nominal_parameters(model.spec)
    if nominal is not None:
        sets.insert(0, InertialParameters("nominal", nominal, None))
    return tuple(sets)


@dataclass(frozen=True)
class Case:
    """What a check compares: a model with the reference ``ne`` of the same ``parameters``, at the states ``s``.

    The rows of the report go to ``rows``.
    """

    model: Model
    ne: NewtonEuler
    parameters: InertialParameters
    s: States
    tolerances: Tolerances
    rows: Collector

    @property
    def beta(self) -> Array | None:
        """The base parameters that are handed to the model, (b,); None for those of the robot file."""
        return self.parameters.beta

    @property
    def exact(self) -> Check:
        """Compares with what differs by round-off."""
        return self.against(self.ne.name, self.tolerances.exact)

    @property
    def close(self) -> Check:
        """Compares with what holds difference quotients."""
        return self.against(self.ne.name, self.tolerances.differenced)

    def against(self, reference: str, tolerance: float) -> Check:
        """Compares with another ``reference``."""
        return self.rows.against(reference, self.parameters.label, tolerance, self.s.count)

    def at(self, chosen: NDArray[np.bool_]) -> Case:
        """The same comparison at the ``chosen`` states alone."""
        return replace(self, s=self.s.at(chosen))
