"""From an experiment file to what runs: the excitation problem, the writing path, the virtual robot's experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from rrrgen.errors import InputError
from rrrgen.identify.columns import Array
from rrrgen.identify.excitation_model import limits_of, robot_problem
from rrrgen.identify.excitation_problem import ExcitationProblem
from rrrgen.identify.experiment_file import Experiment
from rrrgen.identify.kalman import kalman_matrices
from rrrgen.identify.writing import JointPath, solver_inverse_kinematics, writing_task

DEFAULT_RESOLUTION = 1e-5
"""rad (m), where neither the experiment nor the robot file states one: the chapter's encoders."""

Motion = Callable[[Array], tuple[Array, Array, Array]]


def problem_of(experiment: Experiment, model: Any) -> ExcitationProblem:
    """The excitation problem that the file describes for a compiled robot."""
    limits = experiment.limits if experiment.limits is not None else limits_of(model.spec)
    return robot_problem(model, limits, sample_period=experiment.period, **experiment.excitation)


def writing_path(experiment: Experiment, model: Any, solver: Any) -> JointPath:
    """The joint motion of the writing task by a closed-form position ``solver`` of the robot."""
    start = experiment.branch if experiment.branch is not None else (0.0,) * model.n
    revolute = [joint.is_revolute for joint in model.spec.joints]
    task = writing_task(**experiment.writing)
    return JointPath(task, model, solver_inverse_kinematics(solver, start, revolute))


def simulate_motion(
    experiment: Experiment,
    model: Any,
    reference: Motion,
    duration: float,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[Any, Any]:
    """Run the virtual robot along ``reference(t) -> (q, dq, ddq)``; returns its recording and its instruments."""
    from rrrgen.simulate.experiment import Instruments, VirtualRobot
    from rrrgen.simulate.friction import Friction
    from rrrgen.simulate.plant import FlexibleBase, FlexibleJoints, make_plant

    if model.beta is None:
        raise InputError("the virtual robot needs masses and inertias: the robot file has no links")
    parts = dict(experiment.virtual_robot)
    friction = parts.get("friction")
    joints, base = parts.get("flexible_joints"), parts.get("flexible_base")
    plant = make_plant(
        model,
        friction=None if friction is None else Friction(friction),
        drive_inertia=parts.get("drive_inertia"),
        joints=None if joints is None else FlexibleJoints(**joints),
        base=None if base is None else FlexibleBase(**base),
    )
    names = {entry.name for entry in fields(Instruments)}
    instruments = Instruments(**{"torque_limit": _drives(model), **{k: v for k, v in parts.items() if k in names}})
    robot = VirtualRobot(plant, instruments, experiment.period)
    recording = robot.run(
        reference,
        duration,
        _controller(experiment, model),
        _observer(experiment, model, reference, duration),
        seed=experiment.seed,
        progress=progress,
    )
    return recording, instruments


def _drives(model: Any) -> tuple[float, ...] | None:
    """The torque limits of the robot file, where it states them for every joint."""
    limits = [joint.limits.torque for joint in model.spec.joints]
    return None if any(limit is None for limit in limits) else tuple(float(limit) for limit in limits)


def _controller(experiment: Experiment, model: Any) -> Any:
    from rrrgen.simulate.control import PD, ComputedTorque, pd_gains
    from rrrgen.simulate.plant import RigidBody

    control, n = experiment.control, model.n
    if control.kind == "computed_torque":
        omega = 2.0 * np.pi * control.bandwidth
        kp = control.kp if control.kp is not None else (omega**2,) * n
        kd = control.kd if control.kd is not None else (2.0 * control.damping * omega,) * n
        body = RigidBody(model, drive_inertia=experiment.virtual_robot.get("drive_inertia"))
        return ComputedTorque(body, kp, kd, friction=experiment.virtual_robot.get("friction"))
    if control.kp is not None and control.kd is not None:
        return PD(control.kp, control.kd)
    poses = np.random.default_rng(experiment.seed).uniform(-np.pi, np.pi, (1000, n))
    inertia = np.mean(np.diagonal(model.mass_matrix(poses), axis1=1, axis2=2), axis=0)
    added = experiment.virtual_robot.get("drive_inertia")
    return pd_gains(inertia + (0.0 if added is None else np.asarray(added)), control.bandwidth, control.damping)


def _observer(experiment: Experiment, model: Any, reference: Motion, duration: float) -> Any:
    """A Kalman filter by the chapter's rules: quantisation of the encoder, and the largest jerk squared."""
    from rrrgen.simulate.control import BackwardDifference, DeviationFilter

    period, control = experiment.period, experiment.control
    if control.observer == "difference":
        return BackwardDifference(period)
    jerk = control.jerk
    if jerk is None:
        t = np.arange(round(duration / period)) * period
        jerk = tuple(np.abs(np.diff(reference(t)[2], axis=0)).max(axis=0) / period)
    stated = experiment.virtual_robot.get("encoder_resolution")
    given = (
        stated
        if stated is not None
        else [joint.drive and joint.drive.encoder_resolution for joint in model.spec.joints]
    )
    matrices = [
        kalman_matrices(period, (float(step or DEFAULT_RESOLUTION)) ** 2 / 12.0, max(float(top), 1e-3) ** 2)
        for step, top in zip(given, jerk, strict=True)
    ]
    return DeviationFilter([m.E for m in matrices], [m.k for m in matrices])
