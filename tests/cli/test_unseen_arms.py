"""Arms that the project has never seen, from YAML alone: simulate, identify and validate by the command line."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.design.fourier_series import FourierTrajectory

SLIDER = """
schema: rrrgen/1
name: slider
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - name: carriage
    type: prismatic
    alpha: 0
    a: 0
    d: 0
    theta: 0
    friction: {viscous: 12, coulomb: 4}
    drive: {encoder_resolution: 1e-6}
links:
  - mass: 7.5
    com: [0, 0, 0]
    inertia: {about: com, xx: 0.02, yy: 0.02, zz: 0.02}
"""

JOINT = "  - {{name: {}, type: revolute, alpha: {}, a: {}, d: {}, theta: 0, {}, {}}}\n"
LINK = "  - {{mass: {}, com: {}, inertia: {{about: com, xx: {}, yy: {}, zz: {}}}}}\n"
SIX = (
    "schema: rrrgen/1\nname: six\nconvention: modified\nunits: {angle: deg, length: m}\n"
    "gravity: [0, 0, -9.81]\njoints:\n"
    + "".join(
        JOINT.format(f"a{i + 1}", *row, f"friction: {{viscous: {fv}, coulomb: {fc}}}", f"drive: {{inertia: {Ia}}}")
        for i, (row, fv, fc, Ia) in enumerate(
            [
                ((0, 0, 0.3), 4, 3, 0.8),
                ((-90, 0.1, 0), 4, 3, 0.8),
                ((0, 0.4, 0.05), 2, 2, 0.4),
                ((-90, 0.03, 0.35), 1, 0.6, 0.1),
                ((90, 0, 0), 0.6, 0.5, 0.1),
                ((-90, 0, 0.08), 0.4, 0.3, 0.05),
            ]
        )
    )
    + "links:\n"
    + LINK.format(9, [0.02, 0, -0.05], 0.15, 0.16, 0.1)
    + LINK.format(8, [0.2, 0.01, 0.05], 0.05, 0.2, 0.2)
    + LINK.format(4, [0.02, -0.05, 0.01], 0.05, 0.03, 0.05)
    + LINK.format(2, [0, 0.01, -0.1], 0.02, 0.02, 0.008)
    + LINK.format(1, [0, -0.02, 0.01], 0.004, 0.003, 0.004)
    + LINK.format(0.5, [0.01, 0, 0.03], 0.001, 0.001, 0.0008)
)

SEVEN = (
    "schema: rrrgen/1\nname: seven\nconvention: standard\nunits: {angle: deg, length: mm}\n"
    "gravity: [0, 0, -9.81]\njoints:\n"
    + "".join(
        JOINT.format(f"j{i + 1}", alpha, 0, d, f"friction: {{viscous: {fv}, coulomb: {fc}}}", "drive: {}")
        for i, (alpha, d, fv, fc) in enumerate(
            [
                (-90, 340, 3, 2),
                (90, 0, 3, 2),
                (90, 400, 2, 1.5),
                (-90, 0, 2, 1),
                (-90, 380, 1, 0.6),
                (90, 0, 0.6, 0.4),
                (0, 120, 0.4, 0.3),
            ]
        )
    )
    + "links:\n"
    + LINK.format(4, [0, -30, 70], 0.02, 0.02, 0.01)
    + LINK.format(4, [0, 60, 40], 0.03, 0.02, 0.02)
    + LINK.format(3, [0, 30, -70], 0.02, 0.02, 0.01)
    + LINK.format(2.7, [10, 60, 30], 0.02, 0.01, 0.02)
    + LINK.format(1.7, [0, 20, -100], 0.01, 0.01, 0.004)
    + LINK.format(1.6, [0, 10, 10], 0.004, 0.003, 0.004)
    + LINK.format(0.5, [10, 0, 20], 0.001, 0.001, 0.001)
)

WITHIN = 3.0
"""Standard deviations; seeds are fixed, so that the outcome is."""


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


def recorded(folder, robot, joints, amplitude, noise, rate, seed, control="pd"):
    """The mapping file of a simulated recording."""
    rng = np.random.default_rng(seed)
    motion = FourierTrajectory.from_coefficients(rng.uniform(-amplitude, amplitude, (11, joints)), 0.2)
    path = folder / f"motion{seed}.json"
    path.write_text(json.dumps(motion.to_json()))
    out = folder / f"recording{seed}"
    settings = ["--torque-noise", noise, "--rate", rate, "--bandwidth", 3, "--seed", seed, "--control", control]
    result = run("experiment", "simulate", robot, "--trajectory", path, *settings, "-o", out)
    assert result.return_value == 0, result.output
    return out / "results" / "log.yaml"


def deviations(folder, robot):
    """How many of its standard deviations every parameter is from the truth, where a column stands for one alone."""
    estimate = json.loads((folder / "results" / "identification.json").read_text())
    model = rrrgen.compile(robot)
    truth = dict(zip(model.base_parameter_names, model.beta, strict=True))
    for i, joint in enumerate(model.spec.joints, start=1):
        truth |= {f"fv{i}": joint.friction.viscous, f"fc{i}": joint.friction.coulomb}
        if joint.drive.inertia is not None:
            truth[f"Ia{i}"] = joint.drive.inertia
    with (folder / "results" / "parameters.csv").open() as file:
        rows = [(r["parameter"], float(r["value"]), float(r["std"])) for r in csv.DictReader(file)]
    found = {name: (value - truth[name]) / std for name, value, std in rows if name in truth}
    return found, estimate


def test_a_prismatic_drive(tmp_path):
    robot = tmp_path / "slider.yaml"
    robot.write_text(SLIDER)
    first, second = (recorded(tmp_path, robot, 1, 0.3, 0.2, 500, seed) for seed in (1, 2))
    assert run("identify", robot, "--log", first, "-o", tmp_path / "found").return_value == 0
    found, _ = deviations(tmp_path / "found", robot)
    assert set(found) == {"m1R", "fv1", "fc1"}
    assert max(abs(v) for v in found.values()) < WITHIN
    fitted = tmp_path / "found" / "results" / "robot.yaml"
    for log, label in ((second, "held-out data"), (first, "its own data")):  # the mapping files are alike, the data not
        out = tmp_path / f"validated {label}"
        result = run("experiment", "validate", fitted, "--log", log, "--relative-error", 0.02, "-o", out)
        assert result.return_value == 0, result.output
        assert f"scored on {label} (" in result.output


@pytest.mark.sweep  # tests/stranger.py takes arms the same way
def test_a_wrist_arm_in_modified_parameters_with_drives(tmp_path, no_figures):
    robot = tmp_path / "six.yaml"
    robot.write_text(SIX)
    log = recorded(tmp_path, robot, 6, 0.6, 0.05, 250, 3)
    out = tmp_path / "found"
    settings = ["--no-consistent", "--split", "blocks:0.5", "--guard", 0]
    assert run("identify", robot, "--log", log, *settings, "-o", out).return_value == 0
    found, estimate = deviations(out, robot)
    assert {"Ia3", "Ia4", "Ia5", "Ia6", "fv1", "fc6"} <= set(found)
    assert len(found) == 52 - 3  # the others are groups with the first two drive inertias
    assert max(abs(v) for v in found.values()) < WITHIN
    assert estimate["held_out"]["relative_error"] < 0.02
    notes = " ".join(estimate["not_identifiable"])
    assert "Ia1 is not identifiable alone" in notes
    assert "Ia2 is not identifiable alone" in notes


MATLAB_LOG = """
schema: rrrgen-log/1
files: cell.mat
time: {column: time, unit: ms}
units: {position: deg, torque: N*m}
joints:
"""


def as_matlab(log, folder):
    """The recording as a MATLAB file in degrees and milliseconds, with its mapping file."""
    rows = np.genfromtxt(log.with_name("log.csv"), delimiter=",", names=True)
    folder.mkdir()
    content = {"time": 1e3 * rows["t"]}
    content["enc"] = np.degrees(np.column_stack([rows[f"q_j{i}"] for i in range(1, 8)]))
    content["trq"] = np.column_stack([rows[f"tau_j{i}"] for i in range(1, 8)])
    savemat(folder / "cell.mat", content)
    lines = [
        f"  - {{name: j{i}, position: {{column: 'enc[{i - 1}]'}}, torque: {{column: 'trq[{i - 1}]'}}}}\n"
        for i in range(1, 8)
    ]
    (folder / "cell.yaml").write_text(MATLAB_LOG + "".join(lines))
    return folder / "cell.yaml"


@pytest.mark.sweep  # tests/stranger.py takes arms the same way
def test_a_seven_joint_arm_in_standard_parameters_from_matlab(tmp_path, no_figures):
    robot = tmp_path / "seven.yaml"
    robot.write_text(SEVEN)
    first, second = (
        as_matlab(recorded(tmp_path, robot, 7, 0.3, 0.05, 250, seed, "computed-torque"), tmp_path / f"cell{seed}")
        for seed in (4, 5)
    )
    assert run("identify", robot, "--log", first, "-o", tmp_path / "found").return_value == 0
    result = run(
        *("experiment", "validate", tmp_path / "found" / "results" / "robot.yaml", "--log", second),
        *("--relative-error", 0.03, "--require-held-out", "-o", tmp_path / "validated"),
    )
    assert result.return_value == 0, result.output
    assert "scored on held-out data (0 % of its windows of samples were fitted); passed" in result.output
