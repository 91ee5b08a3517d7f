"""Functions that solve with M: their residuals, which are bounded where their rounding errors are not.

A function has a bound of its rounding errors where its divisors stay away from zero; see
:mod:`rrrgen.evidence.rounding`. Forward dynamics and its derivatives divide by pivots of M, so that this does not hold
for most arms: their residuals are bounded instead.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_CEILING, Context
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rrrgen.evidence.boxes import PortRange, Ranges, acceleration_range
from rrrgen.evidence.derivative_residual import OUTPUTS, derivative_residuals
from rrrgen.evidence.residual import residual_bounds
from rrrgen.evidence.rounding import DOUBLE, FLOAT, NoBoundError, Precision
from rrrgen.evidence.sampling import Evaluator, evaluate_nodes, largest_derivative_residuals, largest_residuals
from rrrgen.program import Program, Role

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rrrgen.robot.spec import RobotSpec

INVERSE = "diagonal of dddq_dtau"
"""The name of the range of the diagonal entries of the inverse of M, among those of the inputs and of ddq."""

_STATES, _MORE = 1000, 4.0


class ResidualEntry(NamedTuple):
    """Bounds of residuals by precision and output, the parts per angle, and by precision what they suppose of M.

    That is the least diagonal entry of M, kg m^2 or kg; nothing is supposed where it is 0 or missing.
    """

    bounds: dict[Precision, dict[str, list[float]]]
    parts: int
    least: dict[Precision, float]


@dataclass(frozen=True)
class Solution(ABC):
    """A program that solves with M; ``mass`` is the program of M with the same parameters."""

    program: Program
    mass: Program

    quantity = ""
    """What is bounded."""

    residual_first = False
    """Whether residuals are bounded rather than rounding errors where both can be."""

    def box(self, box: Mapping[str, PortRange], spec: RobotSpec, ranges: Ranges) -> dict[str, PortRange]:
        """The ranges over which residuals are bounded, those of results included; ``box`` has those of the inputs."""
        return {**box, "ddq": acceleration_range(spec, ranges)}

    @abstractmethod
    def bounds(self, box: Mapping[str, PortRange]) -> ResidualEntry:
        """The bounds over the ranges of :meth:`box`. Raises NoBoundError with the reason if there are none."""

    @abstractmethod
    def largest(
        self,
        box: Mapping[str, PortRange],
        precision: Precision,
        samples: int,
        seed: int,
        compiled: Evaluator | None = None,
    ) -> NDArray[np.float64]:
        """The largest residuals found, in the order of the bounds, as by ``largest_errors``."""


@dataclass(frozen=True)
class ForwardDynamics(Solution):
    """Forward dynamics; ``bias`` is the program of h = c + g."""

    bias: Program

    quantity = "residual M ddq - (tau - c - g), where the status is ok and ddq lies in the box, for any torques"
    residual_first = True

    def box(self, box: Mapping[str, PortRange], spec: RobotSpec, ranges: Ranges) -> dict[str, PortRange]:
        """The ranges but for torques, which may be any."""
        torques = {port.name for port in self.program.inputs if port.role is Role.TORQUE}
        inputs = {name: port_range for name, port_range in box.items() if name not in torques}
        return super().box(inputs, spec, ranges)

    def bounds(self, box: Mapping[str, PortRange]) -> ResidualEntry:
        """The bounds of the residual; :mod:`rrrgen.evidence.residual` has their proof."""
        ranges = {name: port_range.bounds for name, port_range in box.items()}
        bounds = residual_bounds(self.program, self.mass, self.bias, ranges, box["ddq"].upper)
        return ResidualEntry(
            {DOUBLE: {"ddq": list(bounds.double)}, FLOAT: {"ddq": list(bounds.single)}}, bounds.parts, {}
        )

    def largest(
        self,
        box: Mapping[str, PortRange],
        precision: Precision,
        samples: int,
        seed: int,
        compiled: Evaluator | None = None,
    ) -> NDArray[np.float64]:
        """The largest residual found of every joint."""
        return largest_residuals(self.program, self.mass, self.bias, box, precision, samples, seed, compiled=compiled)


@dataclass(frozen=True)
class DerivativesOfSolution(Solution):
    """The derivatives of forward dynamics; ``derivatives`` is the program of those of inverse dynamics."""

    derivatives: Program

    quantity = (
        "residuals M ddq - (tau - c - g), M dddq_dq + dtau_dq, M dddq_dv + dtau_dv and M dddq_dtau - 1, with dtau_dq "
        "at the ddq that is returned, where the status is ok, and ddq and the diagonal of dddq_dtau lie in the box"
    )

    def box(self, box: Mapping[str, PortRange], spec: RobotSpec, ranges: Ranges) -> dict[str, PortRange]:
        """The ranges of the inputs, of ddq, and of the diagonal entries of dddq_dtau."""
        return {**super().box(box, spec, ranges), INVERSE: self._inverse(box)}

    def _inverse(self, box: Mapping[str, PortRange]) -> PortRange:
        """Diagonal entries of the inverse of M that are well above those of usual states."""
        rng = np.random.default_rng(0)
        states = []
        for port in self.program.inputs:
            if port.name not in box:
                raise NoBoundError(f"the input {port.name} has no range")
            lower, upper = (np.array(bound) for bound in box[port.name].bounds)
            share = np.full((_STATES, port.size), 0.5) if port.role.is_parameter else rng.random((_STATES, port.size))
            states.append(lower + share * (upper - lower))
        values = evaluate_nodes(self.program, states, DOUBLE)
        place = [port.name for port in self.program.outputs].index("dddq_dtau")
        row = self.program.results[place]
        n = round(len(row) ** 0.5)
        largest = [float(np.max(values[row[(n + 1) * k]])) for k in range(n)]
        upward = Context(prec=2, rounding=ROUND_CEILING)
        limits = tuple(float(upward.create_decimal_from_float(_MORE * entry)) for entry in largest)
        source = f"{_MORE:g} times the largest of {_STATES} states, parameters amid their ranges"
        return PortRange((0.0,) * n, limits, source)

    def bounds(self, box: Mapping[str, PortRange]) -> ResidualEntry:
        """The bounds of the four residuals; :mod:`rrrgen.evidence.derivative_residual` has their proof."""
        ranges = {port.name: box[port.name].bounds for port in self.program.inputs if port.name in box}
        residuals = derivative_residuals(
            self.program, self.mass, self.derivatives, ranges, box["ddq"].upper, box[INVERSE].upper
        )
        bounds = {
            precision: {name: list(rows[name]) for name in OUTPUTS}
            for precision, rows in ((DOUBLE, residuals.double), (FLOAT, residuals.single))
        }
        return ResidualEntry(bounds, residuals.parts, {DOUBLE: residuals.least_double, FLOAT: residuals.least_single})

    def largest(
        self,
        box: Mapping[str, PortRange],
        precision: Precision,
        samples: int,
        seed: int,
        compiled: Evaluator | None = None,
    ) -> NDArray[np.float64]:
        """The largest residual found of every element of the four outputs."""
        return largest_derivative_residuals(
            self.program, self.derivatives, box, box[INVERSE].upper, precision, samples, seed, compiled=compiled
        )


def solution_of(programs: Mapping[str, Program], name: str) -> Solution | None:
    """The function ``name`` as one that solves with M; None if it is no such function that has bounds of residuals."""
    suffix = "_nominal" if name.endswith("_nominal") else ""
    base = name.removesuffix(suffix)
    mass, bias, derivatives = (
        programs.get(f"{function}{suffix}") for function in ("mass_matrix", "bias", "inverse_dynamics_derivatives")
    )
    if base == "forward_dynamics" and mass is not None and bias is not None:
        return ForwardDynamics(programs[name], mass, bias)
    if base == "forward_dynamics_derivatives" and mass is not None and derivatives is not None:
        return DerivativesOfSolution(programs[name], mass, derivatives)
    return None
