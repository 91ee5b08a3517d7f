"""Comparison of the functions of optional groups, which are emitted on request, with formulas over the reference.

What a formula needs of the arm, M, c, g, J and their products, is that of the built-in Newton-Euler recursion. The
Coriolis torques are quadratic in the velocities, so that the product of the matrix of the Christoffel symbols with any
vector v is ``C(q, dq) v = (c(dq + v) - c(dq - v)) / 4`` without a difference quotient. Torques are compared with limits
that half of them exceed, and operational space with a damping that acts at part of the states: both sides of every
choice are seen.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.verify.against_newton_euler import changed_friction
from rrrgen.verify.identities import SECOND_STEP
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array
from rrrgen.verify.report import curvature, curvature_scale, rate, size
from rrrgen.verify.subject import Case

PERIOD = 2.0**-10  # s, of functions that keep a state
POLE = 60.0  # 1/s, of the momentum observer
WIDTH = 0.25  # rad/s or m/s, below which the sign of a speed is smoothed in friction
DAMPING = 0.25  # share below which pivots are damped in operational space; so much that it acts at many states
NULLSPACE_DAMPING = 0.125  # m or 1
RANK = 1e-9  # smallest over largest singular value, below which a Jacobian has lost rank


@dataclass(frozen=True)
class _Case(Case):
    """A model and its reference at states, with all that the formulas of the functions have in common.

    ``wanted`` are the names of the emitted functions, those of a named ``tip`` behind its name.
    """

    wanted: Collection[str] = ()
    tip: str = ""

    def has(self, name: str) -> bool:
        """Whether the function ``name`` is emitted for the tip."""
        return self.emitted_name(name) in self.wanted

    def emitted_name(self, name: str) -> str:
        """The emitted name of the function ``name`` of the tip."""
        return f"{self.tip}_{name}" if self.tip else name

    def call(self, name: str, *states: Array, **given: Any) -> Any:
        """The results of the function ``name`` of the model at ``states``, for the tip."""
        tip = {"tip": self.tip} if self.tip else {}
        return getattr(self.model, name)(*states, **given, **tip)

    def repeat(self, value: Any) -> Array:
        """The same ``value`` at every state."""
        return np.asarray(np.tile(value, (self.s.count, *[1] * np.ndim(value))))

    def draw(self, *shape: int, low: float = -1.0, high: float = 1.0, seed: int = 0) -> Array:
        """Random numbers (N, ``shape``), the same for the same ``seed``, which a float represents exactly."""
        rng = np.random.default_rng((self.s.count, seed))
        return _representable(rng.uniform(low, high, (self.s.count, *shape)))

    @cached_property
    def C(self) -> Array:
        """The Coriolis matrix (N, n, n) of the Christoffel symbols."""
        columns = [self.christoffel(self.repeat(unit)) for unit in np.eye(self.s.q.shape[1])]
        return np.stack(columns, axis=2)

    def christoffel(self, v: Array) -> Array:
        """The product C(q, dq) v (N, n)."""
        q, dq = self.s.q, self.s.dq
        return np.asarray((self.ne.coriolis(q, dq + v) - self.ne.coriolis(q, dq - v)) / 4.0)

    @cached_property
    def M(self) -> Array:
        """The mass matrix (N, n, n)."""
        return self.ne.mass_matrix(self.s.q)

    @cached_property
    def g(self) -> Array:
        """The gravity torques (N, n)."""
        return self.ne.gravity(self.s.q)

    @cached_property
    def desired(self) -> tuple[Array, Array, Array]:
        """A desired motion q_d, dq_d, ddq_d (N, n) near the states."""
        n = self.s.q.shape[1]
        moved = (self.draw(n, low=-0.25, high=0.25, seed=k) for k in range(3))
        parts = (part + move for part, move in zip((self.s.q, self.s.dq, self.s.ddq), moved, strict=True))
        return tuple(_representable(part) for part in parts)  # type: ignore[return-value]

    def friction(self, speeds: Array, load: Array) -> Array:
        """Friction torques (N, n) at ``speeds`` (N, n) under the torques ``load``, by other parameters than the file's.

        The sign of a speed is smoothed over :data:`WIDTH`.
        """
        return changed_friction(self.model.spec).torques(speeds, load, WIDTH)

    @cached_property
    def friction_given(self) -> dict[str, Any]:
        """The arguments of run-time friction."""
        friction = changed_friction(self.model.spec)
        return {"friction": np.array(friction.values), "width": np.full(friction.laws, WIDTH)}


def check_optional_functions(base: Case, wanted: Collection[str], tips: Sequence[tuple[str, NewtonEuler]] = ()) -> None:
    """Compare the functions of optional groups whose names are ``wanted`` with formulas over the reference ``ne``.

    ``tips`` are the named tips of the robot with the references of the same robot with this tip.
    """
    case = _Case(**vars(base), wanted=frozenset(wanted))
    for check in (_terms, _joint_laws, _adaptive_law, _observer, _elastic, _path, _second_derivatives):
        check(case)
    for tip, other in [("", base.ne), *tips]:
        of_tip = replace(case, ne=other, tip=tip)
        _impedance(of_tip)
        _operational_space(of_tip)


def check_optional_kinematics(
    base: Case, wanted: Collection[str], tips: Sequence[tuple[str, NewtonEuler]] = ()
) -> None:
    """Compare the functions of optional groups that take no inertial parameters: points, motions and contact.

    ``wanted`` are names of functions, ``tips`` the named tips of the robot with the references that have this tip.
    """
    case = _Case(**vars(base), wanted=frozenset(wanted))
    for check in (_points, _contact, _external_load, _quintic, _trapezoidal):
        check(case)
    for tip, other in [("", base.ne), *tips]:
        of_tip = replace(case, ne=other, tip=tip)
        for check in (_tools, _manipulability, _nullspace):
            check(of_tip)


# ------------------------------------------------------------------------------------------------------------------
# Control laws and the momentum observer
# ------------------------------------------------------------------------------------------------------------------


def _results(
    case: _Case, name: str, call: Callable[[], Any], expected: Sequence[tuple[str, Array, float | None]]
) -> None:
    """Compare the results of ``call`` one by one with ``expected``: their names, values and scales."""
    results: list[Any] = []

    def answer(k: int) -> Array:
        if not results:
            result = call()
            results.append(result if isinstance(result, tuple) else (result,))
        return np.asarray(results[0][k])

    for k, (part, value, scale) in enumerate(expected):
        title = case.emitted_name(name) if not part else f"{case.emitted_name(name)}: {part}"
        case.exact(title, lambda k=k: answer(k), value, scale=scale)  # type: ignore[misc]


def _terms(case: _Case) -> None:
    """Momentum with its rate, and the torques of a reference motion with their regressor (Slotine and Li)."""
    s, beta = case.s, case.parameters.beta
    p, ct = _times(case.M, s.dq), _times(np.swapaxes(case.C, 1, 2), s.dq)
    torque = max(size(ct), size(case.g), size(p))
    if case.has("momentum_terms"):
        expected = [("p", p, None), ("ct", ct, torque), ("g", case.g, torque)]
        _results(case, "momentum_terms", lambda: case.call("momentum_terms", s.q, s.dq, beta=beta), expected)
    n = s.q.shape[1]
    v, a = case.draw(n, low=-3.0, high=3.0, seed=11), case.draw(n, low=-9.0, high=9.0, seed=12)
    if case.has("reference_torque"):
        tau = _times(case.M, a) + case.christoffel(v) + case.g
        call = lambda: case.call("reference_torque", s.q, s.dq, v, a, beta=beta)  # noqa: E731
        _results(case, "reference_torque", call, [("", tau, None)])
    if case.has("reference_regressor_transpose"):
        K = np.asarray(case.model.base_projection)
        r = np.einsum("nij,ni->nj", _reference_regressor(case, v, a), s.e)
        call = lambda: case.call("reference_regressor_transpose", s.q, s.dq, v, a, s.e) @ K  # noqa: E731
        _results(case, "reference_regressor_transpose", call, [("K", r, None)])


def _reference_regressor(case: _Case, v: Array, a: Array) -> Array:
    """The regressor Y (N, n, 10 links) of ``M a + C v + g`` in standard parameters, without drive inertia."""
    q, dq, still = case.s.q, case.s.dq, np.zeros_like(case.s.q)
    of = case.ne.standard_regressor
    return np.asarray(of(q, still, a) + (of(q, dq + v, still) - of(q, dq - v, still)) / 4.0)


def _limit_torques(tau: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Limits (n,) that about half of the torques (N, n) exceed, the torques within them, and which exceed them."""
    limit = 0.9 * np.median(np.abs(tau), axis=0) + 1e-3
    return limit, np.clip(tau, -limit, limit), np.abs(tau) > limit


