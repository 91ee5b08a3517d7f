"""The experiment for the frequency response of a joint, on the virtual robot under feedback linearisation.

Equations (14.34) and (14.36).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.kalman import KalmanMatrices, kalman_matrices, quantisation_variance
from rrrgen.lab.design.plan import ResponseDesign, ResponsePlan
from rrrgen.lab.design.response_design import design_response
from rrrgen.lab.experiment.experiment_file import Experiment
from rrrgen.lab.experiment.setup import (
    arm_of,
    friction_of,
    instruments_of,
    limited_spec,
    plant_of,
    resolutions_of,
    rigid_body_of,
)
from rrrgen.lab.plant.controllers import BackwardDifference, ComputedTorque, DeviationFilter, Observer, RecordedInput
from rrrgen.lab.plant.elastic_modes import ElasticMode, elastic_modes
from rrrgen.lab.plant.experiment import SimulatedRecording, VirtualRobot
from rrrgen.lab.plant.loop_margin import LoopMargin, SampledArm
from rrrgen.lab.plant.recording_files import LoopSignals
from rrrgen.lab.response.resonances import Resonating
from rrrgen.lab.response.response_model import ControllerTransferFunction

POSTURES = 8
"""Number of postures of a run in which the margin of its loop is computed: the other joints hardly move."""

Progress = Callable[[int, int, str], None]


def response_plan(experiment: Experiment, joint: str | None = None) -> ResponsePlan:
    """The plan of a response experiment, from the file's section ``response``; ``joint`` overrides its joint."""
    settings = dict(experiment.response)
    if joint is not None:
        settings["joint"] = joint
    if "joint" not in settings:
        raise InputError(
            "the section `response` of the experiment file names no joint: add `joint: NAME`, or name it in the command"
        )
    return ResponsePlan(**settings)


def response_design(experiment: Experiment, model: Any, plan: ResponsePlan) -> ResponseDesign:
    """Design the runs of ``plan`` for the robot ``model``, with sampling rate, seed and limits of the experiment."""
    spec = limited_spec(experiment, model.spec)
    return design_response(model, plan, 1.0 / experiment.period, experiment.seed, spec)


def simulate_response(
    experiment: Experiment, model: Any, design: ResponseDesign, progress: Progress | None = None
) -> tuple[list[LoopSignals], ControllerTransferFunction]:
    """Run every run of ``design`` on the virtual robot; returns its signals, and the sampled controller of the joint.

    The model torques are computed along the reference, with the friction of the virtual robot. Velocities are backward
    differences, or those of the Kalman filter if the control states ``jerk``. Raises :class:`InputError` if the design
    is for another robot or sampling period.
    """
    if model.beta is None:
        raise InputError("the virtual robot needs masses and inertias: the robot file has no links")
    if len(design.kp) != model.n or design.joint >= model.n:
        raise InputError(f"the response excitation is for {len(design.kp)} joints, the robot has {model.n}")
    if abs(design.period - experiment.period) > 1e-9 * design.period:
        raise InputError(
            f"the response excitation is sampled every {design.period:g} s, the experiment every "
            f"{experiment.period:g} s"
        )
    filters = _filters(experiment, model)
    signals = [recorded_run(experiment, model, design, k, filters, progress)[0] for k in range(len(design.runs))]
    i = design.joint
    return signals, sampled_controller(design.kp[i], design.kd[i], design.period, filters[i] if filters else None)


def response_margin(experiment: Experiment, model: Any, design: ResponseDesign) -> LoopMargin:
    """Stability margin of the loops in which ``design`` is run, the worst of all postures of its runs."""
    filters, margins = _filters(experiment, model), []
    for run in design.runs:
        arm = arm_of(experiment, model, partial(design.reference, run), len(run.n) * experiment.period)
        some = np.unique(np.linspace(0, len(arm.masses) - 1, POSTURES).round().astype(int))
        sampled = SampledArm.at(
            arm.masses[some],
            arm.plant.joints,
            arm.plant.base,
            experiment.period,
            delay=arm.delay,
            assumed=arm.moved[some],
            slowest=float(np.sqrt(min(design.kp))) / (2.0 * np.pi),
        )
        margins.append(sampled.margin(_observer(experiment, filters).feedback(design.kp, design.kd)))
    return min(margins, key=lambda margin: margin.modulus)


def _observer(experiment: Experiment, filters: list[KalmanMatrices] | None) -> Observer:
    if filters is None:
        return BackwardDifference(experiment.period)
    return DeviationFilter([m.E for m in filters], [m.k for m in filters])


