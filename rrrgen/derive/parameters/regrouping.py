"""The regrouping table: whether each standard parameter is kept, regrouped with others or without effect, and why."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from rrrgen.derive.parameters.base_parameters import BaseSet, Regrouping, factored, standard_symbols
from rrrgen.robot.model import RobotModel
from rrrgen.robot.model.inertial_parameters import STANDARD


def regroupings(
    model: RobotModel, compiler_set: BaseSet, names: Sequence[str], projection: Sequence[Sequence[sp.Expr]]
) -> list[Regrouping]:
    """Make the regrouping table: one entry per standard parameter, link by link.

    ``names`` are the base parameters, ``projection`` (b, 10 n) their coefficients over the standard parameters.
    """
    entries = []
    for j, symbol in enumerate(standard_symbols(model.links)):
        factors = [(name, row[j]) for name, row in zip(names, projection, strict=True) if row[j] != 0]
        link, kind = j // len(STANDARD), STANDARD[j % len(STANDARD)]
        if not factors:
            entries.append(Regrouping(str(symbol), "no effect", _why_without_effect(model, link, kind)))
        elif len(factors) == 1 and _alone(factors[0][0], names, projection, j):
            entries.append(Regrouping(str(symbol), f"{factors[0][0]} = {_times(factors[0][1], symbol)}", "alone"))
        else:
            formula = ", ".join(f"{name} += {_times(factor, symbol)}" for name, factor in factors)
            entries.append(Regrouping(str(symbol), formula, _why_regrouped(model, compiler_set, link, kind)))
    return entries


def _alone(name: str, names: Sequence[str], projection: Sequence[Sequence[sp.Expr]], j: int) -> bool:
    row = projection[list(names).index(name)]
    return all(value == 0 for k, value in enumerate(row) if k != j)


def _times(factor: sp.Expr, symbol: sp.Symbol) -> str:
    return str((factored(factor) if factor.is_Add else factor) * symbol)


def _leading_parallel(model: RobotModel, link: int) -> bool:
    """Whether the links up to ``link`` on its branch rotate only about axes parallel to the first (shifts allowed)."""
    axis = None
    direction = sp.Matrix([0, 0, 1])
    R = sp.eye(3)
    branch = [model.joints[i] for i in model.path(link)]
    for k, joint in enumerate(branch):
        R = R * joint.before.R
        if joint.revolute:
            current = R * direction
            if axis is not None and sp.Matrix(axis).cross(current) != sp.zeros(3, 1):
                return False
            axis = current
            if any(not j.parallel for j in branch[k + 1 :] if j.revolute):
                return False
    return True


def _why_without_effect(model: RobotModel, link: int, kind: str) -> str:
    if not any(model.joints[i].revolute for i in model.path(link)):
        what = "its first moments and inertia have" if kind != "m" else "its mass has"
        return f"link {link + 1} does not rotate, so {what} no effect"
    if _leading_parallel(model, link):
        if kind in ("mx", "my", "m", "mz"):
            return (
                f"link {link + 1} rotates about one fixed direction only; with gravity along it, or with the origin at "
                "rest, this parameter has no effect"
            )
        return (
            f"link {link + 1} rotates about one fixed direction only; of its inertia, only the moment about that "
            "axis has an effect"
        )
    return f"the motion of link {link + 1} never excites it"


def _why_regrouped(model: RobotModel, compiler_set: BaseSet, link: int, kind: str) -> str:
    joint = model.joints[link]
    carrier = joint.parent + 1  # number of the link, 0 for the base
    extra = any(d.parameter[0] == link and d.combination for d in compiler_set.dependencies)
    if not joint.revolute:
        reason = f"joint {link + 1} is prismatic: link {link + 1} does not rotate relative to link {carrier}"
    else:
        reason = (
            f"mass along the axis of joint {link + 1} is regrouped to link {carrier}: "
            f"J{carrier} += X{link + 1} [Jzz, hz, m] X{link + 1}'"
            if carrier
            else f"joint {link + 1} rotates about a fixed axis"
        )
    if extra and _leading_parallel(model, link):
        reason += "; further axes parallel to the first one excite no more parameters"
    return reason
