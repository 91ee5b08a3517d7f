"""Friction of joint 3 by experiment in the case study, (14.15) and Fig. 14.9: the other joints are locked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.lab.data.recordings import read_log
from rrrgen.lab.design.friction_motion import design_friction_motion
from rrrgen.lab.friction.estimation import FrictionEstimate, estimate_friction
from rrrgen.lab.friction.joint_recording import joint_data, recorded_joint
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[int, int, str], None]

LOCKED = 1e7  # kg m^2 added to a joint with its brake on
LIMITS = {"inertia": 0.01, "coulomb": 0.02, "viscous": 0.05, "stiction_excess": 0.1, "stribeck_speed": 0.1}
"""Largest relative error of each estimated parameter."""


@dataclass(frozen=True)
class JointFrictionSettings:
    """Settings of the friction experiment: joint (from 1), duration (s), laws to try (all if empty), true parameters.

    ``stiction_excess`` (N m) and ``stribeck_speed`` (rad/s) add a Stribeck curve to the friction of the case study.
    """

    joint: int = 3
    duration: float = 40.0
    laws: tuple[str, ...] = ()
    stiction_excess: float = 0.4
    stribeck_speed: float = 0.1


@dataclass(frozen=True, eq=False)
class JointFriction:
    """The result of the friction experiment: the ``estimate``, and the ``truth``.

    ``truth`` maps names of friction parameters to their values in the virtual robot.
    """

    estimate: FrictionEstimate
    truth: dict[str, float]

    @property
    def errors(self) -> dict[str, float]:
        """Relative error, by name, of each parameter of the true friction law that the chosen law has too."""
        values = self.estimate.chosen.values
        return {name: values[name] / actual - 1.0 for name, actual in self.truth.items() if name in values}

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences that name the required accuracies which are missed; empty if there are none."""
        problems = [
            f"{name} of the friction experiment is {100 * error:.1f} % off"
            for name, error in self.errors.items()
            if not abs(error) <= LIMITS[name]
        ]
        if self.estimate.chosen.name != "stribeck":
            problems.append(f"the friction law chosen is {self.estimate.chosen.name}, the virtual robot has stribeck")
        return tuple(problems)

    def to_json(self) -> dict[str, Any]:
        """Plain data: the estimates of all laws, the true parameters, and the errors of the chosen law."""
        return {**self.estimate.to_json(), "truth": self.truth, "errors": self.errors}

    def figure(self) -> Figure:
        """Plot torque and speed over time with the model, and friction over speed with the samples (Fig. 14.9)."""
        from rrrgen.lab.friction.report import plot_experiment

        return plot_experiment(self.estimate)


def joint_friction(
    model: Any,
    friction: FrictionModel,
    settings: JointFrictionSettings,
    torque_noise: tuple[float, ...],
    folder: Path,
    period: float,
    seed: int,
    tell: Progress,
) -> JointFriction:
    """Design the motion, run it on the virtual robot (once: the recording in ``folder`` is kept) and estimate.

    ``friction`` holds viscous and Coulomb coefficients of all joints, ``torque_noise`` (n,) N m, ``period`` in s.
    """
    from rrrgen.lab.plant.controllers import BackwardDifference, pd_gains
    from rrrgen.lab.plant.experiment import Instruments, VirtualRobot
    from rrrgen.lab.plant.friction import Friction
    from rrrgen.lab.plant.plant import make_plant
    from rrrgen.lab.plant.recording_files import write_recording

    spec, i = model.spec, settings.joint - 1
    motion = design_friction_motion(spec, spec.joints[i].name, settings.duration, seed)
    viscous, coulomb = friction.parameters[:, 0], friction.parameters[:, 1]
    excess, speed = (np.full(model.n, v) for v in (settings.stiction_excess, settings.stribeck_speed))
    truth = FrictionModel(LAWS["stribeck"], np.column_stack([excess, coulomb, viscous, speed]))
    inertia = np.diag(model.mass_matrix(np.array(motion.centre)))
    mapping = folder / "friction_log.yaml"
    if not mapping.exists():
        locked = [0.0 if k == i else LOCKED for k in range(model.n)]
        resolution = tuple(float(joint.drive.encoder_resolution) for joint in spec.joints)
        plant = make_plant(model, friction=Friction(truth), drive_inertia=locked)
        robot = VirtualRobot(plant, Instruments(resolution, torque_noise=torque_noise), period)
        recording = robot.run(
            motion.evaluate,
            motion.period,
            pd_gains(inertia, 6.0),
            BackwardDifference(period),
            seed=seed,
            progress=lambda done, total, message: tell(done, total, f"friction: {message}"),
        )
        write_recording(folder, "friction_log", recording, joints=[joint.name for joint in spec.joints])
    log = read_log(mapping)
    joint = recorded_joint(spec, log, spec.joints[i].name)
    data = joint_data(log, joint.name, joint.resolution)
    estimate = estimate_friction(data, joint.gravity, settings.laws, seed, tell)
    actual = {"inertia": inertia[i], "coulomb": coulomb[i], "viscous": viscous[i]}
    actual |= {"stiction_excess": settings.stiction_excess, "stribeck_speed": settings.stribeck_speed}
    return JointFriction(estimate, {name: float(value) for name, value in actual.items()})
