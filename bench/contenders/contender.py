"""Contender: one implementation of one function, as C statements, and its comparison with the reference values."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bench.contenders.cases import Case, Numbers, References
from rrrgen.base.errors import RrrgenError
from rrrgen.verify.references.numeric_robot import Array

OURS, OURS_FILE, OURS_LIBM = "rrrgen", "rrrgen, numbers folded", "rrrgen, libm"
HAND, HAND_FILE, PINOCCHIO = "hand CasADi", "hand CasADi, file's numbers", "Pinocchio"

TITLES = {
    "inverse_dynamics": "inverse dynamics",
    "mass_matrix": "mass matrix M",
    "bias": "bias torques c + g",
    "gravity": "gravity g",
    "forward_dynamics": "forward dynamics",
    "kinematics": "FK + Jacobian",
    "regressor": "base regressor",
    "standard_regressor": "standard regressor",
    "regressor_transpose": "Y' e",
    "coriolis_matrix": "Coriolis matrix",
    "inverse_dynamics_derivatives": "inverse dynamics and its derivatives",
    "forward_dynamics_derivatives": "forward dynamics and its derivatives",
}
"""Compared functions, in the order of the report."""


ZERO = 1e-6
"""Fraction of the largest torque below which a quantity, such as the gravity torque of a vertical axis, counts as zero:
its error is then relative to this value."""


class DisagreementError(RrrgenError):
    """A contender returns wrong values, so its time cannot be compared."""

    exit_code = 1


@dataclass(frozen=True)
class Contender:
    """One implementation of one function: the C ``statements`` compute ``out`` from the state ``in``.

    ``outputs`` is the size of ``out``, ``parameters`` the vector that a regressor multiplies to give torques,
    ``operations`` the counted operations, if known.
    """

    label: str
    function: str
    outputs: int
    statements: str
    numbers: Numbers = "dense"
    parameters: Array | None = None
    operations: dict[str, int] | None = None


@dataclass
class Supplier:
    """The contenders of one supplier (rrrgen, CasADi, Pinocchio) for one robot, with the C files that they need."""

    contenders: list[Contender]
    sources: dict[str, str] = field(default_factory=dict)
    declarations: str = ""
    setup: str = ""
    cpp: tuple[str, str, tuple[str, ...]] | None = None  # a C++ file, its text and its include flags


def deviation(contender: Contender, values: Array, case: Case) -> float:
    """Largest difference to the reference over all states, relative to the largest reference value.

    A regressor is compared through ``Y beta = tau``, ``Y' e`` through ``beta' (Y' e) = e' tau``, a Coriolis matrix
    through ``C dq = c``.
    """
    reference: References = case.references[contender.numbers]
    known, N, n = reference.values, len(case.states), case.n
    name = contender.function
    if contender.parameters is not None and name == "regressor_transpose":
        got, wanted = values @ contender.parameters, np.sum(reference.e * known["inverse_dynamics"], axis=1)
    elif contender.parameters is not None:
        got, wanted = values.reshape(N, n, -1) @ contender.parameters, known["inverse_dynamics"]
    elif name == "coriolis_matrix":
        got, wanted = np.einsum("kij,kj->ki", values.reshape(N, n, n), reference.dq), known["coriolis"]
    else:
        wanted = known[name].reshape(N, -1)
        got = values
    if got.shape != wanted.shape:
        raise DisagreementError(f"{case.name}: {name} of {contender.label} returns {got.shape}, not {wanted.shape}")
    scale = max(float(np.max(np.abs(wanted))), ZERO * float(np.max(np.abs(known["inverse_dynamics"]))))
    return float(np.max(np.abs(got - wanted))) / scale
