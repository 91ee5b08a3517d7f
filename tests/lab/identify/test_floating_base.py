"""Identification on a floating base: from wrench and torques, each alone, and in flight, against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rrrgen
from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.cli.main import run
from samples.floating_motion import falling, floating_motion

SATELLITE = """
schema: rrrgen/1
name: satellite
convention: modified
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
floating_base:
  name: body
  mass: 3.1
  com: [0.02, -0.01, 0.03]
  inertia: {about: com, xx: 0.05, yy: 0.06, zz: 0.04, xy: 0.002, xz: -0.003, yz: 0.001}
joints:
  - {name: shoulder, type: revolute, parent: base, alpha: 0.4, a: 0.1, d: 0.2, friction: {viscous: 0.1, coulomb: 0.2}}
  - {name: elbow, type: revolute, alpha: -1.2, a: 0.25, d: 0.05, friction: {viscous: 0.05, coulomb: 0.1}}
links:
  - {mass: 1.2, com: [0.1, 0.01, 0.02], inertia: {about: com, xx: 0.004, yy: 0.012, zz: 0.011, xy: 0.001, xz: 0, yz: 0}}
  - {mass: 0.8, com: [0.08, 0.02, 0], inertia: {about: com, xx: 0.003, yy: 0.006, zz: 0.007, xy: 0, xz: 0.0005, yz: 0}}
"""


@pytest.fixture(scope="module")
def robot() -> Any:
    return rrrgen.compile(rrrgen.loads_spec(SATELLITE))


@pytest.fixture(scope="module")
def recorded(robot: Any) -> dict[str, Array]:
    return _recording(robot, floating_motion(2, seed=1))


def _recording(
    robot: Any, motion: dict[str, Array], noise: float = 1e-3, beside: tuple[str, ...] = ()
) -> dict[str, Array]:
    """Positions, twist, wrench and torques of ``motion``, with friction and ``noise`` in N and N m."""
    state = [motion[key] for key in ("q", "dq", "ddq")]
    base = {key: motion[key] for key in ("orientation", "twist", "twist_rate")}
    found = robot.inverse_dynamics(*state, **base)
    rng = np.random.default_rng(7)
    kept = {key: motion[key] for key in ("t", "q", "orientation", "twist", *beside)}
    kept["wrench"] = found.wrench + noise * rng.normal(size=found.wrench.shape)
    kept["tau"] = found.tau + robot.friction(motion["dq"]) + noise * rng.normal(size=found.tau.shape)
    return kept


def _truth(robot: Any) -> dict[str, float]:
    friction = {"fv1": 0.1, "fv2": 0.05, "fc1": 0.2, "fc2": 0.1}
    return dict(zip(robot.base_parameter_names, robot.beta, strict=True)) | friction


def _check(robot: Any, found: rrrgen.lab.studies.identify.IdentificationResult, tolerance: float = 2e-3) -> None:
    truth = _truth(robot)
    for name, value, std in zip(found.names, found.values, found.std, strict=True):
        assert abs(value - truth[name]) < max(5 * std, tolerance * abs(truth[name])), name
        assert abs(value - truth[name]) < 0.02, name


def test_wrench_and_torques_together(robot, recorded):
    found = rrrgen.identify(robot, recorded)
    assert len(found.names) == 10 + 7 * 2 + 4  # of the base, of two revolute joints, friction
    _check(robot, found)
    assert found.identification.consistent is not None
    assert all(share == 0.0 for share in found.identification.indefinite.values())
    assert found.spec.floating_base
    assert float(found.spec.links[0].mass) == pytest.approx(3.1, rel=0.1)
    assert "base fx" in repr(found)


def test_the_wrench_alone_determines_all_but_friction(robot, recorded):
    """Ayusawa, Venture and Nakamura (2014): no torque is needed."""
    found = rrrgen.identify(robot, {k: v for k, v in recorded.items() if k != "tau"}, consistent=False)
    assert len(found.names) == 10 + 7 * 2
    _check(robot, found)
    notes = " ".join(found.notes)
    assert "fv1 has no effect" in notes


def test_torques_alone_leave_the_base_undetermined(robot, recorded):
    found = rrrgen.identify(robot, {k: v for k, v in recorded.items() if k != "wrench"}, consistent=False)
    assert len(found.names) == 7 * 2 + 4
    assert not any(name.endswith("1R") for name in found.names if name.startswith(("m", "h", "J")))
    _check(robot, found)


def test_a_flight_determines_all_but_a_factor(robot):
    fall = falling(robot, floating_motion(2, seed=3, duration=5.0, rate=200.0))
    flight = _recording(robot, fall, noise=1e-4, beside=("dq", "ddq", "twist_rate"))
    assert np.abs(flight["wrench"]).max() < 1e-3
    flight["wrench"] = np.zeros_like(flight["wrench"])
    _check(robot, rrrgen.identify(robot, flight, consistent=False, method="logged"), 0.01)
    alone = {key: values for key, values in flight.items() if key != "tau"}  # sensitive to errors of the motion
    with pytest.raises(InputError, match="up to one factor only"):
        rrrgen.identify(robot, alone, consistent=False)
    mass = _truth(robot)["m1R"]
    found = rrrgen.identify(robot, alone, consistent=False, method="logged", fix={"m1R": mass})
    assert len(found.names) == 10 + 7 * 2 - 1
    _check(robot, found, 0.01)
    heavier = rrrgen.identify(robot, alone, consistent=False, method="logged", fix={"m1R": 2 * mass})
    assert heavier.values == pytest.approx(2 * found.values, rel=1e-6, abs=1e-9)


BASE = "orientation: [ox, oy, oz, ow], twist: [v1, v2, v3, w1, w2, w3]"
NAMES = {
    "orientation": ("ox", "oy", "oz", "ow"),
    "twist": ("v1", "v2", "v3", "w1", "w2", "w3"),
    "wrench": ("f1", "f2", "f3", "m1", "m2", "m3"),
    "q": ("q_shoulder", "q_elbow"),
    "tau": ("tau_shoulder", "tau_elbow"),
    "t": ("t",),
}


def _write(folder: Path, recorded: dict[str, Array], base: str) -> Path:
    """A CSV with own names of columns and its mapping file, with ``base`` as the keys of the base."""
    table = np.column_stack([recorded[key] for key in recorded])
    names = [name for key in recorded for name in NAMES[key]]
    np.savetxt(folder / "flight.csv", table, delimiter=",", header=",".join(names), comments="")
    (folder / "satellite.yaml").write_text(SATELLITE, encoding="utf-8", newline="\n")
    joints = [f"{{name: {j}, position: q_{j}{f', torque: tau_{j}' if 'tau' in recorded else ''}}}" for j in JOINTS]
    text = f"""
