"""One tick of the controller in C: Kalman filter, friction, and an online estimator, along an exciting motion."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.templates import render
from bench.toolchain import Toolchain, run
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.controller.filters import kalman_program
from rrrgen.emit.controller.online_estimators import (
    KINDS,
    EstimatorSettings,
    chosen_gain,
    estimator_files,
    gain_bound,
    regression,
)
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.programs import friction_program

PERIOD = 1e-3
SAMPLES = 2000
JERK = 200.0
RESOLUTION = 1e-5


@dataclass(frozen=True)
class TickTime:
    """Nanoseconds per sample of the ``work`` of one robot with so many estimated ``parameters``."""

    robot: str
    work: str
    parameters: int
    nanoseconds: float


def control_ticks(derived: DerivedModel, toolchain: Toolchain, passes: int) -> list[TickTime]:
    """The least times of ``passes`` over :data:`SAMPLES` samples, parts added one by one."""
    name, n = derived.name, derived.spec.n
    setting = regression(derived)
    rng = np.random.default_rng(1)
    path = FourierTrajectory(np.zeros(n), rng.normal(size=(n, 5)), rng.normal(size=(n, 5)), 0.1)
    motion = path.evaluate(PERIOD * np.arange(SAMPLES))
    settings = EstimatorSettings(gain=chosen_gain(None, gain_bound(setting, *motion)))
    matrices = kalman_matrices(PERIOD, RESOLUTION**2 / 12.0, JERK**2)
    step = kalman_program([matrices.E.tolist()] * n, [matrices.k.tolist()] * n, PERIOD).with_fields(name="step")
    law = friction_program(LAWS["neural"], n).with_fields(name="neural")
    files = function_files(f"{name}_kalman", "filter", [step], "double")
    files |= function_files(f"{name}_friction", "friction", [law], "double")
    for kind in KINDS:
        files |= estimator_files(setting, kind, settings, "double")
    weights = rng.uniform(0.1, 2.0, size=n * len(LAWS["neural"].parameters)).tolist()
    main = render("tick.c.j2", robot=name, n=str(n), friction=", ".join(map(repr, weights)))
    headers = {file: text for file, text in files.items() if file.endswith(".h")}
    readings = np.round(motion[0] / RESOLUTION) * RESOLUTION
    rows = np.hstack([readings, *motion, rng.normal(size=(SAMPLES, n))])
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as folder:
        place = Path(folder)
        objects = [toolchain.object(file, text, headers) for file, text in files.items() if file.endswith(".c")]
        toolchain.link([*objects, toolchain.object("tick.c", main, headers)], place / "tick", False)
        (place / "samples").write_bytes(np.ascontiguousarray(rows, dtype=float).tobytes())
        lines = run([str(place / "tick"), str(place / "samples"), str(passes)]).splitlines()
    found = [line.split("\t") for line in lines]
    return [TickTime(name, work, len(setting.names), float(time)) for work, time in found]