def _joint_laws(case: _Case) -> None:
    """PD control with gravity, feed-forward and computed torque, within limits of the torques."""
    s, ne, (q_d, dq_d, ddq_d), n = case.s, case.ne, case.desired, case.s.q.shape[1]
    kp, kd, ki = (case.draw(n, low=1.0, high=20.0, seed=20 + k) for k in range(3))
    z = case.draw(n, seed=23)
    e = q_d - s.q
    feedback = kp * e + kd * (dq_d - s.dq) + ki * z
    laws: dict[str, Callable[[], Array]] = {
        "pd_gravity": lambda: feedback + case.g,
        "feedforward": lambda: feedback + ne.inverse_dynamics(q_d, dq_d, ddq_d),
        "computed_torque": lambda: ne.inverse_dynamics(s.q, s.dq, ddq_d + feedback),
    }
    for name, torques in laws.items():
        if not case.has(name):
            continue
        before = torques()
        free = before + case.friction(dq_d, before)
        limit, tau, beyond = _limit_torques(free)
        resting = beyond & (free * e > 0.0)
        given = {"Ts": PERIOD, "tau_max": limit, "beta": case.parameters.beta, **case.friction_given}
        arguments = (s.q, s.dq, q_d, dq_d, ddq_d, kp, kd, ki, z)

        def call(name: str = name, given: dict[str, Any] = given, arguments: tuple[Array, ...] = arguments) -> Any:
            return case.call(name, *arguments, **given)

        expected = [("tau", tau, None), ("z_next", np.where(resting, z, z + PERIOD * e), None)]
        _results(case, name, call, expected)


