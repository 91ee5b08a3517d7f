"""The methods of a model that are made from the table of model functions. Written by `make stubs`."""

from typing import Any, Literal, overload

from numpy.typing import ArrayLike

from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.results import (
    AdaptiveStep,
    ClosedLoops,
    Contact,
    ControlStep,
    DynamicsTerms,
    ElasticAccelerations,
    Energy,
    ExternalLoad,
    FloatingAccelerations,
    FloatingDerivatives,
    FloatingForces,
    ForwardDynamicsDerivatives,
    FrictionStep,
    InverseDynamicsDerivatives,
    Kinematics,
    LoopPositions,
    Manipulability,
    MomentumTerms,
    Motion,
    ObserverState,
    ObserverStep,
    OperationalStep,
    PathDynamics,
    PointMotion,
    RotorMotion,
    SecondDerivatives,
    TimedMotion,
)

class TableFunctions(Calls):
    """Methods for the functions of the model."""

    def forward_kinematics(self, q: ArrayLike, *, tip: str | None = None) -> Array:
        """Pose of the tip in the base frame, ``T_0_n = base A_1 ... A_n tool``. Source: (14.5).

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            Homogeneous transforms T, (..., 4, 4), positions in m.

        Raises:
            ValueError: the robot has no tip of this name.
        """

    def link_frames(self, q: ArrayLike) -> Array:
        """Poses of all link frames in the base frame, ``T_0_i = base A_1 ... A_i``, without the tool.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            Homogeneous transforms T, (..., n, 4, 4), positions in m: ``T[..., i, :, :]`` is the frame of link i + 1.
        """

    def jacobian(self, q: ArrayLike, *, tip: str | None = None) -> Array:
        """Geometric Jacobian of the tip, ``[v; w] = J(q) dq``, in the axes of the base frame.

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            J, (..., 6, n): linear velocity v of the tip (m/s) first, then angular velocity w (rad/s).

        Raises:
            ValueError: the robot has no tip of this name.
        """

    def link_jacobians(self, q: ArrayLike) -> Array:
        """Geometric Jacobians of the origins of all link frames, ``[v_i; w_i] = J_i(q) dq``, in the base frame's axes.

        A wrench [f; m] at the origin of link frame i loads the joints with ``tau = J_i' [f; m]``.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            J, (..., n, 6, n), linear rows first: ``J[..., i, :, :]`` belongs to ``link_frames(q)[..., i, :, :]``. The
            columns of joints beyond the link are zero.
        """

    def kinematics(self, q: ArrayLike, *, tip: str | None = None) -> Kinematics:
        """Pose and Jacobian of the tip from one evaluation, cheaper than one call for each.

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            The named tuple (T, J): as :meth:`forward_kinematics`, (..., 4, 4), and :meth:`jacobian`, (..., 6, n).

        Raises:
            ValueError: the robot has no tip of this name.
        """

    def jacobian_dot_dq(self, q: ArrayLike, dq: ArrayLike, *, tip: str | None = None) -> Array:
        """Acceleration of the tip for ddq = 0, ``a = (dJ/dt) dq``, so that ``d[v; w]/dt = J ddq + a``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            a, (..., 6), in the axes of the base frame: linear part (m/s^2) first, then angular (rad/s^2).

        Raises:
            ValueError: the robot has no tip of this name.
        """

    def tip_target(self, T: ArrayLike, q: ArrayLike, *, tip: str | None = None) -> Array:
        """Target of the inverse kinematics of the tip, at the values in q of the joints that it shares with other tips.

        Args:
            T: wanted pose of the tip in the base frame, (..., 4, 4), translation in m.
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            target, (..., 4, 4), translation in m: ``T_carrier(q)^-1 T`` with the frame of the last link that the shared
            joints move. The other elements of q are not read.

        Raises:
            InputError: the wanted pose is no rigid motion.
            ValueError: ``tip`` is not given, or shares no joint with other tips.
        """

    def mass_matrix(self, q: ArrayLike, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None) -> Array:
        """Mass matrix ``M(q)``, symmetric, drive inertia included. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.

        Returns:
            M, (..., n, n), kg m^2, kg m or kg.
        """

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Coriolis matrix ``C(q, dq)`` of the Christoffel symbols: ``c = C dq``, and ``dM/dt - 2 C`` is skew-symmetric.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            C, (..., n, n), in SI units.
        """

    def coriolis(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Coriolis and centrifugal torques ``c = C(q, dq) dq``. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            c, (..., n), N m or N.
        """

    def coriolis_transpose(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Transposed Coriolis matrix times dq, for momentum observers: ``d(M dq)/dt = tau + p - g``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            ``p = C(q, dq)' dq``, (..., n), N m or N.
        """

    def gravity(self, q: ArrayLike, beta: ArrayLike | None = None, *, gravity: ArrayLike | None = None) -> Array:
        """Gravity torques ``g = dU/dq``: the joint torques that hold the arm still. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            g, (..., n), N m or N.
        """

    @overload
    def bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
    ) -> Array:
        """Bias torques ``h = c(q, dq) + g(q)``: the joint torques for ddq = 0, without friction.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.

        Returns:
            h, (..., n), N m or N. Of a floating base that moves, what :meth:`floating_bias` returns.
        """
    @overload
    def bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
    ) -> Array: ...
    def dynamics_terms(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> DynamicsTerms:
        """All terms of ``tau = M ddq + c + g`` from one evaluation, cheaper than one call for each.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (M, c, g): (..., n, n), (..., n) and (..., n).
        """

    @overload
    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        twist_rate: None = None,
    ) -> Array:
        """Joint torques ``tau = M ddq + c + g`` of rigid body and drive inertia, without friction. Source: (14.6).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.
            twist_rate: of a floating base that moves: time derivatives of the components of the twist, (..., 6), m/s^2
                and rad/s^2; the base origin is accelerated by ``dv/dt + omega x v``.

        Returns:
            tau, (..., n), N m or N. Of a floating base that moves, what :meth:`floating_inverse_dynamics` returns.
        """
    @overload
    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
    ) -> FloatingForces: ...
    @overload
    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        wrench: None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Joint accelerations ``ddq = M^-1 (tau - c - g)``; friction is not part of it: subtract it from ``tau``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.
            wrench: of a floating base that moves: force, then moment about the base origin, on the base, (..., 6), N
                and N m, base axes.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            ddq, (..., n), rad/s^2 or m/s^2; zero where M is not positive definite. The status, (...), is 0 where M is
            positive definite and 1 elsewhere. Of a floating base that moves, what :meth:`floating_forward_dynamics`
            returns.

        Raises:
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
    @overload
    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        wrench: None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        wrench: None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
        wrench: ArrayLike,
        with_status: bool = False,
    ) -> Any: ...
    @overload
    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        twist_rate: None = None,
    ) -> InverseDynamicsDerivatives:
        """Joint torques and their analytical derivatives, ``d tau = dtau_dq d(q) + dtau_dv d(dq) + M d(ddq)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.
            twist_rate: of a floating base that moves: time derivatives of the components of the twist, (..., 6), m/s^2
                and rad/s^2; the base origin is accelerated by ``dv/dt + omega x v``.

        Returns:
            The named tuple (tau, dtau_dq, dtau_dv, M): (..., n), then three times (..., n, n), in SI units. Of a
            floating base that moves, what :meth:`floating_inverse_dynamics_derivatives` returns.
        """
    @overload
    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
    ) -> FloatingDerivatives: ...
    @overload
    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ForwardDynamicsDerivatives:
        """Joint accelerations and their derivatives, ``d ddq = dddq_dq d(q) + dddq_dv d(dq) + dddq_dtau d(tau)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (ddq, dddq_dq, dddq_dv, dddq_dtau): (..., n), then three times (..., n, n), in SI units;
            ``dddq_dtau`` is the inverse of M. All are zero where M is not positive definite; the status, (...), is 1
            there and 0 elsewhere.

        Raises:
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
    @overload
    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ForwardDynamicsDerivatives, Array]: ...
    @overload
    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> ForwardDynamicsDerivatives | tuple[ForwardDynamicsDerivatives, Array]: ...
    @overload
    def regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        twist_rate: None = None,
    ) -> Array:
        """Base regressor: ``tau = Y(q, dq, ddq) beta``, rigid body without drive inertia. Source: (14.10).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.
            twist_rate: of a floating base that moves: time derivatives of the components of the twist, (..., 6), m/s^2
                and rad/s^2; the base origin is accelerated by ``dv/dt + omega x v``.

        Returns:
            Y, (..., n, b), in SI units; its columns belong to ``base_parameter_names``. Of a floating base that moves,
            what :meth:`floating_regressor` returns.
        """
    @overload
    def regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
    ) -> Array: ...
    def regressor_transpose(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        e: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Transposed base regressor times a vector, ``r = Y' e``, without forming Y: for adaptation. Source: (14.23).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            e: the vector, (..., n), in any unit, such as a tracking error.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            r, (..., b), in SI units times the unit of ``e``.
        """

    def standard_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Regressor of the standard parameters of all links: ``tau = Y(q, dq, ddq) phi``.

        phi lists, link by link, m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz: mass (kg), first moments (kg m) and
        inertia tensor (kg m^2, Ixy = -integral of x y dm) about the origin of the link frame, in its axes.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            Y, (..., n, 10 n), in SI units.
        """

    def energy(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Energy:
        """Kinetic energy ``dq' M dq / 2`` and potential energy U with ``dU/dq = g``, defined up to a constant.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (kinetic, potential), each (...), J.
        """

    def link_velocities(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocities of all link frames in the base frame, ``[v_i; omega_i] = J_i(q) dq``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.

        Returns:
            V, (..., n, 6): linear, m/s, then angular, rad/s.
        """

    def link_jacobians_dot_dq(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Time derivatives of the Jacobians of all link frames times dq: the accelerations of the frames for ddq = 0.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.

        Returns:
            A, (..., n, 6): linear, m/s^2, then angular, rad/s^2, in the base frame.
        """

    def point_jacobian(self, T: ArrayLike, J: ArrayLike, point: ArrayLike) -> Array:
        """Geometric Jacobian of a point that is fixed to a frame: ``[v_p; omega] = J_p dq``.

        Args:
            T: pose of the frame, (..., 4, 4), translation in m.
            J: its Jacobian, (..., 6, n), SI units, base frame, linear rows first.
            point: the point in that frame, (..., 3), m.

        Returns:
            J_p, (..., 6, n), base frame, linear rows first.
        """

    def point_motion(self, T: ArrayLike, V: ArrayLike, A: ArrayLike, point: ArrayLike) -> PointMotion:
        """Velocity and acceleration of a point that is fixed to a frame.

        Args:
            T: pose of the frame, (..., 4, 4), translation in m.
            V: its velocity, (..., 6), m/s and rad/s, linear part first, such as ``link_velocities(q, dq)[..., i, :]``.
            A: its acceleration, (..., 6), m/s^2 and rad/s^2. If only its part (dJ/dt) dq is given, A_p is that part for
                the point.
            point: the point in that frame, (..., 3), m.

        Returns:
            The named tuple (V_p, A_p), (..., 6) each, in the base frame.
        """

    def wrench_torques(self, J: ArrayLike, F: ArrayLike) -> Array:
        """Joint torques ``tau = J' F`` of a wrench: if F acts on the robot, ``M ddq + c + g = tau_m + J' F``.

        Args:
            J: Jacobian of the frame or point at which the wrench acts, (..., 6, n), SI units.
            F: force and moment about that point, (..., 6), N and N m, in base axes.

        Returns:
            tau, (..., n), N m or N.
        """

    def tool_kinematics(self, q: ArrayLike, tool: ArrayLike, *, tip: str | None = None) -> Kinematics:
        """Pose and Jacobian of a tool in place of that of the robot file.

        Args:
            q: joint positions, (..., n), rad or m.
            tool: pose of the tool in the last link frame, (4, 4) or (..., 4, 4), translation in m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            The named tuple (T, J): (..., 4, 4) and (..., 6, n), base frame.

        Raises:
            InputError: the tool is no rigid motion: another last row than 0 0 0 1, or no rotation.
            ValueError: the robot has no tip of this name.
        """

    def tool_target(self, T: ArrayLike, tool: ArrayLike, *, tip: str | None = None) -> Array:
        """Target of ``inverse_kinematics`` for which a tool in place of that of the robot file has the pose T.

        Args:
            T: wanted pose of the tool in the base frame, (..., 4, 4), translation in m.
            tool: pose of the tool in the last link frame, (4, 4) or (..., 4, 4), translation in m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            target, (..., 4, 4), translation in m: ``T tool^-1 T_tool`` with the tool T_tool of the robot file.

        Raises:
            InputError: the tool or the wanted pose is no rigid motion: another last row than 0 0 0 1, no rotation.
            ValueError: the robot has no tip of this name.
        """

    @overload
    def manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> Manipulability:
        """Manipulability ``w = sqrt(det(J J'))`` (of ``J' J`` for fewer than six joints) and its gradient.

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (w, dw_dq): (...) and (..., n); zero where J loses rank, and the status, (...), is 1 there.

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, and ``with_status`` is False.
            ValueError: the robot has no tip of this name.
        """
    @overload
    def manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[Manipulability, Array]: ...
    @overload
    def manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: bool,
    ) -> Manipulability | tuple[Manipulability, Array]: ...
    @overload
    def position_manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> Manipulability:
        """Manipulability of the position of the tip alone, from the three linear rows of J.

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (w, dw_dq): (...) and (..., n).

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, and ``with_status`` is False.
            ValueError: the robot has no tip of this name.
        """
    @overload
    def position_manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[Manipulability, Array]: ...
    @overload
    def position_manipulability(
        self,
        q: ArrayLike,
        *,
        tip: str | None = None,
        with_status: bool,
    ) -> Manipulability | tuple[Manipulability, Array]: ...
    @overload
    def nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Projection ``N = 1 - J' (J J' + damping^2 1)^-1 J`` on joint motions that keep the pose of the tip.

        Args:
            q: joint positions, (..., n), rad or m.
            damping: damping of the projection: 0 is exact; larger values keep N smooth through singularities, (...), SI
                units.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            N, (..., n, n); the unit matrix where J loses rank and damping is 0, and the status, (...), is 1 there.

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, damping is 0, and ``with_status`` is False.
            ValueError: the robot has six joints or fewer.
        """
    @overload
    def nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def position_nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Projection N on joint motions that keep the position of the tip, while its orientation may change.

        Args:
            q: joint positions, (..., n), rad or m.
            damping: damping of the projection: 0 is exact; larger values keep N smooth through singularities, (...), m
                or 1.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            N, (..., n, n).

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, damping is 0, and ``with_status`` is False.
            ValueError: the robot has three joints or fewer.
        """
    @overload
    def position_nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def position_nullspace(
        self,
        q: ArrayLike,
        damping: ArrayLike = 0.0,
        *,
        tip: str | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    def momentum_terms(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> MomentumTerms:
        """Generalized momentum and the terms of its rate, for momentum observers: ``dp/dt = tau + ct - g``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (p, ct, g), (..., n) each: ``p = M dq`` in N m s or N s, ``ct = C(q, dq)' dq`` and the
            gravity torques in N m or N.
        """

    def reference_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Torques ``tau = M a + C(q, dq) v + g`` of a reference motion at the measured velocity (Slotine and Li).

        C is the matrix of the Christoffel symbols, so that ``dM/dt - 2 C`` is skew-symmetric.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            v: reference velocities, (..., n), rad/s or m/s.
            a: reference accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            tau, (..., n), N m or N.
        """

    def reference_regressor_transpose(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        e: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Transposed regressor of :meth:`reference_torque` times a vector, ``r = Y' e``, for adaptive control.

        ``Y(q, dq, v, a) beta = M a + C(q, dq) v + g``, without drive inertia; Y is never formed.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            v: reference velocities, (..., n), rad/s or m/s.
            a: reference accelerations, (..., n), rad/s^2 or m/s^2.
            e: the vector, (..., n), in any unit, such as a tracking error of the velocities.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            r, (..., b), in SI units times the unit of ``e``.
        """

    @overload
    def pd_gravity(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ControlStep:
        """PD control with gravity and friction compensation, ``tau = kp e + kd e' + ki z + g(q) + f(dq_d)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            ki: gains of the integral, (n,) or (..., n), N m/(rad s) or N/(m s); zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick. Where
            the input is refused the status, (...), is 2; ``z_next`` is then z, tau zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def pd_gravity(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ControlStep, Array]: ...
    @overload
    def pd_gravity(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> ControlStep | tuple[ControlStep, Array]: ...
    @overload
    def feedforward(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ControlStep:
        """Torques of the desired motion, ``M ddq_d + c + g`` at q_d and dq_d, with ``kp e + kd e' + ki z + f(dq_d)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            ki: gains of the integral, (n,) or (..., n), N m/(rad s) or N/(m s); zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick. Where
            the input is refused the status, (...), is 2; ``z_next`` is then z, tau zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def feedforward(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ControlStep, Array]: ...
    @overload
    def feedforward(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> ControlStep | tuple[ControlStep, Array]: ...
    @overload
    def computed_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ControlStep:
        """Computed torque, ``tau = M (ddq_d + kp e + kd e' + ki z) + c + g + f(dq_d)``. Source: (14.34).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), 1/s^2.
            kd: gains of the velocity error, (n,) or (..., n), 1/s.
            ki: gains of the integral, (n,) or (..., n), 1/s^3; zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick. Where
            the input is refused the status, (...), is 2; ``z_next`` is then z, tau zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def computed_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ControlStep, Array]: ...
    @overload
    def computed_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        width: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> ControlStep | tuple[ControlStep, Array]: ...
    @overload
    def slotine_li(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        lam: ArrayLike,
        k: ArrayLike,
        beta: ArrayLike,
        *,
        width: ArrayLike,
        gamma: ArrayLike,
        beta_min: ArrayLike,
        beta_max: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> AdaptiveStep:
        """Passivity-based tracking with adaptation of the base parameters (Slotine and Li 1987).

        ``tau = M a + C(q, dq) v + g - k s + f(dq_d)`` and ``beta_next = beta - Ts gamma Y' s``, with ``v = dq_d + lam
        e``, ``a = ddq_d + lam e'``, ``s = dq - v``; beta stays as it is while a joint is at its limit.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            lam: bandwidth of the error on s = 0, (n,) or (..., n), 1/s.
            k: gains of s, (n,) or (..., n), N m s/rad or N s/m.
            beta: base parameters, (..., b), SI units: at the start an estimate, then ``beta_next`` of the last tick.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            gamma: adaptation gains, (b,) or (..., b), (unit of beta)^2/J; zero for parameters to keep. Drive inertias
                are kept.
            beta_min: lower bounds of beta, (b,) or (..., b), SI units.
            beta_max: upper bounds of beta, (b,) or (..., b), SI units.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (tau, beta_next), (..., n) and (..., b). Where the input is refused the status, (...), is 2;
            ``beta_next`` is then beta, tau zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def slotine_li(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        lam: ArrayLike,
        k: ArrayLike,
        beta: ArrayLike,
        *,
        width: ArrayLike,
        gamma: ArrayLike,
        beta_min: ArrayLike,
        beta_max: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[AdaptiveStep, Array]: ...
    @overload
    def slotine_li(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        lam: ArrayLike,
        k: ArrayLike,
        beta: ArrayLike,
        *,
        width: ArrayLike,
        gamma: ArrayLike,
        beta_min: ArrayLike,
        beta_max: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> AdaptiveStep | tuple[AdaptiveStep, Array]: ...
    @overload
    def impedance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Impedance control of the tip, ``tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)``.

        The error e_x (6,) is that of the position (m), then the axis of the rotation from the actual to the desired
        orientation, times the sine of its angle.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            T_d: desired pose of the tip in the base frame, (..., 4, 4), translation in m.
            V_d: desired velocity of the tip, (..., 6), m/s and rad/s, base frame.
            stiffness: spring along and about the axes of the base, (6,) or (..., 6), N/m and N m/rad.
            damping: damper along and about these axes, (6,) or (..., 6), N s/m and N m s/rad.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            tau, (..., n), N m or N, within ``tau_max``. Where the input is refused the status, (...), is 2; tau is then
            zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
            ValueError: the robot has no tip of this name.
        """
    @overload
    def impedance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def impedance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> OperationalStep:
        """Operational-space control of the pose of the tip (Khatib 1987), damped near singular configurations.

        ``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J inv(M) J')`` and ``a
        = A_d + kp e_x + kd (V_d - J dq) + ki z``. The error e_x (6,) is that of the position (m), then the axis of the
        rotation from the actual to the desired orientation, times the sine of its angle.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            T_d: desired pose of the tip in the base frame, (..., 4, 4), translation in m.
            V_d: desired velocity of the tip, (..., 6), m/s and rad/s, base frame.
            A_d: desired acceleration of the tip, (..., 6), m/s^2 and rad/s^2, base frame.
            kp: gains of the error of the tip, (6,) or (..., 6), 1/s^2.
            kd: gains of the error of its velocity, (6,) or (..., 6), 1/s.
            ki: gains of the integral, (6,) or (..., 6), 1/s^3; zero for none.
            z: state of the integral, (..., 6), m s and rad s; zero at the start, then ``z_next`` of the last tick.
            tau_0: torques of a second task that must not move the tip, (..., n), N m or N; zero for none.
            damping: share, such as 0.01, of the mean diagonal entry of J inv(M) J' below which its pivots are damped,
                (...).
            tau_add: torques to add before the limits, (..., n), N m or N, such as friction at the desired speeds.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (tau, z_next), (..., n) and (..., 6): torques to apply and the state for the next tick. The
            status, (...), is 1 where damping acts; the tip then follows only where it can move. Where the input is
            refused the status, (...), is 2; ``z_next`` is then z, tau zero.

        Raises:
            numpy.linalg.LinAlgError: damping acts at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than six joints.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[OperationalStep, Array]: ...
    @overload
    def operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: bool,
    ) -> OperationalStep | tuple[OperationalStep, Array]: ...
    @overload
    def position_operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        p_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[False] = ...,
    ) -> OperationalStep:
        """Operational-space control of the position of the tip (Khatib 1987), damped near singular configurations.

        ``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J inv(M) J')`` and ``a
        = A_d + kp e_x + kd (V_d - J dq) + ki z``, J the first three rows of the Jacobian, e_x the position error (m).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            p_d: desired position of the tip in the base frame, (..., 3), m.
            V_d: desired velocity of the tip, (..., 3), m/s, base frame.
            A_d: desired acceleration of the tip, (..., 3), m/s^2, base frame.
            kp: gains of the error of the tip, (3,) or (..., 3), 1/s^2.
            kd: gains of the error of its velocity, (3,) or (..., 3), 1/s.
            ki: gains of the integral, (3,) or (..., 3), 1/s^3; zero for none.
            z: state of the integral, (..., 3), m s; zero at the start, then ``z_next`` of the last tick.
            tau_0: torques of a second task that must not move the tip, (..., n), N m or N; zero for none.
            damping: share, such as 0.01, of the mean diagonal entry of J inv(M) J' below which its pivots are damped,
                (...).
            tau_add: torques to add before the limits, (..., n), N m or N, such as friction at the desired speeds.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            tip: a named tip of the robot file in place of the unnamed one.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (tau, z_next), (..., n) and (..., 3): torques to apply and the state for the next tick. The
            status, (...), is 1 where damping acts; the tip then follows only where it can move. Where the input is
            refused the status, (...), is 2; ``z_next`` is then z, tau zero.

        Raises:
            numpy.linalg.LinAlgError: damping acts at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than three joints.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def position_operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        p_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: Literal[True],
    ) -> tuple[OperationalStep, Array]: ...
    @overload
    def position_operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        p_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        tau_add: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        tip: str | None = None,
        with_status: bool,
    ) -> OperationalStep | tuple[OperationalStep, Array]: ...
    @overload
    def momentum_observer_start(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ObserverState:
        """Initial state of the momentum observer (:meth:`momentum_observer`) for its first period.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (p, u), (..., n) each: ``p = M dq`` and ``u = C' dq - g - f(dq)``. Where the input is
            refused the status, (...), is 2; p and u are then zero, and no state to start with.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def momentum_observer_start(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ObserverState, Array]: ...
    @overload
    def momentum_observer_start(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: bool,
    ) -> ObserverState | tuple[ObserverState, Array]: ...
    @overload
    def momentum_observer(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        width: ArrayLike,
        p_last: ArrayLike,
        u_last: ArrayLike,
        r_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ObserverStep:
        """One period of the momentum observer, which estimates the torques r that the environment exerts, low-passed.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: torques applied since the last tick, (..., n), N m or N.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            p_last: momentum at the last tick, (..., n), N m s or N s.
            u_last: torques u at the last tick, (..., n), N m or N.
            r_last: estimate of the last tick, (..., n), N m or N; zero at the start.
            gain: pole of the observer, (...), 1/s.
            Ts: the period, (...), s.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (r, p, u), (..., n) each: the estimate, and the state for the next tick. Where the input is
            refused the status, (...), is 2; the results are then those of the last tick.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def momentum_observer(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        width: ArrayLike,
        p_last: ArrayLike,
        u_last: ArrayLike,
        r_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ObserverStep, Array]: ...
    @overload
    def momentum_observer(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        width: ArrayLike,
        p_last: ArrayLike,
        u_last: ArrayLike,
        r_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        with_status: bool,
    ) -> ObserverStep | tuple[ObserverStep, Array]: ...
    @overload
    def contact(
        self,
        r: ArrayLike,
        r_last: ArrayLike,
        change_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        threshold: ArrayLike,
        change_threshold: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> Contact:
        """One period of contact detection: compare estimated external torques and their changes with thresholds.

        The change ``h = alpha^2 change_last + alpha (r - r_last)``, alpha = exp(-gain Ts), is what an observer with
        twice the pole would estimate, minus r: a contact shows in it although the model errors in r are larger.

        Args:
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            r_last: those of the last tick, (..., n), N m or N; zero at the start.
            change_last: change of the last tick, (..., n), N m or N; zero at the start.
            gain: pole of the momentum observer, (...), 1/s.
            Ts: the period, (...), s.
            threshold: thresholds of r, (n,) or (..., n), N m or N, of ``contact-thresholds``; inf for none.
            change_threshold: thresholds of the change, (n,) or (..., n), N m or N, of the same command; inf for none.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (ratio, touches, change): the larger of ``|r|/threshold`` and ``|h|/change_threshold``,
            (..., n), 1 where one of them exceeds 1, (...), and the change h for the next tick, (..., n). Where the
            input is refused the status, (...), is 2; ``change`` is then the last one, ``touches`` 1.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def contact(
        self,
        r: ArrayLike,
        r_last: ArrayLike,
        change_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        threshold: ArrayLike,
        change_threshold: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[Contact, Array]: ...
    @overload
    def contact(
        self,
        r: ArrayLike,
        r_last: ArrayLike,
        change_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        threshold: ArrayLike,
        change_threshold: ArrayLike,
        *,
        with_status: bool,
    ) -> Contact | tuple[Contact, Array]: ...
    @overload
    def external_wrench(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> ExternalLoad:
        """Estimate the wrench F on the robot that causes the external torques r: ``F = P J inv(S) r``.

        It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of the errors of r and
        the Jacobian J of the point where the wrench acts.

        Args:
            J: Jacobian of the tip or of the point where it acts, (..., 6, n), SI units, linear rows first.
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            covariance: of the errors of r, (n, n) or (..., n, n), (N m)^2 or N^2, of ``contact-thresholds``.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (F, P, condition): the wrench in base axes, (..., 6), N and N m, its covariance, (..., 6,
            6), and a condition number, (...), that is 1 at best and large near singular configurations. Where the input
            is refused the status, (...), is 2; the results are then zero.

        Raises:
            numpy.linalg.LinAlgError: the torques do not determine it at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than six joints.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def external_wrench(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[ExternalLoad, Array]: ...
    @overload
    def external_wrench(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: bool,
    ) -> ExternalLoad | tuple[ExternalLoad, Array]: ...
    @overload
    def external_force(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> ExternalLoad:
        """Estimate the force F, without a moment, that causes the external torques r: ``F = P J inv(S) r``.

        It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of the errors of r and J
        the first three rows of the Jacobian of the point where the force acts.

        Args:
            J: Jacobian of the tip or of the point where it acts, (..., 6, n), SI units, linear rows first.
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            covariance: of the errors of r, (n, n) or (..., n, n), (N m)^2 or N^2, of ``contact-thresholds``.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (F, P, condition): the force in base axes, (..., 3), N, its covariance, (..., 3, 3), and a
            condition number, (...), that is 1 at best and large near singular configurations. Where the input is
            refused the status, (...), is 2; the results are then zero.

        Raises:
            numpy.linalg.LinAlgError: the torques do not determine it at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than three joints.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def external_force(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[ExternalLoad, Array]: ...
    @overload
    def external_force(
        self,
        J: ArrayLike,
        r: ArrayLike,
        covariance: ArrayLike,
        *,
        with_status: bool,
    ) -> ExternalLoad | tuple[ExternalLoad, Array]: ...
    @overload
    def elastic_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> ElasticAccelerations:
        """Accelerations of links and rotors under torques on the rotors.

        Args:
            q: positions of the links, (..., n), rad or m.
            dq: velocities of the links, (..., n), rad/s or m/s.
            theta: positions of the rotors, seen at the joints, (..., n), rad or m.
            dtheta: velocities of the rotors, (..., n), rad/s or m/s.
            tau: torques on the rotors, friction subtracted, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, seen at the joints, (n,) or (..., n), kg m^2 or kg; by default those
                of the robot file.
            stiffness: stiffnesses of the joints, (n,) or (..., n), N m/rad or N/m; positive; by default those of the
                robot file.
            damping: dampings, (n,) or (..., n), N m s/rad or N s/m; by default those of the robot file, else zero.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (ddq, ddtheta), (..., n) each, rad/s^2 or m/s^2. The status, (...), is 1 where the mass
            matrix is not positive definite; ddq is zero there.

        Raises:
            numpy.linalg.LinAlgError: the mass matrix is not positive definite, and ``with_status`` is False.
        """
    @overload
    def elastic_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[ElasticAccelerations, Array]: ...
    @overload
    def elastic_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        with_status: bool,
    ) -> ElasticAccelerations | tuple[ElasticAccelerations, Array]: ...
    def elastic_inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        d3q: ArrayLike,
        d4q: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
    ) -> RotorMotion:
        """Torques of the motors and motion of the rotors for a motion of the links, without damping and friction.

        ``tau = J theta'' + tau_l``, ``theta = q + tau_l/K``, with the torques tau_l of the links.

        Args:
            q: positions of the links, (..., n), rad or m.
            dq: their velocities, (..., n), rad/s or m/s.
            ddq: their accelerations, (..., n), rad/s^2 or m/s^2.
            d3q: their third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q: their fourth derivatives, (..., n), rad/s^4 or m/s^4.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, seen at the joints, (n,) or (..., n), kg m^2 or kg; by default those
                of the robot file.
            stiffness: stiffnesses of the joints, (n,) or (..., n), N m/rad or N/m; positive; by default those of the
                robot file.

        Returns:
            The named tuple (tau, theta, dtheta), (..., n) each: torques, N m or N, positions and velocities of rotors.
        """

    @overload
    def elastic_feedforward(
        self,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Feed-forward of a motion of the links, and PD control of the rotors, where the encoders are.

        ``tau = J theta_d'' + tau_l + kp (theta_d - theta) + kd (theta_d' - theta') + f(dq_d)``, where theta_d are the
        rotor positions and tau_l the torques of the links that belong to the desired motion.

        Args:
            theta: measured positions of the rotors, seen at the joints, (..., n), rad or m.
            dtheta: measured velocities of the rotors, (..., n), rad/s or m/s.
            q_d: desired positions of the links, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            d3q_d: desired third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q_d: desired fourth derivatives, (..., n), rad/s^4 or m/s^4.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            rotor_inertia: inertias of the rotors, seen at the joints, (n,) or (..., n), kg m^2 or kg; by default those
                of the robot file.
            stiffness: stiffnesses of the joints, (n,) or (..., n), N m/rad or N/m; positive; by default those of the
                robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The torques to apply, (..., n), N m or N. Where the input is refused the status, (...), is 2; tau is then
            zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def elastic_feedforward(
        self,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def elastic_feedforward(
        self,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def elastic_feedback_linearization(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        w: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Feedback linearisation with elastic joints (Spong 1987): errors of the links decay with four poles at -w.

        Args:
            q: measured positions of the links, (..., n), rad or m.
            dq: measured velocities of the links, (..., n), rad/s or m/s.
            theta: measured positions of the rotors, seen at the joints, (..., n), rad or m.
            dtheta: measured velocities of the rotors, (..., n), rad/s or m/s.
            q_d: desired positions of the links, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            d3q_d: desired third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q_d: desired fourth derivatives, (..., n), rad/s^4 or m/s^4.
            w: bandwidths of the loops, (n,) or (..., n), rad/s.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            rotor_inertia: inertias of the rotors, seen at the joints, (n,) or (..., n), kg m^2 or kg; by default those
                of the robot file.
            stiffness: stiffnesses of the joints, (n,) or (..., n), N m/rad or N/m; positive; by default those of the
                robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            tau_max: largest torques, (n,) or (..., n), N m or N; infinite for none; by default the limits of the robot
                file.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The torques to apply, (..., n), N m or N. The status, (...), is 1 where the mass matrix is not positive
            definite. Where the input is refused the status, (...), is 2; tau is then zero.

        Raises:
            numpy.linalg.LinAlgError: the mass matrix is not positive definite, and ``with_status`` is False.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def elastic_feedback_linearization(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        w: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def elastic_feedback_linearization(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        w: ArrayLike,
        *,
        width: ArrayLike,
        gravity: ArrayLike | None = None,
        beta: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    def path_dynamics(
        self,
        q: ArrayLike,
        q_s: ArrayLike,
        q_ss: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> PathDynamics:
        """Joint torques along a path, linear in u = d2s/dt2 and x = (ds/dt)^2: ``tau = a u + b x + g``.

        ``a = M q_s``, ``b = M q_ss + c(q, q_s)``, without friction.

        Args:
            q: joint positions, (..., n), rad or m.
            q_s: their derivatives dq/ds, (..., n), rad per unit of s or m per unit of s.
            q_ss: their second derivatives d2q/ds2, (..., n), rad per unit of s^2 or m per unit of s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (a, b, g), (..., n) each, N m or N per unit of u, of x, and N m or N.
        """

    @overload
    def quintic(
        self,
        t: ArrayLike,
        T: ArrayLike,
        q_0: ArrayLike,
        dq_0: ArrayLike,
        ddq_0: ArrayLike,
        q_1: ArrayLike,
        dq_1: ArrayLike,
        ddq_1: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> Motion:
        """Motion at the time t along quintic polynomials that connect two states (position, velocity, acceleration).

        Args:
            t: time since the start, (...), s; before 0 and after T the nearer end is returned.
            T: duration, (...), s.
            q_0: positions at the start, (..., n), rad or m.
            dq_0: velocities at the start, (..., n), rad/s or m/s.
            ddq_0: accelerations at the start, (..., n), rad/s^2 or m/s^2.
            q_1: positions at the end, (..., n), rad or m.
            dq_1: velocities at the end, (..., n), rad/s or m/s.
            ddq_1: accelerations at the end, (..., n), rad/s^2 or m/s^2.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (q_d, dq_d, ddq_d), (..., n) each. Where the input is refused the status, (...), is 2; the
            motion is then zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def quintic(
        self,
        t: ArrayLike,
        T: ArrayLike,
        q_0: ArrayLike,
        dq_0: ArrayLike,
        ddq_0: ArrayLike,
        q_1: ArrayLike,
        dq_1: ArrayLike,
        ddq_1: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[Motion, Array]: ...
    @overload
    def quintic(
        self,
        t: ArrayLike,
        T: ArrayLike,
        q_0: ArrayLike,
        dq_0: ArrayLike,
        ddq_0: ArrayLike,
        q_1: ArrayLike,
        dq_1: ArrayLike,
        ddq_1: ArrayLike,
        *,
        with_status: bool,
    ) -> Motion | tuple[Motion, Array]: ...
    @overload
    def trapezoidal(
        self,
        t: ArrayLike,
        q_0: ArrayLike,
        q_1: ArrayLike,
        dq_max: ArrayLike,
        ddq_max: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> TimedMotion:
        """Fastest straight motion in joint space with trapezoidal speed and all joints in phase, at the time t.

        Args:
            t: time since the start, (...), s.
            q_0: positions at the start, (..., n), rad or m.
            q_1: positions at the end, (..., n), rad or m.
            dq_max: largest speeds, (n,) or (..., n), rad/s or m/s; positive.
            ddq_max: largest accelerations, (n,) or (..., n), rad/s^2 or m/s^2; positive.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (q_d, dq_d, ddq_d, T): (..., n) each, and the duration, (...), s. Where the input is refused
            the status, (...), is 2; the motion is then zero.

        Raises:
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def trapezoidal(
        self,
        t: ArrayLike,
        q_0: ArrayLike,
        q_1: ArrayLike,
        dq_max: ArrayLike,
        ddq_max: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[TimedMotion, Array]: ...
    @overload
    def trapezoidal(
        self,
        t: ArrayLike,
        q_0: ArrayLike,
        q_1: ArrayLike,
        dq_max: ArrayLike,
        ddq_max: ArrayLike,
        *,
        with_status: bool,
    ) -> TimedMotion | tuple[TimedMotion, Array]: ...
    def mass_matrix_derivatives(
        self,
        q: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
    ) -> Array:
        """Derivatives of the mass matrix with respect to the joint positions, ``dM_ij/dq_k``.

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.

        Returns:
            dM_dq, (..., n, n, n), in SI units: ``dM_dq[..., i, j, k]``, symmetric in i and j.
        """

    @overload
    def inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        direction: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: None = None,
        twist: None = None,
        twist_rate: None = None,
    ) -> Array:
        """Product of the Hessian of ``weights' tau`` with respect to (q, dq, ddq) with a direction.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            weights: weights of the torques, (..., n), in any unit, such as the multipliers of a solver. Of a floating
                base that moves: weights of force and moment on the base, then of the torques, (..., 6 + n), such as the
                multipliers of a solver.
            direction: the direction, (..., 3 n), in any unit: changes of q, then of dq, then of ddq. Of a floating base
                that moves: the direction, (..., 3 (6 + n)): changes of translation and rotation of the base and of q,
                then of twist and dq, then of twist_rate and ddq.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base, (...,
                6), m/s and rad/s, base axes.
            twist_rate: of a floating base that moves: time derivatives of the components of the twist, (..., 6), m/s^2
                and rad/s^2; the base origin is accelerated by ``dv/dt + omega x v``.

        Returns:
            ``H direction``, (..., 3 n), in SI units times the units of weights and direction. H is never formed. Of a
            floating base that moves, what :meth:`floating_inverse_dynamics_hessian_product` returns.
        """
    @overload
    def inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        direction: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
    ) -> Array: ...
    def inverse_dynamics_second_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> SecondDerivatives:
        """All second derivatives of the joint torques with respect to q, dq and ddq that can differ from zero.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (d2tau_dqq, d2tau_dvq, d2tau_dvv, dM_dq), (..., n, n, n) each, in SI units: ``d2tau_dvq[...,
            i, j, k]`` is the derivative of tau_i by dq_j and q_k.
        """

    @overload
    def closed_loops(self, q: ArrayLike, *, with_status: Literal[False] = ...) -> ClosedLoops:
        """Passive joints of closed loops: their angles and rates ``W dq``, and whether the loops can be assembled.

        At a dead point, where the sine is zero, the passive joints have no rates. All functions stay finite there: a
        sine below 1e-6, also that of a loop that cannot be assembled, counts as 1e-6.

        Args:
            q: joint positions, (..., n), rad or m.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (passive, W, sine): cosine and sine of the displacement of every passive joint, of a
            prismatic one its displacement and 0, (..., p, 2), the matrix of their rates, (..., p, n), and the sine of
            the angle between the two bars of every loop, (..., k). The status, (...), is 0; 1 where a loop is near a
            dead point, 2 where one cannot be assembled.

        Raises:
            numpy.linalg.LinAlgError: a sine is below 1e-3 at some state, and ``with_status`` is False.
            ValueError: a loop cannot be assembled at some state, and ``with_status`` is False.
        """
    @overload
    def closed_loops(self, q: ArrayLike, *, with_status: Literal[True]) -> tuple[ClosedLoops, Array]: ...
    @overload
    def closed_loops(self, q: ArrayLike, *, with_status: bool) -> ClosedLoops | tuple[ClosedLoops, Array]: ...
    @overload
    def solve_loops(
        self,
        q: ArrayLike,
        q_last: ArrayLike,
        loop_q_last: ArrayLike,
        *,
        with_status: Literal[False] = ...,
    ) -> LoopPositions:
        """Positions of the passive joints at ``q`` by two steps of Newton's method, from those at ``q_last``.

        The loops are assembled as at ``q_last``. With status 2 they cannot be assembled at ``q``, or ``q_last`` is too
        far away.

        Args:
            q: joint positions, (..., n), rad or m.
            q_last: joint positions of the last call, (..., n), rad or m.
            loop_q_last: positions of the passive joints there, (..., p), rad or m, its result.
            with_status: return ``(result, status)`` instead of raising LinAlgError or ValueError.

        Returns:
            The named tuple (loop_q, gap): positions of the passive joints, (..., p), in the order of the loops, and the
            largest gap of a pin that is left, (...), m. The status, (...), is 0; 1 where the loops are near a dead
            point or have passed one, 2 where the gap exceeds 1e-6 of their lengths.

        Raises:
            numpy.linalg.LinAlgError: the loops are near a dead point, and ``with_status`` is False.
            ValueError: the loops are not solved at some state, and ``with_status`` is False.
        """
    @overload
    def solve_loops(
        self,
        q: ArrayLike,
        q_last: ArrayLike,
        loop_q_last: ArrayLike,
        *,
        with_status: Literal[True],
    ) -> tuple[LoopPositions, Array]: ...
    @overload
    def solve_loops(
        self,
        q: ArrayLike,
        q_last: ArrayLike,
        loop_q_last: ArrayLike,
        *,
        with_status: bool,
    ) -> LoopPositions | tuple[LoopPositions, Array]: ...
    @overload
    def floating_inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> FloatingForces:
        """Wrench on the floating base and joint torques, without friction.

        ``[wrench; tau] = M(q) [twist_rate; ddq] + h(q, dq, orientation, twist)``. A robot that flies has wrench zero;
        one that stands has ``wrench = sum of J' f`` of the forces at its feet.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            twist_rate: time derivatives of the components of the twist, (..., 6), m/s^2 and rad/s^2; the base origin is
                accelerated by ``dv/dt + omega x v``.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (wrench, tau): force (N) and moment (N m) on the base about its origin, in base axes, (...,
            6), and the joint torques, (..., n), N m or N.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
    @overload
    def floating_inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[FloatingForces, Array]: ...
    @overload
    def floating_inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> FloatingForces | tuple[FloatingForces, Array]: ...
    def floating_mass_matrix(
        self,
        q: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
    ) -> Array:
        """Mass matrix over the twist of the floating base and the joint velocities, drive inertia included.

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.

        Returns:
            M, (..., 6 + n, 6 + n), in SI units. Its first six rows times [twist; dq] are the linear and the angular
            momentum about the base origin, in base axes.

        Raises:
            ValueError: the robot file states no floating base.
        """

    @overload
    def floating_bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Wrench on the floating base and joint torques where neither twist nor dq changes, without friction.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            h, (..., 6 + n), in SI units: force and moment on the base, then joint torques.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
    @overload
    def floating_bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def floating_bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def floating_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Regressor of the floating base, ``[wrench; tau] = Y beta``, linear in the base parameters.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            twist_rate: time derivatives of the components of the twist, (..., 6), m/s^2 and rad/s^2; the base origin is
                accelerated by ``dv/dt + omega x v``.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            Y, (..., 6 + n, b), in SI units: rows of force and moment on the base, then of the joints.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
    @overload
    def floating_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def floating_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def floating_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        wrench: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> FloatingAccelerations:
        """Accelerations of the floating base and of the joints; friction is not part of it: subtract it from ``tau``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, (..., n), N m or N.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            wrench: force, then moment about the base origin, on the base, (..., 6), N and N m, base axes.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError or LinAlgError.

        Returns:
            The named tuple (twist_rate, ddq): rates of the components of the twist, (..., 6), m/s^2 and rad/s^2, and
            joint accelerations, (..., n), rad/s^2 or m/s^2; zero where M is not positive definite. The status, (...),
            is 1 there, 2 where the orientation is no unit quaternion, and else 0.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
    @overload
    def floating_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        wrench: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[FloatingAccelerations, Array]: ...
    @overload
    def floating_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        wrench: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> FloatingAccelerations | tuple[FloatingAccelerations, Array]: ...
    def floating_momentum(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        twist: ArrayLike,
        beta: ArrayLike | None = None,
    ) -> Array:
        """Linear and angular momentum of the whole robot about the origin of its floating base, in base axes.

        With the position c of the centre of mass (:meth:`floating_momentum_matrix`), ``L - c x p`` is the angular
        momentum about it. In world axes ``dp/dt`` is the sum of weight and outer forces.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            The momentum, (..., 6): linear, N s, then angular, N m s.

        Raises:
            ValueError: the robot file states no floating base.
        """

    def floating_momentum_matrix(self, q: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Momentum matrix A about the origin of the floating base, ``[p; L] = A(q) [twist; dq]``, in base axes.

        These are the first six rows of :meth:`floating_mass_matrix`. ``A[..., 0, 0]`` is the mass m of the robot, and
        ``m c = (A[..., 1, 5], A[..., 2, 3], A[..., 0, 4])`` with the position c of its centre of mass.

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            A, (..., 6, 6 + n), in SI units: rows of the linear, then of the angular momentum.

        Raises:
            ValueError: the robot file states no floating base.
        """

    def floating_jacobian(self, q: ArrayLike, *, tip: str | None = None) -> Array:
        """Geometric Jacobian of the tip over the twist of the floating base and dq, in base axes.

        A wrench F at the tip, force first, in base axes, acts as ``[wrench; tau] = J' F``.

        Args:
            q: joint positions, (..., n), rad or m.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            J, (..., 6, 6 + n), ``[v; w] = J(q) [twist; dq]``: linear velocity v of the tip (m/s) first, then angular
            velocity w (rad/s), both seen from the world and written in base axes.

        Raises:
            ValueError: the robot file states no floating base, or the robot has no tip of this name.
        """

    def floating_jacobian_dot_dq(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        twist: ArrayLike,
        *,
        tip: str | None = None,
    ) -> Array:
        """Acceleration a of the tip on a floating base where neither twist nor dq changes, in base axes.

        The tip is accelerated by ``J(q) [twist_rate; ddq] + a``, with J of :meth:`floating_jacobian`: the rate of its
        velocity in world axes, written in base axes.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            tip: a named tip of the robot file in place of the unnamed one.

        Returns:
            a, (..., 6): linear part (m/s^2) first, then angular (rad/s^2).

        Raises:
            ValueError: the robot file states no floating base, or the robot has no tip of this name.
        """

    def floating_inverse_dynamics_from_imu(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        gyro: ArrayLike,
        gyro_rate: ArrayLike,
        accelerometer: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
    ) -> FloatingForces:
        """Wrench on the floating base and joint torques, without friction, from the gyroscope and accelerometer on it.

        As :meth:`floating_inverse_dynamics`, with ``accelerometer = dv/dt + omega x v - R' g``: neither orientation,
        velocity nor gravity enter otherwise.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gyro: angular velocity of the base, in base axes, (..., 3), rad/s.
            gyro_rate: time derivatives of the components of ``gyro``, (..., 3), rad/s^2.
            accelerometer: acceleration of the base origin minus gravity, in base axes, (..., 3), m/s^2: what an
                accelerometer at the base origin measures.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.

        Returns:
            The named tuple (wrench, tau): force (N) and moment (N m) on the base about its origin, in base axes, (...,
            6), and the joint torques, (..., n), N m or N.

        Raises:
            ValueError: the robot file states no floating base.
        """

    def floating_regressor_from_imu(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        gyro: ArrayLike,
        gyro_rate: ArrayLike,
        accelerometer: ArrayLike,
    ) -> Array:
        """Regressor of the floating base from its gyroscope and accelerometer, ``[wrench; tau] = Y beta``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            gyro: angular velocity of the base, in base axes, (..., 3), rad/s.
            gyro_rate: time derivatives of the components of ``gyro``, (..., 3), rad/s^2.
            accelerometer: acceleration of the base origin minus gravity, in base axes, (..., 3), m/s^2: what an
                accelerometer at the base origin measures.

        Returns:
            Y, (..., 6 + n, b), in SI units: rows of force and moment on the base, then of the joints.

        Raises:
            ValueError: the robot file states no floating base.
        """

    @overload
    def floating_inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> FloatingDerivatives:
        """Wrench on the floating base and joint torques, f = [wrench; tau], and their derivatives; friction is not part
        of it.

        The base is moved and turned along and about its own axes, by the displacement that
        :func:`rrrgen.runtime.floating_base.integrate` takes, while the components of twist and twist_rate stay. The
        columns of the translation are zero. Pinocchio's ``computeRNEADerivatives`` has the same columns.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            twist_rate: time derivatives of the components of the twist, (..., 6), m/s^2 and rad/s^2; the base origin is
                accelerated by ``dv/dt + omega x v``.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (wrench, tau, df_dq, df_dv, M): (..., 6), (..., n), and (..., 6 + n, 6 + n) each, in SI
            units. The columns of df_dq belong to translation and rotation of the base, then to q, those of df_dv to
            [twist; dq], those of the mass matrix M to [twist_rate; ddq].

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
    @overload
    def floating_inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[FloatingDerivatives, Array]: ...
    @overload
    def floating_inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> FloatingDerivatives | tuple[FloatingDerivatives, Array]: ...
    @overload
    def floating_inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        direction: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[False] = ...,
    ) -> Array:
        """Product of the Hessian of ``weights' [wrench; tau]`` on a floating base with a direction.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            weights: weights of force and moment on the base, then of the torques, (..., 6 + n), in any unit, such as
                the multipliers of a solver.
            direction: the direction, (..., 3 (6 + n)), in any unit: changes of translation and rotation of the base and
                of q, then of twist and dq, then of twist_rate and ddq.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            twist_rate: time derivatives of the components of the twist, (..., 6), m/s^2 and rad/s^2; the base origin is
                accelerated by ``dv/dt + omega x v``.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            ``H direction``, (..., 3 (6 + n)), in SI units times the units of weights and direction, with the Hessian of
            :meth:`floating_inverse_dynamics_hessian`, which is never formed.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
    @overload
    def floating_inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        direction: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: Literal[True],
    ) -> tuple[Array, Array]: ...
    @overload
    def floating_inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        direction: ArrayLike,
        orientation: ArrayLike,
        twist: ArrayLike,
        twist_rate: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool,
    ) -> Array | tuple[Array, Array]: ...
    @overload
    def friction_step(
        self,
        dq: ArrayLike,
        z: ArrayLike,
        Ts: ArrayLike,
        tau_load: ArrayLike | None = None,
        *,
        with_status: Literal[False] = ...,
    ) -> FrictionStep:
        """One period of the friction laws with a state, exact for constant dq: the next state and the torques.

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            z: states of the laws that have one, (..., s), rad or m, zero at first: bristle deflections at those joints
                and coupled motors, in the order of the robot file.
            Ts: the period, (...), s.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (z_next, tau_f): the states after the period, (..., s), rad or m, and the friction torques
            of all joints, (..., n), N m or N. Where the input is refused the status, (...), is 2; ``z_next`` is then z,
            tau_f zero.

        Raises:
            ValueError: no friction law of this robot has a state, or one depends on the load and ``tau_load`` is
                missing.
            ValueError: an input is not finite or out of its range, and ``with_status`` is False.
        """
    @overload
    def friction_step(
        self,
        dq: ArrayLike,
        z: ArrayLike,
        Ts: ArrayLike,
        tau_load: ArrayLike | None = None,
        *,
        with_status: Literal[True],
    ) -> tuple[FrictionStep, Array]: ...
    @overload
    def friction_step(
        self,
        dq: ArrayLike,
        z: ArrayLike,
        Ts: ArrayLike,
        tau_load: ArrayLike | None = None,
        *,
        with_status: bool,
    ) -> FrictionStep | tuple[FrictionStep, Array]: ...
    def friction_with(self, dq: ArrayLike, friction: ArrayLike, tau_load: ArrayLike | None = None) -> Array:
        """Friction torques under the laws of the robot file, with their parameters at run time.

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            friction: friction parameters, (k,) or (..., k), SI units, in the order of ``friction_parameter_names``.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.

        Returns:
            tau_f, (..., n), N m or N.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """

    def smooth_friction(
        self,
        dq: ArrayLike,
        friction: ArrayLike,
        width: ArrayLike,
        tau_load: ArrayLike | None = None,
    ) -> Array:
        """Friction torques as :meth:`friction_with`, with tanh(s / width) in place of sgn(s).

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            friction: friction parameters, (k,) or (..., k), SI units, in the order of ``friction_parameter_names``.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s;
                positive.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.

        Returns:
            tau_f, (..., n), N m or N.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """
