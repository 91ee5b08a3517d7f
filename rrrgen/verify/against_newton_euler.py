"""Comparison of every function of the model with the built-in Newton-Euler recursion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from rrrgen.robot.spec import FrictionSpec, MotorSpec, RobotSpec
from rrrgen.verify.identities import SECOND_STEP, check_refusal, is_definite
from rrrgen.verify.references.friction_laws import (
    change_parameters,
    has_load,
    has_state,
    integrate,
    parameters_of,
    sliding,
)
from rrrgen.verify.references.newton_euler import FUNCTIONS_OF_POSITION, BaseState, NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, motor_loads, motor_speeds
from rrrgen.verify.report import Check, Collector, Tolerances, curvature, curvature_scale, rate, size
from rrrgen.verify.subject import SPEED, Case, States, draw_states

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

RANK_STATES = 40  # at least four rows of the stacked regressor per standard parameter
RANK_THRESHOLD = 1e-10  # relative to the largest singular value; exact zeros are computed as about 1e-15
NEARLY_SPECIAL = 1.1e-4  # quarter turns or rad; what acts by the square of a smaller angle is near RANK_THRESHOLD
RESIDUE = 1e-25  # what terms of size 1 that cancel leave in 30 digits
NO_PARAMETERS = "-"
LIFT = 10.0  # m/s^2 and rad/s^2, size of the accelerations of a floating base


def check_kinematics(model: Model, ne: NewtonEuler, s: States, tolerances: Tolerances, rows: Collector) -> None:
    """Compare the poses and Jacobians of all link frames and of the tip with those of the reference ``ne``."""
    check = rows.against(ne.name, NO_PARAMETERS, tolerances.exact, s.count)
    for name in FUNCTIONS_OF_POSITION:
        check(name, partial(_at, model, name, s.q), getattr(ne, name)(s.q))
    J, acceleration = ne.jacobian(s.q), ne.jacobian_dot_dq(s.q, s.dq)
    check("kinematics: T", lambda: model.kinematics(s.q)[0], ne.forward_kinematics(s.q))
    check("kinematics: J", lambda: model.kinematics(s.q)[1], J)
    scale = max(size(acceleration), size(J) * size(s.dq) ** 2)
    check("jacobian_dot_dq", lambda: model.jacobian_dot_dq(s.q, s.dq), acceleration, scale=scale)
    if model.spec.floating_base:
        _check_floating_tip(model, ne, "", s, check)


def check_tip(
    model: Model,
    ne: NewtonEuler,
    tip: str,
    carrier: int | None,
    s: States,
    tolerances: Tolerances,
    rows: Collector,
) -> None:
    """Compare pose, Jacobian and target of a named ``tip`` with those of ``ne``, the same robot with this tip.

    ``carrier`` is the link in whose frame targets are given; None for the base.
    """
    check = rows.against(ne.name, NO_PARAMETERS, tolerances.exact, s.count)
    T, J, acceleration = ne.forward_kinematics(s.q), ne.jacobian(s.q), ne.jacobian_dot_dq(s.q, s.dq)
    check(f"{tip}_forward_kinematics", lambda: model.forward_kinematics(s.q, tip=tip), T)
    check(f"{tip}_jacobian", lambda: model.jacobian(s.q, tip=tip), J)
    check(f"{tip}_kinematics: T", lambda: model.kinematics(s.q, tip=tip)[0], T)
    check(f"{tip}_kinematics: J", lambda: model.kinematics(s.q, tip=tip)[1], J)
    scale = max(size(acceleration), size(J) * size(s.dq) ** 2)
    check(f"{tip}_jacobian_dot_dq", lambda: model.jacobian_dot_dq(s.q, s.dq, tip=tip), acceleration, scale=scale)
    if model.spec.floating_base:
        _check_floating_tip(model, ne, tip, s, check)
    if carrier is not None:
        seen = np.asarray(np.linalg.inv(ne.link_frames(s.q)[:, carrier]) @ T)
        check(f"{tip}_tip_target", lambda: model.tip_target(T, s.q, tip=tip), seen)


def _check_floating_tip(model: Model, ne: NewtonEuler, tip: str, s: States, check: Check) -> None:
    """Compare the Jacobian of a named ``tip``, or of the unnamed one, on a floating base with that of ``ne``."""
    twist = draw_base(s.count, np.random.default_rng(0)).twist
    J, acceleration = ne.floating_jacobian(s.q), ne.floating_jacobian_dot_dq(s.q, s.dq, twist)
    prefix, named = (f"{tip}_", {"tip": tip}) if tip else ("", {})
    scale = max(size(acceleration), size(J) * max(size(s.dq), size(twist)) ** 2)
    check(f"{prefix}floating_jacobian", lambda: model.floating_jacobian(s.q, **named), J)
    call = partial(model.floating_jacobian_dot_dq, s.q, s.dq, twist, **named)
    check(f"{prefix}floating_jacobian_dot_dq", call, acceleration, scale=scale)


TICK = 1e-3
"""Period, s, after which loops are solved anew."""


def check_loops(model: Model, ne: NewtonEuler, s: States, tolerances: Tolerances, rows: Collector) -> None:
    """Compare the passive joints of closed loops and their rates with a numerical solution of the loops."""
    if ne.loops is None:
        return
    check, n = rows.against("Newton's method (built in)", NO_PARAMETERS, tolerances.exact, s.count), ne.chain.n
    x, _ = ne.loops.solve(s.q)
    rates, y = ne.loops.passive_rates(x), x[:, n:]
    turning = np.array([ne.chain.revolute[row] for loop in ne.chain.loops for row in loop.passive])
    turned = np.stack([np.where(turning, np.cos(y), y), np.where(turning, np.sin(y), 0.0)], axis=2)
    check("closed_loops: passive", lambda: model.closed_loops(s.q).passive, turned)
    check("closed_loops: W", lambda: model.closed_loops(s.q).W, rates)
    check("closed_loops: sine", lambda: model.closed_loops(s.q).sine, ne.loops.sines(x))
    if ne.chain.loops[0].start:
        q_last = s.q - TICK * s.dq
        last = ne.loops.solve(q_last)[0][:, n:]
        check("solve_loops", lambda: model.solve_loops(s.q, q_last, last).loop_q, y)


def _at(model: Model, name: str, q: Array) -> Array:
    return np.asarray(getattr(model, name)(q))


def check_regressors(model: Model, ne: NewtonEuler, s: States, tolerances: Tolerances, rows: Collector) -> None:
    """Check that ``Y = Y_base K`` holds, and that the base regressor Y_base has as many columns as the rank of Y.

    Y is the standard regressor of the reference, K the model's projection of standard on base parameters.
    """
    check = rows.against(ne.name, NO_PARAMETERS, tolerances.exact, s.count)
    Y, K = ne.standard_regressor(s.q, s.dq, s.ddq), np.asarray(model.base_projection)
    applied = np.einsum("nij,ni->nj", Y, s.e)
    check("standard_regressor", lambda: model.standard_regressor(s.q, s.dq, s.ddq), Y)
    check("regressor K", lambda: np.asarray(model.regressor(s.q, s.dq, s.ddq)) @ K, Y)
    check("regressor_transpose K", lambda: np.asarray(model.regressor_transpose(s.q, s.dq, s.ddq, s.e)) @ K, applied)
    extra = _extra_columns(model, s)
    check(
        "identification_regressor",
        lambda: _identification_columns(model, K, s, extra),
        np.concatenate([Y, extra], axis=2),
    )
    s = draw_states(ne.chain, RANK_STATES, np.random.default_rng(0))
    if model.spec.floating_base:
        return  # check_floating_base has the rank of the regressor with the rows of the wrench
    expected = np.full(2, float(scaled_rank(ne.standard_regressor(s.q, s.dq, s.ddq))))
    if len(K) > expected[0] and is_nearly_special(model.spec):  # what the last parameters do is below round-off
        of_model = "rank of the regressor, nearly special arm"
        check(of_model, lambda: np.full(2, float(scaled_rank(model.regressor(s.q, s.dq, s.ddq)))), expected, scale=1.0)
        return
    check(
        "number of base parameters (rank)",
        lambda: np.array([len(K), len(model.base_parameter_names)], dtype=np.float64),
        expected,
        scale=1.0,
    )


def draw_base(count: int, rng: np.random.Generator) -> BaseState:
    """Draw ``count`` random states of a floating base, in any orientation."""
    orientation = rng.normal(size=(count, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    return BaseState(orientation, rng.uniform(-SPEED, SPEED, (count, 6)), rng.uniform(-LIFT, LIFT, (count, 6)))


def turn_orientation(orientation: Array, rotation: Array) -> Array:
    """The quaternion (..., 4), x, y, z, w, of a base turned by the rotation vector (..., 3), rad, in its own axes."""
    angle = np.linalg.norm(rotation, axis=-1, keepdims=True)
    u, w = 0.5 * np.sinc(angle / (2.0 * np.pi)) * rotation, np.cos(0.5 * angle)
    v, s = orientation[..., :3], orientation[..., 3:]
    return np.concatenate([s * u + w * v + np.cross(v, u), s * w - np.sum(v * u, axis=-1, keepdims=True)], axis=-1)


def check_floating_base(case: Case) -> None:
    """Compare the dynamics on a floating base with the reference, and the base parameters with the rank of its rows."""
    model, ne, s, beta, check = case.model, case.ne, case.s, case.beta, case.exact
    if not model.spec.floating_base:
        return
    base = draw_base(s.count, np.random.default_rng(0))
    pose, twist, twist_rate = base.orientation, base.twist, base.twist_rate
    wrench, tau = ne.floating_inverse_dynamics(s.q, s.dq, s.ddq, base)
    both = np.concatenate([wrench, tau], axis=1)
    rest = replace(base, twist_rate=np.zeros_like(base.twist_rate))
    h = np.concatenate(ne.floating_inverse_dynamics(s.q, s.dq, np.zeros_like(s.q), rest), axis=1)

    def forces() -> Array:
        floating_forces = model.floating_inverse_dynamics(s.q, s.dq, s.ddq, pose, twist, twist_rate, beta=beta)
        return np.concatenate([floating_forces.wrench, floating_forces.tau], axis=1)

    def regenerate_forces() -> Array:
        accelerations = model.floating_forward_dynamics(s.q, s.dq, tau, pose, twist, wrench, beta=beta)
        back = replace(base, twist_rate=np.asarray(accelerations.twist_rate))
        return np.concatenate(ne.floating_inverse_dynamics(s.q, s.dq, np.asarray(accelerations.ddq), back), axis=1)

    check("floating_inverse_dynamics", forces, both)
    check("floating_mass_matrix", lambda: model.floating_mass_matrix(s.q, beta=beta), ne.floating_mass_matrix(s.q))
    momentum, A = ne.floating_momentum(s.q, s.dq, twist), ne.floating_mass_matrix(s.q)[:, :6]
    of_terms = size(A) * max(size(s.dq), size(twist))
    call = partial(model.floating_momentum, s.q, s.dq, twist, beta=beta)
    check("floating_momentum", call, momentum, scale=of_terms)
    check("floating_momentum_matrix", lambda: model.floating_momentum_matrix(s.q, beta=beta), A)
    check("floating_bias", lambda: model.floating_bias(s.q, s.dq, pose, twist, beta=beta), h, scale=size(both))
    if case.parameters.physical:
        check("floating_forward_dynamics (as forces)", regenerate_forces, both)
    Y, K = ne.floating_regressor(s.q, s.dq, s.ddq, base), np.asarray(model.base_projection)
    check("floating_regressor K", lambda: model.floating_regressor(s.q, s.dq, s.ddq, pose, twist, twist_rate) @ K, Y)
    sensors = base.sensors(ne.chain.gravity)

    def from_imu() -> Array:
        floating_forces = model.floating_inverse_dynamics_from_imu(s.q, s.dq, s.ddq, *sensors, beta=beta)
        return np.concatenate([floating_forces.wrench, floating_forces.tau], axis=1)

    check("floating_inverse_dynamics_from_imu", from_imu, both)
    regressor_from_imu = partial(model.floating_regressor_from_imu, s.q, s.dq, s.ddq, *sensors)
    check("floating_regressor_from_imu K", lambda: regressor_from_imu() @ K, Y)
    _check_floating_derivatives(case, base)
    s, base = (
        draw_states(ne.chain, RANK_STATES, np.random.default_rng(0)),
        draw_base(RANK_STATES, np.random.default_rng(1)),
    )
    rank = scaled_rank(ne.floating_regressor(s.q, s.dq, s.ddq, base))
    check("number of base parameters (rank)", lambda: np.array([float(len(K))]), np.array([float(rank)]), scale=1.0)


def _check_floating_derivatives(case: Case, base: BaseState) -> None:
    """Compare the derivatives of wrench and torques on a floating base with differences of those of ``ne``."""
    ne, s, exact, close = case.ne, case.s, case.exact, case.close
    size_of_state, step = 6 + s.q.shape[1], case.tolerances.step

    @cache
    def answer() -> Any:
        of_base = base.orientation, base.twist, base.twist_rate
        return case.model.floating_inverse_dynamics_derivatives(s.q, s.dq, s.ddq, *of_base, beta=case.beta)

    def forces(moved: Array, faster: Array) -> Array:
        """Wrench and torques (m, N, 6 + n) after changes (m, 6 + n) of pose and q, and of twist and dq."""
        x, u = moved[:, None], faster[:, None]
        orientation = turn_orientation(base.orientation, x[..., 3:6])
        parts = np.broadcast_arrays(s.q + x[..., 6:], s.dq + u[..., 6:], s.ddq)
        of_base = np.broadcast_arrays(base.twist + u[..., :6], base.twist_rate)
        q, dq, ddq, *moving = (part.reshape(-1, part.shape[-1]) for part in (*parts, orientation, *of_base))
        floating_forces = np.concatenate(ne.floating_inverse_dynamics(q, dq, ddq, BaseState(*moving)), axis=1)
        return np.asarray(floating_forces.reshape(len(moved), s.count, size_of_state))

    rest, units = np.zeros((size_of_state, size_of_state)), np.eye(size_of_state)
    by_q = np.moveaxis(rate(lambda t: forces(t * units, rest), step), 0, 2)
    by_v = np.moveaxis(rate(lambda t: forces(rest, t * units), step), 0, 2)
    tau = forces(rest[:1], rest[:1])[0]
    scale = max(size(by_q), size(by_v), size(tau))
    name = "floating_inverse_dynamics_derivatives"
    exact(f"{name}: f", lambda: np.concatenate([answer()[0], answer()[1]], axis=1), tau)
    close(f"{name}: df_dq", lambda: answer()[2], by_q, scale=scale)
    close(f"{name}: df_dv", lambda: answer()[3], by_v, scale=scale)
    exact(f"{name}: M", lambda: answer()[4], ne.floating_mass_matrix(s.q))


def check_floating_second_derivatives(case: Case) -> None:
    """Compare the Hessian of weighted wrench and torques on a floating base with second differences of those of ``ne``.

    They are along one random direction of translation, rotation, q, twist, dq, twist_rate and ddq at each state, where
    the base turns about a fixed axis at a constant rate: along the exponential map.
    """
    model, ne, s, beta, close = case.model, case.ne, case.s, case.beta, case.close
    if not model.spec.floating_base:
        return
    count, n = s.q.shape
    rng = np.random.default_rng(count)
    base, w = draw_base(count, rng), rng.uniform(-1.0, 1.0, (count, 6 + n))
    direction = rng.normal(size=(count, 3 * (6 + n)))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    x, v, a = np.split(direction, 3, axis=1)
    of_base = base.orientation, base.twist, base.twist_rate

    def weighted_forces(t: float) -> Array:
        moving = BaseState(
            turn_orientation(base.orientation, t * x[:, 3:6]), base.twist + t * v[:, :6], base.twist_rate + t * a[:, :6]
        )
        joints = s.q + t * x[:, 6:], s.dq + t * v[:, 6:], s.ddq + t * a[:, 6:]
        return np.asarray(np.sum(w * np.concatenate(ne.floating_inverse_dynamics(*joints, moving), axis=1), axis=1))

    @cache
    def answer() -> Any:
        return model.floating_inverse_dynamics_hessian(s.q, s.dq, s.ddq, w, *of_base, beta=beta)

    def product() -> Array:
        products = model.floating_inverse_dynamics_hessian_product(s.q, s.dq, s.ddq, w, direction, *of_base, beta=beta)
        return np.asarray(np.sum(np.asarray(products) * direction, axis=1))

    first, second = rate(weighted_forces, SECOND_STEP), curvature(weighted_forces, SECOND_STEP)
    name = "floating_inverse_dynamics_hessian"
    close(f"{name}: gradient' v", lambda: np.einsum("ki,ki->k", answer()[0], direction), first)
    scale = curvature_scale(second, weighted_forces(0.0))
    close(f"{name}: v' H v", lambda: np.einsum("ki,kij,kj->k", direction, answer()[1], direction), second, scale=scale)
    close(f"{name}_product: v' H v", product, second, scale=scale)


def is_nearly_special(spec: RobotSpec) -> bool:
    """Whether an angle of the table, or gravity in the frame of the first row, is nearly but not exactly special.

    Special are multiples of pi/2 and directions along or normal to an axis; nearly is within :data:`NEARLY_SPECIAL`.
    """
    angles = [spec.nominal(angle) / (sp.pi / 2) for row in spec.rows for angle in (row.alpha, row.theta)]
    gaps = [angle - sp.floor(angle + sp.Rational(1, 2)) for angle in angles]
    g = sp.Matrix(spec.gravity)
    gaps += sp.Matrix(3, 3, list(spec.base.rotation)).T * g / (g.norm() or 1)
    return any(RESIDUE < abs(spec.nominal(gap).evalf(30)) < NEARLY_SPECIAL for gap in gaps)


def scaled_rank(Y: Array) -> int:
    """The rank of a regressor (states, n, columns) stacked over its states, with non-zero columns of unit length."""
    Y = np.asarray(Y, dtype=np.float64).reshape(-1, Y.shape[-1])
    norms = np.linalg.norm(Y, axis=0)
    used = norms > RANK_THRESHOLD * max(size(norms), 1e-300)
    singular_values = np.linalg.svd(Y[:, used] / norms[used], compute_uv=False)
    return int(np.sum(singular_values > RANK_THRESHOLD * size(singular_values)))


STEP = 2.0**-10  # s, the period at which laws with a state are compared
DEFLECTION = 1e-5  # rad or m, size of the states (bristle deflections) at which these laws are compared
LOAD = 20.0  # N m or N, size of the torques of the load


def check_friction(model: Model, s: States, tolerances: Tolerances, rows: Collector) -> None:
    """Compare friction, in sliding and over one period, with a second implementation of the laws.

    Friction must be zero where the robot file states none.
    """
    spec = model.spec
    stated = [joint.friction for joint in spec.joints]
    speeds, lever = s.dq, np.eye(spec.n)
    load = LOAD * np.sin(np.arange(s.dq.size, dtype=float)).reshape(s.dq.shape)
    loads = load
    if spec.drives is not None:  # friction at a motor has the same power as its contribution to the joint torques
        stated += [motor.friction for motor in spec.drives.motors]
        speeds = np.concatenate([speeds, motor_speeds(spec, s.dq)], axis=1)
        lever = np.concatenate([lever, motor_speeds(spec, np.eye(spec.n)).T])
        loads = np.concatenate([loads, motor_loads(spec, load)], axis=1)
    given = (load,) if any(has_load(friction) for friction in stated) else ()
    check = rows.against("(14.11) to (14.14)", NO_PARAMETERS, tolerances.exact, s.count)
    columns = zip(stated, speeds.T, loads.T, strict=True)
    torques = np.stack([sliding(friction, v, load=at) for friction, v, at in columns], axis=1)
    check("friction", lambda: model.friction(s.dq, *given), torques @ lever)
    _check_run_time_friction(model, s, load, rows, tolerances)
    moved = [k for k, friction in enumerate(stated) if has_state(friction)]
    if not moved:
        return
    z = DEFLECTION * np.cos(np.arange(s.count * len(moved), dtype=float)).reshape(s.count, len(moved))
    after = np.zeros_like(z)
    for i, k in enumerate(moved):
        friction = stated[k]
        assert friction is not None
        after[:, i], torques[:, k] = integrate(friction, speeds[:, k], z[:, i], STEP, loads[:, k])
    period = np.full(s.count, STEP)
    check("friction_step: z", lambda: model.friction_step(s.dq, z, period, *given)[0], after)
    check("friction_step: tau_f", lambda: model.friction_step(s.dq, z, period, *given)[1], torques @ lever)


WIDTH = 0.3  # rad/s or m/s, width of tanh(v / WIDTH) in place of sgn(v) where smooth friction is compared


@dataclass(frozen=True)
class ChangedFriction:
    """Friction by the laws of the robot file with other parameters, none of them zero, so that each is compared.

    ``stated`` are these laws of all joints, then of coupled motors, None where there is no friction. ``values`` are the
    parameters in the order in which the emitted functions take them, ``laws`` is the number of joints and motors with
    friction.
    """

    spec: RobotSpec
    stated: tuple[FrictionSpec | None, ...]
    values: tuple[float, ...]
    laws: int

    def torques(self, dq: Array, load: Array, width: float = 0.0) -> Array:
        """Friction torques at the speeds ``dq`` under the torques ``load``, smoothed by ``width``; (N, n) each."""
        total = np.zeros_like(dq)
        for friction, (v, lever_arm, at) in zip(self.stated, _owners(self.spec, dq, load), strict=True):
            if friction is not None:
                total += sliding(friction, v, width, at)[:, None] * lever_arm
        return total


def changed_friction(spec: RobotSpec) -> ChangedFriction:
    """The laws of ``spec`` with other parameters; where it states no friction, the default law at every joint."""
    laws = [joint.friction for joint in spec.joints]
    if spec.drives is not None:
        laws += [motor.friction for motor in spec.drives.motors]
    if not any(laws):
        laws[: spec.n] = [FrictionSpec()] * spec.n
    stated = tuple(None if friction is None else change_parameters(friction) for friction in laws)
    known = [friction for friction in stated if friction is not None]
    return ChangedFriction(spec, stated, tuple(v for law in known for v in parameters_of(law)), len(known))


def _owners(spec: RobotSpec, dq: Array, load: Array) -> list[tuple[Array, Array, Array]]:
    """Speed (N,), joint torques per unit (n,) and load (N,) of every joint, then of every coupled motor."""
    owners = [(dq[:, i], np.eye(spec.n)[i], load[:, i]) for i in range(spec.n)]
    if spec.drives is not None:
        speeds, lever, loads = motor_speeds(spec, dq), motor_speeds(spec, np.eye(spec.n)).T, motor_loads(spec, load)
        owners += [(speeds[:, k], lever[k], loads[:, k]) for k in range(len(spec.drives.motors))]
    return owners


def _check_run_time_friction(model: Model, s: States, load: Array, rows: Collector, tolerances: Tolerances) -> None:
    """Compare the functions with friction parameters as inputs, exact and smooth, at values other than the file's."""
    other = changed_friction(model.spec)
    check = rows.against("(14.11) to (14.14)", NO_PARAMETERS, tolerances.exact, s.count)
    given, widths = np.tile(other.values, (s.count, 1)), np.full((s.count, other.laws), WIDTH)
    last = (load,) if any(has_load(friction) for friction in other.stated) else ()
    smooth = other.torques(s.dq, load, WIDTH)
    check("friction_with", lambda: model.friction_with(s.dq, given, *last), other.torques(s.dq, load))
    check("smooth_friction", lambda: model.smooth_friction(s.dq, given, widths, *last), smooth)


