"""The wheel of a robot: installed by pip, it runs in an environment that has NumPy and nothing else."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emit.targets.arm import FURTHER, TEXT, WITH_CONTROL, arm
from emit.targets.compared import ours
from rrrgen.base.errors import InputError
from rrrgen.base.version import VERSION
from rrrgen.cli.main import run
from rrrgen.emit.targets import shared_libraries
from rrrgen.emit.targets import wheel as wheel_target
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.robot.file import loads_spec

USE = """
import json, sys
import numpy as np
import arm_model as robot
import arm_model.any_gravity

state = json.loads(sys.argv[1])
q, dq, ddq = (np.array(state[name]) for name in ("q", "dq", "ddq"))
T = robot.forward_kinematics(q)
tau = robot.inverse_dynamics(q, dq, ddq)
beta = robot.nominal_parameters()
assert np.array_equal(robot.inverse_dynamics(q[0], dq[0], ddq[0], beta), tau[0])
assert np.allclose(robot.forward_dynamics(q, dq, tau, beta), ddq)
terms = robot.dynamics_terms(q, dq)
assert np.allclose(np.einsum("kij,kj->ki", terms.M, ddq) + terms.c + terms.g, tau)
assert np.array_equal(robot.gravity(q[:, None, :], np.stack([beta, 0 * beta]))[:, 1], 0 * q)
assert robot.JOINT_NAMES == ("shoulder", "elbow") and robot.TAU_MAX[0] == 60 and robot.Q_MIN[1] == -2.5
found = robot.inverse_kinematics(T[0, :3, 3], q[0], nearest=True)
assert found.status == 0 and np.allclose(found.q[0], q[0])
assert "out of reach" in robot.inverse_kinematics([9, 9, 0]).text
e, inf = np.ones(2), np.full(2, np.inf)
gains = (400 * e, 40 * e, 0 * e, 0 * e)
tracked, z = robot.computed_torque(q, dq, q + 0.01, dq, ddq, *gains, 0.01 * e, 1e-3, tau_max=inf)
exact = robot.inverse_dynamics(q, dq, ddq + 4) + robot.smooth_friction(dq, robot.nominal_friction(), 0.01 * e)
assert np.allclose(tracked, exact, rtol=1e-10) and np.allclose(z, 1e-5)
start = robot.momentum_observer_start(q, dq, width=0.01 * e)
assert np.allclose(start.p, np.einsum("kij,kj->ki", terms.M, dq))
J = robot.jacobian(q[0])
weight = [1, 1, 1, 0, 0, 0]
free = (q[0], 0 * e, J, J @ dq[0], weight, 0 * e, 1e-6, -inf, inf)
assert np.allclose(robot.differential_ik(*free, inf, inf, 1e-3), dq[0], atol=1e-6)
slow, status = robot.differential_ik(*free[:1], 9 * e, *free[2:], e, e, 1e-3, with_status=True)
assert status == 1 and np.allclose(slow, 9 - 1e-3)
side = robot.any_gravity.inverse_dynamics(q, 0 * q, 0 * q, [9.81, 0, 0])
assert np.allclose(robot.any_gravity.inverse_dynamics(q, dq, ddq, [0, -9.81, 0]), tau)
y = robot.forward_kinematics(q)[:, 1, 3]
assert np.allclose(side[:, 1], 9.81 * 2.5 * 0.2 * np.sin(q.sum(1))), "the elbow carries 2.5 kg at 0.2 m"
s = np.linspace(0, 1, 101)[:, None]
path = (s[:, 0], s * [1, 2], 1 + 0 * s * [1, 1], 0 * s * [1, 1])
path = (path[0], path[1], path[2] * [1, 2], path[3])
timed = robot.time_path(*path, [60, 30], [6, 6], inf)
assert 0.98 < timed.torque_share < 1.02
motion = robot.timed_path(*path, timed, timed.t[:-1])
assert np.allclose(motion.q_d, path[1][:-1]) and np.allclose(motion.dq_d, path[2][:-1] * timed.ds_dt[:-1, None])
torque = robot.inverse_dynamics(*motion) + robot.friction(motion.dq_d)
assert np.max(np.abs(torque) / [60, 30]) < 1.02
assert robot.any_gravity.time_path(*path, [0, 0, 0], [60, 30], [6, 6], inf).t[-1] < timed.t[-1]
wave = robot.fourier([0, 2.5], 0.1, 0 * e, [[1], [2]], [[0], [0]])
assert np.allclose(wave.dq_d, [[1, 2], [0, 0]]) and np.allclose(wave.q_d[1], np.array([1, 2]) / (0.2 * np.pi))
ddq_0, failed = robot.forward_dynamics(q, dq, tau, 0 * beta, with_status=True)
assert failed.shape == (4,) and failed.all() and ddq_0.shape == (4, 2)
for wrong, error in (
    (lambda: robot.gravity(np.zeros(3)), ValueError),
    (lambda: robot.gravity(q + 0j), ValueError),
    (lambda: robot.time_path(*path, [1, 1]), ValueError),
    (lambda: robot.fourier(0.0, 0.0, 0 * e, [[1], [2]], [[0], [0]]), ValueError),
    (lambda: robot.forward_dynamics(q, dq, tau, 0 * beta), np.linalg.LinAlgError),
    (lambda: robot.differential_ik(*free[:1], 9 * e, *free[2:], e, e, 1e-3), np.linalg.LinAlgError),
):
    try:
        wrong()
    except error:
        continue
    raise SystemExit("no error")
