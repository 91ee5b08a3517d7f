"""Sets up what an experiment file describes: excitation problem, writing path, and simulation of the virtual robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.design.problem import ExcitationLimits, ExcitationProblem
from rrrgen.lab.design.robot import limits_of, robot_problem
from rrrgen.lab.experiment.experiment_file import FROM_ROBOT, Experiment
from rrrgen.lab.experiment.loop_design import POSTURES, ControlledArm, LoopDesign, design_loop
from rrrgen.lab.experiment.writing_task import (
    JointPath,
    newton_inverse_kinematics,
    solver_inverse_kinematics,
    writing_task,
)
from rrrgen.robot.friction.models import motor_friction, robot_friction
from rrrgen.robot.model.drives import stated_at_joints

if TYPE_CHECKING:
    from rrrgen.lab.plant.experiment import Instruments
    from rrrgen.lab.plant.plant import Plant, RigidBody
    from rrrgen.robot.spec import RobotSpec

DEFAULT_RESOLUTION = 1e-5
"""Encoder resolution, rad (m), if neither file states one: that of the encoders in the case study of the RRR arm."""

BASE_TO_ARM = 10.0
"""Default inertia of a flexible base, over that of the arm about joint 1 in its zero pose."""

LARGEST_POSITION_TASK = 3
"""Largest number of joints for which the closed-form inverse kinematics takes tip positions instead of poses."""

Motion = Callable[[Array], tuple[Array, Array, Array]]


def problem_of(experiment: Experiment, model: Any) -> ExcitationProblem:
    """The excitation problem of an experiment file for a compiled robot; limits default to those of the robot file.

    A file with limits of its own leaves positions, speeds and accelerations that it does not state to the robot file;
    the torques of the drives then do not bound the motion. Neither do they for a robot file without links, which does
    not say which torques a motion takes.
    """
    of_robot = limits_of(model.spec, torque=model.beta is not None and experiment.limits is None)
    limits = experiment.limits or ExcitationLimits()
    missing = {
        limit.name: getattr(of_robot, limit.name) for limit in fields(limits) if getattr(limits, limit.name) is None
    }
    return robot_problem(model, replace(limits, **missing), sample_period=experiment.period, **experiment.excitation)


LIMITED = {"velocity": "speed", "acceleration": "acceleration", "torque": "torque"}
"""Largest magnitudes among the limits of a joint, with their names among those of an excitation."""


def limited_spec(experiment: Experiment, spec: RobotSpec) -> RobotSpec:
    """The robot ``spec`` with the tighter of its limits and those that the experiment states for its excitation.

    For motions of single joints, whose design takes the limits of the robot. Raises InputError for limits that leave no
    range, and for a box of the tip, which these designs do not keep.
    """
    limits = experiment.limits
    if limits is None:
        return spec
    if limits.box_lower is not None or limits.box_upper is not None:
        raise InputError(
            "the motion of a single joint, for friction or a frequency response, keeps to no box of the tip: state its "
            "range by 'lower' and 'upper' among the limits of the excitation"
        )
    joints = []
    for i, joint in enumerate(spec.joints):
        of_robot = joint.limits
        lower = _tighter(max, of_robot.lower, limits.position_lower, i)
        upper = _tighter(min, of_robot.upper, limits.position_upper, i)
        if lower is not None and upper is not None and lower >= upper:
            raise InputError(f"the limits of the excitation leave joint {joint.name} no range within the robot file's")
        sizes = {name: _tighter(min, getattr(of_robot, name), getattr(limits, key), i) for name, key in LIMITED.items()}
        joints.append(replace(joint, limits=replace(of_robot, lower=lower, upper=upper, **sizes)))
    return replace(spec, joints=tuple(joints))


def _tighter(
    choose: Callable[[list[float]], float], of_robot: Any, row: Sequence[float | None] | None, i: int
) -> float | None:
    """The limit of joint ``i`` that ``choose`` prefers, of that of the robot file and that in ``row``; None without."""
    stated = [float(value) for value in (of_robot, None if row is None else row[i]) if value is not None]
    return choose(stated) if stated else None


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
    loop: LoopDesign | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[Any, Any]:
    """Run the virtual robot along ``reference(t) -> (q, dq, ddq)`` for ``duration`` s: (recording, instruments).

    Links, drive inertia, friction, encoders and torque limits are those of the robot file unless the experiment states
    others. Friction and torque limits of coupled motors remain in effect in addition to those that the experiment
    states for joints. Rotors of flexible joints replace the drive inertia of the robot file. ``loop`` is the control
    loop, designed for :func:`arm_of` if None. Raises InputError if the robot file has no links.
    """
    from rrrgen.lab.plant.experiment import VirtualRobot

    arm = arm_of(experiment, model, reference, duration)
    if loop is None:
        loop = design_loop(arm, experiment.control)
    instruments = instruments_of(experiment, model)
    robot = VirtualRobot(arm.plant, instruments, experiment.period)
    recording = robot.run(
        reference,
        duration,
        loop.controller,
        loop.observer,
        seed=experiment.seed,
        feedforward=loop.feedforward,
        progress=progress,
    )
    return recording, instruments


def arm_of(experiment: Experiment, model: Any, reference: Motion, duration: float) -> ControlledArm:
    """The arm along ``reference(t) -> (q, dq, ddq)`` for ``duration`` s, as the design of its control loop needs it.

    Raises InputError if the robot file has no links.
    """
    from rrrgen.lab.plant.plant import without_drives

    if model.beta is None:
        raise InputError("the virtual robot needs masses and inertias: the robot file has no links")
    plant, instruments = plant_of(experiment, model), instruments_of(experiment, model)
    masses = np.asarray(model.mass_matrix(reference(np.linspace(0.0, duration, POSTURES))[0]))
    drives = without_drives(model)
    if plant.joints is not None and drives is not None:
        masses = masses + np.diag(drives)
    q, ddq, torques, friction, rubbing = _torques(experiment, model, reference, duration)
    return ControlledArm(
        plant,
        rigid_body_of(experiment, model),
        friction,
        masses,
        duration,
        torques,
        rubbing,
        (np.abs(torques) + np.abs(rubbing)).max(axis=0),
        np.abs(np.diff(ddq, axis=0)).max(axis=0) / experiment.period,
        np.ptp(q, axis=0),
        np.array([not joint.is_revolute for joint in model.spec.joints]),
        resolutions_of(instruments, model.n),
        any(step > 0.0 for step in instruments.encoder_resolution or ()),
        experiment.period,
        instruments.delay,
    )


def plant_of(experiment: Experiment, model: Any) -> Plant:
    """The plant of the virtual robot: rigid body, friction, flexible joints and base."""
    from rrrgen.lab.plant.friction import Friction
    from rrrgen.lab.plant.plant import FlexibleBase, FlexibleJoints, make_plant

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
    flexible_joints: dict[str, Any] = {}
    keys = (("rotor_inertia", "inertia", None), ("stiffness", "stiffness", None), ("damping", "damping", 0.0))
    for name, key, missing in keys:
        values, absent = stated_at_joints(model.spec, key, missing)
        if absent:
            raise InputError(
                f"flexible_joints: {FROM_ROBOT} needs '{key}' under 'drive' of every joint of the robot file; it is "
                f"missing for {', '.join(absent)}"
            )
        flexible_joints[name] = tuple(values)
    return flexible_joints


def friction_of(experiment: Experiment, model: Any) -> Any:
    """Joint friction from the experiment, or else the robot file, together with that of coupled motors."""
    from rrrgen.lab.plant.friction import MotorFriction

    joints = experiment.virtual_robot.get("friction") or robot_friction(model.spec)
    motors = motor_friction(model.spec)
    if motors is None:
        return joints
    return MotorFriction(joints, motors, np.array(model.spec.drives.motor_from_joint, dtype=float))


def instruments_of(experiment: Experiment, model: Any) -> Instruments:
    """Encoders and drives as the experiment states them; what it leaves out is taken from the robot file."""
    from rrrgen.lab.plant.experiment import Instruments, MotorLimits

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
    from rrrgen.lab.plant.plant import RigidBody, without_drives

    flexible = flexible_joints_of(experiment, model)
    if flexible is None:
        return RigidBody(model)
    drives = without_drives(model)
    rotors = np.asarray(flexible["rotor_inertia"], dtype=float)
    return RigidBody(model, drive_inertia=rotors + (0.0 if drives is None else drives))


def _torques(
    experiment: Experiment, model: Any, reference: Motion, duration: float
) -> tuple[Array, Array, Array, Any, Array]:
    """Along a motion at the rate of the controller: q, ddq, torques without friction, the friction, its torques."""
    q, dq, ddq = reference(np.arange(max(2, round(duration / experiment.period))) * experiment.period)
    torques, friction = np.asarray(model.inverse_dynamics(q, dq, ddq)), friction_of(experiment, model)
    rubbing = np.zeros_like(torques) if friction is None else np.asarray(friction.torque(dq, load=torques))
    return q, ddq, torques, friction, rubbing


def overloads(experiment: Experiment, model: Any, reference: Motion, duration: float) -> list[str]:
    """Sentences about joints whose drives are too weak for the motion, by the torques of the robot file and friction.

    Empty where the robot file has no links or no torque limits.
    """
    limits = instruments_of(experiment, model).torque_limit
    if model.beta is None or limits is None:
        return []
    _, _, torques, _, rubbing = _torques(experiment, model, reference, duration)
    joints = zip(model.spec.joints, np.abs(torques + rubbing).max(axis=0), limits, strict=True)
    return [
        f"{joint.name} takes up to {taken:.3g} {unit}, its drive gives {limit:.3g} {unit}: state `torque` among the "
        "limits of the excitation in an experiment file, and the search keeps to it"
        for joint, taken, limit in joints
        for unit in ["N m" if joint.is_revolute else "N"]
        if taken > limit
    ]


def _drives(model: Any) -> tuple[float, ...] | None:
    """The torque limits (n,) of the robot file; None unless it states them for every joint."""
    limits = [joint.limits.torque for joint in model.spec.joints]
    return None if any(limit is None for limit in limits) else tuple(float(limit) for limit in limits)