def _extra_columns(model: Model, s: States) -> Array:
    """The columns (N, n, extra) of the regressor for drive inertia, viscous and Coulomb friction and offset.

    There is one column for every such term that the robot file states.
    """
    signals = {"inertia": s.ddq, "viscous": s.dq, "coulomb": np.sign(s.dq), "offset": np.ones_like(s.q)}
    columns = []
    for kind, signal in signals.items():
        for i, joint in enumerate(model.spec.joints):
            owner = joint.drive if kind == "inertia" else joint.friction
            if owner is not None and getattr(owner, kind) is not None:
                columns.append(np.zeros_like(s.q))
                columns[-1][:, i] = signal[:, i]
    if model.spec.drives is not None:
        columns += _motor_columns(model.spec, model.spec.drives.motors, s)
    return np.stack(columns, axis=2) if columns else np.zeros((*s.q.shape, 0))


def _motor_columns(spec: RobotSpec, motors: Sequence[MotorSpec], s: States) -> list[Array]:
    """The columns (N, n) of the regressor for coupled motors: joint torques per unit of each term of a motor."""
    speeds, accelerations = motor_speeds(spec, s.dq), motor_speeds(spec, s.ddq)
    signals = {"inertia": accelerations, "viscous": speeds, "coulomb": np.sign(speeds), "offset": np.ones_like(speeds)}
    lever = motor_speeds(spec, np.eye(spec.n))  # joint by motor
    columns = []
    for k, motor in enumerate(motors):
        for kind, signal in signals.items():
            owner = motor if kind == "inertia" else motor.friction
            if owner is not None and getattr(owner, kind) is not None:
                columns.append(signal[:, [k]] * lever[:, k])
    return columns


