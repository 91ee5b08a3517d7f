"""Response experiments on a virtual arm, and the truth."""

from __future__ import annotations

from functools import cache

import numpy as np

import rrrgen
from oracles.linear_loop import joint_response
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.response import response_design, response_plan, simulate_response
from rrrgen.lab.experiment.setup import plant_of, rigid_body_of
from rrrgen.lab.response.response_file import ResponseRecording

ARM = """
schema: rrrgen-experiment/1
period: 1 ms
seed: 3
virtual_robot:
  friction: {law: coulomb_viscous, joints: [{coulomb: 3, viscous: 1.1}, {viscous: 0.3}, {viscous: 0.2}]}
  flexible_joints: {rotor_inertia: [0.2, 0.1, 0.02], stiffness: [2e5, 6e4, 1e4], damping: [60, 20, 3]}
  flexible_base: {frequency: 28 Hz, damping_ratio: 0.1}
  delay: 1
"""
EXACT = "  encoder_resolution: 0\n"
NOISY = "  disturbance: [1, 0.5, 0.2]\n"


@cache
def arm():
    return rrrgen.compile("rrr")


def experiment(response: str, more: str = NOISY, control: str = ""):
    return loads_experiment(f"{ARM}{more}{control}response: {{joint: q1, {response}}}\n", 3)


def simulated(found, model=None):
    model = model or arm()
    design = response_design(found, model, response_plan(found))
    signals, controller = simulate_response(found, model, design)
    return design, signals, controller


def truth(found, design, frequency, run=0):
    """Of the arm at the start of a run, with the loops of the other joints closed."""
    plant = plant_of(found, arm())
    state = plant.initial_state(design.runs[run].start, design.reference(design.runs[run], np.zeros(1))[1][0])
    Ts = design.period
    loops = [(p + d / Ts, -d / Ts) for p, d in zip(design.kp, design.kd, strict=True)]
    mass = rigid_body_of(found, arm()).mass(np.array(design.runs[run].start))
    return joint_response(plant, state, mass, design.joint, loops, Ts, 1, frequency)


def record(signals, period=1e-3):
    rows = signals.settled_rows()
    return ResponseRecording(signals.run.name, period, *rows[:, 1:4].T)
