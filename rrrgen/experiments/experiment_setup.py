"""Sets up what an experiment file describes: excitation problem, writing path, and simulation of the virtual robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import InputError
from rrrgen.excitation.problem import ExcitationProblem
from rrrgen.excitation.robot import limits_of, robot_problem
from rrrgen.experiments.experiment_file import Experiment
from rrrgen.experiments.experiment_keys import FROM_ROBOT
from rrrgen.experiments.writing import JointPath, newton_inverse_kinematics, solver_inverse_kinematics, writing_task
from rrrgen.friction.stated import motor_friction, robot_friction
from rrrgen.model.drive_terms import stated_at_joints
from rrrgen.signals.kalman import kalman_matrices
from rrrgen.signals.smoother import quantisation_variance

if TYPE_CHECKING:
    from rrrgen.simulate.experiment import Instruments
    from rrrgen.simulate.plant import Plant, RigidBody

DEFAULT_RESOLUTION = 1e-5
"""Encoder resolution, rad (m), if neither file states one: that of the encoders in the case study of the RRR arm."""

BASE_TO_ARM = 10.0
"""Default inertia of a flexible base, over that of the arm about joint 1 in its zero pose."""

LARGEST_POSITION_TASK = 3
"""Largest number of joints for which the closed-form inverse kinematics takes tip positions instead of poses."""

POSES = 200
"""Number of poses along the motion for which gains are chosen and their stability is tested."""

LARGEST_DAMPING = 1.0
"""Bound on the eigenvalues of ``M^-1 Kd`` times the sampling period: the held torque overshoots above 1, diverges above
2.
"""

OBSERVER_SPEED = 8.0
"""Least ratio of the poles of a Kalman observer to the natural frequency of its loop: its lag costs little phase."""

Motion = Callable[[Array], tuple[Array, Array, Array]]


def problem_of(experiment: Experiment, model: Any) -> ExcitationProblem:
    """The excitation problem of an experiment file for a compiled robot; limits default to those of the robot file."""
    limits = experiment.limits if experiment.limits is not None else limits_of(model.spec)
    return robot_problem(model, limits, sample_period=experiment.period, **experiment.excitation)


def writing_path(experiment: Experiment, model: Any) -> JointPath:
    """Joint motion of the writing task.

    The inverse kinematics is in closed form for up to three joints, by Newton's method for more.
    """
    from rrrgen.ik.classify import plan
    from rrrgen.runtime.inverse_kinematics import load_solver

    start = experiment.branch if experiment.branch is not None else (0.0,) * model.n
    task = writing_task(**experiment.writing)
    if model.n > LARGEST_POSITION_TASK or plan(model.spec).task == "pose":  # the closed form asks for whole poses
        return JointPath(task, model, newton_inverse_kinematics(model, start))
    revolute = [joint.is_revolute for joint in model.spec.joints]
    return JointPath(task, model, solver_inverse_kinematics(load_solver(model.spec), start, revolute))


def simulate_motion(
    experiment: Experiment,
    model: Any,
    reference: Motion,
    duration: float,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[Any, Any]:
    """Run the virtual robot along ``reference(t) -> (q, dq, ddq)`` for ``duration`` s: (recording, instruments).

    Links, drive inertia, friction, encoders and torque limits are those of the robot file unless the experiment states
    others. Friction and torque limits of coupled motors remain in effect in addition to those that the experiment
    states for joints. Rotors of flexible joints replace the drive inertia of the robot file. Raises InputError if the
    robot file has no links or the control is unstable at the sampling rate.
    """
    from rrrgen.simulate.experiment import VirtualRobot

    if model.beta is None:
        raise InputError("the virtual robot needs masses and inertias: the robot file has no links")
    instruments = instruments_of(experiment, model)
    robot = VirtualRobot(plant_of(experiment, model), instruments, experiment.period)
    controller, speeds = _controller(experiment, model, reference, duration)
    recording = robot.run(
        reference,
        duration,
        controller,
        _observer(experiment, speeds, instruments, reference, duration),
        seed=experiment.seed,
        progress=progress,
    )
    return recording, instruments


def plant_of(experiment: Experiment, model: Any) -> Plant:
    """The plant of the virtual robot: rigid body, friction, flexible joints and base."""
    from rrrgen.simulate.friction import Friction
    from rrrgen.simulate.plant import FlexibleBase, FlexibleJoints, make_plant

    parts = experiment.virtual_robot
    friction = friction_of(experiment, model)
    joints, base = flexible_joints_of(experiment, model), parts.get("flexible_base")
    if base is not None and "inertia" not in base:
        base = {**base, "inertia": BASE_TO_ARM * float(model.mass_matrix(np.zeros(model.n))[0, 0])}
    return make_plant(
        model,
        friction=None if friction is None else Friction(friction),
        joints=None if joints is None else FlexibleJoints(**joints),
        base=None if base is None else FlexibleBase(**base),
    )


def flexible_joints_of(experiment: Experiment, model: Any) -> dict[str, Any] | None:
    """Rotor inertia, stiffness and damping (n,) of flexible joints, by the experiment or the robot file; None if rigid.

    Raises InputError for values that the experiment takes from the robot file and the robot file does not state.
    """
    stated = experiment.virtual_robot.get("flexible_joints")
    if stated != FROM_ROBOT:
        return None if stated is None else dict(stated)
    found: dict[str, Any] = {}
    keys = (("rotor_inertia", "inertia", None), ("stiffness", "stiffness", None), ("damping", "damping", 0.0))
    for name, key, missing in keys:
        values, absent = stated_at_joints(model.spec, key, missing)
        if absent:
            raise InputError(
                f"flexible_joints: {FROM_ROBOT} needs '{key}' under 'drive' of every joint of the robot file; it is "
                f"missing for {', '.join(absent)}"
            )
        found[name] = tuple(values)
    return found


def friction_of(experiment: Experiment, model: Any) -> Any:
    """Joint friction from the experiment, or else the robot file, together with that of coupled motors."""
    from rrrgen.simulate.friction import MotorFriction

    joints = experiment.virtual_robot.get("friction") or robot_friction(model.spec)
    motors = motor_friction(model.spec)
    if motors is None:
        return joints
    return MotorFriction(joints, motors, np.array(model.spec.drives.motor_from_joint, dtype=float))


def instruments_of(experiment: Experiment, model: Any) -> Instruments:
    """Encoders and drives as the experiment states them; what it leaves out is taken from the robot file."""
    from rrrgen.simulate.experiment import Instruments, MotorLimits

    names = {entry.name for entry in fields(Instruments)}
    steps = [joint.drive and joint.drive.encoder_resolution for joint in model.spec.joints]
    stated: dict[str, Any] = {"torque_limit": _drives(model)}
    drives = model.spec.drives
    limits = [] if drives is None else [motor.torque_limit for motor in drives.motors]
    if any(limit is not None for limit in limits):
        largest = np.array([np.inf if limit is None else limit for limit in limits])
        stated["motors"] = MotorLimits(largest, np.array(drives.motor_from_joint, dtype=float))
    if any(steps):
        stated["encoder_resolution"] = tuple(float(step or 0.0) for step in steps)
    return Instruments(**{**stated, **{k: v for k, v in experiment.virtual_robot.items() if k in names}})


def resolutions_of(instruments: Instruments, joints: int) -> tuple[float, ...]:
    """The encoder resolution of every joint, rad (m); :data:`DEFAULT_RESOLUTION` where none is stated."""
    return tuple(step or DEFAULT_RESOLUTION for step in instruments.encoder_resolution or (0.0,) * joints)


def rigid_body_of(experiment: Experiment, model: Any) -> RigidBody:
    """The robot model of a controller that assumes rigid joints: rotors of flexible joints count as drive inertia."""
    from rrrgen.simulate.plant import RigidBody, without_drives

    flexible = flexible_joints_of(experiment, model)
    if flexible is None:
        return RigidBody(model)
    drives = without_drives(model)
    rotors = np.asarray(flexible["rotor_inertia"], dtype=float)
    return RigidBody(model, drive_inertia=rotors + (0.0 if drives is None else drives))


def _drives(model: Any) -> tuple[float, ...] | None:
    """The torque limits (n,) of the robot file; None unless it states them for every joint."""
    limits = [joint.limits.torque for joint in model.spec.joints]
    return None if any(limit is None for limit in limits) else tuple(float(limit) for limit in limits)


def _controller(experiment: Experiment, model: Any, reference: Motion, duration: float) -> tuple[Any, Array]:
    """Make the controller of the control section; also returns the natural frequencies of its loops (n,), rad/s."""
    from rrrgen.simulate.control import PD, ComputedTorque, pd_gains

    control, n = experiment.control, model.n
    if control.kind == "computed_torque":
        omega = 2.0 * np.pi * control.bandwidth
        kp = control.kp if control.kp is not None else (omega**2,) * n
        kd = control.kd if control.kd is not None else (2.0 * control.damping * omega,) * n
        friction = friction_of(experiment, model)
        return ComputedTorque(rigid_body_of(experiment, model), kp, kd, friction=friction), np.sqrt(kp)
    poses = reference(np.linspace(0.0, duration, POSES))[0]
    whole, felt = _moved(experiment, model, np.asarray(model.mass_matrix(poses)))
    inertia = np.mean(np.diagonal(whole, axis1=1, axis2=2), axis=0)
    if control.kp is not None and control.kd is not None:
        gains = PD(control.kp, control.kd)
    else:
        gains = pd_gains(inertia, control.bandwidth, control.damping)
    fastest = float(np.max(np.linalg.eigvals(np.linalg.solve(felt, np.diag(gains.kd)[None])).real))
    if fastest * experiment.period > LARGEST_DAMPING:
        raise InputError(
            f"PD control at {1.0 / experiment.period:g} Hz is not stable along this motion: in its lightest direction "
            f"the arm is damped {fastest:.3g} times a second, at most {LARGEST_DAMPING / experiment.period:g} will do. "
            "Use computed torque, a lower bandwidth or a higher rate"
        )
    return gains, np.sqrt(gains.kp / inertia)


def _moved(experiment: Experiment, model: Any, M: Array) -> tuple[Array, Array]:
    """Mass matrices (m, n, n) that the drives accelerate: at low frequencies, and within one controller sample.

    ``M`` are those of the rigid robot at m poses. The two differ for flexible joints: within a sample only the rotors
    respond, at low frequencies also the links.
    """
    from rrrgen.simulate.plant import without_drives

    flexible = flexible_joints_of(experiment, model)
    if flexible is None:
        return M, M
    rotors = np.asarray(flexible["rotor_inertia"], dtype=float)
    drives = without_drives(model)
    return M + np.diag(rotors + (0.0 if drives is None else drives)), np.broadcast_to(np.diag(rotors), M.shape)


def _observer(experiment: Experiment, speeds: Array, instruments: Any, reference: Motion, duration: float) -> Any:
    """Make the observer of the control section; ``speeds`` (n,) are the natural frequencies of the loops, rad/s.

    A Kalman filter is designed with the variances of the encoder quantisation and of the largest jerk. At a joint that
    is to stand still that jerk is zero, but the motion of the others shakes it: the filter is at least so fast that its
    lag does not make the loop unstable.
    """
    from rrrgen.simulate.control import BackwardDifference, DeviationFilter

    period, control = experiment.period, experiment.control
    if control.observer == "difference":
        return BackwardDifference(period)
    jerk, resolutions = control.jerk, resolutions_of(instruments, len(speeds))
    if jerk is None:
        t = np.arange(round(duration / period)) * period
        jerk = tuple(np.abs(np.diff(reference(t)[2], axis=0)).max(axis=0) / period)
        # readings of variance R and a jerk of variance Q give a filter of third order with its poles at (Q/R)^(1/6)
        least = [quantisation_variance(step) ** 0.5 for step in resolutions] * (OBSERVER_SPEED * speeds) ** 3
        jerk = tuple(np.maximum(jerk, least).tolist())
    matrices = [
        kalman_matrices(period, quantisation_variance(step), max(float(top), 1e-3) ** 2)
        for step, top in zip(resolutions, jerk, strict=True)
    ]
    return DeviationFilter([m.E for m in matrices], [m.k for m in matrices])