def _identification_columns(model: Model, K: Array, s: States, extra: Array) -> Array:
    """Identification regressor of the model in standard parameters: base columns times K, then the drive columns.

    The drive columns are put into the order of those of the reference, ``extra`` (N, n, extra).
    """
    got = np.asarray(model.identification_regressor(s.q, s.dq, s.ddq))
    names = len(model.identification_parameter_names)
    if got.shape[-1] != names or names != len(K) + extra.shape[-1]:
        raise ValueError(f"{got.shape[-1]} columns and {names} names instead of {len(K) + extra.shape[-1]}")
    drive_columns = got[..., len(K) :]
    distances = np.max(np.abs(drive_columns[..., :, None] - extra[..., None, :]), axis=(0, 1), initial=0.0)
    order = np.argmin(distances, axis=0) if extra.shape[-1] else np.zeros(0, dtype=np.intp)
    return np.concatenate([got[..., : len(K)] @ K, drive_columns[..., order]], axis=2)


def check_dynamics(case: Case) -> None:
    """Compare torques, mass matrix, Coriolis and gravity terms, forward dynamics and energies with the reference."""
    model, ne, s, beta, check = case.model, case.ne, case.s, case.beta, case.exact
    tau, c, M = ne.inverse_dynamics(s.q, s.dq, s.ddq), ne.coriolis(s.q, s.dq), ne.mass_matrix(s.q)
    torque = size(tau)
    if beta is None:
        check(
            "beta = K phi",
            lambda: _nominal_beta(model),
            np.asarray(model.base_projection) @ case.parameters.phi.ravel(),
        )
    check("inverse_dynamics", lambda: model.inverse_dynamics(s.q, s.dq, s.ddq, beta=beta), tau)
    check("mass_matrix", lambda: model.mass_matrix(s.q, beta=beta), M)
    check("coriolis", lambda: model.coriolis(s.q, s.dq, beta=beta), c, scale=torque)
    check("gravity", lambda: model.gravity(s.q, beta=beta), ne.gravity(s.q), scale=torque)
    check("bias", lambda: model.bias(s.q, s.dq, beta=beta), c + ne.gravity(s.q), scale=torque)
    check("dynamics_terms: M", lambda: model.dynamics_terms(s.q, s.dq, beta=beta)[0], M)
    check("dynamics_terms: c", lambda: model.dynamics_terms(s.q, s.dq, beta=beta)[1], c, scale=torque)
    check("dynamics_terms: g", lambda: model.dynamics_terms(s.q, s.dq, beta=beta)[2], ne.gravity(s.q), scale=torque)
    check(
        "coriolis_matrix dq",
        lambda: np.einsum("nij,nj->ni", model.coriolis_matrix(s.q, s.dq, beta=beta), s.dq),
        c,
        scale=torque,
    )
    M_dot = rate(lambda t: ne.mass_matrix(s.q + t * s.dq), case.tolerances.step)
    transposed = np.einsum("nij,nj->ni", M_dot, s.dq) - c  # dM/dt = C + C'
    case.close(
        "coriolis_transpose",
        lambda: model.coriolis_transpose(s.q, s.dq, beta=beta),
        transposed,
        scale=max(torque, size(transposed)),
    )
    _check_forward_dynamics(case)
    _check_energy(case)


def _check_forward_dynamics(case: Case) -> None:
    """Check that accelerations of the forward dynamics reproduce the torques, and that an indefinite M is reported."""
    ne, s, check = case.ne, case.s, case.exact
    tau, M = ne.inverse_dynamics(s.q, s.dq, s.ddq), ne.mass_matrix(s.q)
    definite = is_definite(M, case.tolerances)

    def ask(q: Array, dq: Array, tau: Array) -> Array:
        return np.asarray(case.model.forward_dynamics(q, dq, tau, beta=case.beta))

    if np.any(definite):
        d, torque = s.at(definite), tau[definite]
        check("forward_dynamics (as torque)", lambda: ne.inverse_dynamics(d.q, d.dq, ask(d.q, d.dq, torque)), torque)
    if not np.all(definite):
        check_refusal("forward_dynamics", check, ask, s.at(~definite), M[~definite])


def _nominal_beta(model: Model) -> Array:
    """The nominal base parameters (b,) of the model."""
    if model.beta is None:
        raise ValueError("the description has links, but the model has no nominal base parameters")
    return np.asarray(model.beta)


def _check_energy(case: Case) -> None:
    """Compare kinetic energy, and potential energy relative to its value at q = 0, with closed loops at the first q."""
    model, ne, s, beta, check = case.model, case.ne, case.s, case.beta, case.exact
    home = np.zeros_like(s.q) if ne.loops is None else np.tile(s.q[0], (s.count, 1))
    kinetic, potential = ne.energy(s.q, s.dq)
    potential = potential - ne.energy(home, s.dq)[1]
    scale = max(size(kinetic), size(potential))

    def model_potential() -> Array:
        here, there = (model.energy(q, s.dq, beta=beta)[1] for q in (s.q, home))
        return np.asarray(here - there)

    check("energy, kinetic", lambda: np.asarray(model.energy(s.q, s.dq, beta=beta)[0]), kinetic, scale=scale)
    check("energy, potential", model_potential, potential, scale=scale)
