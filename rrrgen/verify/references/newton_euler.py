"""The built-in reference: recursive Newton-Euler with spatial vectors in link frames, over batches of states.

Featherstone's recursion (Rigid Body Dynamics Algorithms, 2008, chapter 5): twists and accelerations go outwards,
wrenches inwards, each as an (angular, linear) pair at the origin of the user's link frame and in its axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rrrgen.verify.references.closed_loops import LoopSolver
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, inertia_tensor

FUNCTIONS_OF_POSITION = ("forward_kinematics", "link_frames", "jacobian", "link_jacobians")
"""Methods that verification compares with the model's methods of the same name, at the same positions."""

_TENSOR_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    """The cross products of vectors along the last axes; ``numpy.cross`` rounds alike and takes nine times as long."""
    product: Array = a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1)
    return product


def _cross_matrix(v: Array) -> Array:
    """The matrices [v]x (N, 3, 3) of the cross products with the vectors ``v`` (N, 3): [v]x u = v x u."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def _tensor_rows(w: Array) -> Array:
    """The matrices L(w) (N, 3, 6) that make ``I w`` linear in the inertia: I w = L(w) [Ixx Ixy Iyy Ixz Iyz Izz]'."""
    out = np.zeros((len(w), 3, 6))
    for k, (r, c) in enumerate(_TENSOR_PLACES):
        out[:, r, k] += w[:, c]
        if r != c:
            out[:, c, k] += w[:, r]
    return out


def rotations(orientation: Array) -> Array:
    """The rotation matrices (N, 3, 3) of unit quaternions x, y, z, w (N, 4)."""
    V, w = _cross_matrix(orientation[:, :3]), orientation[:, 3, None, None]
    return np.asarray(np.eye(3) + 2 * (w * V + V @ V))


@dataclass(frozen=True)
class _Outward:
    """The outward pass, one entry per link, in the axes of the link frame at its origin.

    ``R``, ``p``: pose in the frame of the link before. ``w``, ``v``: angular and linear velocity. ``wd``, ``vd``:
    angular and linear part of the spatial acceleration. ``coupling`` maps dq to the rates of all rows.
    """

    coupling: Array
    R: list[Array]
    p: list[Array]
    w: list[Array]
    v: list[Array]
    wd: list[Array]
    vd: list[Array]


@dataclass(frozen=True)
class BaseState:
    """States (N, .) of a floating base: ``orientation`` (x, y, z, w), ``twist`` and ``twist_rate``, linear part first.

    Both are in base axes; the rate is that of the components, which is the spatial acceleration.
    """

    orientation: Array
    twist: Array
    twist_rate: Array

    def sensors(self, gravity: Array) -> tuple[Array, Array, Array]:
        """What sensors on the base measure in this ``gravity`` (3,): angular velocity, its rate, and acceleration.

        (N, 3) each; the acceleration is that of the base origin minus gravity, in base axes.
        """
        v, w = self.twist[:, :3], self.twist[:, 3:]
        weight = np.einsum("nji,j->ni", rotations(self.orientation), gravity)
        return w, self.twist_rate[:, 3:], self.twist_rate[:, :3] + _cross(w, v) - weight


def still_base(count: int, twist: Array | None = None) -> BaseState:
    """``count`` states of an upright base whose ``twist`` (6,) is constant; at rest by default."""
    moving = np.zeros((count, 6)) if twist is None else np.tile(twist, (count, 1))
    return BaseState(np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), moving, np.zeros((count, 6)))


