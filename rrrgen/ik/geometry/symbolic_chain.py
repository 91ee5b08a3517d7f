"""Chains with symbols or exact numbers in place of floats, for closed forms that are printed as formulas."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import sympy as sp

from rrrgen.ik.geometry.chain import KinematicChain, exact_chain
from rrrgen.ik.geometry.nearly_special import exact_like
from rrrgen.ik.plan import SolverPlan
from rrrgen.robot.spec import parameter_symbol

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


def symbolic_chain(spec: RobotSpec, plan: SolverPlan) -> tuple[KinematicChain, tuple[tuple[sp.Symbol, sp.Expr], ...]]:
    """The chain with symbols for its DH values, and the table (symbol, value).

    Special values, such as 0 and multiples of 90 degrees, stay numbers, because the closed form was chosen for them.
    """
    values: list[tuple[sp.Symbol, sp.Expr]] = []
    signed = {
        parameter_symbol(name): sp.Symbol(name, positive=True) if value > 0 else sp.Symbol(name, real=True)
        for name, value in spec.parameters.items()
    }

    def symbol(letter: str, i: int, value: sp.Expr) -> sp.Expr:
        nominal = spec.nominal(value)
        angle = letter in ("alpha", "theta")
        if nominal.is_zero or (angle and (2 * nominal / sp.pi).is_integer):
            return nominal
        sign = {"positive": True} if nominal > 0 else {"negative": True}
        name = sp.Symbol(f"{letter}_{i}", **sign) if value.is_number else value.xreplace(signed)
        if value.is_number:
            values.append((name, nominal))
        return name

    joints = tuple(
        replace(
            joint,
            alpha=symbol("alpha", i, joint.alpha),
            a=symbol("a", i, joint.a),
            d=symbol("d", i, joint.d),
            theta=symbol("theta", i, joint.theta),
        )
        for i, joint in enumerate(spec.joints, start=1)
    )
    exact = exact_chain(replace(spec, joints=joints), nominal=False)
    if plan.solving.n != exact.n:  # virtual joints have numbers only
        return plan.solving, ()
    return exact_like(exact, plan.solving), tuple(values)


def number_chain(spec: RobotSpec, plan: SolverPlan) -> KinematicChain:
    """The chain that ``plan`` solves, in exact numbers; in floats where it has virtual joints."""
    exact = exact_chain(spec)
    return plan.solving if plan.solving.n != exact.n else exact_like(exact, plan.solving)
