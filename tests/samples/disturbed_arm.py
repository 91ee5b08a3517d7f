"""A pendulum under PD control, pushed by random torques that are not recorded: recordings with known truth and noise.

The loop is simulated by the package, so that nothing but noise separates estimate and truth: what is judged with these
recordings are the standard deviations.
"""

from __future__ import annotations

import numpy as np

import rrrgen
from rrrgen.lab.closed_loop.controller import LoopController, loads_controller
from rrrgen.lab.closed_loop.loop import CompiledLoop
from rrrgen.lab.closed_loop.loop_recording import LoopRecording
from rrrgen.lab.closed_loop.validation import stated_equations
from rrrgen.lab.data.recordings import Log
from rrrgen.robot.file import loads_spec

PERIOD, DISTURBANCE = 1e-3, 0.5  # s; N m, another one every period
ROBOT = """schema: rrrgen/1
name: pendulum
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0.4, d: 0, friction: FRICTION}
links:
  - {mass: 3, com: [-0.2, 0.02, 0], inertia: {about: com, xx: 0.01, yy: 0.04, zz: 0.05}}
"""
FRICTION = {
    "linear": "{viscous: 0.8, coulomb: 1.5}",
    "exponential": "{law: exponential, viscous: 0.8, coulomb: 1.2, excess: 0.9, decay_speed: 0.15}",
}
OMEGA = 2.0 * np.pi * 5.0
CONTROLLER = f"""schema: rrrgen-controller/1
rate: 1 kHz
joints:
  - name: a
    signals:
      speed: {{difference: position}}
      pd: {{sum: {{reference: {0.25 * OMEGA**2}, position: {-0.25 * OMEGA**2}, speed: {-0.5 * OMEGA}}}}}
      pushed: {{sum: {{pd: 1, feedforward: 1}}}}
    torque: pd
    acts: ACTS
"""


class DisturbedArm:
    """The pendulum with one of the laws of FRICTION; ``controller`` is the one that its recordings are fitted with."""

    def __init__(self, law: str) -> None:
        self.model = rrrgen.compile(loads_spec(ROBOT.replace("FRICTION", FRICTION[law])))
        equations, self.theta = stated_equations(self.model)
        self.names = equations.names
        self._loop = CompiledLoop(equations, loads_controller(CONTROLLER.replace("ACTS", "pushed")))
        self.controller: LoopController = loads_controller(CONTROLLER.replace("ACTS", "pd"))

    def record(self, seed: int, seconds: float) -> Log:
        """A recording along the same reference, with other disturbances for every ``seed``."""
        count = round(seconds / PERIOD)
        t, rng = PERIOD * np.arange(count), np.random.default_rng(seed)
        shapes = [(0.5, 0.31), (0.3, 0.83), (0.15, 1.37)]
        reference = sum(size * np.sin(2 * np.pi * f * t) for size, f in shapes)[:, None]
        pushes = rng.normal(scale=DISTURBANCE, size=(count, 1))
        nothing = np.zeros_like(reference)
        speed = sum(2 * np.pi * f * size for size, f in shapes)
        loop = LoopRecording(
            **{"t": t, "q": reference, "tau": nothing, "valid": nothing == 0.0, "reference": reference},
            **{"reference_velocity": nothing, "feedforward": pushes, "period": PERIOD, "every": 1, "stride": 1},
            **{"delay": 0.0, "records": "applied", "warm": 1, "start": np.array([0.0, speed]), "span": (0.0, seconds)},
        )
        run = self._loop.run(self.theta, loop)
        return Log(("a",), t, run.q, run.tau, period=PERIOD, reference=reference)
