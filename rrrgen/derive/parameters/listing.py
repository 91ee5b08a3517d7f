"""The list of base parameters for printing in headers, reports and on the screen, with the meaning of their symbols.

All output uses the inertia *tensor* about the origin of the link frame, ``Ixy = -integral of x*y dm``, as does the
standard regressor. A robot file may be written with positive products of inertia; its expressions are converted when
they are read (:func:`rrrgen.derive.parameters.user_basis.with_signs`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rrrgen.robot.model.drives import DriveTerm, inertia_terms

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.derive.derived_model import ParametrizedRobot
    from rrrgen.robot.spec import RobotSpec

TENSOR = "Ixy = -integral of x*y dm, Ixz and Iyz alike"

LINK_PARAMETERS = (
    "Link i, in the axes of link frame i: mass mi, centre of mass xi yi zi, first moments mxi myi mzi = mi*(xi, yi, "
    f"zi), inertia tensor Ixxi Ixyi Iyyi Ixzi Iyzi Izzi about the origin of the frame, with {TENSOR}."
)
"""Meaning, frame and signs of the symbols of link parameters."""

_CONVERTED = "The robot file is written with the opposite sign of Ixy, Ixz, Iyz; what is printed here is converted."

_REGROUPED = (
    "A name ending in R (regrouped) is an entry of link i in the axes of joint i (m mass, h first moment, "
    "J = integral of r r' dm, Izz = Jxx + Jyy) together with what other links add to it."
)


@dataclass(frozen=True)
class PrintedParameter:
    """One base parameter: name, unit, expression in the link parameters, nominal value (None without link data)."""

    name: str
    unit: str
    expression: sp.Expr
    nominal: float | None


_NUMERICAL = (
    "Which parameters are identifiable, and the factors, are numerical results: rank and solutions of the regressor in "
    "numbers of 60 digits, at states of loops that Newton's method solves."
)


@dataclass(frozen=True)
class ParameterListing:
    """The base parameters of one robot (``rows``), and its ``drives``, the drive inertias.

    ``statement`` defines the symbols and the signs of their expressions.
    """

    statement: str
    rows: tuple[PrintedParameter, ...]
    drives: tuple[PrintedParameter, ...] = ()

    @property
    def beta(self) -> tuple[PrintedParameter, ...]:
        """The elements of the port beta: base parameters, then drive inertias."""
        return self.rows + self.drives

    def heading(self, beta: str) -> str:
        """What the array ``beta`` is, and the meaning of the symbols in its elements."""
        if not self.drives:
            return f"Base parameters {beta}. {self.statement}"
        seen = "drive inertia seen at its joint, or at the motor it is named after"
        return f"Base parameters, then drive inertias: {beta}. {self.statement} Ia: {seen}."


def listing(model: ParametrizedRobot) -> ParameterListing:
    """List the base parameters of ``model`` for headers, ``rrrgen show``, reports, the manifest and CasADi modules."""
    spec = model.spec
    positive = any(link.products == "positive" for link in spec.links or ())
    positive |= spec.basis is not None and spec.basis.products == "positive"
    sentences = [LINK_PARAMETERS]
    sentences += [_CONVERTED] if positive else []
    sentences += [_REGROUPED] if spec.basis is None else []
    sentences += [_NUMERICAL] if spec.newton else []
    nominal = model.beta_nominal
    values = [None] * model.b if nominal is None else [float(value) for value in nominal]
    rows = zip(model.base_parameters, values, strict=True)
    return ParameterListing(
        " ".join(sentences),
        tuple(PrintedParameter(p.name, p.unit, p.expression, value) for p, value in rows),
        tuple(_drive_inertia(spec, term) for term in inertia_terms(spec)),
    )


def _drive_inertia(spec: RobotSpec, term: DriveTerm) -> PrintedParameter:
    """The drive inertia of ``term`` as an element of beta."""
    import sympy as sp

    moved = [joint for joint, weight in zip(spec.joints, term.direction, strict=True) if weight]
    unit = "kg m^2" if all(joint.is_revolute for joint in moved) else "kg"
    return PrintedParameter(term.name, unit, sp.Symbol(term.name), term.value)
