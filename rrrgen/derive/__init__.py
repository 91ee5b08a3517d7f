"""Derivation of the functions of a robot, from its exact geometry to programs and closed forms.

Other packages call the functions below, which import the heavy modules only when they run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from rrrgen.base.parallel import Tell, without_collection

if TYPE_CHECKING:
    from rrrgen.derive.closed_forms import ClosedForm
    from rrrgen.derive.derived_model import Derivation, DerivedModel, ParametrizedRobot, RecordedModel
    from rrrgen.derive.functions.model_function import ModelFunction
    from rrrgen.derive.functions.table import Part
    from rrrgen.robot.spec import RobotSpec


def prepare(spec: RobotSpec) -> Derivation:
    """Compute the exact chain of ``spec`` and its minimal base parameters, from which every function is derived.

    Raises InputError if the base parameters chosen in the robot file are no basis.
    """
    from rrrgen.derive.derived_model import Derivation
    from rrrgen.derive.functions.recording import parametrize
    from rrrgen.derive.parameters.base_parameters import base_set
    from rrrgen.derive.parameters.user_basis import change_basis
    from rrrgen.robot.model import build_model

    model = build_model(spec)
    compiler_set = base_set(model)
    change = change_basis(spec, compiler_set) if spec.basis is not None else None
    return Derivation(spec, model, compiler_set, change, parametrize(compiler_set, change))


def parametrize_robot(derivation: Derivation) -> ParametrizedRobot:
    """List the base parameters of the robot of ``derivation``, with names, expressions, units and nominal values.

    Raises DerivationError if a named parameter has no nominal value.
    """
    import sympy as sp

    from rrrgen.derive.derived_model import ParametrizedRobot
    from rrrgen.derive.parameters.base_parameters import BaseParameter, linear_expression, regroupings, standard_symbols
    from rrrgen.derive.recursions.link_frames import rational

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


def derive_model(spec: RobotSpec, groups: Sequence[str] = ("model",), part: Part = "all") -> RecordedModel:
    """Derive functions of ``groups`` and the minimal base parameters of ``spec``, before optimization.

    ``part`` is "all" of these functions, or those that Python compiles "at once" or "on demand".

    Raises InputError if the base parameters chosen in the robot file are no basis, DerivationError if a named parameter
    has no nominal value.
    """
    from rrrgen.derive.functions.table import functions_for

    return record(prepare(spec), functions_for(spec, groups, part))


def record(derivation: Derivation, functions: Sequence[ModelFunction]) -> RecordedModel:
    """Record the programs of some functions of the table, before optimization.

    Args:
        derivation: the robot, as :func:`prepare` returns it.
        functions: entries of the table, in the order of emission.

    Raises:
        DerivationError: a named parameter has no nominal value.
    """
    from rrrgen.derive.functions.table import recorders, with_sources

    alternatives = {
        function.name: tuple(recorder(derivation.recording()) for recorder in recorders(function.name))
        for function in with_sources(functions)
        # the recursions for derivatives hold for constant couplings; with loops, programs are differentiated
        if function.record and not (derivation.spec.loops and function.combine and function.group == "model")
    }
    return parametrize_robot(derivation).make_recorded_model(
        derivation, alternatives, tuple(function.name for function in functions)
    )


def _nominal_standard(spec: RobotSpec) -> list[Fraction] | None:
    """The standard parameters phi (10 n,), SI units, of the links in the robot file; None if it states no links."""
    if spec.links is None:
        return None
    from rrrgen.robot.spec import standard_parameters

    phi: list[Fraction] = []
    for link in spec.links:
        phi += [Fraction(int(v.p), int(v.q)) for v in standard_parameters(link)]
    return phi


def _nominal_drive_inertia(spec: RobotSpec) -> tuple[Fraction, ...] | None:
    from rrrgen.derive.recursions.link_frames import rational_float
    from rrrgen.robot.model.drives import inertia_terms

    return tuple(rational_float(term.value) for term in inertia_terms(spec)) or None


def _dot(row: list[Fraction | int], phi: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(row, phi, strict=True)), Fraction(0))


@without_collection()
def derive(
    spec: RobotSpec,
    jobs: int = 1,
    groups: Sequence[str] = ("model",),
    tell: Tell | None = None,
    part: Part = "all",
) -> DerivedModel:
    """Derive the functions of a robot: optimized programs, with their ``_nominal`` specializations.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        jobs: the largest number of processes; the result does not depend on it.
        groups: names of groups of functions: "model", "control", "observer", "points", "trajectory".
        tell: called as ``tell(done, total, message)`` as the work proceeds.
        part: "all" of these functions, or those that Python compiles "at once" or "on demand".

    Raises:
        DerivationError: a function does not exist for this robot.
    """
    from rrrgen.derive.optimizer import Optimizer

    return Optimizer()(derive_model(spec, groups, part), jobs, tell)


def derive_once(
    spec: RobotSpec,
    groups: Sequence[str] = ("model",),
    part: Part = "all",
    jobs: int = 1,
    tell: Tell | None = None,
) -> DerivedModel:
    """The result of :func:`derive`, from the user's cache if this robot has been derived before.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        groups: names of groups of functions, as for :func:`derive`.
        part: "all" of these functions, or those that Python compiles "at once" or "on demand".
        jobs: the largest number of processes; the result does not depend on it.
        tell: called as ``tell(done, total, message)`` as the work proceeds.

    Raises:
        DerivationError: a function does not exist for this robot.
    """
    from rrrgen.derive.derived_model import join_models, recall, store
    from rrrgen.derive.functions.table import functions_for
    from rrrgen.robot.identity import identify

    identity = identify(replace(spec, ik="general"))  # no function depends on the choice of a solver
    # the cache holds the parts: what one call has derived, every other finds; no group but "model" leaves any for later
    parts: tuple[tuple[Sequence[str], Part], ...] = ((groups, part),)
    if part == "all":
        parts = ((groups, "at once"), (("model",), "on demand")) if "model" in groups else ((groups, "at once"),)
    cached_models = [recall(spec, identity, (*of, which)) for of, which in parts]
    if not any(cached_models):
        whole = derive(spec, jobs, groups, tell, part)
        for of, which in parts:
            store(whole, identity, (*of, which), functions_for(spec, of, which))
        return whole
    models = []
    for model, (of, which) in zip(cached_models, parts, strict=True):
        models.append(model or derive(spec, jobs, of, tell, which))
        if model is None:
            store(models[-1], identity, (*of, which), functions_for(spec, of, which))
    return join_models(models, functions_for(spec, groups, part))


def closed_form(spec: RobotSpec, function: str) -> ClosedForm:
    """A function of a robot as exact SymPy expressions: index the result for entries, or call ``matrix()``.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        function: name of the function such as "mass_matrix"; of one with several results, "dynamics_terms.c".

    Raises:
        DerivationError: the function has no closed form.
    """
    from rrrgen.derive.closed_forms import closed_form as closed_form_of

    return closed_form_of(prepare(spec), function)