schema: rrrgen-log/1
files: flight.csv
time: {{column: t, unit: s}}
units: {{position: rad, torque: N*m}}
base: {{{base}}}
joints: [{", ".join(joints)}]
"""
    (folder / "log.yaml").write_text(text, encoding="utf-8", newline="\n")
    return folder / "log.yaml"


JOINTS = ("shoulder", "elbow")


def test_the_command_reads_the_base_from_a_mapping_file(robot, recorded, tmp_path, capsys, no_figures):
    """The sign of a quaternion means nothing: half of the rows have the other one."""
    signs = np.where(np.arange(len(recorded["t"])) // 50 % 2, -1.0, 1.0)
    turned = recorded | {"orientation": signs[:, None] * recorded["orientation"]}
    log = _write(tmp_path, turned, f"{BASE}, wrench: [f1, f2, f3, m1, m2, m3]")
    words = ["identify", str(tmp_path / "satellite.yaml"), "--log", str(log), "-o", str(tmp_path / "out")]
    assert run(words) == 0
    assert "base mz" in capsys.readouterr().out
    written = rrrgen.load_spec(tmp_path / "out" / "results" / "robot.yaml")
    identified = rrrgen.compile(written, backend="numpy")
    assert identified.beta == pytest.approx(robot.beta, abs=5e-3)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("orientation: [ox, oy, oz, ow]", "twist"),
        (BASE.replace("w1, ", ""), "no list of 6 columns"),
        (f"{BASE}, wrench: zero", "no list of 6 columns"),
        (BASE.replace("[ox, oy, oz, ow]", "[v1, v2, v3, w1]"), "unit quaternion"),
        (f"{BASE}, wrench: none", "up to one factor only"),
    ],
)
def test_what_a_base_lacks_is_said(recorded, tmp_path, capsys, base, message):
    log = _write(tmp_path, {key: values for key, values in recorded.items() if key != "tau"}, base)
    words = ["identify", str(tmp_path / "satellite.yaml"), "--log", str(log), "-o", str(tmp_path / "out")]
    assert run(words) in (2, 3)
    assert message in capsys.readouterr().err


def test_refused_with_the_reason(robot, recorded):
    for changes in ({"friction": ("coulomb_viscous",)}, {"estimate": ("zeros",)}, {"bias_check": 1.0}):
        with pytest.raises(InputError, match="is for a base at rest"):
            rrrgen.identify(robot, recorded, **changes)
    with pytest.raises(InputError, match="which rrrgen identify takes"):
        rrrgen.validate(robot, recorded)
    with pytest.raises(InputError, match="no 'orientation'"):
        rrrgen.identify(robot, {key: values for key, values in recorded.items() if key != "orientation"})
    with pytest.raises(InputError, match="'twist' has the shape"):
        rrrgen.identify(robot, recorded | {"twist": recorded["twist"][:, :3]})
    with pytest.raises(InputError, match="'twist'"):
        rrrgen.identify("rrr", recorded)
    with pytest.raises(InputError, match="some recordings have the motion"):
        rrrgen.identify(robot, [recorded, {key: recorded[key] for key in ("t", "q", "tau")}])


def test_gaps_in_the_motion_of_the_base_and_in_its_wrench(robot, recorded):
    """Rows without the twist split the recording, those without the wrench are left out of its rows."""
    holes = {key: values.copy() for key, values in recorded.items()}
    holes["twist"][100:110, 4] = np.nan
    holes["wrench"][200:210, 2] = np.nan
    found = rrrgen.identify(robot, holes, consistent=False)
    kinds = [finding.kind for finding in found.recordings[0].repairs.findings]
    assert kinds == ["rows without all positions", "missing torques", "splitting holes"]
    _check(robot, found)
    with pytest.raises(InputError, match="neither the wrench on the base nor joint torques"):
        rrrgen.identify(robot, {key: recorded[key] for key in ("t", "q", "orientation", "twist")})


@pytest.mark.sweep
@pytest.mark.parametrize("measured", ["both", "wrench", "tau"])
def test_the_quadruped(measured):
    quadruped = rrrgen.compile("examples/trees/quadruped.yaml", backend="numpy")
    recorded = _recording(quadruped, floating_motion(12, seed=2, duration=12.0, rate=200.0), noise=1e-2)
    kept = {
        key: values for key, values in recorded.items() if measured in ("both", key) or key not in ("wrench", "tau")
    }
    found = rrrgen.identify(quadruped, kept, consistent=False)
    truth = dict(zip(quadruped.base_parameter_names, quadruped.beta, strict=True))
    assert len(found.names) == (84 if measured == "tau" else 94)
    for name, value, std in zip(found.names, found.values, found.std, strict=True):
        assert abs(value - truth[name]) < max(5 * std, 1e-3), name
