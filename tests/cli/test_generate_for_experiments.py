"""C for the controller itself: the motion, the Kalman step and friction, against their references in Python."""

from __future__ import annotations

import json
import re
import subprocess

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.cli.main import run as run_command
from rrrgen.lab.data.kalman import kalman_matrices, kalman_step
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel

FLAGS = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow"]
STRICT = ["-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror", "-ffp-contract=off"]

ROUND_OFF = {"double": 1e-13, "float": 1e-4}
"""Of the largest value: sums of some ten products, along a record of a thousand steps of a stable filter."""

VAR_ETA, VAR_XI = [1e-10 / 12, 4e-10 / 12], [400.0, 900.0]


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    rng = np.random.default_rng(3)
    motion = FourierTrajectory(rng.normal(size=2), rng.normal(size=(2, 5)), rng.normal(size=(2, 5)), 0.1)
    (folder / "trajectory.json").write_text(json.dumps({"trajectory": motion.to_json()}))
    (folder / "tuning.json").write_text(json.dumps({"var_eta": VAR_ETA, "var_xi": VAR_XI}))
    return folder, motion


def written(inputs, folder, real):
    friction = [word for law in LAWS for word in ("--friction", law)]
    result = run(
        *("generate", "planar2r", "--trajectory", inputs / "trajectory.json", "--tuning", inputs / "tuning.json"),
        *(*friction, "--rate", 1000, "--real", real, "-o", folder, "--json"),
    )
    assert result.return_value == 0, result.output


