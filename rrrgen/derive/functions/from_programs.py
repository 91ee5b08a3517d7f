"""Functions derived from the programs of other functions, instead of from the chain."""

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
"""Functions that follow from another by the chain rule, and which."""


def by_chain_rule(recorded: RecordedModel, function: str, source: Program) -> Program:
    """``function``, one of :data:`SOURCES`, from a program of its source."""
    if function == "inverse_dynamics_derivatives":
        return differentiated(source, recorded.alternatives[function][0])
    return from_inverse_dynamics(recorded.derivation.recording(), source)


def with_forward_dynamics(derivation: Derivation, programs: Mapping[str, Program]) -> dict[str, Program]:
    """``forward_dynamics`` from the programs of the mass matrix and the bias torques, and its nominal specialization.

    The latter only where those two have one. Both programs are used as they are, so the cheapest ones are wanted.
    """
    program = forward_dynamics(derivation.recording(), programs["mass_matrix"], programs["bias"])
    found = {"forward_dynamics": program}
    if "mass_matrix_nominal" in programs:
        nominal = forward_dynamics(derivation.recording(), programs["mass_matrix_nominal"], programs["bias_nominal"])
        found["forward_dynamics_nominal"] = as_nominal(nominal, "forward_dynamics", program.summary)
    return found


def as_nominal(program: Program, function: str, summary: str) -> Program:
    """``program``, which has the file's numbers in it, described as the nominal specialization of ``function``."""
    words = summary.rstrip(".") + ", with the parameters of the robot file."
    return program.described(name=f"{function}_nominal", summary=words)
