"""Functions derived from the programs of other functions instead of from the chain."""

from __future__ import annotations

from collections.abc import Mapping

from rrrgen.derive.derived_model import Derivation, RecordedModel
from rrrgen.derive.functions.derivatives import differentiated, from_inverse_dynamics
from rrrgen.derive.functions.dynamic_functions import forward_dynamics
from rrrgen.program import Program

SOURCES = {
    "inverse_dynamics_derivatives": "inverse_dynamics",
    "forward_dynamics_derivatives": "inverse_dynamics_derivatives",
}
"""Function -> the function from whose program it can be derived by the chain rule."""


def by_chain_rule(recorded: RecordedModel, function: str, source: Program) -> Program:
    """``function``, a key of :data:`SOURCES`, derived from ``source``, a program of the function it maps to."""
    if function == "inverse_dynamics_derivatives":
        return differentiated(source, recorded.alternatives[function][0])
    return from_inverse_dynamics(recorded.derivation.recording(), source)


def with_forward_dynamics(derivation: Derivation, programs: Mapping[str, Program]) -> dict[str, Program]:
    """``forward_dynamics`` from the optimized programs of mass matrix and bias torques.

    Also ``forward_dynamics_nominal`` if those two functions have a nominal specialization.
    """
    program = forward_dynamics(derivation.recording(), programs["mass_matrix"], programs["bias"])
    found = {"forward_dynamics": program}
    if "mass_matrix_nominal" in programs:
        nominal = forward_dynamics(derivation.recording(), programs["mass_matrix_nominal"], programs["bias_nominal"])
        found["forward_dynamics_nominal"] = as_nominal(nominal, "forward_dynamics", program.summary)
    return found


def as_nominal(program: Program, function: str, summary: str) -> Program:
    """``program`` under the name and summary of the nominal specialization of ``function``."""
    words = summary.rstrip(".") + ", with the parameters of the robot file."
    return program.described(name=f"{function}_nominal", summary=words)
