"""Time-optimal timing of a path of 1000 points in C, without and with viscous friction."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.templates import render
from bench.toolchain import Toolchain, run
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.c.path_timing import further_inputs, timing_files
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.program import evaluate

POINTS = 1000


@dataclass(frozen=True)
class PathTime:
    """Microseconds for a path of one robot with so many ``joints``, and the ``duration`` (s) that was found."""

    robot: str
    joints: int
    friction: str
    duration: float
    microseconds: float


def path_timings(derived: DerivedModel, timing: DerivedModel, toolchain: Toolchain, passes: int) -> list[PathTime]:
    """The least times of ``passes`` calls; ``timing`` has the path dynamics of the robot ``derived``.

    Torques are limited to those of the heaviest posture and half of what the largest acceleration takes.
    """
    name, n = derived.name, derived.spec.n
    dynamics, friction = timing.programs["path_dynamics"], derived.programs["friction_with"]
    files = function_files(name, "dynamics along a path, friction", [dynamics, friction], "double")
    files |= timing_files(dynamics, Dialect(name, "double"))
    further = {port.name: np.array([float(v) for v in derived.nominal[port.role]]) for port in further_inputs(dynamics)}
    rng = np.random.default_rng(1)
    series = FourierTrajectory(np.zeros(n), 0.3 * rng.normal(size=(n, 3)), 0.3 * rng.normal(size=(n, 3)), 1.0)
    s = np.linspace(0.0, 1.0, POINTS)
    q, q_s, q_ss = series.evaluate(s)
    rows = [evaluate(dynamics, q[k], q_s[k], q_ss[k], *further.values()) for k in range(0, POINTS, 20)]
    a, _, g = (np.max(np.abs(np.array(part)), axis=0) for part in zip(*rows, strict=True))
    limits = 1.2 * g + 0.5 * a * 15.0 / np.max(np.abs(q_s)) + 1e-3
    count = len(friction_parameters(derived.spec))
    parameters = [0.02 * limits[min(k // 3, n - 1)] if k % 3 < 2 else 0.0 for k in range(count)]
    starts = np.cumsum([0, *(value.size for value in further.values())])[:-1]
    main = render(
        "path.c.j2",
        robot=name,
        n=str(n),
        points=str(POINTS),
        friction=str(len(parameters)),
        further=str(sum(value.size for value in further.values())),
        arguments="".join(f"further + {start}, " for start in starts),
    )
    data = np.concatenate([s, q.ravel(), q_s.ravel(), q_ss.ravel(), limits, parameters, *further.values()])
    headers = {file: text for file, text in files.items() if file.endswith(".h")}
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as folder:
        place = Path(folder)
        objects = [toolchain.object(file, text, headers) for file, text in files.items() if file.endswith(".c")]
        toolchain.link([*objects, toolchain.object("path.c", main, headers)], place / "path", False)
        (place / "samples").write_bytes(np.ascontiguousarray(data, dtype=float).tobytes())
        lines = run([str(place / "path"), str(place / "samples"), str(passes)]).splitlines()
    found = []
    for line, words in zip(lines, ("none", "viscous and Coulomb"), strict=True):
        status, duration, microseconds = line.split("\t")
        if status != "0":
            raise RuntimeError(f"{name}: the path cannot be timed, status {status}")
        found.append(PathTime(name, n, words, float(duration), float(microseconds)))
    return found