class NewtonEuler:
    """Kinematics and dynamics of a chain with standard parameters ``phi`` (links, 10); states are batches (N, n).

    The chain may branch. Its displacements are ``coupling q``, with the constant matrix ``coupling`` of the chain. With
    closed loops they are those of the open tree at positions at which the loops are closed, found numerically.
    """

    name = "Newton-Euler (built in)"

    def __init__(self, chain: NumericRobot, phi: Array) -> None:
        self.chain = chain
        self.phi = phi
        self._tensors = [inertia_tensor(row) for row in phi]
        self._around = chain.around_joints()
        self.axes = [self._axis(i) for i in range(chain.links)]
        self.loops: LoopSolver | None = None
        if chain.loops:
            self.loops = LoopSolver(chain, NewtonEuler(chain.spanning_tree(), phi))

    def _axis(self, i: int) -> tuple[Array, Array]:
        """Motion subspace of joint i in link frame i: (angular, linear), constant."""
        after = self._around[i][1]
        z, arm = after[:3, :3].T @ [0.0, 0.0, 1.0], after[:3, :3].T @ after[:3, 3]
        return (z, _cross(z, arm)) if self.chain.revolute[i] else (np.zeros(3), z)

    def _positions(self, q: Array) -> Array:
        """The positions of all rows that follow none (N, .): q, and those of passive rows of closed loops."""
        return q if self.loops is None else self.loops.solve(q)[0]

    def _coupling(self, q: Array) -> Array:
        """The matrix from dq to the rates of all rows, (links, n), or (N, links, n) with closed loops."""
        if self.loops is None:
            return self.chain.coupling
        S, n = self.chain.coupling, self.chain.n
        return np.asarray(S[:, :n] + S[:, n:] @ self.loops.passive_rates(self._positions(q)))

    def _steps(self, q: Array) -> list[Array]:
        """DH transforms A_i(y_i) (N, 4, 4), one per row, with ``y = coupling q``; ``q`` is (N, n)."""
        steps = []
        y = self._positions(q) @ self.chain.coupling.T
        for i, (before, after) in enumerate(self._around):
            motion = np.tile(np.eye(4), (len(q), 1, 1))
            if self.chain.revolute[i]:
                c, s = np.cos(y[:, i]), np.sin(y[:, i])
                motion[:, 0, 0], motion[:, 0, 1], motion[:, 1, 0], motion[:, 1, 1] = c, -s, s, c
            else:
                motion[:, 2, 3] = y[:, i]
            steps.append(before @ motion @ after)
        return steps

    def link_frames(self, q: Array) -> Array:
        """The poses T_0_i (N, n, 4, 4) of the link frames 1..n in the base frame."""
        base = np.tile(self.chain.base, (len(q), 1, 1))
        frames: list[Array] = []
        for parent, step in zip(self.chain.parents, self._steps(q), strict=True):
            frames.append((base if parent < 0 else frames[parent]) @ step)
        return np.stack(frames, axis=1)

    def forward_kinematics(self, q: Array) -> Array:
        """The pose (N, 4, 4) of the tip in the base frame."""
        return np.asarray(self.link_frames(q)[:, self.chain.tip] @ self.chain.tool)

    def jacobian(self, q: Array) -> Array:
        """The Jacobian J (N, 6, n) of the tip in the base frame, linear rows first."""
        frames = self.link_frames(q)
        tip = (frames[:, self.chain.tip] @ self.chain.tool)[:, :3, 3]
        return self.point_jacobian(frames, q, self.chain.tip, tip)

    def link_jacobians(self, q: Array) -> Array:
        """The Jacobians J_i (N, n, 6, n) of the origins of the link frames in the base frame, linear rows first."""
        frames = self.link_frames(q)
        jacobians = [self.point_jacobian(frames, q, i, frames[:, i, :3, 3]) for i in range(self.chain.links)]
        return np.stack(jacobians, axis=1)

    def point_jacobian(self, frames: Array, q: Array, link: int, point: Array) -> Array:
        """The Jacobian J (N, 6, n) of a point (N, 3) that is fixed to ``link``, in the base frame.

        ``frames`` are the link frames at ``q``; the base is link -1.
        """
        J = np.zeros((len(point), 6, self.chain.links))
        i = link
        while i >= 0:
            angular, linear = self.axes[i]
            R, origin = frames[:, i, :3, :3], frames[:, i, :3, 3]
            J[:, 3:, i] = R @ angular
            J[:, :3, i] = R @ linear + _cross(J[:, 3:, i], point - origin)
            i = self.chain.parents[i]
        return np.asarray(J @ self._coupling(q))

    def point_acceleration(self, q: Array, dq: Array, link: int, place: Array) -> Array:
        """The acceleration (N, 3), in the base frame and for ddq = 0, of the ``place`` (3,) in the frame of ``link``.

        The base is link -1.
        """
        if link < 0:
            return np.zeros((len(q), 3))
        return self._acceleration(q, self._outward(q, dq, np.zeros_like(dq), np.zeros(3)), link, place)[:, :3]

    def _acceleration(self, q: Array, out: _Outward, link: int, place: Array) -> Array:
        """The acceleration (N, 6) of ``link`` at ``place`` in its frame, in the base frame, linear rows first."""
        w, wd = out.w[link], out.wd[link]
        r = np.broadcast_to(place, w.shape)
        linear = out.vd[link] + _cross(w, out.v[link]) + _cross(wd, r) + _cross(w, _cross(w, r))
        R = self.link_frames(q)[:, link, :3, :3]
        return np.concatenate([np.einsum("nij,nj->ni", R, linear), np.einsum("nij,nj->ni", R, wd)], axis=1)

    def jacobian_dot_dq(self, q: Array, dq: Array) -> Array:
        """The vector dJ/dt dq (N, 6): the acceleration of the tip in the base frame for ddq = 0, linear rows first."""
        return self._tip_acceleration(q, self._outward(q, dq, np.zeros_like(dq), np.zeros(3)))

    def link_jacobians_dot_dq(self, q: Array, dq: Array) -> Array:
        """The accelerations (N, links, 6) of all link frames in the base frame for ddq = 0, linear rows first."""
        out = self._outward(q, dq, np.zeros_like(dq), np.zeros(3))
        return np.stack([self._acceleration(q, out, i, np.zeros(3)) for i in range(self.chain.links)], axis=1)

    def _tip_acceleration(self, q: Array, out: _Outward) -> Array:
        """The acceleration (N, 6) of the tip in the base frame, linear rows first."""
        return self._acceleration(q, out, self.chain.tip, self.chain.tool[:3, 3])

    def floating_jacobian(self, q: Array) -> Array:
        """The Jacobian J (N, 6, 6 + n) of the tip over the twist of a floating base and dq, linear rows first.

        Column k is the velocity of the tip, in base axes, for the unit velocity k.
        """
        R, columns = self.link_frames(q)[:, self.chain.tip, :3, :3], []
        for unit in np.eye(6 + q.shape[1]):
            base = still_base(len(q), unit[:6])
            out = self._outward(q, np.tile(unit[6:], (len(q), 1)), np.zeros_like(q), np.zeros(3), base)
            w, v = out.w[self.chain.tip], out.v[self.chain.tip]
            both = v + _cross(w, np.broadcast_to(self.chain.tool[:3, 3], w.shape)), w
            columns.append(np.concatenate([np.einsum("nij,nj->ni", R, part) for part in both], axis=1))
        return np.stack(columns, axis=2)

    def floating_jacobian_dot_dq(self, q: Array, dq: Array, twist: Array) -> Array:
        """The acceleration (N, 6) of the tip, in base axes, where neither dq nor the ``twist`` (N, 6) changes."""
        base = replace(still_base(len(q)), twist=twist)
        return self._tip_acceleration(q, self._outward(q, dq, np.zeros_like(q), np.zeros(3), base))

    def floating_momentum(self, q: Array, dq: Array, twist: Array) -> Array:
        """The momentum (N, 6) of all links about the base origin, linear part first, in base axes."""
        base = replace(still_base(len(q)), twist=twist)
        out, frames = self._outward(q, dq, np.zeros_like(q), np.zeros(3), base), self.link_frames(q)
        total = np.zeros((len(q), 6))
        for i, (phi, inertia) in enumerate(zip(self.phi, self._tensors, strict=True)):
            w, v, R = out.w[i], out.v[i], frames[:, i, :3, :3]
            P = np.einsum("nij,nj->ni", R, phi[0] * v + _cross(w, np.broadcast_to(phi[1:4], w.shape)))
            L = np.einsum("nij,nj->ni", R, w @ inertia + _cross(np.broadcast_to(phi[1:4], v.shape), v))
            total += np.concatenate([P, L + _cross(frames[:, i, :3, 3], P)], axis=1)
        return total

    def _outward(self, q: Array, dq: Array, ddq: Array, gravity: Array, floating: BaseState | None = None) -> _Outward:
        """Velocities and accelerations of all links, base to tip; gravity enters as an acceleration of the base.

        The base rests, or moves as ``floating`` says.
        """
        zero = np.zeros((len(q), 3))
        start = (zero, zero, zero, zero - self.chain.base[:3, :3].T @ gravity)
        if floating is not None:
            weight = np.einsum("nji,j->ni", rotations(floating.orientation), gravity)
            v, w = floating.twist[:, :3], floating.twist[:, 3:]
            start = (w, v, floating.twist_rate[:, 3:], floating.twist_rate[:, :3] - weight)
        C = self._coupling(q)
        dy, ddy = ((C @ rates[:, :, None])[:, :, 0] for rates in (dq, ddq))
        if self.loops is not None:
            x, n = self._positions(q), self.chain.n
            dx = np.concatenate([dq, (self.loops.passive_rates(x) @ dq[:, :, None])[:, :, 0]], axis=1)
            ddy = ddy + self.loops.passive_accelerations(x, dx) @ self.chain.coupling[:, n:].T
        out = _Outward(C, [], [], [], [], [], [])
        for i, step in enumerate(self._steps(q)):
            last = self.chain.parents[i]
            w, v, wd, vd = start if last < 0 else (out.w[last], out.v[last], out.wd[last], out.vd[last])
            R, p = step[:, :3, :3], step[:, :3, 3]
            back = np.swapaxes(R, 1, 2)
            angular, linear = self.axes[i]
            rate, acceleration = dy[:, i : i + 1], ddy[:, i : i + 1]
            v, vd = v + _cross(w, p), vd + _cross(wd, p)
            w, v, wd, vd = (np.einsum("nij,nj->ni", back, x) for x in (w, v, wd, vd))
            w, v = w + angular * rate, v + linear * rate
            wd = wd + angular * acceleration + _cross(w, angular * rate)
            vd = vd + linear * acceleration + _cross(w, linear * rate) + _cross(v, angular * rate)
            for store, value in zip((out.R, out.p, out.w, out.v, out.wd, out.vd), (R, p, w, v, wd, vd), strict=True):
                store.append(value)
        return out

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array, *, with_gravity: bool = True) -> Array:
        """The joint torques tau (N, n) of the links and the drive inertia, without friction."""
        gravity = self.chain.gravity if with_gravity else np.zeros(3)
        return self._inward(self._outward(q, dq, ddq, gravity), ddq)[1]

    def floating_inverse_dynamics(self, q: Array, dq: Array, ddq: Array, base: BaseState) -> tuple[Array, Array]:
        """The wrench (N, 6) on the floating ``base``, force first, and the joint torques (N, n), without friction."""
        return self._inward(self._outward(q, dq, ddq, self.chain.gravity, base), ddq)

    def _inward(self, out: _Outward, ddq: Array) -> tuple[Array, Array]:
        """The wrench (N, 6) on the first link, force first, and the joint torques (N, n), tip to base."""
        joints = np.zeros((len(ddq), self.chain.links))
        forces, moments = ([np.zeros((len(ddq), 3)) for _ in range(self.chain.links)] for _ in range(2))
        for i in reversed(range(self.chain.links)):
            force, moment = forces[i], moments[i]
            m, h, inertia = self.phi[i, 0], self.phi[i, 1:4], self._tensors[i]
            w, v, wd, vd = out.w[i], out.v[i], out.wd[i], out.vd[i]
            momentum, spin = m * v + _cross(w, h), w @ inertia + _cross(h, v)
            force = force + m * vd + _cross(wd, h) + _cross(w, momentum)
            moment = moment + wd @ inertia + _cross(h, vd) + _cross(w, spin) + _cross(v, momentum)
            angular, linear = self.axes[i]
            joints[:, i] = moment @ angular + force @ linear
            before = self.chain.parents[i]
            if before >= 0:
                force = np.einsum("nij,nj->ni", out.R[i], force)
                forces[before] = forces[before] + force
                moments[before] += np.einsum("nij,nj->ni", out.R[i], moment) + _cross(out.p[i], force)
        torques = np.asarray(ddq @ self.chain.drive_inertia + (joints[:, None] @ out.coupling)[:, 0])
        return np.concatenate([force, moment], axis=1), torques

    def floating_regressor(self, q: Array, dq: Array, ddq: Array, base: BaseState) -> Array:
        """The regressor Y (N, 6 + n, 10 links) of wrench and torques on a floating base, without drive inertia."""
        columns = []
        for phi in (np.zeros(self.phi.size), *np.eye(self.phi.size)):
            reference = NewtonEuler(self.chain, phi.reshape(self.phi.shape))
            columns.append(np.concatenate(reference.floating_inverse_dynamics(q, dq, ddq, base), axis=1))
        return np.stack(columns[1:], axis=2) - columns[0][:, :, None]

    def floating_mass_matrix(self, q: Array) -> Array:
        """The mass matrix (N, 6 + n, 6 + n) over the twist of a floating base and dq.

        Column k is what a unit acceleration changes of wrench and torques.
        """
        count, n = q.shape
        still, rest = still_base(count), np.zeros_like(q)
        at_rest = np.concatenate(self.floating_inverse_dynamics(q, rest, rest, still), axis=1)
        columns = []
        for k in range(6 + n):
            unit = np.tile(np.eye(6 + n)[k], (count, 1))
            moved = replace(still, twist_rate=unit[:, :6])
            columns.append(
                np.concatenate(self.floating_inverse_dynamics(q, rest, unit[:, 6:], moved), axis=1) - at_rest
            )
        return np.stack(columns, axis=2)

    def standard_regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """The regressor Y (N, n, 10 links): torque of the links, without drive inertia, per standard parameter."""
        out = self._outward(q, dq, ddq, self.chain.gravity)
        n = self.chain.links
        Y = np.zeros((len(q), n, 10 * n))
        for j in range(n):
            W = _cross_matrix(out.w[j])
            lift = out.vd[j] + _cross(out.w[j], out.v[j])
            force, moment = np.zeros((len(q), 3, 10)), np.zeros((len(q), 3, 10))
            force[:, :, 0] = lift
            force[:, :, 1:4] = _cross_matrix(out.wd[j]) + W @ W
            moment[:, :, 1:4] = -_cross_matrix(lift)
            moment[:, :, 4:] = _tensor_rows(out.wd[j]) + W @ _tensor_rows(out.w[j])
            i = j
            while i >= 0:
                angular, linear = self.axes[i]
                Y[:, i, 10 * j : 10 * j + 10] = np.einsum("i,nik->nk", angular, moment)
                Y[:, i, 10 * j : 10 * j + 10] += np.einsum("i,nik->nk", linear, force)
                force = out.R[i] @ force
                moment = out.R[i] @ moment + _cross_matrix(out.p[i]) @ force
                i = self.chain.parents[i]
        return np.asarray(np.swapaxes(out.coupling, -1, -2) @ Y)

    def mass_matrix(self, q: Array) -> Array:
        """The mass matrix M (N, n, n); column k is the torque for unit acceleration of joint k at rest, no gravity."""
        count, n = q.shape
        units = np.repeat(np.eye(n), count, axis=0)
        torques = self.inverse_dynamics(np.tile(q, (n, 1)), np.zeros_like(units), units, with_gravity=False)
        return np.asarray(torques.reshape(n, count, n).transpose(1, 2, 0))

    def coriolis(self, q: Array, dq: Array) -> Array:
        """The Coriolis and centrifugal torques c(q, dq), (N, n)."""
        return self.inverse_dynamics(q, dq, np.zeros_like(q), with_gravity=False)

    def gravity(self, q: Array) -> Array:
        """The gravity torques g(q), (N, n)."""
        still = np.zeros_like(q)
        return self.inverse_dynamics(q, still, still)

    def energy(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Kinetic energy with drive inertia, and potential energy counted from the base frame's origin, (N,) each."""
        out = self._outward(q, dq, np.zeros_like(dq), np.zeros(3))
        frames = self.link_frames(q)
        kinetic = 0.5 * np.sum(dq * (dq @ self.chain.drive_inertia), axis=1)
        potential = np.zeros(len(q))
        for i in range(self.chain.links):
            m, h, w, v = self.phi[i, 0], self.phi[i, 1:4], out.w[i], out.v[i]
            spin = w @ self._tensors[i]
            kinetic = kinetic + np.sum(0.5 * m * v * v + v * _cross(w, h) + 0.5 * w * spin, axis=1)
            potential = potential - (m * frames[:, i, :3, 3] + frames[:, i, :3, :3] @ h) @ self.chain.gravity
        return kinetic, potential
