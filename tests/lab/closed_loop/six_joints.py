"""Closed-loop output error of an arm of six joints: a Puma 560 with drives and friction, recorded on the virtual robot.

    python tests/lab/closed_loop/six_joints.py --seconds 6

The recording has PD control with a delay, encoders of 1e-4 rad and torque noise. 52 parameters are fitted, as
`rrrgen identify --controller` does. Prints the torque error of the simulated loop before and after the fit, beside that
of the true parameters ("floor"), and the share of the parameters whose 95 % interval holds the truth. Exits with 1 if
the error after the fit exceeds the floor by more than a tenth, or fewer than 85 % of the intervals hold.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

import numpy as np
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.closed_loop.controller import load_controller
from rrrgen.lab.closed_loop.refinement import closed_loop_estimate
from rrrgen.lab.closed_loop.validation import stated_equations, validate_loop
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.identification import Options, identify

ADDED = "    friction: {{viscous: {}, coulomb: {}}}\n    drive: {{inertia: {}, encoder_resolution: 1e-4}}\n"
DRIVES = ((4, 5, 1.1), (5, 6, 4.7), (3, 4, 0.8), (0.4, 0.6, 0.2), (0.3, 0.5, 0.18), (0.2, 0.4, 0.19))
EXPERIMENT = "schema: rrrgen-experiment/1\nvirtual_robot: {torque_noise: 0.05, delay: 1}\n"


def robot_file(folder: Path) -> Path:
    """The bundled Puma 560 with friction and drives at all joints."""
    head, *rows = (files("rrrgen.robot") / "robots/puma560.yaml").read_text().split("  - name: ")
    joints = [row for row in rows if "type: revolute" in row]
    text = head
    for row, drive in zip(joints, DRIVES, strict=True):
        body, found, links = row.partition("links:\n")
        text += "  - name: " + body + ADDED.format(*drive) + found + links
    path = folder / "robot.yaml"
    path.write_text(text)
    return path


def reference(folder: Path, names: list[str], seconds: float) -> Path:
    """A sum of sines at every joint, as a log of positions."""
    t = 1e-3 * np.arange(round(seconds * 1e3))
    rng = np.random.default_rng(1)
    columns = [t]
    for _ in names:
        f, size = np.array([0.2, 0.5, 0.9, 1.4]), rng.uniform(0.08, 0.2, 4)
        phase = 2.0 * np.pi * f * t[:, None] + rng.uniform(0.0, 2.0 * np.pi, 4)
        columns.append(np.sum(size * np.sin(phase), axis=1))
    path = folder / "reference.csv"
    header = ",".join(["t", *(f"q_{name}" for name in names)])
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.10g")
    return path


def main() -> int:
    """Run the study and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=6.0, help="length of the recording")
    seconds = parser.parse_args().seconds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robot = robot_file(folder)
        model = rrrgen.compile(robot)
        (folder / "experiment.yaml").write_text(EXPERIMENT)
        path = reference(folder, [joint.name for joint in model.spec.joints], seconds)
        words = [
            "experiment",
            "simulate",
            robot,
            "--reference",
            path,
            "--experiment",
            folder / "experiment.yaml",
            "-o",
            folder / "run",
        ]
        done = CliRunner().invoke(cli, [str(word) for word in words])
        assert done.exit_code == 0, done.output
        results = folder / "run/results"
        log, controller = LogStream(open_log(results / "log.yaml")), load_controller(results / "log_controller.yaml")
        options, processing = Options(consistent=False, poses=1), Processing("differences", decimate=10)
        floor = validate_loop(model, controller, [log], processing).score.relative_error
        found = identify(model, [log], processing, options)
        loop = closed_loop_estimate(found, [log], controller, options)
    assert loop.start is not None
    own = loop.identification
    assert own.parametrisation is not None
    truth = own.parametrisation.contract(stated_equations(model)[1][: len(own.columns)])
    held = float(np.mean(np.abs(own.estimate.x - truth) < 1.96 * own.estimate.std))
    record = {
        "parameters": len(truth),
        "iterations": loop.iterations,
        "error before": f"{100 * loop.start.relative_error:.3g} %",
        "error after": f"{100 * loop.fit.relative_error:.3g} %",
        "floor": f"{100 * floor:.3g} %",
        "intervals that hold": f"{100 * held:.0f} %",
    }
    print(json.dumps(record, indent=2))
    return int(loop.fit.relative_error > 1.1 * floor or held < 0.85)


if __name__ == "__main__":
    sys.exit(main())