def recorded_run(
    experiment: Experiment,
    model: Any,
    design: ResponseDesign,
    number: int,
    filters: list[KalmanMatrices] | None = None,
    progress: Progress | None = None,
) -> tuple[LoopSignals, SimulatedRecording]:
    """Simulate run number ``number`` of ``design``: (signals of the excited joint, recording of all joints)."""
    run = design.runs[number]
    robot = VirtualRobot(plant_of(experiment, model), instruments_of(experiment, model), experiment.period)
    law = ComputedTorque(
        rigid_body_of(experiment, model),
        design.kp,
        design.kd,
        friction=friction_of(experiment, model),
        along_reference=True,
    )
    controller = RecordedInput(law)
    excitation = np.zeros((len(run.n), model.n))
    excitation[:, design.joint] = run.n

    def tell(done: int, total: int, message: str) -> None:
        if progress is not None:
            progress(done, total, f"{run.name}: {message}")

    recording = robot.run(
        lambda t: design.reference(run, t),
        len(run.n) * experiment.period,
        controller,
        _observer(experiment, filters),
        seed=experiment.seed + number,
        excitation=excitation,
        progress=tell,
    )
    i = design.joint
    u = np.array(controller.inputs)[:, i]
    clipped = int(recording.saturated.sum())
    signals = LoopSignals(run, recording.t, run.n, u, recording.q[:, i], recording.reference[:, i], clipped)
    return signals, recording


def _filters(experiment: Experiment, model: Any) -> list[KalmanMatrices] | None:
    """The Kalman filters of the joints; None unless the control section states a jerk for their design.

    Without a stated jerk none can be derived, since the reference of a response experiment has no jerk.
    """
    control = experiment.control
    if control.observer != "kalman" or control.jerk is None:
        return None
    resolutions = resolutions_of(instruments_of(experiment, model), model.n)
    return [
        kalman_matrices(experiment.period, quantisation_variance(step), float(jerk) ** 2)
        for step, jerk in zip(resolutions, control.jerk, strict=True)
    ]


def sampled_controller(
    kp: float, kd: float, period: float, matrices: KalmanMatrices | None = None
) -> ControllerTransferFunction:
    """The controller C(z) of ``u = n - C (q - q_r)`` as implemented: PD with backward difference or Kalman filter.

    The filter ``matrices``, with transition matrix E and gain k, estimate ``x = (I - k c) E x z^-1 + k e`` from the
    deviation e, c = [1, 0, 0]; x holds the deviation and its derivatives, and ``u = n - [kp, kd, 0] x``.
    """
    if matrices is None:
        return ControllerTransferFunction((kp + kd / period, -kd / period))
    from scipy.signal import ss2tf

    A = (np.eye(3) - np.outer(matrices.k, [1.0, 0.0, 0.0])) @ matrices.E
    h: Array = np.array([[kp, kd, 0.0]])
    numerator, denominator = ss2tf(A, matrices.k[:, None], h @ A, h @ matrices.k[:, None])
    return ControllerTransferFunction(tuple(numerator[0].tolist()), tuple(denominator.tolist()))


# ------------------------------------------------------------------------------------------------------------------
# Compares measured resonances with those computed from mass matrix and stiffness of an experiment file.
# ------------------------------------------------------------------------------------------------------------------

FARTHEST = 0.2  # relative distance of two frequencies of one mode


def expected_modes(experiment: Experiment, model: Any, joint: str | None = None) -> list[list[ElasticMode]]:
    """Compute the vibration modes for each posture of the section ``response``, from M(q) and the elastic elements.

    ``model`` is the compiled robot, ``joint`` overrides the joint of the section. Raises :class:`InputError` where
    nothing is elastic or the section does not fit the robot.
    """
    plan, plant = response_plan(experiment, joint), plant_of(experiment, model)
    i = plan.joint_index(tuple(joint_spec.name for joint_spec in model.spec.joints))
    postures = plan.postures or ((0.0,) * model.n,)
    if any(len(posture) != model.n for posture in postures):
        raise InputError(f"postures of the section `response` need {model.n} joint positions")
    loops = [plan.bandwidth[1]] * model.n
    return [elastic_modes(plant.body.mass(np.array(q)), i, plant.joints, plant.base, loops) for q in postures]


def beside(models: Sequence[Resonating], computed: dict[str, list[ElasticMode]]) -> list[dict[str, Any]]:
    """Pair each computed mode with a measured resonance, for each posture of ``computed`` (name -> modes).

    Modes are paired in order of decreasing peak, each with the nearest resonance within 20 % of its frequency that is
    still free. ``deviation`` is the relative difference of the frequencies; without a partner it is infinite and
    ``measured`` is None.
    """
    rows = []
    for model in models:
        left = list(model.resonances)
        for mode in sorted(computed[model.name], key=lambda elastic_mode: -elastic_mode.peak):
            ratios = [abs(resonance.frequency / mode.frequency - 1.0) for resonance in left]
            k = int(np.argmin(ratios)) if ratios else -1
            known = k >= 0 and ratios[k] < FARTHEST
            rows.append(
                {
                    "posture": model.name,
                    "computed": vars(mode),
                    "measured": vars(left.pop(k)) if known else None,
                    "deviation": ratios[k] if known else np.inf,
                }
            )
    return rows
