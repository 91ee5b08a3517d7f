"""The table of all model functions, by group and in the order of emission.

The group "model" is always emitted, and with it, behind all other groups, "loops", "floating" and "friction". The
functions of the other groups are needed by some users only, and are derived and emitted on request.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import DerivationError
from rrrgen.derive.functions.model_function import ArgumentKind, ModelFunction, Needs, about_tip, like
from rrrgen.program import Op, Program

if TYPE_CHECKING:
    from rrrgen.derive.functions.recording import FunctionBuilder, Recorder
    from rrrgen.robot.spec import RobotSpec

KINEMATICS = "rrrgen.derive.functions.kinematics"
DYNAMICS = "rrrgen.derive.functions.dynamics"
DERIVATIVES = "rrrgen.derive.functions.derivatives"
REGRESSORS = "rrrgen.derive.functions.regressors"
ENERGIES = "rrrgen.derive.functions.dynamics"
PARAMETERS = "rrrgen.derive.functions.parameters"
POINTS = "rrrgen.derive.functions.points"
TERMS = "rrrgen.derive.functions.control_laws"
LAWS = "rrrgen.derive.functions.control_laws"
OPERATIONAL = "rrrgen.derive.functions.operational_space"
OBSERVERS = "rrrgen.derive.functions.contact"
CONTACT = "rrrgen.derive.functions.contact"
ELASTIC = "rrrgen.derive.functions.elastic_joints"
SECOND = "rrrgen.derive.functions.second_derivatives"
PATHS = "rrrgen.derive.functions.motions"
MOTIONS = "rrrgen.derive.functions.motions"
FLOATING = "rrrgen.derive.functions.floating_base"
FLOATING_DERIVATIVES = "rrrgen.derive.functions.floating_derivatives"
FLOATING_SECOND = "rrrgen.derive.functions.floating_second_derivatives"
FRICTION = "rrrgen.derive.functions.friction"
LOOPS = "rrrgen.derive.functions.loops"

NO_FLOATING_BASE = (
    "the robot file states no floating base, or the orientation is no unit quaternion (its norm is off by more than "
    "1e-6, status 2) and ``with_status`` is False."
)

STATE_FLOATING_BASE = "the robot has no floating base: state it under floating_base in the robot file"

WEIGHTS_OF_FORCES = like(
    "weights",
    shape="6+n",
    meaning="weights of force and moment on the base, then of the torques",
    note=", such as the multipliers of a solver",
)

TABLE = (
    ModelFunction(
        "forward_kinematics",
        "model",
        "Pose of the tip in the base frame, ``T_0_n = base A_1 ... A_n tool``. Source: (14.5).",
        takes="q",
        returns="Homogeneous transforms T, (..., 4, 4), positions in m.",
        record=f"{KINEMATICS}:FORWARD_KINEMATICS",
        of_tip=True,
    ),
    ModelFunction(
        "link_frames",
        "model",
        "Poses of all link frames in the base frame, ``T_0_i = base A_1 ... A_i``, without the tool.",
        takes="q",
        returns="Homogeneous transforms T, (..., n, 4, 4), positions in m: ``T[..., i, :, :]`` is the frame "
        "of link i + 1.",
        record=f"{KINEMATICS}:link_frames",
    ),
    ModelFunction(
        "jacobian",
        "model",
        "Geometric Jacobian of the tip, ``[v; w] = J(q) dq``, in the axes of the base frame.",
        takes="q",
        returns="J, (..., 6, n): linear velocity v of the tip (m/s) first, then angular velocity w (rad/s).",
        record=f"{KINEMATICS}:jacobian",
        of_tip=True,
    ),
    ModelFunction(
        "link_jacobians",
        "model",
        "Geometric Jacobians of the origins of all link frames, ``[v_i; w_i] = J_i(q) dq``, in the base frame's axes.",
        takes="q",
        returns="J, (..., n, 6, n), linear rows first: ``J[..., i, :, :]`` belongs to ``link_frames(q)[..., "
        "i, :, :]``. The columns of joints beyond the link are zero.",
        record=f"{KINEMATICS}:link_jacobians",
        details="A wrench [f; m] at the origin of link frame i loads the joints with ``tau = J_i' [f; m]``.",
    ),
    ModelFunction(
        "kinematics",
        "model",
        "Pose and Jacobian of the tip from one evaluation, cheaper than one call for each.",
        takes="q",
        returns="The named tuple (T, J): as :meth:`forward_kinematics`, (..., 4, 4), and :meth:`jacobian`, "
        "(..., 6, n).",
        record=f"{KINEMATICS}:kinematics",
        result="Kinematics",
        of_tip=True,
    ),
    ModelFunction(
        "jacobian_dot_dq",
        "model",
        "Acceleration of the tip for ddq = 0, ``a = (dJ/dt) dq``, so that ``d[v; w]/dt = J ddq + a``.",
        takes="q dq",
        returns="a, (..., 6), in the axes of the base frame: linear part (m/s^2) first, then angular (rad/s^2).",
        record=f"{KINEMATICS}:jacobian_dot_dq",
        of_tip=True,
    ),
    ModelFunction(
        "tip_target",
        "model",
        "Target of the inverse kinematics of the tip, at the values in q of the joints that it shares with other tips.",
        takes="T q",
        where=(like("T", meaning="wanted pose of the tip in the base frame", rigid=True),),
        returns="target, (..., 4, 4), translation in m: ``T_carrier(q)^-1 T`` with the frame of the last link that the "
        "shared joints move. The other elements of q are not read.",
        record=f"{POINTS}:tip_target",
        raises=(
            ("InputError", "the wanted pose is no rigid motion."),
            ("ValueError", "``tip`` is not given, or shares no joint with other tips."),
        ),
        needs=Needs.SHARED_JOINTS,
        absent="tip= must name a tip that shares joints with others",
        of_tip=True,
    ),
    ModelFunction(
        "mass_matrix",
        "model",
        "Mass matrix ``M(q)``, symmetric, drive inertia included. Source: (14.7).",
        takes="q beta * Ia",
        returns="M, (..., n, n), kg m^2, kg m or kg.",
        record=f"{DYNAMICS}:mass_matrix",
    ),
    ModelFunction(
        "coriolis_matrix",
        "model",
        "Coriolis matrix ``C(q, dq)`` of the Christoffel symbols: ``c = C dq``, and ``dM/dt - 2 C`` is skew-symmetric.",
        takes="q dq beta",
        returns="C, (..., n, n), in SI units.",
        record=f"{DYNAMICS}:coriolis_matrix",
    ),
    ModelFunction(
        "coriolis",
        "model",
        "Coriolis and centrifugal torques ``c = C(q, dq) dq``. Source: (14.7).",
        takes="q dq beta",
        returns="c, (..., n), N m or N.",
        record=f"{DYNAMICS}:CORIOLIS",
    ),
    ModelFunction(
        "coriolis_transpose",
        "model",
        "Transposed Coriolis matrix times dq, for momentum observers: ``d(M dq)/dt = tau + p - g``.",
        takes="q dq beta",
        returns="``p = C(q, dq)' dq``, (..., n), N m or N.",
        record=f"{DYNAMICS}:coriolis_transpose",
    ),
    ModelFunction(
        "gravity",
        "model",
        "Gravity torques ``g = dU/dq``: the joint torques that hold the arm still. Source: (14.7).",
        takes="q beta * gravity",
        returns="g, (..., n), N m or N.",
        record=f"{DYNAMICS}:gravity",
    ),
    ModelFunction(
        "bias",
        "model",
        "Bias torques ``h = c(q, dq) + g(q)``: the joint torques for ddq = 0, without friction.",
        takes="q dq beta * gravity",
        returns="h, (..., n), N m or N.",
        record=f"{DYNAMICS}:BIAS",
    ),
    ModelFunction(
        "dynamics_terms",
        "model",
        "All terms of ``tau = M ddq + c + g`` from one evaluation, cheaper than one call for each.",
        takes="q dq beta * Ia gravity",
        returns="The named tuple (M, c, g): (..., n, n), (..., n) and (..., n).",
        record=f"{DYNAMICS}:DYNAMICS_TERMS",
        result="DynamicsTerms",
    ),
    ModelFunction(
        "inverse_dynamics",
        "model",
        "Joint torques ``tau = M ddq + c + g`` of rigid body and drive inertia, without friction. Source: (14.6).",
        takes="q dq ddq beta * Ia gravity",
        returns="tau, (..., n), N m or N.",
        record=f"{DYNAMICS}:INVERSE_DYNAMICS",
    ),
    ModelFunction(
        "forward_dynamics",
        "model",
        "Joint accelerations ``ddq = M^-1 (tau - c - g)``; friction is not part of it: subtract it from ``tau``.",
        takes="q dq tau beta * Ia gravity",
        returns="ddq, (..., n), rad/s^2 or m/s^2; zero where M is not positive definite. The status, (...), "
        "is 0 where M is positive definite and 1 elsewhere.",
        combine=f"{DYNAMICS}:forward_dynamics",
        of=(
            "mass_matrix",
            "bias",
        ),
        raises=(
            ("numpy.linalg.LinAlgError", "M is indefinite or singular at some state, and ``with_status`` is False."),
        ),
        status=True,
    ),
    ModelFunction(
        "inverse_dynamics_derivatives",
        "model",
        "Joint torques and their analytical derivatives, ``d tau = dtau_dq d(q) + dtau_dv d(dq) + M d(ddq)``.",
        takes="q dq ddq beta * Ia gravity",
        returns="The named tuple (tau, dtau_dq, dtau_dv, M): (..., n), then three times (..., n, n), in SI units.",
        record=f"{DERIVATIVES}:inverse_dynamics_derivatives",
        combine=f"{DERIVATIVES}:differentiate_inverse_dynamics",
        of=("inverse_dynamics",),
        result="InverseDynamicsDerivatives",
        on_demand=True,
    ),
    ModelFunction(
        "forward_dynamics_derivatives",
        "model",
        "Joint accelerations and their derivatives, ``d ddq = dddq_dq d(q) + dddq_dv d(dq) + dddq_dtau d(tau)``.",
        takes="q dq tau beta * Ia gravity",
        returns="The named tuple (ddq, dddq_dq, dddq_dv, dddq_dtau): (..., n), then three times (..., n, n), "
        "in SI units; ``dddq_dtau`` is the inverse of M. All are zero where M is not positive "
        "definite; the status, (...), is 1 there and 0 elsewhere.",
        record=f"{DERIVATIVES}:forward_dynamics_derivatives",
        combine=f"{DERIVATIVES}:from_inverse_dynamics",
        of=("inverse_dynamics_derivatives",),
        raises=(
            ("numpy.linalg.LinAlgError", "M is indefinite or singular at some state, and ``with_status`` is False."),
        ),
        result="ForwardDynamicsDerivatives",
        on_demand=True,
        status=True,
    ),
    ModelFunction(
        "regressor",
        "model",
        "Base regressor: ``tau = Y(q, dq, ddq) beta``, rigid body without drive inertia. Source: (14.10).",
        takes="q dq ddq * gravity",
        returns="Y, (..., n, b), in SI units; its columns belong to ``base_parameter_names``.",
        record=f"{REGRESSORS}:REGRESSOR",
        links_only="Y",
    ),
    ModelFunction(
        "regressor_transpose",
        "model",
        "Transposed base regressor times a vector, ``r = Y' e``, without forming Y: for adaptation. Source: (14.23).",
        takes="q dq ddq e * gravity",
        where=(like("e", note=", such as a tracking error"),),
        returns="r, (..., b), in SI units times the unit of ``e``.",
        record=f"{REGRESSORS}:regressor_transpose",
        links_only="r",
    ),
    ModelFunction(
        "standard_regressor",
        "model",
        "Regressor of the standard parameters of all links: ``tau = Y(q, dq, ddq) phi``.",
        takes="q dq ddq * gravity",
        returns="Y, (..., n, 10 n), in SI units.",
        record=f"{REGRESSORS}:standard_regressor",
        details="phi lists, link by link, m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz: mass (kg), first "
        "moments (kg m) and inertia tensor (kg m^2, Ixy = -integral of x y dm) about the origin of "
        "the link frame, in its axes.",
        links_only="Y",
    ),
    ModelFunction(
        "energy",
        "model",
        "Kinetic energy ``dq' M dq / 2`` and potential energy U with ``dU/dq = g``, defined up to a constant.",
        takes="q dq beta * Ia gravity",
        returns="The named tuple (kinetic, potential), each (...), J.",
        record=f"{ENERGIES}:energy",
        result="Energy",
    ),
    ModelFunction(
        "base_parameters",
        "model",
        "Base parameters ``beta = K phi`` of given links; in C and CasADi ``base_parameters``.",
        takes="phi",
        where=(ArgumentKind("phi", "10n", "SI", "standard parameters of all links"),),
        returns="beta, (..., b), in SI units.",
        record=f"{PARAMETERS}:BASE_PARAMETERS",
        by_hand=True,
    ),
    ModelFunction(
        "add_payload",
        "model",
        "Base parameters of the robot with a body fixed to its last link, to be passed as ``beta`` to other methods.",
        takes="mass com inertia * beta",
        where=(
            ArgumentKind(
                "com",
                "3",
                "m",
                "its centre of mass",
                note=", in the frame of the last link, ``link_frames(q)[-1]``, which is the one before the tool",
            ),
            ArgumentKind(
                "inertia",
                "3 3",
                "kg m^2",
                "its inertia tensor about that centre",
                note=", in the axes of the same frame; zero by default, a point mass",
            ),
            like("beta", meaning="base parameters without the body"),
        ),
        returns="beta_loaded, (..., b), in SI units.",
        record=f"{PARAMETERS}:ADD_PAYLOAD",
        details="Further bodies are added one by one; a negative mass with the negative tensor removes a body again.",
        raises=(
            ("ValueError", "the tensor is not symmetric, or the robot file has no links and ``beta`` is not given."),
        ),
        by_hand=True,
        of_tip=True,
    ),
    ModelFunction(
        "add_payload_at",
        "model",
        "Base parameters of the robot with a body fixed to its last link; the body is described in its own frame.",
        takes="mass com inertia frame * beta",
        where=(
            ArgumentKind("com", "3", "m", "its centre of mass", note=", in its own frame"),
            ArgumentKind(
                "inertia",
                "3 3",
                "kg m^2",
                "its inertia tensor about that centre",
                note=", in the axes of its own frame; None for a point mass",
            ),
            ArgumentKind("frame", "4 4", "1, m", "pose of its frame in the last link"),
            like("beta", meaning="base parameters without the body"),
        ),
        returns="beta_loaded, (..., b), in SI units.",
        record=f"{PARAMETERS}:ADD_PAYLOAD_AT",
        raises=(("ValueError", "as for :meth:`add_payload`."),),
        by_hand=True,
        of_tip=True,
    ),
    ModelFunction(
        "link_velocities",
        "points",
        "Velocities of all link frames in the base frame, ``[v_i; omega_i] = J_i(q) dq``.",
        takes="q dq",
        returns="V, (..., n, 6): linear, m/s, then angular, rad/s.",
        record=f"{POINTS}:link_velocities",
    ),
    ModelFunction(
        "link_jacobians_dot_dq",
        "points",
        "Time derivatives of the Jacobians of all link frames times dq: the accelerations of the frames for ddq = 0.",
        takes="q dq",
        returns="A, (..., n, 6): linear, m/s^2, then angular, rad/s^2, in the base frame.",
        record=f"{POINTS}:link_jacobians_dot_dq",
    ),
    ModelFunction(
        "point_jacobian",
        "points",
        "Geometric Jacobian of a point that is fixed to a frame: ``[v_p; omega] = J_p dq``.",
        takes="T J point",
        where=(like("J", meaning="its Jacobian", note=", base frame, linear rows first"),),
        returns="J_p, (..., 6, n), base frame, linear rows first.",
        record=f"{POINTS}:point_jacobian",
    ),
    ModelFunction(
        "point_motion",
        "points",
        "Velocity and acceleration of a point that is fixed to a frame.",
        takes="T V A point",
        where=(
            ArgumentKind(
                "V",
                "6",
                "m/s, rad/s",
                "its velocity",
                note=", linear part first, such as ``link_velocities(q, dq)[..., i, :]``",
            ),
            ArgumentKind(
                "A",
                "6",
                "m/s^2, rad/s^2",
                "its acceleration",
                note=". If only its part (dJ/dt) dq is given, A_p is that part for the point",
            ),
        ),
        returns="The named tuple (V_p, A_p), (..., 6) each, in the base frame.",
        record=f"{POINTS}:point_motion",
        result="PointMotion",
    ),
    ModelFunction(
        "wrench_torques",
        "points",
        "Joint torques ``tau = J' F`` of a wrench: if F acts on the robot, ``M ddq + c + g = tau_m + J' F``.",
        takes="J F",
        where=(
            like("J", meaning="Jacobian of the frame or point at which the wrench acts", note=""),
            ArgumentKind("F", "6", "N, N m", "force and moment about that point", note=", in base axes"),
        ),
        returns="tau, (..., n), N m or N.",
        record=f"{POINTS}:wrench_torques",
    ),
    ModelFunction(
        "tool_kinematics",
        "points",
        "Pose and Jacobian of a tool in place of that of the robot file.",
        takes="q tool",
        returns="The named tuple (T, J): (..., 4, 4) and (..., 6, n), base frame.",
        record=f"{POINTS}:tool_kinematics",
        raises=(("InputError", "the tool is no rigid motion: another last row than 0 0 0 1, or no rotation."),),
        result="Kinematics",
        of_tip=True,
    ),
    ModelFunction(
        "tool_target",
        "points",
        "Target of ``inverse_kinematics`` for which a tool in place of that of the robot file has the pose T.",
        takes="T tool",
        where=(like("T", meaning="wanted pose of the tool in the base frame", rigid=True),),
        returns="target, (..., 4, 4), translation in m: ``T tool^-1 T_tool`` with the tool T_tool of the robot file.",
        record=f"{POINTS}:tool_target",
        raises=(
            (
                "InputError",
                "the tool or the wanted pose is no rigid motion: another last row than 0 0 0 1, no rotation.",
            ),
        ),
        of_tip=True,
    ),
    ModelFunction(
        "manipulability",
        "points",
        "Manipulability ``w = sqrt(det(J J'))`` (of ``J' J`` for fewer than six joints) and its gradient.",
        takes="q",
        returns="The named tuple (w, dw_dq): (...) and (..., n); zero where J loses rank, and the status, "
        "(...), is 1 there.",
        record=f"{POINTS}:MANIPULABILITY",
        closed_loops=False,
        raises=(("numpy.linalg.LinAlgError", "J loses rank at some state, and ``with_status`` is False."),),
        result="Manipulability",
        status=True,
        of_tip=True,
    ),
    ModelFunction(
        "position_manipulability",
        "points",
        "Manipulability of the position of the tip alone, from the three linear rows of J.",
        takes="q",
        returns="The named tuple (w, dw_dq): (...) and (..., n).",
        record=f"{POINTS}:POSITION_MANIPULABILITY",
        closed_loops=False,
        raises=(("numpy.linalg.LinAlgError", "J loses rank at some state, and ``with_status`` is False."),),
        result="Manipulability",
        status=True,
        of_tip=True,
    ),
    ModelFunction(
        "nullspace",
        "points",
        "Projection ``N = 1 - J' (J J' + damping^2 1)^-1 J`` on joint motions that keep the pose of the tip.",
        takes="q damping",
        where=(
            ArgumentKind(
                "damping",
                "",
                "SI",
                "damping of the projection: 0 is exact; larger values keep N smooth through singularities",
                default=0.0,
            ),
        ),
        returns="N, (..., n, n); the unit matrix where J loses rank and damping is 0, and the status, (...), "
        "is 1 there.",
        record=f"{POINTS}:NULLSPACE",
        raises=(
            ("numpy.linalg.LinAlgError", "J loses rank at some state, damping is 0, and ``with_status`` is False."),
            ("ValueError", "the robot has six joints or fewer."),
        ),
        status=True,
        more_joints_than=6,
        of_tip=True,
    ),
    ModelFunction(
        "position_nullspace",
        "points",
        "Projection N on joint motions that keep the position of the tip, while its orientation may change.",
        takes="q damping",
        where=(
            ArgumentKind(
                "damping",
                "",
                "m | 1",
                "damping of the projection: 0 is exact; larger values keep N smooth through singularities",
                default=0.0,
            ),
        ),
        returns="N, (..., n, n).",
        record=f"{POINTS}:POSITION_NULLSPACE",
        raises=(
            ("numpy.linalg.LinAlgError", "J loses rank at some state, damping is 0, and ``with_status`` is False."),
            ("ValueError", "the robot has three joints or fewer."),
        ),
        status=True,
        more_joints_than=3,
        of_tip=True,
    ),
    ModelFunction(
        "momentum_terms",
        "control",
        "Generalized momentum and the terms of its rate, for momentum observers: ``dp/dt = tau + ct - g``.",
        takes="q dq beta * Ia gravity",
        returns="The named tuple (p, ct, g), (..., n) each: ``p = M dq`` in N m s or N s, ``ct = C(q, dq)' "
        "dq`` and the gravity torques in N m or N.",
        record=f"{TERMS}:momentum_terms",
        result="MomentumTerms",
    ),
    ModelFunction(
        "reference_torque",
        "control",
        "Torques ``tau = M a + C(q, dq) v + g`` of a reference motion at the measured velocity (Slotine and Li).",
        takes="q dq v a beta * Ia gravity",
        returns="tau, (..., n), N m or N.",
        record=f"{TERMS}:REFERENCE_TORQUE",
        details="C is the matrix of the Christoffel symbols, so that ``dM/dt - 2 C`` is skew-symmetric.",
    ),
    ModelFunction(
        "reference_regressor_transpose",
        "control",
        "Transposed regressor of :meth:`reference_torque` times a vector, ``r = Y' e``, for adaptive control.",
        takes="q dq v a e * gravity",
        where=(like("e", note=", such as a tracking error of the velocities"),),
        returns="r, (..., b), in SI units times the unit of ``e``.",
        record=f"{TERMS}:reference_regressor_transpose",
        details="``Y(q, dq, v, a) beta = M a + C(q, dq) v + g``, without drive inertia; Y is never formed.",
        links_only="r",
    ),
    ModelFunction(
        "pd_gravity",
        "control",
        "PD control with gravity and friction compensation, ``tau = kp e + kd e' + ki z + g(q) + f(dq_d)``.",
        takes="q dq q_d dq_d ddq_d kp kd ki z * width Ts gravity beta Ia friction tau_max",
        returns="The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.",
        record=f"{LAWS}:pd_gravity",
        result="ControlStep",
        status=True,
        refuses="``z_next`` is then z, tau zero",
    ),
    ModelFunction(
        "feedforward",
        "control",
        "Torques of the desired motion, ``M ddq_d + c + g`` at q_d and dq_d, with ``kp e + kd e' + ki z + f(dq_d)``.",
        takes="q dq q_d dq_d ddq_d kp kd ki z * width Ts gravity beta Ia friction tau_max",
        returns="The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.",
        record=f"{LAWS}:feedforward",
        result="ControlStep",
        status=True,
        refuses="``z_next`` is then z, tau zero",
    ),
    ModelFunction(
        "computed_torque",
        "control",
        "Computed torque, ``tau = M (ddq_d + kp e + kd e' + ki z) + c + g + f(dq_d)``. Source: (14.34).",
        takes="q dq q_d dq_d ddq_d kp kd ki z * width Ts gravity beta Ia friction tau_max",
        where=(like("kp", unit="1/s^2"), like("kd", unit="1/s"), like("ki", unit="1/s^3")),
        returns="The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.",
        record=f"{LAWS}:computed_torque",
        result="ControlStep",
        status=True,
        refuses="``z_next`` is then z, tau zero",
    ),
    ModelFunction(
        "slotine_li",
        "control",
        "Passivity-based tracking with adaptation of the base parameters (Slotine and Li 1987).",
        takes="q dq q_d dq_d ddq_d lam k beta * width gamma beta_min beta_max Ts gravity Ia friction tau_max",
        where=(
            ArgumentKind("lam", "n", "1/s", "bandwidth of the error on s = 0", constant=True),
            ArgumentKind("k", "n", "N m s/rad | N s/m", "gains of s", constant=True),
            like(
                "beta",
                note=": at the start an estimate, then ``beta_next`` of the last tick",
                constant=False,
                from_file="",
            ),
            ArgumentKind(
                "gamma",
                "b",
                "(unit of beta)^2/J",
                "adaptation gains",
                note="; zero for parameters to keep. Drive inertias are kept",
                constant=True,
                for_drives=0.0,
            ),
            ArgumentKind("beta_min", "b", "SI", "lower bounds of beta", constant=True, for_drives=-math.inf),
            ArgumentKind("beta_max", "b", "SI", "upper bounds of beta", constant=True, for_drives=math.inf),
        ),
        returns="The named tuple (tau, beta_next), (..., n) and (..., b).",
        record=f"{LAWS}:slotine_li",
        details="``tau = M a + C(q, dq) v + g - k s + f(dq_d)`` and ``beta_next = beta - Ts gamma Y' s``, "
        "with ``v = dq_d + lam e``, ``a = ddq_d + lam e'``, ``s = dq - v``; beta stays as it is "
        "while a joint is at its limit.",
        result="AdaptiveStep",
        links_only="beta_next",
        status=True,
        refuses="``beta_next`` is then beta, tau zero",
    ),
    ModelFunction(
        "impedance",
        "control",
        "Impedance control of the tip, ``tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)``.",
        takes="q dq T_d V_d stiffness damping * gravity beta tau_max",
        where=(
            ArgumentKind(
                "stiffness", "6", "N/m, N m/rad", "spring along and about the axes of the base", constant=True
            ),
            ArgumentKind("damping", "6", "N s/m, N m s/rad", "damper along and about these axes", constant=True),
        ),
        returns="tau, (..., n), N m or N, within ``tau_max``.",
        record=f"{LAWS}:impedance",
        details="The error e_x (6,) is that of the position (m), then the axis of the rotation from the "
        "actual to the desired orientation, times the sine of its angle.",
        status=True,
        refuses="tau is then zero",
        of_tip=True,
    ),
    ModelFunction(
        "operational_space",
        "control",
        "Operational-space control of the pose of the tip (Khatib 1987), damped near singular configurations.",
        takes="q dq T_d V_d A_d kp kd ki z tau_0 damping * tau_add Ts gravity beta Ia tau_max",
        where=(
            ArgumentKind("A_d", "6", "m/s^2, rad/s^2", "desired acceleration of the tip", note=", base frame"),
            like("kp", shape="6", unit="1/s^2", meaning="gains of the error of the tip"),
            like("kd", shape="6", unit="1/s", meaning="gains of the error of its velocity"),
            like("ki", shape="6", unit="1/s^3"),
            like("z", shape="6", unit="m s, rad s"),
        ),
        returns="The named tuple (tau, z_next), (..., n) and (..., 6): torques to apply and the state for "
        "the next tick. The status, (...), is 1 where damping acts; the tip then follows only where "
        "it can move.",
        record=f"{OPERATIONAL}:OPERATIONAL_SPACE",
        details="``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J "
        "inv(M) J')`` and ``a = A_d + kp e_x + kd (V_d - J dq) + ki z``. The error e_x (6,) is that "
        "of the position (m), then the axis of the rotation from the actual to the desired "
        "orientation, times the sine of its angle.",
        raises=(
            ("numpy.linalg.LinAlgError", "damping acts at some state, and ``with_status`` is False."),
            ("ValueError", "the robot has fewer than six joints."),
        ),
        result="OperationalStep",
        status=True,
        more_joints_than=5,
        needs=Needs.TIP_POSE,
        refuses="``z_next`` is then z, tau zero",
        of_tip=True,
    ),
    ModelFunction(
        "position_operational_space",
        "control",
        "Operational-space control of the position of the tip (Khatib 1987), damped near singular configurations.",
        takes="q dq p_d V_d A_d kp kd ki z tau_0 damping * tau_add Ts gravity beta Ia tau_max",
        where=(
            ArgumentKind("p_d", "3", "m", "desired position of the tip in the base frame"),
            like("V_d", shape="3", unit="m/s"),
            ArgumentKind("A_d", "3", "m/s^2", "desired acceleration of the tip", note=", base frame"),
            like("kp", shape="3", unit="1/s^2", meaning="gains of the error of the tip"),
            like("kd", shape="3", unit="1/s", meaning="gains of the error of its velocity"),
            like("ki", shape="3", unit="1/s^3"),
            like("z", shape="3", unit="m s"),
        ),
        returns="The named tuple (tau, z_next), (..., n) and (..., 3): torques to apply and the state for "
        "the next tick. The status, (...), is 1 where damping acts; the tip then follows only where "
        "it can move.",
        record=f"{OPERATIONAL}:POSITION_OPERATIONAL_SPACE",
        details="``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J "
        "inv(M) J')`` and ``a = A_d + kp e_x + kd (V_d - J dq) + ki z``, J the first three rows of "
        "the Jacobian, e_x the position error (m).",
        raises=(
            ("numpy.linalg.LinAlgError", "damping acts at some state, and ``with_status`` is False."),
            ("ValueError", "the robot has fewer than three joints."),
        ),
        result="OperationalStep",
        status=True,
        more_joints_than=2,
        needs=Needs.TIP_POSITION,
        refuses="``z_next`` is then z, tau zero",
        of_tip=True,
    ),
    ModelFunction(
        "momentum_observer_start",
        "observer",
        "Initial state of the momentum observer (:meth:`momentum_observer`) for its first period.",
        takes="q dq * width gravity beta Ia friction",
        returns="The named tuple (p, u), (..., n) each: ``p = M dq`` and ``u = C' dq - g - f(dq)``.",
        record=f"{OBSERVERS}:momentum_observer_start",
        result="ObserverState",
        status=True,
        refuses="p and u are then zero, and no state to start with",
    ),
    ModelFunction(
        "momentum_observer",
        "observer",
        "One period of the momentum observer, which estimates the torques r that the environment exerts, low-passed.",
        takes="q dq tau * width p_last u_last r_last gain Ts gravity beta Ia friction",
        where=(
            like("tau", meaning="torques applied since the last tick"),
            ArgumentKind("p_last", "n", "N m s | N s", "momentum at the last tick"),
            ArgumentKind("u_last", "n", "N m | N", "torques u at the last tick"),
            ArgumentKind("r_last", "n", "N m | N", "estimate of the last tick", note="; zero at the start"),
            ArgumentKind("gain", "", "1/s", "pole of the observer"),
        ),
        returns="The named tuple (r, p, u), (..., n) each: the estimate, and the state for the next tick.",
        record=f"{OBSERVERS}:momentum_observer",
        result="ObserverStep",
        status=True,
        refuses="the results are then those of the last tick",
    ),
    ModelFunction(
        "contact",
        "observer",
        "One period of contact detection: compare estimated external torques and their changes with thresholds.",
        takes="r r_last change_last gain Ts threshold change_threshold",
        where=(
            ArgumentKind("r_last", "n", "N m | N", "those of the last tick", note="; zero at the start"),
            ArgumentKind("change_last", "n", "N m | N", "change of the last tick", note="; zero at the start"),
            ArgumentKind("gain", "", "1/s", "pole of the momentum observer"),
            ArgumentKind(
                "threshold",
                "n",
                "N m | N",
                "thresholds of r",
                note=", of ``contact-thresholds``; inf for none",
                constant=True,
            ),
            ArgumentKind(
                "change_threshold",
                "n",
                "N m | N",
                "thresholds of the change",
                note=", of the same command; inf for none",
                constant=True,
            ),
        ),
        returns="The named tuple (ratio, touches, change): the larger of ``|r|/threshold`` and "
        "``|h|/change_threshold``, (..., n), 1 where one of them exceeds 1, (...), and the change h "
        "for the next tick, (..., n).",
        record=f"{CONTACT}:contact",
        details="The change ``h = alpha^2 change_last + alpha (r - r_last)``, alpha = exp(-gain Ts), is what "
        "an observer with twice the pole would estimate, minus r: a contact shows in it although the "
        "model errors in r are larger.",
        result="Contact",
        status=True,
        refuses="``change`` is then the last one, ``touches`` 1",
    ),
    ModelFunction(
        "external_wrench",
        "observer",
        "Estimate the wrench F on the robot that causes the external torques r: ``F = P J inv(S) r``.",
        takes="J r covariance",
        returns="The named tuple (F, P, condition): the wrench in base axes, (..., 6), N and N m, its "
        "covariance, (..., 6, 6), and a condition number, (...), that is 1 at best and large near "
        "singular configurations.",
        record=f"{CONTACT}:EXTERNAL_WRENCH",
        details="It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of "
        "the errors of r and the Jacobian J of the point where the wrench acts.",
        raises=(
            (
                "numpy.linalg.LinAlgError",
                "the torques do not determine it at some state, and ``with_status`` is False.",
            ),
            ("ValueError", "the robot has fewer than six joints."),
        ),
        result="ExternalLoad",
        status=True,
        refuses="the results are then zero",
        more_joints_than=5,
    ),
    ModelFunction(
        "external_force",
        "observer",
        "Estimate the force F, without a moment, that causes the external torques r: ``F = P J inv(S) r``.",
        takes="J r covariance",
        returns="The named tuple (F, P, condition): the force in base axes, (..., 3), N, its covariance, "
        "(..., 3, 3), and a condition number, (...), that is 1 at best and large near singular "
        "configurations.",
        record=f"{CONTACT}:EXTERNAL_FORCE",
        details="It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of "
        "the errors of r and J the first three rows of the Jacobian of the point where the force "
        "acts.",
        raises=(
            (
                "numpy.linalg.LinAlgError",
                "the torques do not determine it at some state, and ``with_status`` is False.",
            ),
            ("ValueError", "the robot has fewer than three joints."),
        ),
        result="ExternalLoad",
        status=True,
        refuses="the results are then zero",
        more_joints_than=2,
    ),
    ModelFunction(
        "elastic_forward_dynamics",
        "elastic",
        "Accelerations of links and rotors under torques on the rotors.",
        takes="q dq theta dtheta tau beta * gravity rotor_inertia stiffness damping",
        where=(
            like("q", meaning="positions of the links"),
            like("dq", meaning="velocities of the links"),
            like("theta", meaning="positions of the rotors, seen at the joints"),
            like("dtheta", meaning="velocities of the rotors"),
            like("tau", meaning="torques on the rotors, friction subtracted"),
            ArgumentKind(
                "damping",
                "n",
                "N m s/rad | N s/m",
                "dampings",
                constant=True,
                from_file="those of the robot file, else zero",
            ),
        ),
        returns="The named tuple (ddq, ddtheta), (..., n) each, rad/s^2 or m/s^2. The status, (...), is 1 "
        "where the mass matrix is not positive definite; ddq is zero there.",
        record=f"{ELASTIC}:elastic_forward_dynamics",
        raises=(
            ("numpy.linalg.LinAlgError", "the mass matrix is not positive definite, and ``with_status`` is False."),
        ),
        result="ElasticAccelerations",
        status=True,
    ),
    ModelFunction(
        "elastic_inverse_dynamics",
        "elastic",
        "Torques of the motors and motion of the rotors for a motion of the links, without damping and friction.",
        takes="q dq ddq d3q d4q beta * gravity rotor_inertia stiffness",
        where=(
            like("q", meaning="positions of the links"),
            like("dq", meaning="their velocities"),
            like("ddq", meaning="their accelerations"),
            ArgumentKind("d3q", "n", "rad/s^3 | m/s^3", "their third derivatives"),
            ArgumentKind("d4q", "n", "rad/s^4 | m/s^4", "their fourth derivatives"),
        ),
        returns="The named tuple (tau, theta, dtheta), (..., n) each: torques, N m or N, positions and "
        "velocities of rotors.",
        record=f"{ELASTIC}:ELASTIC_INVERSE_DYNAMICS",
        combine=f"{ELASTIC}:elastic_inverse_dynamics",
        of=("inverse_dynamics",),
        details="``tau = J theta'' + tau_l``, ``theta = q + tau_l/K``, with the torques tau_l of the links.",
        result="RotorMotion",
    ),
    ModelFunction(
        "elastic_feedforward",
        "elastic",
        "Feed-forward of a motion of the links, and PD control of the rotors, where the encoders are.",
        takes="theta dtheta q_d dq_d ddq_d d3q_d d4q_d kp kd * width gravity beta rotor_inertia stiffness "
        "friction tau_max",
        where=(like("q_d", meaning="desired positions of the links"),),
        returns="The torques to apply, (..., n), N m or N.",
        record=f"{ELASTIC}:ELASTIC_FEEDFORWARD",
        combine=f"{ELASTIC}:elastic_feedforward",
        of=("inverse_dynamics",),
        details="``tau = J theta_d'' + tau_l + kp (theta_d - theta) + kd (theta_d' - theta') + f(dq_d)``, "
        "where theta_d are the rotor positions and tau_l the torques of the links that belong to the "
        "desired motion.",
        status=True,
        refuses="tau is then zero",
    ),
    ModelFunction(
        "elastic_feedback_linearization",
        "elastic",
        "Feedback linearisation with elastic joints (Spong 1987): errors of the links decay with four poles at -w.",
        takes="q dq theta dtheta q_d dq_d ddq_d d3q_d d4q_d w * width gravity beta rotor_inertia stiffness "
        "friction tau_max",
        where=(
            like("q", meaning="measured positions of the links"),
            like("dq", meaning="measured velocities of the links"),
            like("q_d", meaning="desired positions of the links"),
            ArgumentKind("w", "n", "rad/s", "bandwidths of the loops", constant=True),
        ),
        returns="The torques to apply, (..., n), N m or N. The status, (...), is 1 where the mass matrix is "
        "not positive definite.",
        record=f"{ELASTIC}:ELASTIC_FEEDBACK_LINEARIZATION",
        combine=f"{ELASTIC}:elastic_feedback_linearization",
        of=("inverse_dynamics",),
        raises=(
            ("numpy.linalg.LinAlgError", "the mass matrix is not positive definite, and ``with_status`` is False."),
        ),
        status=True,
        refuses="tau is then zero",
    ),
    ModelFunction(
        "path_dynamics",
        "timing",
        "Joint torques along a path, linear in u = d2s/dt2 and x = (ds/dt)^2: ``tau = a u + b x + g``.",
        takes="q q_s q_ss beta * Ia gravity",
        where=(
            ArgumentKind("q_s", "n", "rad per unit of s | m per unit of s", "their derivatives dq/ds"),
            ArgumentKind("q_ss", "n", "rad per unit of s^2 | m per unit of s^2", "their second derivatives d2q/ds2"),
        ),
        returns="The named tuple (a, b, g), (..., n) each, N m or N per unit of u, of x, and N m or N.",
        record=f"{PATHS}:path_dynamics",
        details="``a = M q_s``, ``b = M q_ss + c(q, q_s)``, without friction.",
        result="PathDynamics",
    ),
    ModelFunction(
        "quintic",
        "trajectory",
        "Motion at the time t along quintic polynomials that connect two states (position, velocity, acceleration).",
        takes="t T q_0 dq_0 ddq_0 q_1 dq_1 ddq_1",
        where=(
            ArgumentKind(
                "t", "", "s", "time since the start", note="; before 0 and after T the nearer end is returned"
            ),
            like("T", shape="", unit="s", meaning="duration"),
            ArgumentKind("dq_0", "n", "rad/s | m/s", "velocities at the start"),
            ArgumentKind("ddq_0", "n", "rad/s^2 | m/s^2", "accelerations at the start"),
            ArgumentKind("dq_1", "n", "rad/s | m/s", "velocities at the end"),
            ArgumentKind("ddq_1", "n", "rad/s^2 | m/s^2", "accelerations at the end"),
        ),
        returns="The named tuple (q_d, dq_d, ddq_d), (..., n) each.",
        record=f"{MOTIONS}:quintic",
        result="Motion",
        status=True,
        refuses="the motion is then zero",
    ),
    ModelFunction(
        "trapezoidal",
        "trajectory",
        "Fastest straight motion in joint space with trapezoidal speed and all joints in phase, at the time t.",
        takes="t q_0 q_1 dq_max ddq_max",
        where=(
            ArgumentKind("t", "", "s", "time since the start"),
            ArgumentKind("dq_max", "n", "rad/s | m/s", "largest speeds", note="; positive", constant=True),
            ArgumentKind("ddq_max", "n", "rad/s^2 | m/s^2", "largest accelerations", note="; positive", constant=True),
        ),
        returns="The named tuple (q_d, dq_d, ddq_d, T): (..., n) each, and the duration, (...), s.",
        record=f"{MOTIONS}:trapezoidal",
        result="TimedMotion",
        status=True,
        refuses="the motion is then zero",
    ),
    ModelFunction(
        "mass_matrix_derivatives",
        "hessian",
        "Derivatives of the mass matrix with respect to the joint positions, ``dM_ij/dq_k``.",
        takes="q beta * Ia",
        returns="dM_dq, (..., n, n, n), in SI units: ``dM_dq[..., i, j, k]``, symmetric in i and j.",
        combine=f"{SECOND}:mass_matrix_derivatives",
        of=("mass_matrix",),
        differentiated=True,
    ),
    ModelFunction(
        "inverse_dynamics_hessian",
        "hessian",
        "Gradient and Hessian of ``weights' tau`` with respect to (q, dq, ddq), for given weights.",
        takes="q dq ddq weights beta * Ia gravity",
        where=(like("weights", meaning="weights of the torques", note=", such as the multipliers of a solver"),),
        returns="The named tuple (gradient, H): (..., 3 n), and (..., 3 n, 3 n), symmetric, in SI units times the unit "
        "of the weights.",
        combine=f"{SECOND}:inverse_dynamics_hessian",
        of=("inverse_dynamics",),
        details="The blocks of ddq and ddq, and of ddq and dq, are zero. In C the others are separate outputs, those "
        "on the diagonal as upper triangles.",
        result="Hessian",
        differentiated=True,
        by_hand=True,
    ),
    ModelFunction(
        "inverse_dynamics_hessian_product",
        "hessian",
        "Product of the Hessian of ``weights' tau`` with respect to (q, dq, ddq) with a direction.",
        takes="q dq ddq weights direction beta * Ia gravity",
        where=(
            like("weights", meaning="weights of the torques", note=", such as the multipliers of a solver"),
            ArgumentKind("direction", "3n", "any", "the direction", note=": changes of q, then of dq, then of ddq"),
        ),
        returns="``H direction``, (..., 3 n), in SI units times the units of weights and direction. H is never formed.",
        combine=f"{SECOND}:inverse_dynamics_hessian_product",
        of=("inverse_dynamics",),
        differentiated=True,
    ),
    ModelFunction(
        "forward_dynamics_hessian",
        "hessian",
        "Gradient and Hessian of ``weights' ddq`` with respect to (q, dq, tau), for given weights.",
        takes="q dq tau weights beta * Ia gravity",
        where=(like("weights", meaning="weights of the accelerations", note=", such as the multipliers of a solver"),),
        returns="The named tuple (gradient, H): (..., 3 n), and (..., 3 n, 3 n), symmetric, in SI units times the unit "
        "of the weights; zero where M is not positive definite. The status, (...), is 1 there and 0 elsewhere.",
        combine=f"{SECOND}:forward_dynamics_hessian",
        of=("inverse_dynamics_hessian", "forward_dynamics_derivatives"),
        details="The blocks of tau and tau, and of tau and dq, are zero.",
        raises=(
            ("numpy.linalg.LinAlgError", "M is indefinite or singular at some state, and ``with_status`` is False."),
        ),
        result="Hessian",
        status=True,
        by_hand=True,
    ),
    ModelFunction(
        "inverse_dynamics_second_derivatives",
        "tensors",
        "All second derivatives of the joint torques with respect to q, dq and ddq that can differ from zero.",
        takes="q dq ddq beta * Ia gravity",
        returns="The named tuple (d2tau_dqq, d2tau_dvq, d2tau_dvv, dM_dq), (..., n, n, n) each, in SI units: "
        "``d2tau_dvq[..., i, j, k]`` is the derivative of tau_i by dq_j and q_k.",
        combine=f"{SECOND}:inverse_dynamics_second_derivatives",
        of=("inverse_dynamics_derivatives",),
        result="SecondDerivatives",
        differentiated=True,
        most_joints=8,
        absent="all second derivatives exist for at most eight joints; inverse_dynamics_hessian has their weighted sum",
    ),
    ModelFunction(
        "closed_loops",
        "loops",
        "Passive joints of closed loops: their angles and rates ``W dq``, and whether the loops can be assembled.",
        takes="q",
        returns="The named tuple (passive, W, sine): cosine and sine of the displacement of every passive joint, of a "
        "prismatic one its displacement and 0, (..., p, 2), "
        "the matrix of their rates, (..., p, n), and the sine of the angle between the two bars of "
        "every loop, (..., k). The status, (...), is 0; 1 where a loop is near a dead point, 2 where one cannot be "
        "assembled.",
        record=f"{LOOPS}:closed_loops",
        details="At a dead point, where the sine is zero, the passive joints have no rates. All functions stay finite "
        "there: a sine below 1e-6, also that of a loop that cannot be assembled, counts as 1e-6.",
        raises=(
            ("numpy.linalg.LinAlgError", "a sine is below 1e-3 at some state, and ``with_status`` is False."),
            ("ValueError", "a loop cannot be assembled at some state, and ``with_status`` is False."),
        ),
        result="ClosedLoops",
        status=True,
        needs=Needs.LOOPS,
        absent="the robot file states no loops",
    ),
    ModelFunction(
        "solve_loops",
        "loops",
        "Positions of the passive joints at ``q`` by two steps of Newton's method, from those at ``q_last``.",
        takes="q q_last loop_q_last",
        where=(
            ArgumentKind("q_last", "n", "rad | m", "joint positions of the last call"),
            ArgumentKind("loop_q_last", "p", "rad | m", "positions of the passive joints there", note=", its result"),
        ),
        returns="The named tuple (loop_q, gap): positions of the passive joints, (..., p), in the order of the loops, "
        "and the largest gap of a pin that is left, (...), m. The status, (...), is 0; 1 where the loops are near a "
        "dead point or have passed one, 2 where the gap exceeds 1e-6 of their lengths.",
        record=f"{LOOPS}:solve_loops",
        details="The loops are assembled as at ``q_last``. With status 2 they cannot be assembled at ``q``, or "
        "``q_last`` is too far away.",
        raises=(
            ("numpy.linalg.LinAlgError", "the loops are near a dead point, and ``with_status`` is False."),
            ("ValueError", "the loops are not solved at some state, and ``with_status`` is False."),
        ),
        result="LoopPositions",
        status=True,
        needs=Needs.NEWTON,
        absent="no loop of the robot file has solve: newton",
    ),
    ModelFunction(
        "floating_inverse_dynamics",
        "floating",
        "Wrench on the floating base and joint torques, without friction.",
        takes="q dq ddq orientation twist twist_rate beta * Ia gravity",
        returns="The named tuple (wrench, tau): force (N) and moment (N m) on the base about its origin, in base axes, "
        "(..., 6), and the joint torques, (..., n), N m or N.",
        record=f"{FLOATING}:INVERSE_DYNAMICS",
        details="``[wrench; tau] = M(q) [twist_rate; ddq] + h(q, dq, orientation, twist)``. A robot that flies has "
        "wrench zero; one that stands has ``wrench = sum of J' f`` of the forces at its feet.",
        raises=(("ValueError", NO_FLOATING_BASE),),
        status=True,
        result="FloatingForces",
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_mass_matrix",
        "floating",
        "Mass matrix over the twist of the floating base and the joint velocities, drive inertia included.",
        takes="q beta * Ia",
        returns="M, (..., 6 + n, 6 + n), in SI units. Its first six rows times [twist; dq] are the linear and the "
        "angular momentum about the base origin, in base axes.",
        record=f"{FLOATING}:mass_matrix",
        raises=(("ValueError", "the robot file states no floating base."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_bias",
        "floating",
        "Wrench on the floating base and joint torques where neither twist nor dq changes, without friction.",
        takes="q dq orientation twist beta * gravity",
        returns="h, (..., 6 + n), in SI units: force and moment on the base, then joint torques.",
        record=f"{FLOATING}:BIAS",
        raises=(("ValueError", NO_FLOATING_BASE),),
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_regressor",
        "floating",
        "Regressor of the floating base, ``[wrench; tau] = Y beta``, linear in the base parameters.",
        takes="q dq ddq orientation twist twist_rate * gravity",
        returns="Y, (..., 6 + n, b), in SI units: rows of force and moment on the base, then of the joints.",
        record=f"{FLOATING}:REGRESSOR",
        links_only="Y",
        raises=(("ValueError", NO_FLOATING_BASE),),
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_forward_dynamics",
        "floating",
        "Accelerations of the floating base and of the joints; friction is not part of it: subtract it from ``tau``.",
        takes="q dq tau orientation twist wrench beta * Ia gravity",
        returns="The named tuple (twist_rate, ddq): rates of the components of the twist, (..., 6), m/s^2 and "
        "rad/s^2, and joint accelerations, (..., n), rad/s^2 or m/s^2; zero where M is not positive definite. The "
        "status, (...), is 1 there, 2 where the orientation is no unit quaternion, and else 0.",
        combine=f"{FLOATING}:forward_dynamics",
        of=("floating_mass_matrix", "floating_bias"),
        raises=(
            ("ValueError", NO_FLOATING_BASE),
            ("numpy.linalg.LinAlgError", "M is indefinite or singular at some state, and ``with_status`` is False."),
        ),
        result="FloatingAccelerations",
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_momentum",
        "floating",
        "Linear and angular momentum of the whole robot about the origin of its floating base, in base axes.",
        takes="q dq twist beta",
        returns="The momentum, (..., 6): linear, N s, then angular, N m s.",
        record=f"{FLOATING}:MOMENTUM",
        details="With the position c of the centre of mass (:meth:`floating_momentum_matrix`), ``L - c x p`` is the "
        "angular momentum about it. In world axes ``dp/dt`` is the sum of weight and outer forces.",
        raises=(("ValueError", "the robot file states no floating base."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_momentum_matrix",
        "floating",
        "Momentum matrix A about the origin of the floating base, ``[p; L] = A(q) [twist; dq]``, in base axes.",
        takes="q beta",
        returns="A, (..., 6, 6 + n), in SI units: rows of the linear, then of the angular momentum.",
        record=f"{FLOATING}:momentum_matrix",
        details="These are the first six rows of :meth:`floating_mass_matrix`. ``A[..., 0, 0]`` is the mass m of the "
        "robot, and ``m c = (A[..., 1, 5], A[..., 2, 3], A[..., 0, 4])`` with the position c of its centre of mass.",
        raises=(("ValueError", "the robot file states no floating base."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_jacobian",
        "floating",
        "Geometric Jacobian of the tip over the twist of the floating base and dq, in base axes.",
        takes="q",
        returns="J, (..., 6, 6 + n), ``[v; w] = J(q) [twist; dq]``: linear velocity v of the tip (m/s) first, then "
        "angular velocity w (rad/s), both seen from the world and written in base axes.",
        record=f"{FLOATING}:jacobian",
        details="A wrench F at the tip, force first, in base axes, acts as ``[wrench; tau] = J' F``.",
        raises=(("ValueError", "the robot file states no floating base, or the robot has no tip of this name."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
        of_tip=True,
    ),
    ModelFunction(
        "floating_jacobian_dot_dq",
        "floating",
        "Acceleration a of the tip on a floating base where neither twist nor dq changes, in base axes.",
        takes="q dq twist",
        returns="a, (..., 6): linear part (m/s^2) first, then angular (rad/s^2).",
        record=f"{FLOATING}:jacobian_dot_dq",
        details="The tip is accelerated by ``J(q) [twist_rate; ddq] + a``, with J of :meth:`floating_jacobian`: the "
        "rate of its velocity in world axes, written in base axes.",
        raises=(("ValueError", "the robot file states no floating base, or the robot has no tip of this name."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
        of_tip=True,
    ),
    ModelFunction(
        "floating_inverse_dynamics_from_imu",
        "floating",
        "Wrench on the floating base and joint torques, without friction, from the gyroscope and accelerometer on it.",
        takes="q dq ddq gyro gyro_rate accelerometer beta * Ia",
        returns="The named tuple (wrench, tau): force (N) and moment (N m) on the base about its origin, in base axes, "
        "(..., 6), and the joint torques, (..., n), N m or N.",
        record=f"{FLOATING}:INVERSE_DYNAMICS_FROM_IMU",
        details="As :meth:`floating_inverse_dynamics`, with ``accelerometer = dv/dt + omega x v - R' g``: neither "
        "orientation, velocity nor gravity enter otherwise.",
        raises=(("ValueError", "the robot file states no floating base."),),
        result="FloatingForces",
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_regressor_from_imu",
        "floating",
        "Regressor of the floating base from its gyroscope and accelerometer, ``[wrench; tau] = Y beta``.",
        takes="q dq ddq gyro gyro_rate accelerometer",
        returns="Y, (..., 6 + n, b), in SI units: rows of force and moment on the base, then of the joints.",
        record=f"{FLOATING}:REGRESSOR_FROM_IMU",
        links_only="Y",
        raises=(("ValueError", "the robot file states no floating base."),),
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
    ),
    ModelFunction(
        "floating_inverse_dynamics_derivatives",
        "floating",
        "Wrench on the floating base and joint torques, f = [wrench; tau], and their derivatives; friction is not part "
        "of it.",
        takes="q dq ddq orientation twist twist_rate beta * Ia gravity",
        returns="The named tuple (wrench, tau, df_dq, df_dv, M): (..., 6), (..., n), and (..., 6 + n, 6 + n) each, in "
        "SI units. The columns of df_dq belong to translation and rotation of the base, then to q, those of df_dv to "
        "[twist; dq], those of the mass matrix M to [twist_rate; ddq].",
        record=f"{FLOATING_DERIVATIVES}:inverse_dynamics_derivatives",
        details="The base is moved and turned along and about its own axes, by the displacement that "
        ":func:`rrrgen.runtime.floating_base.integrate` takes, while the components of twist and twist_rate stay. The "
        "columns of the translation are zero. Pinocchio's ``computeRNEADerivatives`` has the same columns.",
        raises=(("ValueError", NO_FLOATING_BASE),),
        result="FloatingDerivatives",
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
        on_demand=True,
    ),
    ModelFunction(
        "floating_inverse_dynamics_hessian",
        "hessian",
        "Gradient and Hessian of ``weights' [wrench; tau]`` on a floating base, for given weights.",
        takes="q dq ddq weights orientation twist twist_rate beta * Ia gravity",
        where=(WEIGHTS_OF_FORCES,),
        returns="The named tuple (gradient, H): (..., 3 (6 + n)), and (..., 3 (6 + n), 3 (6 + n)), symmetric, in SI "
        "units times the unit of the weights, by translation and rotation of the base and q, then by twist and dq, "
        "then by twist_rate and ddq.",
        combine=f"{FLOATING_SECOND}:inverse_dynamics_hessian",
        of=("floating_inverse_dynamics_from_imu",),
        details="The base is moved and turned along and about its own axes, as in "
        ":meth:`floating_inverse_dynamics_derivatives`: the Hessian is that along the exponential map, R exp([xi]x), "
        "which is symmetric, while repeated derivatives by rotations are not. The elements of the translation are "
        "zero. In C the blocks that can differ from zero are separate outputs, those on the diagonal as upper "
        "triangles.",
        raises=(("ValueError", NO_FLOATING_BASE),),
        result="Hessian",
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
        differentiated=True,
        by_hand=True,
    ),
    ModelFunction(
        "floating_inverse_dynamics_hessian_product",
        "hessian",
        "Product of the Hessian of ``weights' [wrench; tau]`` on a floating base with a direction.",
        takes="q dq ddq weights direction orientation twist twist_rate beta * Ia gravity",
        where=(
            WEIGHTS_OF_FORCES,
            ArgumentKind(
                "direction",
                "3(6+n)",
                "any",
                "the direction",
                note=": changes of translation and rotation of the base and of q, then of twist and dq, then of "
                "twist_rate and ddq",
            ),
        ),
        returns="``H direction``, (..., 3 (6 + n)), in SI units times the units of weights and direction, with the "
        "Hessian of :meth:`floating_inverse_dynamics_hessian`, which is never formed.",
        combine=f"{FLOATING_SECOND}:inverse_dynamics_hessian_product",
        of=("floating_inverse_dynamics_from_imu",),
        raises=(("ValueError", NO_FLOATING_BASE),),
        status=True,
        needs=Needs.FLOATING_BASE,
        absent=STATE_FLOATING_BASE,
        differentiated=True,
    ),
    ModelFunction(
        "friction",
        "friction",
        "Friction torques of the laws of the robot file, such as ``tau_f = fv dq + fc sgn(dq) + offset``.",
        takes="dq tau_load",
        where=(like("tau_load", note=", as of :meth:`inverse_dynamics`; needed where a law depends on the load"),),
        returns="tau_f, (..., n), N m or N; zero where the file states no friction.",
        record=f"{FRICTION}:friction",
        details="They add to the torques of the rigid body. Laws with a state are taken in steady sliding. "
        "Coupled motors add ``S^-T tau_fm(S^-1 dq)``, the laws at their shafts. Source: "
        "(14.11)-(14.14).",
        raises=(("ValueError", "a law depends on the load and ``tau_load`` is missing."),),
        needs=Needs.FRICTION,
        by_hand=True,
    ),
    ModelFunction(
        "friction_step",
        "friction",
        "One period of the friction laws with a state, exact for constant dq: the next state and the torques.",
        takes="dq z Ts tau_load",
        where=(
            ArgumentKind(
                "z",
                "s",
                "rad | m",
                "states of the laws that have one",
                note=", zero at first: bristle deflections at those joints and coupled motors, in the order of "
                "the robot file",
            ),
        ),
        returns="The named tuple (z_next, tau_f): the states after the period, (..., s), rad or m, and the "
        "friction torques of all joints, (..., n), N m or N.",
        record=f"{FRICTION}:friction_step",
        raises=(
            (
                "ValueError",
                "no friction law of this robot has a state, or one depends on the load and ``tau_load`` is missing.",
            ),
        ),
        result="FrictionStep",
        needs=Needs.FRICTION_STATE,
        absent="no friction law of this robot has a state: friction(dq) states it all",
        status=True,
        refuses="``z_next`` is then z, tau_f zero",
    ),
    ModelFunction(
        "friction_with",
        "friction",
        "Friction torques under the laws of the robot file, with their parameters at run time.",
        takes="dq friction tau_load",
        where=(like("friction", note=", in the order of ``friction_parameter_names``", from_file=""),),
        returns="tau_f, (..., n), N m or N.",
        record=f"{FRICTION}:friction_with",
        raises=(("ValueError", "a law depends on the load and ``tau_load`` is missing."),),
    ),
    ModelFunction(
        "smooth_friction",
        "friction",
        "Friction torques as :meth:`friction_with`, with tanh(s / width) in place of sgn(s).",
        takes="dq friction width tau_load",
        where=(like("friction", note=", in the order of ``friction_parameter_names``", from_file=""),),
        returns="tau_f, (..., n), N m or N.",
        record=f"{FRICTION}:smooth_friction",
        raises=(("ValueError", "a law depends on the load and ``tau_load`` is missing."),),
    ),
)
"""All model functions, in the order of emission within their groups."""

FUNCTIONS = {function.name: function for function in TABLE}
"""All model functions by name."""

OF_TIP = tuple(sorted((f for f in TABLE if f.of_tip), key=lambda f: -len(f.name)))
"""The functions about the tip, those with long names first: ``<tip>_tool_kinematics`` ends with two of the names."""


@cache
def find(name: str) -> ModelFunction | None:
    """The model function ``name``: one of the table or, of a named tip, ``<tip>_<function>``; None if it is neither."""
    if name in FUNCTIONS:
        return FUNCTIONS[name]
    for function in OF_TIP:
        if name.endswith(f"_{function.name}"):
            return function.at_tip(name.removesuffix(f"_{function.name}"))
    return None


def get_function(name: str) -> ModelFunction:
    """The model function ``name``, as :func:`find` does; KeyError where there is none."""
    function = find(name)
    if function is None:
        raise KeyError(name)
    return function


GROUPS = {
    "model": "Kinematics and dynamics: poses, Jacobians, and the equation of motion ``tau = M(q) ddq + c(q, dq) +"
    " g(q)`` of the rigid body with drive inertia, its regressors, derivatives and energies.",
    "points": "Velocities, Jacobians and wrenches at any link frame or point, tools at run time, null space,"
    " manipulability. A point is fixed to a frame with pose T and Jacobian J: those of a link, from link_frames and"
    " link_jacobians, or those of the tip.",
    "control": "Control laws, each one tick of a controller that keeps its state itself: ``e = q_d - q``,"
    " ``e' = dq_d - dq``, f the friction torque at the desired speed. Torques are limited to ``tau_max``; the integral"
    " z of a joint rests while its torque is at the limit and its error would drive it further. Terms for observers and"
    " passivity-based control.",
    "observer": "The momentum observer of external torques, detection of contacts, and the wrench of a contact.",
    "elastic": "Elastic joints (Spong 1987): a spring K and a damper D between link q and rotor theta of every joint,"
    " ``M ddq + c + g = K (theta - q) + D (dtheta - dq) = tau - J ddtheta`` with M, c and g of the links alone. Rotor"
    " positions, torques and the rotor inertia J are seen at the joints.",
    "timing": "Dynamics along a given path q(s).",
    "trajectory": "Desired motions from point to point.",
    "hessian": "Second derivatives of inverse and forward dynamics for solvers that use exact Hessians, summed with the"
    " multipliers of the solver as weights, so that n matrices become one.",
    "tensors": "All second derivatives of inverse dynamics, unweighted, for robots of at most eight joints: their"
    " number grows with n^3.",
    "loops": "Closed loops: the joints without a drive, which the loops move, and their dead points.",
    "floating": "Dynamics on a floating base: its twist [v; omega] and the rates of the components of the twist are in"
    " base axes; the wrench on it, force and moment, is about its origin. The functions of the other groups hold the"
    " base still.",
    "friction": "Friction at the joints and at coupled motors, under the laws of the robot file.",
}
"""The groups of functions, and what they are for."""

WITH_NEWTON = ("model", "loops", "floating", "friction", "points", "trajectory")
"""The groups that robots have whose closed loops are solved by Newton's method: their functions are about one position
at most. Second derivatives would need those of the positions of the passive joints."""

ARGUMENT_ORDER = 2
"""Version of the order of arguments in emitted code. It is raised with every change of an order, since C accepts many
old calls: pointers look alike. In version 1 parameters of the robot file stood before gains, width and period."""

ALWAYS = ("model", "loops", "floating", "friction")
"""The groups that every model has."""


def functions_of(group: str, joints: int, tips: Iterable[str] = ()) -> tuple[str, ...]:
    """Names of the functions of ``group`` for robots with so many ``joints``, whatever else the robot file states.

    ``tips`` are the names of its tips.
    """
    return tuple(f.name for f in _at_all_tips((group,), tips) if f.suits(joints))


def _at_all_tips(groups: Iterable[str], tips: Iterable[str]) -> Iterator[ModelFunction]:
    """The functions of the ``groups``, each about the tip followed by those about every named tip."""
    named_tips = tuple(tips)
    for group in groups:
        for function in TABLE:
            if function.group == group:
                if function.needs is not Needs.SHARED_JOINTS:
                    yield function
                yield from (function.at_tip(tip) for tip in named_tips if function.of_tip)


def exists(function: ModelFunction, spec: RobotSpec) -> bool:
    """Whether the robot ``spec`` has ``function``."""
    from rrrgen.derive.functions.friction import friction_of

    if function.needs is Needs.FRICTION and not friction_of(spec):
        return False
    if function.needs is Needs.FRICTION_STATE and not any(surface.has_state for surface in friction_of(spec)):
        return False
    if function.needs is Needs.FLOATING_BASE and not spec.floating_base:
        return False
    if spec.loops and not function.closed_loops:
        return False
    if function.needs is Needs.LOOPS and not spec.loops:
        return False
    if function.needs is Needs.NEWTON and not spec.newton:
        return False
    if not function.suits(spec.n):
        return False
    if function.needs is Needs.SHARED_JOINTS:
        from rrrgen.robot.model.mechanism import tip_arm

        try:
            return bool(function.tip and tip_arm(spec, function.tip).shared)
        except DerivationError:
            return False
    if function.needs in (Needs.TIP_POSITION, Needs.TIP_POSE):
        from rrrgen.derive.functions.operational_space import tip_moves

        shifts, turns = tip_moves(spec.at_tip(function.tip) if function.tip else spec)
        return shifts and (turns or function.needs is Needs.TIP_POSITION)
    return True


Part = Literal["all", "at once", "on demand"]
"""Functions of a group: all, those that Python compiles at once, or those that it compiles when they are called."""


def functions_for(spec: RobotSpec, groups: Sequence[str], part: Part = "all") -> tuple[ModelFunction, ...]:
    """The functions of ``groups`` that the robot ``spec`` has, in the order of emission: all, or a ``part`` of them.

    Raises DerivationError if a group has functions for robots with fewer joints alone.
    """
    if spec.newton:
        from rrrgen.robot.model.mechanism import refuse_newton

        for group in groups:
            if group not in WITH_NEWTON:
                refuse_newton(spec, f"the group {group}")
    for function in TABLE:
        if function.group in groups and 0 < function.most_joints < spec.n:
            raise DerivationError(f"{function.group} of {spec.name}, {spec.n} joints: {function.absent}")
    if "model" in groups:
        last = [group for group in ALWAYS if group != "model"]
        groups = (*(group for group in groups if group not in last), *last)
    every = tuple(f for f in _at_all_tips(dict.fromkeys(groups), spec.tips) if exists(f, spec))
    return every if part == "all" else tuple(f for f in every if f.on_demand == (part == "on demand"))


def with_sources(functions: Sequence[ModelFunction]) -> tuple[ModelFunction, ...]:
    """The ``functions``, behind those others that they are, or may be, made of."""
    needed = list(functions)
    for function in needed:  # grows on the way
        needed += [FUNCTIONS[name] for name in function.of if FUNCTIONS[name] not in needed]
    return (*(f for f in TABLE if f in needed and f not in functions), *functions)


def order_inputs(program: Program) -> Program:
    """The same ``program`` with its inputs in the order of the table.

    It is the same in all languages: what the caller must give, then gravity, then what the robot file can give.
    """
    function = FUNCTIONS[program.function]
    places = {quantity.name: place for place, quantity in enumerate(function.arguments)}
    late = {quantity.name: 1 + (quantity.name != "gravity") for quantity in function.arguments if quantity.from_file}

    def place(k: int) -> tuple[int, int]:
        name = program.inputs[k].name  # closed forms have the constants of the geometry as a further, last input
        return late.get(name, 0), places.get(name, len(places))

    order = sorted(range(len(program.inputs)), key=place)
    if order == list(range(len(order))):
        return program
    now = {before: after for after, before in enumerate(order)}
    nodes = [
        node._replace(value=(now[node.place[0]], node.place[1])) if node.op is Op.INPUT else node
        for node in program.nodes
    ]
    return program.with_fields(inputs=tuple(program.inputs[k] for k in order), nodes=tuple(nodes))


@cache
def recorders(name: str) -> tuple[Recorder, ...]:
    """The recorders of the function ``name``; none for a function that is combined from programs of others."""
    function = get_function(name)
    loaded = _load(function.record)
    every: tuple[Recorder, ...] = loaded if isinstance(loaded, tuple) else (loaded,)
    return tuple(partial(_record, function, recorder) for recorder in every)


def _record(function: ModelFunction, recorder: Recorder, recording: FunctionBuilder) -> Program:
    recording.function = function
    if not function.tip:
        return order_inputs(recorder(recording))
    recording.model = recording.model.at_tip(function.tip)
    program, about = order_inputs(recorder(recording)), partial(about_tip, tip=function.tip)
    inputs, outputs = (
        tuple(replace(port, meaning=about(port.meaning), frame=about(port.frame)) for port in ports)
        for ports in (program.inputs, program.outputs)
    )
    return program.with_fields(name=function.name, summary=about(program.summary), inputs=inputs, outputs=outputs)


def combine(name: str, recording: FunctionBuilder, programs: Sequence[Program]) -> Program:
    """Record a program of the function ``name`` from ``programs`` of the functions that it is made ``of``."""
    recording.function = get_function(name)
    return order_inputs(_load(recording.function.combine)(recording, *programs))


def _load(reference: str) -> Any:
    """The object that "module:NAME" refers to; () for the empty text."""
    if not reference:
        return ()
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name)