def _adaptive_law(case: _Case) -> None:
    """The law of Slotine and Li: its torques, and what it adapts, as torques of the parameters."""
    if not case.has("slotine_li"):
        return
    s, (q_d, dq_d, ddq_d), n = case.s, case.desired, case.s.q.shape[1]
    lam, k = (case.draw(n, low=1.0, high=9.0, seed=30 + i) for i in range(2))
    v, a = dq_d + lam * (q_d - s.q), ddq_d + lam * (dq_d - s.dq)
    error = s.dq - v
    before = _times(case.M, a) + case.christoffel(v) + case.g - k * error
    free = before + case.friction(dq_d, before)
    beta = np.asarray(case.model.beta if case.parameters.beta is None else case.parameters.beta)
    K, count = np.asarray(case.model.base_projection), len(beta)
    bound = np.full(count, 1e6)
    given = {"gamma": np.full(count, 1.0 / PERIOD), "beta_min": -bound, "beta_max": bound, "Ts": PERIOD}
    arguments = (s.q, s.dq, q_d, dq_d, ddq_d, lam, k, case.repeat(beta))
    limit, tau, _ = _limit_torques(free)
    far = np.full(n, 1e9)

    def call(tau_max: Array) -> Any:
        return case.call("slotine_li", *arguments, **given, tau_max=tau_max, **case.friction_given)

    def adaptation() -> Array:
        return np.asarray((beta - call(far)[1]) @ K)

    slope = np.einsum("nij,ni->nj", _reference_regressor(case, v, a), error)
    case.exact("slotine_li: tau", lambda: call(limit)[0], tau)
    case.exact("slotine_li: beta_next", adaptation, slope)
    case.exact("slotine_li: beta_next at a limit", lambda: call(np.full(n, 1e-3))[1], case.repeat(beta))


def _observer(case: _Case) -> None:
    """The momentum observer: the state at its start, and one period."""
    s, n, beta = case.s, case.s.q.shape[1], case.parameters.beta
    if not case.has("momentum_observer"):
        return
    p = _times(case.M, s.dq)
    u = _times(np.swapaxes(case.C, 1, 2), s.dq) - case.g - case.friction(s.dq, case.g)
    given = {"beta": beta, **case.friction_given}
    state = [("p", p, None), ("u", u, None)]
    _results(
        case,
        "momentum_observer_start",
        lambda: case.call("momentum_observer_start", s.q, s.dq, **given),
        state,
    )
    last = {f"{name}_last": case.draw(n, seed=40 + k)[0] for k, name in enumerate("pur")}
    applied = case.draw(n, low=-20.0, high=20.0, seed=43)
    y = (p - last["p_last"]) / PERIOD - applied - (u + last["u_last"]) / 2.0
    r = y + np.exp(-POLE * PERIOD) * (last["r_last"] - y)
    given |= {**last, "gain": POLE, "Ts": PERIOD}
    call = lambda: case.call("momentum_observer", s.q, s.dq, applied, **given)  # noqa: E731
    _results(case, "momentum_observer", call, [("r", r, None), *state])


