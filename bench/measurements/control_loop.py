"""One tick of a whole loop in C: Kalman filter, momentum observer, computed torque with friction and limits."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from bench.measurements.control_tick import JERK, PERIOD, RESOLUTION, SAMPLES, TickTime
from bench.templates import render
from bench.toolchain import Toolchain, run
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.language import Dialect, sincos_strategy
from rrrgen.emit.c.robot_files import header_and_sources
from rrrgen.emit.controller.filters import kalman_program
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.program import Program, Role
from rrrgen.robot.identity import identify

WORK = "computed torque + friction + observer + Kalman filter"
GROUPS = ("control", "observer")
SEVEN_JOINTS = "panda"
FROM_ROW = frozenset({"q_d", "dq_d", "ddq_d"})
VALUES = {
    "kp": 400.0,
    "kd": 40.0,
    "ki": 100.0,
    "width": 0.05,
    "tau_max": 1e9,
    "friction": 0.3,
    "gain": 50.0,
    "Ts": PERIOD,
}


def loop_tick(derived: DerivedModel, toolchain: Toolchain, passes: int) -> TickTime:
    """The least time of ``passes`` over :data:`SAMPLES` samples, of a model with the groups :data:`GROUPS`."""
    name, n = derived.name, derived.spec.n
    law, observer = (derived.programs[function] for function in ("computed_torque", "momentum_observer"))
    matrices = kalman_matrices(PERIOD, RESOLUTION**2 / 12.0, JERK**2)
    step = kalman_program([matrices.E.tolist()] * n, [matrices.k.tolist()] * n, PERIOD).with_fields(name="step")
    sincos = sincos_strategy("inline")
    files = header_and_sources(derived, identify(derived.spec), Dialect(name, "double"), sincos)
    files |= function_files(f"{name}_kalman", "filter", [step], "double")
    ports = {port.name: port for program in (law, observer) for port in (*program.inputs, *program.data_outputs)}
    values = VALUES | {port.name: 0.1 for port in ports.values() if port.role is Role.BASE_PARAMETERS}
    main = render(
        "loop.c.j2",
        robot=name,
        n=str(n),
        arrays=[
            (port.name, str(port.size), repr(values.get(port.name, 0.0)))
            for port in ports.values()
            if port.shape and port.name not in FROM_ROW
        ],
        scalars=[(port.name, repr(values[port.name])) for port in ports.values() if not port.shape],
        law=_arguments(law),
        observer=_arguments(observer),
    )
    headers = {file: text for file, text in files.items() if file.endswith(".h")}
    a, b = np.random.default_rng(1).normal(size=(2, n, 5))
    motion = FourierTrajectory(np.zeros(n), a / 5, b / 5, 0.1)
    q, dq, ddq = motion.evaluate(PERIOD * np.arange(SAMPLES))
    rows = np.hstack([np.round(q / RESOLUTION) * RESOLUTION, q, dq, ddq])
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as folder:
        place = Path(folder)
        objects = [toolchain.object(file, text, headers) for file, text in files.items() if file.endswith(".c")]
        toolchain.link([*objects, toolchain.object("loop.c", main, headers)], place / "loop", False)
        (place / "samples").write_bytes(np.ascontiguousarray(rows, dtype=float).tobytes())
        (time,) = run([str(place / "loop"), str(place / "samples"), str(passes)]).splitlines()
    return TickTime(name, WORK, derived.b, float(time))


def _arguments(program: Program) -> str:
    """The arguments of the C call, variables of the names of the ports."""
    return ", ".join(port.name for port in (*program.inputs, *program.data_outputs))
