"""Builds the excitation problem of a compiled robot: base regressor, limits of its file, nominal torques, tip."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.lab.design.problem import ExcitationLimits, ExcitationProblem, excitation_problem
from rrrgen.robot.friction.models import motor_friction, robot_friction
from rrrgen.robot.model.mechanism import follower_limits, refuse_newton


def limits_of(spec: Any, torque: bool = False) -> ExcitationLimits:
    """Motion limits of the joints from the robot file ``spec``; with ``torque`` also their torque limits."""

    def row(name: str) -> tuple[float | None, ...] | None:
        values = tuple(None if v is None else float(v) for v in (getattr(j.limits, name) for j in spec.joints))
        return values if any(v is not None for v in values) else None

    return ExcitationLimits(
        position_lower=row("lower"),
        position_upper=row("upper"),
        speed=row("velocity"),
        acceleration=row("acceleration"),
        torque=row("torque") if torque else None,
        followers=follower_limits(spec),
    )


SLOW = 0.001
"""Share of the largest speed below which Coulomb friction grows with the speed, so that the search has derivatives."""


def robot_problem(model: Any, limits: ExcitationLimits | None = None, **settings: Any) -> ExcitationProblem:
    """Build the excitation problem of a compiled robot (:class:`rrrgen.Model`), by default within its file's limits.

    Torque limits apply to the joint torques of the nominal model, drive inertia and friction of the robot file
    included; a Cartesian box bounds the tip; rows of a mechanism whose displacement depends on several joint positions
    stay within their range, and closed loops away from dead points. ``settings`` are further fields of
    ``ExcitationProblem``, such as ``harmonics`` or ``sample_period``. Raises InputError if torques are limited but the
    robot file has no links, or for an inconsistent problem.
    """
    import casadi

    refuse_newton(model.spec, "an exciting trajectory")
    chosen = replace(limits or limits_of(model.spec), followers=follower_limits(model.spec))
    regressor = _of_links(model)
    torque = tip = None
    if chosen.torque is not None:
        if model.beta is None:
            raise InputError("torque limits need nominal parameters: the robot file has no links")
        q, dq, ddq = (casadi.SX.sym(name, model.n) for name in ("q", "dq", "ddq"))
        if model.drive_inertia is None:
            tau = casadi.mtimes(regressor(q, dq, ddq), casadi.DM(model.beta))
        else:
            tau = model.casadi_function("inverse_dynamics_nominal")(q, dq, ddq)
        torque = casadi.Function("torque", [q, dq, ddq], [tau + _friction(model, chosen, dq, tau)])
    if chosen.box_lower is not None or chosen.box_upper is not None:
        q = casadi.SX.sym("q", model.n)
        tip = casadi.Function("tip", [q], [model.casadi_function("forward_kinematics")(q)[:3, 3]])
    loops = _loop_margins(model.spec) if model.spec.loops else None
    return excitation_problem(regressor, chosen, torque=torque, tip=tip, loops=loops, **settings)


def _loop_margins(spec: Any) -> Any:
    """The squared sines between the bars of all closed loops at q as a CasADi function, negative for open loops."""
    from rrrgen.derive import prepare
    from rrrgen.derive.functions.loops import loop_margins
    from rrrgen.derive.functions.recording import FunctionBuilder
    from rrrgen.emit.casadi.function import function

    derivation = prepare(spec)
    return function(loop_margins(FunctionBuilder(derivation.model, derivation.parametrization)), "loop_margins")


def _friction(model: Any, limits: ExcitationLimits, dq: Any, load: Any) -> Any:
    """The friction that the robot file states, (n,), a CasADi expression; zero if it states none."""
    if robot_friction(model.spec) is None and motor_friction(model.spec) is None:
        return 0.0
    speeds = [value for value in limits.row("speed", model.n) if value < math.inf]
    friction = model.casadi_function("friction", smooth_sign=SLOW * min(speeds, default=1.0))
    return friction(*([dq, load] if friction.n_in() == 2 else [dq]))


def _of_links(model: Any) -> Any:
    """The regressor of the base parameters, without the columns of the drive inertias, as a CasADi function."""
    import casadi

    regressor = model.casadi_function("regressor")
    if model.drive_inertia is None:
        return regressor
    motion = [casadi.SX.sym(name, model.n) for name in ("q", "dq", "ddq")]
    return casadi.Function("regressor", motion, [regressor(*motion)[:, : -model.drive_inertia.size]])
