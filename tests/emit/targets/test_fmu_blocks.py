"""Desired motions as FMUs: the same as in Python, and followed by the FMUs of controller and plant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rrrgen
from emit.targets.arm import TEXT, arm
from emit.targets.rrr_library import STRICT, run
from rrrgen.controller.files import unit_code
from rrrgen.emit.targets.c_package import emitted_code
from rrrgen.emit.targets.fmu_blocks import BLOCKS, POINTS, _unit_of
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.robot.file import loads_spec

fmpy = pytest.importorskip("fmpy", reason="needs FMPy to load an FMU")
MOTION = [f"{name}[{k}]" for name in ("q_d", "dq_d", "ddq_d") for k in (1, 2)]
LIMITS = {"tau_max": 40.0, "dq_max": 4.0, "ddq_max": 40.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("blocks")
    options = ExportOptions(further=("controller", "timing", "trajectory"))
    for name, contents in export_robot(arm(), "fmu", options=options).files.items():
        (place / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return place


def slave(folder: Path, place: Path, name: str):
    from fmpy.validation import validate_fmu

    from emit.targets.fmu_slave import Slave

    assert validate_fmu(str(folder / f"{name}.fmu")) == []
    return Slave(folder / f"{name}.fmu", place / name)


def set_path(block, points: int) -> rrrgen.TimedPath:
    """Give a block a path, and the motion along it that Python finds."""
    path = rrrgen.spline_path([[0.3, -0.8], [1.0, 0.2], [0.3, 0.4]], points=points)
    block["points"] = points
    for k in range(points):
        block[f"s[{k + 1}]"] = path.s[k]
        for j in range(2):
            for name in ("q", "q_s", "q_ss"):
                block[f"{name}[{k + 1},{j + 1}]"] = getattr(path, name)[k, j]
    for name, value in LIMITS.items():
        for j in range(2):
            block[f"{name}[{j + 1}]"] = value
    given = {name: np.full(2, value) for name, value in LIMITS.items()}
    return rrrgen.compile(arm()).time_path(path, **given)


@pytest.mark.sweep
def test_timing_of_a_path(folder, tmp_path):
    block = slave(folder, tmp_path, "arm_timing")
    run("gcc", "-std=c99", *STRICT, "-fsyntax-only", "arm_timing_fmu.c", cwd=block.folder / "sources")
    timed = set_path(block, 31)
    block["begin"] = 0.1
    block.start()
    shares = [timed.torque_share, timed.speed_share, timed.acceleration_share]
    found = block.all(["duration", "stretch", "torque_share", "speed_share", "acceleration_share"])
    np.testing.assert_allclose(found, [timed.duration, timed.stretch, *shares], rtol=1e-9)
    while block.time < timed.duration + 0.2:
        expected = np.concatenate([each.ravel() for each in timed.sample(block.time - 0.1)])
        np.testing.assert_allclose(block.all(MOTION), expected, atol=1e-9)
        block.step(0.05)
    block["dq_max[1]"] = 0.5  # and is timed again
    block.step(0.05)
    assert block["duration"] > 1.2 * timed.duration
    block["points"] = 0
    block.step(0.05)
    assert block.all(MOTION) == [0.3, -0.8, 0, 0, 0, 0]
    for wrong, text in ({"points": POINTS + 1}, "points must be 0 to 51"), ({"points": 2, "s[2]": -1.0}, "point 2: "):
        for name, value in wrong.items():
            block[name] = value
        with pytest.raises(Exception, match="fmi2"):
            block.step()
        assert block.said[-1].startswith(text)
    block.end()


def test_fourier_series(folder, tmp_path):
    block = slave(folder, tmp_path, "arm_fourier")
    run("gcc", "-std=c99", *STRICT, "-fsyntax-only", "arm_fourier_fmu.c", cwd=block.folder / "sources")
    q0, a, b = np.array([0.1, -0.2]), np.array([[1.0, -0.5], [0.3, 0.4]]), np.array([[0.2, 0.1], [0.0, 0.3]])
    block["base_frequency"] = 0.5
    for j in range(2):
        block[f"q0[{j + 1}]"] = q0[j]
        for k in range(2):
            block[f"a[{j + 1},{k + 1}]"], block[f"b[{j + 1},{k + 1}]"] = a[j, k], b[j, k]
    block.start()
    w = np.pi * np.arange(1, 3)
    for _ in range(5):
        sine, cosine = np.sin(block.time * w), np.cos(block.time * w)
        expected = [q0 + (a * sine - b * cosine) @ (1 / w), a @ cosine + b @ sine, (b * cosine - a * sine) @ w]
        np.testing.assert_allclose(block.all(MOTION), np.ravel(expected), atol=1e-12)
        block.step(0.37)
    block["base_frequency"] = 0.0
    with pytest.raises(Exception, match="fmi2"):
        block.step()
    assert "base_frequency must be positive" in block.said[-1]
    block.end()


def test_the_controller_follows_the_path_on_the_plant(folder, tmp_path):
    """Three FMUs that are connected as the README says."""
    motion, controller, plant = (slave(folder, tmp_path, name) for name in ("arm_timing", "arm_controller", "arm"))
    timed = set_path(motion, 51)
    for k, q in enumerate((0.3, -0.8)):
        plant[f"q[{k + 1}]"] = controller[f"in.q[{k + 1}]"] = q
    modes = unit_code(arm(), "double").description["modes"]
    for each in (motion, controller, plant):
        each.start()
    controller["in.mode"] = modes["computed_torque"]
    worst = 0.0
    while motion.time < timed.duration + 0.1:
        for k in (1, 2):
            for name in ("q", "dq"):
                controller[f"in.{name}[{k}]"] = plant[f"{name}[{k}]"]
            for name in ("q_d", "dq_d", "ddq_d"):
                controller[f"in.{name}[{k}]"] = motion[f"{name}[{k}]"]
        controller.step()
        for k in (1, 2):
            plant[f"torque[{k}]"] = controller[f"out.tau[{k}]"]
        plant.step()
        motion.step()
        worst = max(worst, *(abs(plant[f"q[{k}]"] - motion[f"q_d[{k}]"]) for k in (1, 2)))
    assert worst < 0.02
    np.testing.assert_allclose([plant["q[1]"], plant["q[2]"]], [0.3, 0.4], atol=5e-3)
    for each in (motion, controller, plant):
        each.end()


def test_a_wrench_has_forces_before_moments():
    units = [_unit_of("N, N m", k, 6, arm()) for k in range(6)]
    assert units == ["N"] * 3 + ["N.m"] * 3
    assert [_unit_of("N, N m", k, 5, arm()) for k in range(5)] == [""] * 5


def test_units_are_those_of_the_joint():
    """Of a table by the joint of the element, which is its row or its column."""
    text = TEXT.replace("{name: elbow, type: revolute", "{name: elbow, type: prismatic")
    code = emitted_code(loads_spec(text), "double", ("timing", "trajectory"))
    units = {v["name"]: v["unit"] for block in BLOCKS[1:] for v in block.values(code)["variables"]}
    assert (units["q[1,1]"], units["q[1,2]"]) == ("rad", "m")
    assert (units["a[1,2]"], units["a[2,1]"]) == ("rad/s", "m/s")
    assert (units["tau_max[1]"], units["tau_max[2]"]) == ("N.m", "N")
