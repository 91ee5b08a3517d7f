"""Functions derived from the programs of other functions instead of from the chain."""

from __future__ import annotations

from collections.abc import Mapping

from rrrgen.derive.derived_model import Derivation, RecordedModel
from rrrgen.derive.functions.control import elastic
from rrrgen.derive.functions.derivatives import differentiated, from_inverse_dynamics
from rrrgen.derive.functions.dynamic_functions import forward_dynamics
from rrrgen.program import Program, nominal_name, specialization

SOURCES = {
    **dict.fromkeys(elastic.FROM_LINKS, "inverse_dynamics"),
    "inverse_dynamics_derivatives": "inverse_dynamics",
    "forward_dynamics_derivatives": "inverse_dynamics_derivatives",
}
"""Function -> the function from whose program it can be derived by the chain rule."""


def by_chain_rule(recorded: RecordedModel, function: str, source: Program) -> Program:
    """Derive a program of ``function`` by differentiating ``source``, a program of another function of the robot.

    :data:`SOURCES` says of which; ``recorded`` is the robot with all functions before optimization.
    """
    if function in elastic.FROM_LINKS:
        return elastic.FROM_LINKS[function](recorded.derivation.recording(), source)
    if function == "inverse_dynamics_derivatives":
        return differentiated(source, recorded.alternatives[function][0])
    return from_inverse_dynamics(recorded.derivation.recording(), source)


def with_forward_dynamics(derivation: Derivation, programs: Mapping[str, Program]) -> dict[str, Program]:
    """Make ``forward_dynamics`` from the optimized ``programs`` of the mass matrix and the bias torques.

    Returns it by name, and also ``forward_dynamics_nominal`` if those two functions have nominal specializations.
    """
    program = forward_dynamics(derivation.recording(), programs["mass_matrix"], programs["bias"])
    found = {"forward_dynamics": program}
    mass_matrix, bias = (specialization(programs, name) for name in ("mass_matrix", "bias"))
    if mass_matrix is not None and bias is not None:
        computed = forward_dynamics(derivation.recording(), mass_matrix, bias)
        nominal = as_nominal(computed, "forward_dynamics", program.summary)
        found[nominal.name] = nominal
    return found


def as_nominal(program: Program, function: str, summary: str) -> Program:
    """Rename ``program`` to ``<function>_nominal`` and mark it as the nominal specialization of ``function``."""
    words = summary.rstrip(".") + ", with the parameters of the robot file."
    return program.described(name=nominal_name(function), summary=words, specializes=function)