missing = [name for name in ("rrrgen", "cffi", "sympy") if name in sys.modules]
assert not missing, missing
try:
    import rrrgen
except ImportError:
    print(json.dumps({"T": T.tolist(), "tau": tau.tolist()}))
"""


@pytest.fixture(autouse=True, scope="module")
def unoptimized_libraries():
    with pytest.MonkeyPatch.context() as patch:
        flags = tuple("-O0" if flag == "-O2" else flag for flag in shared_libraries.FLAGS)
        patch.setattr(shared_libraries, "FLAGS", flags)
        yield


@pytest.fixture(scope="module")
def files(unoptimized_libraries):
    return export_robot(arm(), "wheel", options=ExportOptions(further=(*WITH_CONTROL, *FURTHER))).files


def environment(folder: Path) -> Path:
    """The Python of a new environment that sees NumPy and nothing else of this one."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
    shown = folder / "shown"
    shown.mkdir()
    for each in Path(np.__file__).parents[1].glob("numpy*"):
        (shown / each.name).symlink_to(each)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    (site / "numpy.pth").write_text(str(shown), encoding="utf-8")
    return folder / "venv" / "bin" / "python"


@pytest.mark.skipif(sys.platform == "win32", reason="the environment is made with symbolic links")
def test_a_fresh_environment_runs_it(files, tmp_path):
    (name,) = (name for name in files if name.endswith(".whl"))
    (tmp_path / name).write_bytes(files[name])
    python = environment(tmp_path)
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--no-index", "-q"]
    done = subprocess.run([*pip, str(tmp_path / name)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    random = np.random.default_rng(1)
    q, dq, ddq = (random.uniform(-2, 2, (4, 2)) for _ in range(3))
    state = json.dumps({"q": q.tolist(), "dq": dq.tolist(), "ddq": ddq.tolist()})
    done = subprocess.run([python, "-I", "-c", USE, state], capture_output=True, text=True, cwd="/", check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found, (T, tau) = json.loads(done.stdout), ours(arm(), q, dq, ddq)
    np.testing.assert_allclose(found["T"], T, atol=1e-13)
    np.testing.assert_allclose(found["tau"], tau, rtol=1e-12, atol=1e-12)


def test_the_readme_runs_for_an_arm_without_friction(tmp_path):
    """Its law then takes friction parameters, which the robot file does not give."""
    rod = "{mass: 2, com: [-0.1, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}"
    text = TEXT.partition("joints:")[0] + "joints:\n  - {type: revolute, alpha: 0, a: 0.5, d: 0}\nlinks:\n  - " + rod
    files = export_robot(loads_spec(text), "wheel", options=ExportOptions(further=("control",))).files
    (name,) = (name for name in files if name.endswith(".whl"))
    with zipfile.ZipFile(io.BytesIO(files[name])) as wheel:
        wheel.extractall(tmp_path)
    (program,) = re.findall(r"```python\n(.*?)```", files["README.md"], re.S)
    assert "robot.computed_torque(" in program
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)


def release(monkeypatch, spec=None, **options):
    """The version of a wheel whose library is not compiled, as its file name and its module state it."""
    with monkeypatch.context() as patch:
        patch.setattr(wheel_target, "shared_library", lambda files, platform: b"")
        files = export_robot(spec or arm(), "wheel", options=ExportOptions(**options)).files
    wheels = {name: data for name, data in files.items() if name.endswith(".whl")}
    stated = {name.split("-")[1] for name in wheels}
    for data in wheels.values():
        with zipfile.ZipFile(io.BytesIO(data)) as wheel:
            texts = {entry: wheel.read(entry).decode() for entry in wheel.namelist()}
        stated |= {version for text in texts.values() for version in re.findall(r'^__version__ = "(.*)"', text, re.M)}
        stated |= {version for text in texts.values() for version in re.findall(r"^Version: (.*)", text, re.M)}
        stated |= {re.match(r"arm_model-(.*)\.dist-info", name)[1] for name in texts if "dist-info" in name}
    (version,) = stated
    return version


def test_wheels_with_different_contents_have_different_versions(monkeypatch):
    """Otherwise pip takes the second for the first, which is installed already."""
    plain = release(monkeypatch)
    assert release(monkeypatch) == plain
    others = [
        release(monkeypatch, further=("control",)),
        release(monkeypatch, further=("gravity",)),
        release(monkeypatch, real="float"),
        release(monkeypatch, replace(arm(), description="another arm")),
    ]
    assert len({plain, *others}) == 5


def test_wheels_for_several_systems_have_one_version(monkeypatch):
    monkeypatch.setattr(wheel_target, "platforms", lambda names: [shared_libraries.PLATFORMS[name] for name in names])
    names = ("linux-x86_64", "macos-arm64", "windows-x86_64")
    assert release(monkeypatch, platforms=names) == release(monkeypatch, platforms=names[:1])


def test_the_record_lists_every_file(files, tmp_path):
    (name,) = (name for name in files if name.endswith(".whl"))
    assert re.fullmatch(rf"arm_model-{re.escape(VERSION)}\+[0-9a-f]{{12}}-py3-none-\w+\.whl", name)
    (tmp_path / name).write_bytes(files[name])
    with zipfile.ZipFile(tmp_path / name) as wheel:
        assert wheel.testzip() is None
        (record,) = (entry for entry in wheel.namelist() if entry.endswith("RECORD"))
        rows = [line.split(",") for line in wheel.read(record).decode().splitlines()]
        assert {row[0] for row in rows} == set(wheel.namelist())
        sizes = {row[0]: int(row[2]) for row in rows if row[2]}
        assert all(len(wheel.read(entry)) == size for entry, size in sizes.items())
        code = wheel.read("arm_model/__init__.py").decode()
    compile(code, "__init__.py", "exec")
    assert re.search(r"^def forward_dynamics\(q: Array, dq: Array, tau: Array, beta: Array = None, \*", code, re.M)


def test_options_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="did you mean 'linux-x86_64'"):
        export_robot(arm(), "wheel", options=ExportOptions(platforms=("linux-x86-64",)))
    with pytest.raises(InputError, match=r"urdf has no use for --platform; targets that have: .*wheel"):
        export_robot(arm(), "urdf", options=ExportOptions(platforms=("linux-x86_64",)))


def test_packages_hold_what_is_asked_for_and_say_what_they_cannot(capsys, tmp_path):
    with pytest.raises(
        InputError,
        match=r"fmu cannot hold 'control'; it takes controller, timing, trajectory; targets that can: cuda, embedded",
    ):
        export_robot(arm(), "fmu", options=ExportOptions(further=("control",)))
    with pytest.raises(InputError, match=r"wheel cannot hold 'cpp'; it takes control, .*targets that can: embedded"):
        export_robot(arm(), "wheel", options=ExportOptions(further=("cpp",)))
    with pytest.raises(InputError, match=r"ros2 cannot hold 'rust'; .*generate --with' writes it"):
        export_robot(arm(), "ros2", options=ExportOptions(further=("rust",)))
    asked = replace(arm(), emit=("trajectory", "rust"))
    found = export_robot(asked, "ros2")
    assert "arm_quintic" in found.files["model/arm.h"]
    assert any("rust: not in this package" in note for note in found.notes)
    file = tmp_path / "arm.yaml"
    file.write_text(TEXT, encoding="utf-8")
    assert run(["export", str(file), "--to", "embedded", "--with", "control,tracking", "-o", str(tmp_path)]) == 2
    assert "'tracking' is not known" in capsys.readouterr().err
