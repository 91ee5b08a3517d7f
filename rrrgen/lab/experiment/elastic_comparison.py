"""Compares measured resonances with those computed from mass matrix and stiffness of an experiment file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.lab.experiment.experiment_file import Experiment
from rrrgen.lab.experiment.response_experiment import response_plan
from rrrgen.lab.experiment.setup import plant_of
from rrrgen.lab.plant.elastic_modes import ElasticMode, elastic_modes
from rrrgen.lab.response.response_model import ResponseModel

FARTHEST = 0.2  # relative distance of two frequencies of one mode


def expected_modes(experiment: Experiment, model: Any, joint: str | None = None) -> list[list[ElasticMode]]:
    """Compute the vibration modes for each posture of the section ``response``, from M(q) and the elastic elements.

    ``model`` is the compiled robot, ``joint`` overrides the joint of the section. Raises :class:`InputError` where
    nothing is elastic or the section does not fit the robot.
    """
    plan, plant = response_plan(experiment, joint), plant_of(experiment, model)
    i = plan.joint_index(tuple(each.name for each in model.spec.joints))
    postures = plan.postures or ((0.0,) * model.n,)
    if any(len(posture) != model.n for posture in postures):
        raise InputError(f"postures of the section `response` need {model.n} joint positions")
    loops = [plan.bandwidth[1]] * model.n
    return [elastic_modes(plant.body.mass(np.array(q)), i, plant.joints, plant.base, loops) for q in postures]


def beside(models: Sequence[ResponseModel], computed: dict[str, list[ElasticMode]]) -> list[dict[str, Any]]:
    """Pair each computed mode with a measured resonance, for each posture of ``computed`` (name -> modes).

    Modes are paired in order of decreasing peak, each with the nearest resonance within 20 % of its frequency that is
    still free. ``deviation`` is the relative difference of the frequencies; without a partner it is infinite and
    ``measured`` is None.
    """
    rows = []
    for model in models:
        left = list(model.resonances)
        for mode in sorted(computed[model.name], key=lambda each: -each.peak):
            ratios = [abs(each.frequency / mode.frequency - 1.0) for each in left]
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