def _pose_error(T: Array, T_d: Array) -> Array:
    """The error (N, 6) from pose T to T_d: of the position, then the sine of the angle times the axis."""
    turn = T_d[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
    skew = (turn - np.swapaxes(turn, 1, 2)) / 2.0
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.concatenate([(T_d - T)[:, :3, 3], axis], axis=1)


def _nearby(case: _Case) -> Array:
    """Desired poses (N, 4, 4) of the tip near its poses: those half a radian or half a metre of every joint away."""
    return case.ne.forward_kinematics(case.s.q + case.draw(case.s.q.shape[1], low=-0.5, high=0.5, seed=50))


def _reachable(case: _Case) -> Array:
    """Poses near those of the tip: with closed loops the poses of other states, else :func:`_nearby`."""
    if case.ne.loops is not None:
        return np.roll(case.ne.forward_kinematics(case.s.q), 1, axis=0)
    return _nearby(case)


def _impedance(case: _Case) -> None:
    """Impedance control of the tip, within limits of the torques."""
    if not case.has("impedance"):
        return
    s, ne = case.s, case.ne
    J, T, T_d = ne.jacobian(s.q), ne.forward_kinematics(s.q), _reachable(case)
    V_d = case.draw(6, seed=51)
    stiffness, damping = (case.draw(6, low=5.0, high=90.0, seed=52 + k) for k in range(2))
    F = stiffness * _pose_error(T, T_d) + damping * (V_d - _times(J, s.dq))
    limit, tau, _ = _limit_torques(_times(np.swapaxes(J, 1, 2), F) + case.g)
    given = {"beta": case.parameters.beta, "tau_max": limit}
    call = lambda: case.call("impedance", s.q, s.dq, T_d, V_d, stiffness, damping, **given)  # noqa: E731
    _results(case, "impedance", call, [("", tau, None)])


def _operational_space(case: _Case) -> None:
    """Operational-space control of pose and position, damped at part of the states."""
    for name, count in (("operational_space", 6), ("position_operational_space", 3)):
        if case.has(name):
            _one_operational_space(case, name, count)


def _one_operational_space(case: _Case, name: str, count: int) -> None:
    s, ne, n = case.s, case.ne, case.s.q.shape[1]
    T, T_d, h = ne.forward_kinematics(s.q), _reachable(case), ne.coriolis(s.q, s.dq) + case.g
    J, drift = ne.jacobian(s.q)[:, :count], ne.jacobian_dot_dq(s.q, s.dq)[:, :count]
    e = _pose_error(T, T_d)[:, :count]
    V_d, A_d, z = (case.draw(count, seed=60 + k) for k in range(3))
    kp, kd, ki = (case.draw(count, low=1.0, high=9.0, seed=63 + k) for k in range(3))
    tau_0, tau_add = case.draw(n, seed=66), case.draw(n, seed=67)[0]
    X = np.linalg.solve(case.M, np.swapaxes(J, 1, 2))
    A = J @ X
    parts = np.einsum("nkk->nk", A).reshape(-1, count // 3, 3).mean(axis=2)
    scales = np.repeat(parts, 3, axis=1)
    pivots = _pivots(A)
    delta = np.maximum(0.0, DAMPING - np.maximum(0.0, np.min(pivots / scales, axis=1)))
    wanted = A_d + kp * e + kd * (V_d - _times(J, s.dq)) + ki * z - drift - _times(np.swapaxes(X, 1, 2), tau_0)
    damped = A + (delta[:, None] * scales)[:, :, None] * np.eye(count)
    force = np.linalg.solve(damped, wanted[..., None])[..., 0]
    free = _times(np.swapaxes(J, 1, 2), force) + h + tau_0 + tau_add
    limit, tau, beyond = _limit_torques(free)
    stuck = (delta > 0.0) | beyond.any(axis=1)
    given = {"tau_add": tau_add, "Ts": PERIOD, "beta": case.parameters.beta, "with_status": True}
    goal = T_d if count == 6 else T_d[:, :3, 3]
    arguments = (s.q, s.dq, goal, V_d, A_d, kp, kd, ki, z, tau_0, case.repeat(DAMPING))

    def call(tau_max: Array) -> Any:
        (torques, following), status = case.call(name, *arguments, tau_max=tau_max, **given)
        return torques, following, status

    far = np.full(n, 1e9)
    moved = np.where((delta > 0.0)[:, None], z, z + PERIOD * e)
    _results(
        case, name, lambda: call(far), [("tau", free, None), ("z_next", moved, None), ("status", delta > 0.0, 1.0)]
    )
    after = np.where(stuck[:, None], z, z + PERIOD * e)
    _results(
        case, name, lambda: call(limit), [("tau within limits", tau, size(free)), ("z_next at limits", after, None)]
    )


def _pivots(A: Array) -> Array:
    """The pivots D (N, m) of ``A = L D L'`` (N, m, m); where one is not positive, it and those behind it are 0."""
    pivots = np.zeros(A.shape[:2])
    A = A.copy()
    alive = np.ones(len(A), dtype=bool)
    for k in range(A.shape[1]):
        alive &= A[:, k, k] > 0.0
        pivots[alive, k] = A[alive, k, k]
        column = A[:, :, k] / np.where(alive, A[:, k, k], 1.0)[:, None]
        A = A - column[:, :, None] * A[:, None, k, :]
    return pivots


# ------------------------------------------------------------------------------------------------------------------
# Contact, and the wrench that causes external torques
# ------------------------------------------------------------------------------------------------------------------


def _contact(case: _Case) -> None:
    """Contact detection: ratios to the thresholds, and the change of the estimate."""
    if not case.has("contact"):
        return
    n = case.s.q.shape[1]
    r, r_last, change_last = (case.draw(n, low=-3.0, high=3.0, seed=70 + k) for k in range(3))
    threshold, change_threshold = (case.draw(n, low=2.0, high=9.0, seed=73 + k) for k in range(2))
    alpha = np.exp(-POLE * PERIOD)
    change = alpha**2 * change_last + alpha * (r - r_last)
    ratio = np.maximum(np.abs(r) / threshold, np.abs(change) / change_threshold)
    touches = np.any(ratio > 1.0, axis=1).astype(float)
    arguments = (r, r_last, change_last, case.repeat(POLE), case.repeat(PERIOD), threshold, change_threshold)
    expected = [("ratio", ratio, None), ("touches", touches, 1.0), ("change", change, None)]
    _results(case, "contact", lambda: case.call("contact", *arguments), expected)


def _external_load(case: _Case) -> None:
    """Wrench and force by weighted least squares, at Jacobians whose rows are far from dependent."""
    n = case.s.q.shape[1]
    for name, count in (("external_wrench", 6), ("external_force", 3)):
        if not case.has(name):
            continue
        square = case.draw(n, n, seed=80)
        turned = np.linalg.qr(square)[0][:, :, : min(n, 6)]
        J = case.draw(6, n, low=-0.1, high=0.1, seed=81)
        J[:, : turned.shape[2]] += np.swapaxes(turned, 1, 2)
        J = _representable(J)
        root = case.draw(n, n, seed=82)
        S = _representable(np.eye(n) + 0.125 * (root + np.swapaxes(root, 1, 2)))
        S += 0.25 * n * np.eye(n)
        r, rows = case.draw(n, low=-9.0, high=9.0, seed=83), J[:, :count]
        weighted = np.linalg.solve(S, np.swapaxes(rows, 1, 2))
        G = rows @ weighted
        P = np.asarray(np.linalg.inv(G), dtype=np.float64)
        F = _times(P, _times(np.swapaxes(weighted, 1, 2), r))
        means = [np.einsum("nkk->nk", part).reshape(-1, count // 3, 3).mean(axis=2) for part in (G, P)]
        condition = np.sqrt(np.mean(means[0] * means[1], axis=1))
        expected = [("F", F, None), ("P", P, None), ("condition", condition, None)]
        _results(case, name, lambda name=name, J=J, r=r, S=S: case.call(name, J, r, S), expected)  # type: ignore[misc]


# ------------------------------------------------------------------------------------------------------------------
# Points, tools, manipulability
# ------------------------------------------------------------------------------------------------------------------


def _points(case: _Case) -> None:
    """Velocities and accelerations of link frames and points, and the torques of a wrench."""
    if not case.has("point_jacobian"):
        return
    s, ne = case.s, case.ne
    link = ne.chain.links - 1
    J, frames, A = ne.link_jacobians(s.q), ne.link_frames(s.q), ne.link_jacobians_dot_dq(s.q, s.dq)
    V = np.asarray(J @ s.dq[:, None, :, None])[..., 0]
    _results(case, "link_velocities", lambda: case.call("link_velocities", s.q, s.dq), [("", V, None)])
    scale = max(size(A), size(J) * size(s.dq) ** 2)
    call = lambda: case.call("link_jacobians_dot_dq", s.q, s.dq)  # noqa: E731
    _results(case, "link_jacobians_dot_dq", call, [("", A, scale)])
    place = np.array([0.25, -0.125, 0.375])
    T, points = frames[:, link], case.repeat(place)
    at = T[:, :3, 3] + T[:, :3, :3] @ place
    J_p = ne.point_jacobian(frames, s.q, link, at)
    call = lambda: case.call("point_jacobian", T, J[:, link], points)  # noqa: E731
    _results(case, "point_jacobian", call, [("", J_p, None)])
    V_p = _times(J_p, s.dq)
    A_p = np.concatenate([ne.point_acceleration(s.q, s.dq, link, place), A[:, link, 3:]], axis=1)
    call = lambda: case.call("point_motion", T, V[:, link], A[:, link], points)  # noqa: E731
    _results(case, "point_motion", call, [("V_p", V_p, None), ("A_p", A_p, max(scale, size(A_p)))])
    F = case.draw(6, low=-9.0, high=9.0, seed=90)
    tau = np.einsum("nij,ni->nj", J[:, link], F)
    _results(case, "wrench_torques", lambda: case.call("wrench_torques", J[:, link], F), [("", tau, size(J) * size(F))])


def _tools(case: _Case) -> None:
    """Pose, Jacobian and target of a tool in place of that of the robot file."""
    s, ne = case.s, case.ne
    if not case.has("tool_kinematics"):
        return
    tool = np.array([[0.0, -1.0, 0.0, 0.25], [0.0, 0.0, -1.0, -0.125], [1.0, 0.0, 0.0, 0.375], [0.0, 0.0, 0.0, 1.0]])
    frames, tools = ne.link_frames(s.q), case.repeat(tool)
    T = frames[:, ne.chain.tip] @ tool
    J = ne.point_jacobian(frames, s.q, ne.chain.tip, T[:, :3, 3])
    call = lambda: case.call("tool_kinematics", s.q, tools)  # noqa: E731
    _results(case, "tool_kinematics", call, [("T", T, None), ("J", J, None)])
    if case.has("tool_target"):
        target = np.asarray(T @ np.linalg.inv(tool) @ ne.chain.tool)
        _results(case, "tool_target", lambda: case.call("tool_target", T, tools), [("", target, None)])


def _manipulability(case: _Case) -> None:
    """Manipulability of pose and position with its gradient ``w tr(pinv(J) dJ/dq)``, the derivative by differences."""
    s, ne, step = case.s, case.ne, case.tolerances.step
    for name, count in (("manipulability", 6), ("position_manipulability", 3)):
        if not case.has(name):
            continue
        J = ne.jacobian(s.q)[:, :count]
        values = np.linalg.svd(J, compute_uv=False)
        lost = values[:, -1] <= RANK * values[:, 0]
        w = np.where(lost, 0.0, np.prod(values, axis=1))
        inverse = np.zeros((s.count, s.q.shape[1], count))
        inverse[~lost] = np.linalg.pinv(J[~lost])
        gradient = np.zeros_like(s.q)
        for k, unit in enumerate(np.eye(s.q.shape[1])):
            change = rate(lambda t, unit=unit, count=count: ne.jacobian(s.q + t * unit)[:, :count], step)  # type: ignore[misc]
            gradient[:, k] = w * np.einsum("nij,nji->n", inverse, change)
        most = size(J) ** min(J.shape[1:])

        def call(k: int, name: str = name) -> Array:
            (value, slope), _ = case.call(name, s.q, with_status=True)
            return np.asarray((value, slope)[k])

        case.exact(f"{case.emitted_name(name)}: w", lambda call=call: call(0), w, scale=most)  # type: ignore[misc]
        case.close(f"{case.emitted_name(name)}: dw_dq", lambda call=call: call(1), gradient, scale=most)  # type: ignore[misc]


def _nullspace(case: _Case) -> None:
    """The damped projection on joint motions that keep pose or position."""
    s, n = case.s, case.s.q.shape[1]
    for name, count in (("nullspace", 6), ("position_nullspace", 3)):
        if not case.has(name):
            continue
        J = case.ne.jacobian(s.q)[:, :count]
        G = J @ np.swapaxes(J, 1, 2) + NULLSPACE_DAMPING**2 * np.eye(count)
        N = np.eye(n) - np.swapaxes(J, 1, 2) @ np.linalg.solve(G, J)
        call = lambda name=name: case.call(name, s.q, case.repeat(NULLSPACE_DAMPING))  # noqa: E731
        _results(case, name, call, [("", N, None)])


# ------------------------------------------------------------------------------------------------------------------
# Motions and paths
# ------------------------------------------------------------------------------------------------------------------


def _quintic(case: _Case) -> None:
    """The polynomial that meets the six conditions of every joint, from their linear equations."""
    if not case.has("quintic"):
        return
    n = case.s.q.shape[1]
    T = case.draw(low=0.5, high=2.0, seed=100)
    t = T * case.draw(low=-0.25, high=1.25, seed=101)
    ends = [case.draw(n, low=-2.0, high=2.0, seed=102 + k) for k in range(6)]
    now, powers = np.clip(t, 0.0, T), np.arange(6)

    def condition(at: Array, order: int) -> Array:
        factors = np.prod([np.maximum(powers - k, 0) for k in range(order)], axis=0) if order else np.ones(6)
        return np.asarray(factors * at[:, None] ** np.maximum(powers - order, 0))

    equations = [condition(at, order) for at in (np.zeros_like(T), T) for order in range(3)]
    coefficients = np.linalg.solve(np.stack(equations, axis=1), np.stack(ends, axis=1))
    motion = [np.einsum("nk,nkj->nj", condition(now, order), coefficients) for order in range(3)]
    expected = [(name, value, None) for name, value in zip(("q_d", "dq_d", "ddq_d"), motion, strict=True)]
    _results(case, "quintic", lambda: case.call("quintic", t, T, *ends), expected)


def _trapezoidal(case: _Case) -> None:
    """The phase as the area under its trapezoidal rate, whose flanks and top the slowest joints set."""
    if not case.has("trapezoidal"):
        return
    n = case.s.q.shape[1]
    q_0, way = case.draw(n, seed=110), case.draw(n, low=-2.0, high=2.0, seed=111)
    q_1 = _representable(q_0 + way * 10.0 ** case.draw(1, low=-2.0, high=0.5, seed=112))
    way = q_1 - q_0
    speed, acceleration = (case.draw(n, low=0.5, high=4.0, seed=113 + k) for k in range(2))
    W, B = np.max(np.abs(way) / speed, axis=1), np.max(np.abs(way) / acceleration, axis=1)
    top = 1.0 / np.maximum(W, np.sqrt(B))
    ramp = top * B
    T = 1.0 / top + ramp
    t = T * case.draw(low=-0.25, high=1.25, seed=115)
    now = np.clip(t, 0.0, T)
    rising, falling = np.minimum(now, ramp), np.clip(now - (T - ramp), 0.0, None)
    level = np.clip(now - ramp, 0.0, T - 2.0 * ramp)
    phase = rising**2 / (2.0 * B) + top * level + top * falling - falling**2 / (2.0 * B)
    inside = (t > 0.0) & (t < T)
    slope = inside * np.minimum(top, np.minimum(now, T - now) / B)
    bend = inside * np.where(now < ramp, 1.0, np.where(T - now < ramp, -1.0, 0.0)) / B
    expected = [
        ("q_d", q_0 + phase[:, None] * way, None),
        ("dq_d", slope[:, None] * way, None),
        ("ddq_d", bend[:, None] * way, None),
        ("T", T, None),
    ]
    call = lambda: case.call("trapezoidal", t, q_0, q_1, speed, acceleration)  # noqa: E731
    _results(case, "trapezoidal", call, expected)


def _path(case: _Case) -> None:
    """The torques along a path: factors of u and x."""
    if not case.has("path_dynamics"):
        return
    s, n = case.s, case.s.q.shape[1]
    slope, curve = (case.draw(n, low=-2.0, high=2.0, seed=120 + k) for k in range(2))
    b = _times(case.M, curve) + case.ne.coriolis(s.q, slope)
    call = lambda: case.call("path_dynamics", s.q, slope, curve, beta=case.parameters.beta)  # noqa: E731
    _results(case, "path_dynamics", call, [("a", _times(case.M, slope), None), ("b", b, None), ("g", case.g, None)])


# ------------------------------------------------------------------------------------------------------------------
# Elastic joints
# ------------------------------------------------------------------------------------------------------------------


def _elastic(case: _Case) -> None:
    """Dynamics and control laws of links and rotors with springs between them."""
    if not case.has("elastic_forward_dynamics"):
        return
    s, n, beta = case.s, case.s.q.shape[1], case.parameters.beta
    links = NewtonEuler(replace(case.ne.chain, drive_inertia=np.zeros((n, n))), case.ne.phi)
    M, h = links.mass_matrix(s.q), links.inverse_dynamics(s.q, s.dq, np.zeros_like(s.q))
    J, K, D = (case.draw(n, low=low, high=2 * low, seed=130 + k)[0] for k, low in enumerate((0.5, 40.0, 2.0)))
    given = {"beta": beta, "rotor_inertia": J, "stiffness": K}
    theta, dtheta = s.q + case.draw(n, seed=133), s.dq + case.draw(n, seed=134)
    theta, dtheta = (_representable(part) for part in (theta, dtheta))
    tau = case.draw(n, low=-20.0, high=20.0, seed=135)
    load = K * (theta - s.q) + D * (dtheta - s.dq)

    def accelerations() -> Any:
        return case.call("elastic_forward_dynamics", s.q, s.dq, theta, dtheta, tau, **given, damping=D)

    case.exact(
        "elastic_forward_dynamics: ddq (as torque)",
        lambda: _times(M, np.asarray(accelerations()[0])) + h,
        load,
        scale=max(size(load), size(h)),
    )
    case.exact("elastic_forward_dynamics: ddtheta", lambda: accelerations()[1], (tau - load) / J)
    jerk, snap = (case.draw(n, low=-20.0, high=20.0, seed=136 + k) for k in range(2))
    torques, rotors, speeds = _rotor_motion(links, (s.q, s.dq, s.ddq, jerk, snap), J, K)
    scale = max(size(torques), size(K * (rotors - s.q)))
    for k, (name, value) in enumerate((("tau", torques), ("theta", rotors), ("dtheta", speeds))):
        case.close(
            f"elastic_inverse_dynamics: {name}",
            lambda k=k: case.call("elastic_inverse_dynamics", s.q, s.dq, s.ddq, jerk, snap, **given)[k],  # type: ignore[misc]
            value,
            scale=scale if name == "tau" else None,
        )
    # rotors where the links accelerate moderately: far from there they turn too fast for the steps of differences
    near = _representable(rotors), _representable(speeds)
    _elastic_laws(case, links, (J, K), near, (jerk, snap), given)


def _rotor_motion(links: NewtonEuler, motion: Sequence[Array], J: Array, K: Array) -> tuple[Array, Array, Array]:
    """Torques, positions and speeds of the rotors for the ``motion`` q, dq, .. d4q of the links, by differences."""
    q, dq, ddq = motion[:3]
    first, second = _torque_rates(links, motion)
    tau = links.inverse_dynamics(q, dq, ddq)
    return J * (ddq + second / K) + tau, q + tau / K, dq + first / K


def _torque_rates(links: NewtonEuler, motion: Sequence[Array]) -> tuple[Array, Array]:
    """The first and second time derivatives of the torques of the links along the ``motion`` q, dq, .. d4q."""
    q, dq, ddq, d3q, d4q = motion

    def at(t: float) -> Array:
        return links.inverse_dynamics(
            q + t * (dq + t / 2 * (ddq + t / 3 * (d3q + t / 4 * d4q))),
            dq + t * (ddq + t / 2 * (d3q + t / 3 * d4q)),
            ddq + t * (d3q + t / 2 * d4q),
        )

    return rate(at, SECOND_STEP / 4), curvature(at, SECOND_STEP / 2)


def _elastic_laws(
    case: _Case,
    links: NewtonEuler,
    springs: tuple[Array, Array],
    rotors: tuple[Array, ...],
    further: tuple[Array, Array],
    given: dict[str, Any],
) -> None:
    """Feed-forward and feedback linearisation, within limits of the torques."""
    s, n, (J, K), (theta, dtheta) = case.s, case.s.q.shape[1], springs, rotors
    q_d, dq_d, ddq_d = case.desired
    desired = (q_d, dq_d, ddq_d, *further)
    kp, kd = (case.draw(n, low=1.0, high=20.0, seed=140 + k) for k in range(2))
    w = case.draw(n, low=1.0, high=4.0, seed=142)
    torques, theta_d, dtheta_d = _rotor_motion(links, desired, J, K)
    before = torques + kp * (theta_d - theta) + kd * (dtheta_d - dtheta)
    free = before + case.friction(dq_d, before)
    limit, tau, _ = _limit_torques(free)
    more = {**given, **case.friction_given}
    case.close(
        "elastic_feedforward",
        lambda: case.call("elastic_feedforward", theta, dtheta, *desired, kp, kd, tau_max=limit, **more),
        tau,
        scale=size(free),
    )
    M, h, still = links.mass_matrix(s.q), links.inverse_dynamics(s.q, s.dq, np.zeros_like(s.q)), np.zeros_like(s.q)
    ddq = _solve(M, K * (theta - s.q) - h)
    rest = _torque_rates(links, (s.q, s.dq, ddq, still, still))[0]
    d3q = _solve(M, K * (dtheta - s.dq) - rest)
    e, de, dde, d3e = (a - b for a, b in zip(desired, (s.q, s.dq, ddq, d3q), strict=False))
    d4q = desired[4] + 4 * w * d3e + 6 * w**2 * dde + 4 * w**3 * de + w**4 * e
    second = _torque_rates(links, (s.q, s.dq, ddq, d3q, d4q))[1]
    before = J * (ddq + second / K) + K * (theta - s.q)
    free = before + case.friction(dq_d, before)
    limit, tau, _ = _limit_torques(free)
    case.close(
        "elastic_feedback_linearization",
        lambda: case.call(
            "elastic_feedback_linearization", s.q, s.dq, theta, dtheta, *desired, w, tau_max=limit, **more
        ),
        tau,
        scale=size(free),
    )


# ------------------------------------------------------------------------------------------------------------------
# All second derivatives of the torques
# ------------------------------------------------------------------------------------------------------------------


def _second_derivatives(case: _Case) -> None:
    """Second derivatives along one random direction of (q, dq), and dM/dq along q, with second differences."""
    if not case.has("inverse_dynamics_second_derivatives"):
        return
    s, ne, n = case.s, case.ne, case.s.q.shape[1]
    vq, vv = (case.draw(n, seed=150 + k) / np.sqrt(n) for k in range(2))

    def torques(t: float) -> Array:
        return ne.inverse_dynamics(s.q + t * vq, s.dq + t * vv, s.ddq)

    def answer() -> Any:
        return case.call("inverse_dynamics_second_derivatives", s.q, s.dq, s.ddq, beta=case.parameters.beta)

    def along() -> Array:
        by_q, mixed, by_dq, _ = answer()
        pairs = ((by_q, vq, vq, 1.0), (mixed, vv, vq, 2.0), (by_dq, vv, vv, 1.0))
        return np.asarray(sum(factor * np.einsum("nijk,nj,nk->ni", part, x, y) for part, x, y, factor in pairs))

    name = "inverse_dynamics_second_derivatives"
    second = curvature(torques, SECOND_STEP)
    case.close(f"{name}: v' H v", along, second, scale=curvature_scale(second, torques(0.0)))
    turning = rate(lambda t: ne.mass_matrix(s.q + t * vq), SECOND_STEP)
    case.close(f"{name}: dM/dq vq", lambda: np.einsum("nijk,nk->nij", answer()[3], vq), turning)


def _representable(value: Array) -> Array:
    """The numbers rounded to those that a float represents."""
    return np.asarray(value).astype(np.float32).astype(np.float64)


def _times(A: Array, x: Array) -> Array:
    """The products (N, m) of matrices (N, m, n) and vectors (N, n)."""
    return np.asarray(np.einsum("nij,nj->ni", A, x))


def _solve(A: Array, x: Array) -> Array:
    return np.asarray(np.linalg.solve(A, x[..., None])[..., 0])