@pytest.mark.sweep(but=["double-gcc", "float-clang"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_step_and_the_motion_equal_python_to_round_off(inputs, tmp_path, compiler, real):
    folder, motion = inputs
    written(folder, tmp_path, real)
    parts = [f"planar2r_{part}" for part in ("trajectory", "kalman", "friction")]
    files = [f"{part}{suffix}" for part in parts for suffix in (".h", ".c")]
    listed = json.loads((tmp_path / "manifest.json").read_text())["files"]
    assert set(files) <= set(listed)
    assert all(f"{part}.c" in (tmp_path / "CMakeLists.txt").read_text() for part in parts)
    sources = [f"{part}.c" for part in parts]
    for name in files:
        text = (tmp_path / name).read_text()
        assert "malloc" not in text
        assert not re.search(r"\bstatic\b(?! const)[^({]*[;=]", text)  # no state; functions of the file are static too
    library = tmp_path / "all.so"
    command = [compiler, *FLAGS, *STRICT, "-shared", "-fPIC", *sources, "-o", str(library), "-lm"]
    try:
        built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip(f"{compiler} is not installed")
    assert built.returncode == 0, built.stderr
    lib, ffi, dtype = loaded(library, real)

    rng = np.random.default_rng(8)
    N = 1000
    t = 1e-3 * np.arange(N)
    q, dq, ddq = motion.evaluate(t)
    y = q + 1e-3 * rng.normal(size=(N, 2))
    matrices = [kalman_matrices(1e-3, eta, xi) for eta, xi in zip(VAR_ETA, VAR_XI, strict=True)]
    expected, found = np.empty((N, 4, 2)), np.empty((N, 4, 2))
    states = [np.zeros(3), np.zeros(3)]
    x = np.zeros((2, 3), dtype)
    for k in range(N):
        for i in range(2):
            expected[k, 3, i] = y[k, i] - q[k, i] - states[i][0]
            m, wanted = matrices[i], (q[k, i], dq[k, i], ddq[k, i])
            states[i], expected[k, :3, i] = kalman_step(m.E, m.k, states[i], y[k, i], wanted)
        following, out = np.empty((2, 3), dtype), np.empty((4, 2), dtype)
        rows = [np.ascontiguousarray(v[k], dtype) for v in (y, q, dq, ddq)]
        lib.planar2r_kalman_step(*(pointer(ffi, v, real) for v in (x, *rows, following, *out)))
        x, found[k] = following, out
    scale = np.abs(expected).max(axis=(0, 2), keepdims=True)
    # accelerations of the filter come from 1e-3 rad of noise over Ts^2: rounding of y is amplified alike
    gain = np.array([m.k for m in matrices]).max(axis=0) * np.abs(y).max()
    allowed = ROUND_OFF[real] * np.maximum(scale, np.array([*gain, np.abs(y).max()])[None, :, None])
    assert np.all(np.abs(found - expected) <= allowed)

    for k in (0, 17, 999):
        out = np.empty((3, 2), dtype)
        lib.planar2r_trajectory_evaluate(t[k], *(pointer(ffi, v, real) for v in out))
        for got, wanted in zip(out, (q[k], dq[k], ddq[k]), strict=True):
            assert np.abs(got - wanted).max() <= ROUND_OFF[real] * max(1.0, np.abs(wanted).max())

    parameters = np.array([[3.0, 0.5, 0.2], [1.0, 0.1, -0.1]], dtype)
    tau = np.empty(2, dtype)
    speeds = np.array([0.3, -0.7], dtype)
    lib.planar2r_friction_coulomb_viscous(*(pointer(ffi, v, real) for v in (speeds, parameters, tau)))
    wanted = FrictionModel(LAWS["coulomb_viscous"], parameters.astype(float)).torque(speeds.astype(float))
    assert np.abs(tau - wanted).max() <= ROUND_OFF[real] * np.abs(wanted).max()


def loaded(library, real):
    import cffi

    ffi = cffi.FFI()
    vector = f"{real} *"
    ffi.cdef(
        f"void planar2r_kalman_step({', '.join([vector] * 10)});"
        f"void planar2r_trajectory_evaluate({real}, {vector}, {vector}, {vector});"
        f"void planar2r_friction_coulomb_viscous({vector}, {vector}, {vector});"
    )
    return ffi.dlopen(str(library)), ffi, np.dtype(real if real == "double" else "float32")


def pointer(ffi, values, real):
    return ffi.from_buffer(f"{real}[]", values)


def test_tunings_and_motions_that_do_not_fit_are_refused(inputs, tmp_path):
    folder, _ = inputs
    for option, name in (("--tuning", "tuning.json"), ("--trajectory", "trajectory.json")):
        with pytest.raises(Exception, match="2 joints, the robot has 3"):
            run("generate", "rrr", option, folder / name, "-o", tmp_path)
    with pytest.raises(Exception, match="no tuning"):
        run("generate", "planar2r", "--tuning", folder / "trajectory.json", "-o", tmp_path)
    with pytest.raises(Exception, match="--rate belongs to"):
        run("generate", "planar2r", "--rate", 500, "-o", tmp_path)


@pytest.mark.parametrize("variance", ["NaN", "1e999", "0", "-1e-8"])
def test_a_tuning_with_impossible_variances_is_refused(tmp_path, variance):
    (tmp_path / "tuning.json").write_text(f'{{"var_eta": [{variance}], "var_xi": [1.0]}}')
    result = run_command(
        ["generate", "pendulum", "--tuning", str(tmp_path / "tuning.json"), "-o", str(tmp_path / "out")]
    )
    assert result == InputError.exit_code
    assert not (tmp_path / "out").exists()


def test_a_motion_with_an_infinite_coefficient_is_refused(tmp_path):
    (tmp_path / "motion.json").write_text('{"q0": [0], "a": [[1e999]], "b": [[1]], "base_frequency_hz": 0.1}')
    arguments = ["generate", "pendulum", "--trajectory", str(tmp_path / "motion.json"), "-o", str(tmp_path / "out")]
    assert run_command(arguments) == InputError.exit_code


@pytest.mark.parametrize("real", ["double", "float"])
def test_online_estimators_are_strict_c_and_cpp_without_heap(inputs, tmp_path, real):
    folder, _ = inputs
    kinds = ("--estimator", "rls", "--estimator", "gradient", "--trajectory", folder / "trajectory.json")
    result = run(
        "generate",
        "planar2r",
        *kinds,
        "--torque-noise",
        "0.2,0.1",
        "--spread",
        "0.5",
        "--real",
        real,
        "-o",
        tmp_path,
        "--json",
    )
    names = {f"planar2r_{kind}{suffix}" for kind in ("rls", "gradient") for suffix in (".h", ".c")}
    assert names <= set(json.loads(result.output)["files"])
    assert "+- 0.5" in (tmp_path / "planar2r_rls.h").read_text()
    assert not any("malloc" in (tmp_path / name).read_text() for name in names)
    sources = ["planar2r_rls.c", "planar2r_gradient.c"]
    cpp = ["-std=c++11", "-x", "c++", *(flag for flag in FLAGS if flag != "-std=c99"), "-Werror"]
    for command in (["gcc", *FLAGS, *STRICT], ["clang", *FLAGS, *STRICT], ["g++", *cpp], ["clang++", *cpp]):
        try:
            built = subprocess.run(
                [*command, "-fstack-usage", "-c", *sources], cwd=tmp_path, capture_output=True, text=True, check=False
            )
        except FileNotFoundError:
            pytest.skip(f"{command[0]} is not installed")
        assert built.returncode == 0, built.stderr
        for kind in ("rls", "gradient"):
            (used,) = re.findall(r"_update[^\t]*\t(\d+)", (tmp_path / f"planar2r_{kind}.su").read_text())
            (stated,) = re.findall(r"at most (\d+) bytes, and those", (tmp_path / f"planar2r_{kind}.h").read_text())
            assert int(used) <= int(stated)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--gain", "1"), "belongs to --estimator gradient"),
        (("--estimator", "gradient", "--forgetting", "0.9"), "belongs to --estimator rls"),
        (("--estimator", "gradient"), "needs --gain, or the --trajectory"),
        (("--estimator", "rls", "--torque-noise", "0.1,0.2"), "neither one positive number nor 3"),
        (("--estimator", "rls", "--torque-noise", "much"), "neither one positive number nor 3"),
        (("--estimator", "rls", "--fix", "p4"), "not NAME=VALUE"),
        (("--estimator", "rls", "--fix", "p99=1"), "no parameter of rrr"),
    ],
)
def test_options_of_estimators_that_cannot_work_are_refused(tmp_path, options, reason):
    with pytest.raises(Exception, match=reason):
        run("generate", "rrr", *options, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_gain_above_the_bound_of_the_motion_is_refused(inputs, tmp_path):
    folder, _ = inputs
    options = ["--estimator", "gradient", "--gain", "1e6", "--trajectory", str(folder / "trajectory.json")]
    assert run_command(["generate", "planar2r", *options, "-o", str(tmp_path / "out")]) == InputError.exit_code
    assert not (tmp_path / "out").exists()
