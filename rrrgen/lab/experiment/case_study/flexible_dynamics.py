"""Flexible dynamics in the case study, (14.34)-(14.42): frequency responses of joint 1 in several postures.

Modes are fitted to the responses, and their frequencies are compared with those computed from the mass matrix and the
stiffness of the virtual robot (Fig. 14.14).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.lab.experiment.experiment_file import Experiment
from rrrgen.lab.experiment.response import beside, expected_modes, response_design, response_plan, simulate_response
from rrrgen.lab.plant.recording_files import write_responses
from rrrgen.lab.response.estimation import estimate_responses
from rrrgen.lab.response.figures import plot_models
from rrrgen.lab.response.fitting import FittedModels, fit_responses
from rrrgen.lab.response.response_file import load_response
from rrrgen.robot.friction.models import FrictionModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[int, int, str], None]

LEAST_TRUSTED = 0.65  # least share of the spectral lines that must be trusted
LARGEST_DEVIATION = 0.005  # largest relative difference between a measured and the computed frequency
SEEN = 0.5  # computed modes with at least this peak, relative to the rigid response, must be found


@dataclass(frozen=True)
class FlexibleSettings:
    """The elastic parts of the virtual robot and the experiment on joint 1.

    ``postures`` are joint positions in rad, the chapter's (a) and (b) first; ``rotor_inertia`` (kg m^2), ``stiffness``
    (N m/rad) and ``damping`` (N m s/rad) are those of the joints; ``base`` is the frequency (Hz) and damping ratio of
    the base; ``disturbance`` is the RMS of a torque that is not recorded (N m); ``periods`` of the excitation are
    recorded.
    """

    postures: tuple[tuple[float, ...], ...] = ((0.0, 0.0, np.pi / 2), (0.0, 0.0, 0.0), (0.0, 0.0, 2.6))
    rotor_inertia: tuple[float, ...] = (0.8, 0.25, 0.06)
    stiffness: tuple[float, ...] = (1.45e5, 1.2e5, 4e4)
    damping: tuple[float, ...] = (14.0, 8.0, 3.0)
    base: tuple[float, float] = (28.0, 0.1)
    disturbance: float = 0.5
    periods: int = 10


@dataclass(frozen=True, eq=False)
class FlexibleDynamics:
    """Results of the study of flexible dynamics.

    ``fitted`` holds the responses and models of all postures; ``resonances`` has an entry for each computed mode, with
    the measured resonance that belongs to it.
    """

    settings: FlexibleSettings
    fitted: FittedModels
    resonances: list[dict[str, Any]]

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences that name the required accuracies which are missed; empty if there are none."""
        problems = [f"response of {name}: {reason}" for name, reason in self.fitted.refused.items()]
        for response in self.fitted.measured:
            share = float(np.mean(response.trusted))
            if share < LEAST_TRUSTED:
                problems.append(f"{response.name}: only {100 * share:.0f} % of the lines are trusted")
        for row in self.resonances:
            if row["computed"]["peak"] > SEEN and not row["deviation"] <= LARGEST_DEVIATION:
                limit, frequency = 100 * LARGEST_DEVIATION, row["computed"]["frequency"]
                problems.append(f"{row['posture']}: no resonance within {limit:g} % of {frequency:.2f} Hz")
        return tuple(problems)

    def figure(self) -> Figure:
        """Plot the responses of all postures with their confidence bands, and the models (Fig. 14.14)."""
        return plot_models(self.fitted.measured, self.fitted.models)

    def to_json(self) -> dict[str, Any]:
        """Plain data: the verdicts on the responses, and the measured with the computed resonances."""
        return {
            "postures": self.settings.postures,
            "trusted": {response.name: float(np.mean(response.trusted)) for response in self.fitted.measured},
            "resonances": self.resonances,
        }


def flexible_dynamics(
    model: Any,
    friction: FrictionModel,
    settings: FlexibleSettings,
    folder: Path,
    period: float,
    seed: int,
    tell: Progress,
) -> FlexibleDynamics:
    """Excite joint 1 of the virtual robot in every posture, estimate the responses, and fit their modes.

    Recordings and response file are written to ``folder``; those of an interrupted run are used again.
    """
    joints = {name: getattr(settings, name) for name in ("rotor_inertia", "stiffness", "damping")}
    frequency, damping_ratio = settings.base
    experiment = Experiment(
        virtual_robot={
            "friction": friction,
            "flexible_joints": joints,
            "flexible_base": {"frequency": frequency, "damping_ratio": damping_ratio},
            "disturbance": (settings.disturbance,) * model.n,
        },
        response={"joint": model.spec.joints[0].name, "postures": settings.postures, "periods": settings.periods},
        period=period,
        seed=seed,
    )
    log = folder / "response.yaml"
    if not log.exists():  # written last: with it, the recordings are complete
        design = response_design(experiment, model, response_plan(experiment))
        signals, controller = simulate_response(experiment, model, design, tell)
        write_responses(folder, design, signals, controller)
    tell(0, 0, "frequency responses")
    measured = [
        replace(response, name=_label(posture))
        for response, posture in zip(estimate_responses(load_response(log)), settings.postures, strict=True)
    ]
    fitted = fit_responses(measured)
    modes = expected_modes(experiment, model)
    computed = {response.name: of_posture for response, of_posture in zip(measured, modes, strict=True)}
    return FlexibleDynamics(settings, fitted, beside(fitted.models, computed))


def _label(posture: tuple[float, ...]) -> str:
    """The name of a posture as the chapter writes it: the positions of the joints that do not move."""
    standing = range(2, len(posture) + 1)
    return f"[{', '.join(f'q{k}' for k in standing)}] = [{', '.join(f'{posture[k - 1]:.3g}' for k in standing)}] rad"
