"""Derivation of the functions of a robot, from its exact geometry to programs and closed forms.

Other packages call the functions below, which import the heavy modules only when they run.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import Derivation, ParametrizedRobot, RecordedModel
from rrrgen.robotfile.robot_spec import RobotSpec


def prepare(spec: RobotSpec) -> Derivation:
    """Compute the exact chain of ``spec`` and its minimal base parameters, from which every function is derived.

    Raises InputError if the base parameters chosen in the robot file are no basis.
    """
    from rrrgen.derive.derived_model import Derivation
    from rrrgen.derive.functions.recording import parametrize
    from rrrgen.derive.parameters.base_parameters import base_set
    from rrrgen.derive.parameters.user_basis import change_basis
    from rrrgen.model import build_model

    model = build_model(spec)
    compiler_set = base_set(model)
    change = change_basis(spec, compiler_set) if spec.basis is not None else None
    return Derivation(spec, model, compiler_set, change, parametrize(compiler_set, change))


def parametrized(derivation: Derivation) -> ParametrizedRobot:
    """List the base parameters of the robot of ``derivation``, with names, expressions, units and nominal values.

    Raises DerivationError if a named parameter has no nominal value.
    """
    import sympy as sp

    from rrrgen.derive.derived_model import ParametrizedRobot
    from rrrgen.derive.parameters.base_parameters import BaseParameter, linear_expression, standard_symbols
    from rrrgen.derive.parameters.regrouping import regroupings
    from rrrgen.derive.recursions.chain import rational

    spec, change, parametrization = derivation.spec, derivation.basis_change, derivation.parametrization
    projection = parametrization.projection
    symbols = standard_symbols(len(spec.rows))
    expressions = change.expressions if change else [linear_expression(row, symbols) for row in projection]
    numeric = [[rational(spec.nominal(v)) for v in row] for row in projection]
    phi = _nominal_standard(spec)
    return ParametrizedRobot(
        spec=spec,
        base_parameters=tuple(
            BaseParameter(name, sp.S(expression), unit)
            for name, expression, unit in zip(parametrization.names, expressions, parametrization.units, strict=True)
        ),
        base_projection=tuple(tuple(float(v) for v in row) for row in numeric),
        regrouping=tuple(regroupings(derivation.model, derivation.compiler_basis, parametrization.names, projection)),
        beta_nominal=None if phi is None else tuple(_dot(row, phi) for row in numeric),
        drive_inertia_nominal=_nominal_drive_inertia(spec),
    )


def derive_model(spec: RobotSpec, groups: Sequence[str] = ("model",)) -> RecordedModel:
    """Derive the functions of ``groups`` and the minimal base parameters of ``spec``, before optimization.

    Raises InputError if the base parameters chosen in the robot file are no basis, DerivationError if a named parameter
    has no nominal value.
    """
    from rrrgen.derive.functions.friction_functions import (
        friction,
        friction_of,
        friction_step,
        friction_with,
        smooth_friction,
    )
    from rrrgen.derive.functions.table import functions_of

    derivation = prepare(spec)
    alternatives = {
        name: tuple(record(derivation.recording()) for record in recorders)
        for group in dict.fromkeys(groups)
        for name, recorders in functions_of(group, spec.n).items()
    }
    surfaces = friction_of(spec) if "model" in groups else ()
    if surfaces:
        alternatives["friction"] = (friction(derivation.recording()),)
    if any(surface.has_state for surface in surfaces):
        alternatives["friction_step"] = (friction_step(derivation.recording()),)
    if "model" in groups:
        alternatives["friction_with"] = (friction_with(derivation.recording()),)
        alternatives["smooth_friction"] = (smooth_friction(derivation.recording()),)
    return parametrized(derivation).recorded(derivation, alternatives)


def _nominal_standard(spec: RobotSpec) -> list[Fraction] | None:
    """The standard parameters phi (10 n,), SI units, of the links in the robot file; None if it states no links."""
    if spec.links is None:
        return None
    from rrrgen.model.standard_parameters import standard_parameters

    phi: list[Fraction] = []
    for link in spec.links:
        phi += [Fraction(int(v.p), int(v.q)) for v in standard_parameters(link)]
    return phi


def _nominal_drive_inertia(spec: RobotSpec) -> tuple[Fraction, ...] | None:
    from rrrgen.derive.recursions.chain import rational_float
    from rrrgen.model.drive_terms import inertia_terms

    return tuple(rational_float(term.value) for term in inertia_terms(spec)) or None


def _dot(row: list[Fraction | int], phi: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(row, phi, strict=True)), Fraction(0))
