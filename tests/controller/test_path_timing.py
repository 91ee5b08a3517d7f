"""Timing of paths: the emitted C against toppra, against a nonlinear program, within its limits, and at its borders."""

from __future__ import annotations

import runpy
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.derive import derive
from rrrgen.emit.package import emit
from rrrgen.robot.file import load_spec

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]

PANDA = {
    "tau_max": np.array([45.0, 75.0, 45.0, 50.0, 6.0, 6.0, 3.0]),
    "dq_max": 2.0 * np.array([2.175] * 4 + [2.61] * 3),
    "ddq_max": np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
}


@pytest.fixture(scope="module")
def panda():
    return rrrgen.compile("panda")


@pytest.fixture(scope="module")
def planar():
    return rrrgen.compile("planar2r")


def path_of(n: int, points: int, seed: int = 0):
    return rrrgen.spline_path(np.random.default_rng(seed).uniform(-1.2, 1.2, (6, n)), points)


def reference(model, path, limits, coulomb):
    """The duration by toppra, with the interpolation scheme."""
    toppra = pytest.importorskip("toppra", reason="toppra is not installed")
    from scipy.interpolate import BPoly

    toppra.setup_logging("ERROR")

    class Sampled(toppra.interpolator.AbstractGeometricPath):
        """The path at its own points."""

        dof = model.n
        path_interval = path.s[[0, -1]]
        waypoints = path.s, path.q
        pieces = BPoly.from_derivatives(path.s, np.stack([path.q, path.q_s, path.q_ss], axis=1))

        def __call__(self, s, order=0):
            return self.pieces(s, order)

    scheme = {"discretization_scheme": toppra.constraint.DiscretizationType.Interpolation}
    both = lambda name: np.stack([-limits[name], limits[name]], axis=1)  # noqa: E731
    constraints = [toppra.constraint.JointVelocityConstraint(both("dq_max"))]
    if np.all(np.isfinite(limits["ddq_max"])):
        constraints.append(toppra.constraint.JointAccelerationConstraint(both("ddq_max"), **scheme))
    torque = model.inverse_dynamics
    constraints.append(toppra.constraint.JointTorqueConstraint(torque, both("tau_max"), coulomb, **scheme))
    solver = toppra.algorithm.TOPPRA(constraints, Sampled(), gridpoints=path.s, solver_wrapper="seidel")
    speed = solver.compute_parameterization(0, 0)[1]
    return float(2.0 * np.sum(np.diff(path.s) / (speed[1:] + speed[:-1])))


def friction(model, viscous, coulomb):
    return np.stack(np.broadcast_arrays(viscous, coulomb, np.zeros(model.n)), axis=1).ravel()


TENTHS, EIGHTHS = (np.arange(10) + 0.5) / 10, np.arange(9) / 8


def worst(model, timed, limits, viscous=0.0, coulomb=0.0, finer=TENTHS):
    """The largest ratio of torque, speed and acceleration to their limits on a finer grid of the spline."""
    x, s = np.square(timed.ds_dt), timed.path.s
    u = timed.d2s_dt2
    inside = finer * np.diff(s)[:, None]
    reached = np.sqrt(x[:-1, None] + 2.0 * u[:, None] * inside)
    times = timed.t[:-1, None] + 2.0 * inside / (timed.ds_dt[:-1, None] + reached)
    q, dq, ddq = timed.sample(times.ravel())
    tau = model.inverse_dynamics(q, dq, ddq) + viscous * dq + coulomb * np.sign(dq)
    found = {"tau_max": tau, "dq_max": dq, "ddq_max": ddq}
    return {name: float(np.max(np.abs(value) / limits[name])) for name, value in found.items()}


@pytest.mark.parametrize(("seed", "ddq_max"), [(0, PANDA["ddq_max"]), (1, np.full(7, np.inf))])
def test_duration_is_that_of_toppra(panda, seed, ddq_max):
    path, coulomb = path_of(7, 1000, seed), np.full(7, 0.3)
    limits = PANDA | {"ddq_max": ddq_max}
    timed = panda.time_path(path, **limits, friction=friction(panda, 0.0, coulomb))
    assert timed.duration / timed.stretch == pytest.approx(reference(panda, path, limits, coulomb), rel=1e-5)
    assert 1.0 <= timed.stretch < 1.003


def test_finer_grid_keeps_the_limits(panda):
    path = path_of(7, 1000)
    viscous, coulomb = np.array([2, 2, 2, 2, 0.25, 0.25, 0.1]), np.full(7, 0.05)
    timed = panda.time_path(path, **PANDA, friction=friction(panda, viscous, coulomb))
    found = worst(panda, timed, PANDA, viscous, coulomb)
    assert 0.99 < found["tau_max"] < 1.02, "a limit is touched, and none is exceeded"
    told = worst(panda, timed, PANDA, viscous, coulomb, EIGHTHS)["tau_max"]
    assert timed.torque_share == pytest.approx(told, rel=1e-9)
    assert found["ddq_max"] <= 1.0
    assert found["dq_max"] <= 1.0


def test_a_grid_too_coarse_is_told(planar):
    """Strong viscous friction: between few points the torques exceed their limits, and more points mend it."""
    viscous = np.array([2.0, 1.0])
    held = np.max(np.abs(planar.gravity(path_of(2, 201, 4).q)), axis=0)
    limits = free(2) | {"tau_max": 1.5 * held}
    losses = friction(planar, viscous, 0.0)
    with pytest.warns(
        UserWarning, match="between the 51 points of the path the torques exceed their limits by up to 5 %"
    ):
        timed = planar.time_path(path_of(2, 51, 4), **limits, friction=losses)
    assert worst(planar, timed, limits, viscous)["tau_max"] > 1.03
    told = worst(planar, timed, limits, viscous, 0.0, EIGHTHS)["tau_max"]
    assert timed.torque_share == pytest.approx(told, rel=1e-9)
    assert planar.time_path(path_of(2, 51, 4), **free(2) | {"dq_max": np.ones(2)}).torque_share == 0.0
    with warnings.catch_warnings(action="error"):
        timed = planar.time_path(path_of(2, 201, 4), **limits, friction=losses)
    assert worst(planar, timed, limits, viscous)["tau_max"] < 1.02


def spline_paths(count: int, points: int):
    """Random paths of 2 to 7 joints through four waypoints, with the speed and acceleration limits of the Panda."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        n = int(rng.integers(2, 8))
        limits = free(n) | {name: PANDA[name][:n] for name in ("dq_max", "ddq_max")}
        yield rrrgen.spline_path(rng.uniform(-1.2, 1.2, (4, n)), points), limits


def kernel_of(n: int):
    """The timing for a robot of ``n`` joints without inertia or friction, so that speeds and accelerations decide."""
    from rrrgen.program import Builder, Port, Program
    from rrrgen.runtime.paths import TimingKernel

    def zero(name: str, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Program:
        b = Builder()
        for each in inputs:
            b.input(Port(each, (n,)))
        return b.program(name, [(Port(each, (n,)), [0] * n) for each in outputs])

    dynamics = zero("path_dynamics", ("q", "q_s", "q_ss"), ("a", "b", "g"))
    return TimingKernel(f"free{n}", dynamics, zero("friction_with", ("dq", "friction"), ("tau_f",)), "double")


def excess_and_stretch(count: int, points: int, inside: int) -> tuple[float, np.ndarray]:
    """The largest share of a limit over ``count`` paths at ``inside`` instants of every interval, and the stretches."""
    kernels, most, stretches = {n: kernel_of(n) for n in range(2, 8)}, 0.0, []
    for path, limits in spline_paths(count, points):
        kernel = kernels[path.q.shape[1]]
        status, _, ds_dt, t, stretch = kernel.time(path, limits, None, (0.0, 0.0), {})
        assert status == 0
        shares = kernel.check(path, limits, None, {}, ds_dt)
        z = np.linspace(0.0, 1.0, inside)
        times = (t[:-1, None] + z * np.diff(t)[:, None]).ravel()
        speed = acceleration = 0.0
        for block in np.array_split(times, 1 + len(times) // 20_000):  # all at once would take a gigabyte
            _, dq, ddq = kernel.sample(path, ds_dt, t, block)
            speed = max(speed, np.max(np.abs(dq) / limits["dq_max"]))
            acceleration = max(acceleration, np.max(np.abs(ddq) / limits["ddq_max"]))
        for share, sampled in zip(shares, (0.0, speed, acceleration), strict=True):
            assert sampled <= share * (1.0 + 1e-9)
            assert sampled >= 0.99 * share, "the bound is close to what is reached"
        most = max(most, speed, acceleration)
        stretches.append(stretch)
    return most, np.array(stretches)


@pytest.mark.parametrize(("points", "median", "largest"), [(11, 1.1, 1.17), (51, 1.01, 1.03)])
def test_limits_hold_between_the_points(points, median, largest):
    """A small version of ``python -m tests.controller.timed_paths``, which takes 125 paths and up to 1001 points."""
    most, stretches = excess_and_stretch(12, points, 60)
    assert most <= 1.0 + 1e-9
    assert 1.0 < np.median(stretches) < median
    assert stretches.max() < largest


def test_a_stretch_above_two_percent_is_told(planar):
    limits = free(2) | {"dq_max": np.ones(2), "ddq_max": np.full(2, 2.0)}
    with pytest.warns(
        UserWarning, match=r"between the 7 points .* the whole motion takes \d+ % longer: take more points"
    ):
        coarse = planar.time_path(path_of(2, 7, 4), **limits)
    with warnings.catch_warnings(action="error"):
        fine = planar.time_path(path_of(2, 401, 4), **limits)
    assert coarse.stretch > 1.02 > fine.stretch >= 1.0
    for timed in (coarse, fine):
        assert max(timed.speed_share, timed.acceleration_share) == pytest.approx(1.0, abs=2e-4)
        found = worst(planar, timed, limits | {"tau_max": np.full(2, 1e9)})
        assert max(found["dq_max"], found["ddq_max"]) <= 1.0 + 1e-9


def test_friction_is_evaluated_at_the_stretched_speed(planar):
    """Friction that falls with the speed grows when the motion is stretched: the share of torque says so."""
    path = path_of(2, 9, 4)
    held = np.max(np.abs(planar.gravity(path.q)), axis=0)
    limits = {"tau_max": 4.0 * held, "dq_max": np.full(2, 3.0), "ddq_max": np.full(2, 6.0)}
    viscous = np.array([0.8, 0.4])
    with warnings.catch_warnings(action="ignore"):
        timed = planar.time_path(path, **limits, friction=friction(planar, viscous, 0.1))
    told = worst(planar, timed, limits, viscous, 0.1, EIGHTHS)["tau_max"]
    assert timed.torque_share == pytest.approx(told, rel=1e-9)


def best_by_nonlinear_program(model, path, limits, viscous):
    """The shortest duration that IPOPT finds, with the square root in the friction as it is."""
    casadi = pytest.importorskip("casadi")
    a, b, g = model.path_dynamics(path.q, path.q_s, path.q_ss)
    ds, count = np.diff(path.s), len(path.s)
    problem = casadi.Opti()
    v = problem.variable(count)  # ds/dt
    x = v**2
    u = (x[1:] - x[:-1]) / (2 * ds)
    for j in range(model.n):
        for end in (slice(0, count - 1), slice(1, count)):
            tau = a[end, j] * u + b[end, j] * x[end] + g[end, j] + viscous[j] * path.q_s[end, j] * v[end]
            problem.subject_to(problem.bounded(-limits["tau_max"][j], tau, limits["tau_max"][j]))
    problem.subject_to(v[0] == 0)
    problem.subject_to(v[-1] == 0)
    problem.subject_to(v >= 0)
    problem.set_initial(v, np.sin(np.pi * path.s) * 0.3)
    problem.minimize(casadi.sum1(2 * ds / (v[1:] + v[:-1])))
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-10})
    return float(problem.solve().value(problem.f))


@pytest.mark.parametrize("seed", [0, 3, 4])
def test_viscous_friction_against_a_nonlinear_program(planar, seed):
    path, viscous = path_of(2, 201, seed), np.array([2.0, 1.0])
    held = np.max(np.abs(planar.gravity(path.q)), axis=0)
    limits = {"tau_max": 1.5 * held, "dq_max": np.full(2, np.inf), "ddq_max": np.full(2, np.inf)}
    timed = planar.time_path(path, **limits, friction=friction(planar, viscous, 0.0))
    best = best_by_nonlinear_program(planar, path, limits, viscous)
    assert timed.duration == pytest.approx(best, rel=5e-5)
    assert abs(planar.time_path(path, **limits).duration / best - 1) > 0.05, "friction matters here"


@pytest.fixture(scope="module")
def rrr():
    return rrrgen.compile("rrr")


def line(n: int, points: int = 201):
    """A straight path whose parameter is the angle of every joint."""
    s = np.linspace(0.0, 1.0, points)
    return rrrgen.Path(s, np.outer(s, np.ones(n)), np.ones((points, n)), np.zeros((points, n)))


def free(n: int) -> dict:
    return {name: np.full(n, np.inf) for name in ("tau_max", "dq_max", "ddq_max")}


def test_a_trapezoidal_motion(rrr):
    """On a straight path under speed and acceleration alone the answer is known."""
    limits = free(3) | {"dq_max": np.array([1.0, 2.0, 0.5]), "ddq_max": np.array([4.0, 3.0, 8.0])}
    timed = rrr.time_path(line(3), **limits)
    assert timed.duration == pytest.approx(1 / 0.5 + 0.5 / 3.0, rel=1e-4)
    assert np.max(timed.ds_dt) == pytest.approx(0.5)
    moving = rrr.time_path(line(3), **limits, start=0.5, end=0.25)
    assert moving.ds_dt[[0, -1]] == pytest.approx([0.5, 0.25])
    assert moving.duration < timed.duration


def test_sampled_motion_is_consistent(panda):
    path = path_of(7, 400)
    timed = panda.time_path(path, **PANDA)
    times = np.linspace(-0.1, timed.duration + 0.1, 9001)
    q, dq, ddq = timed.sample(times)
    assert np.array_equal(q[[0, -1]], path.q[[0, -1]])
    assert np.max(np.abs(dq[[0, -1]])) < 1e-12
    step = times[1] - times[0]
    np.testing.assert_allclose((q[2:] - q[:-2]) / (2 * step), dq[1:-1], atol=20 * step)
    k = np.searchsorted(timed.t, times)
    inside = (k[2:] == k[:-2]) & (times[:-2] > 0) & (times[2:] < timed.duration)  # u jumps at the points
    np.testing.assert_allclose(((dq[2:] - dq[:-2]) / (2 * step))[inside], ddq[1:-1][inside], atol=0.02)
    at_points = timed.sample(timed.t)
    np.testing.assert_allclose(at_points.q_d, path.q, atol=1e-9)
    np.testing.assert_allclose(at_points.dq_d, path.q_s * timed.ds_dt[:, None], atol=1e-6)


def test_no_time_has_no_motion(rrr):
    motion = rrr.time_path(line(3), **free(3) | {"dq_max": np.full(3, 2.0), "ddq_max": np.full(3, 2.0)}).sample([])
    assert motion.q_d.shape == (0, 3)


def test_the_arm_rests_before_and_after_the_motion(rrr):
    """Also where speed and acceleration at the ends are not zero: a controller would follow them off the end."""
    limits = free(3) | {"dq_max": np.full(3, 2.0), "ddq_max": np.full(3, 5.0)}
    for ends in ({}, {"start": 0.5, "end": 0.5}):
        timed = rrr.time_path(line(3), **limits, **ends)
        q, dq, ddq = timed.sample([-1e-9, timed.duration * (1 + 1e-12), timed.duration + 1.0])
        np.testing.assert_array_equal(q, timed.path.q[[0, -1, -1]])
        assert not np.any(dq)
        assert not np.any(ddq)
        assert np.all(np.abs(timed.sample([0.0, timed.duration]).ddq_d) > 1.0)


def test_speed_limits_without_any_torque_limit_and_without_any_limit(rrr):
    timed = rrr.time_path(line(3), **free(3) | {"dq_max": np.full(3, 2.0)}, start=2.0, end=2.0)
    assert timed.duration == pytest.approx(0.5)
    with pytest.raises(InputError, match="no limit bounds the speed"):
        rrr.time_path(line(3), **free(3))


def test_what_cannot_be_timed(rrr):
    held = np.max(np.abs(rrr.gravity(line(3).q)), axis=0)
    some = free(3) | {"dq_max": np.full(3, 2.0), "ddq_max": np.full(3, 2.0)}
    with pytest.raises(InputError, match=r"at any speed: point \d+, s = .*; to hold the arm against gravity q2 needs"):
        rrr.time_path(line(3), **some | {"tau_max": np.where(held > 0, 0.5 * held, 1.0)})
    with pytest.raises(InputError, match="from the speed at the start: point 0"):
        rrr.time_path(line(3), **some | {"ddq_max": np.full(3, 1.0)}, start=2.0)
    with pytest.raises(InputError, match="at the end is above the limits: point 200, s = 1"):
        rrr.time_path(line(3), **some, end=3.0)
    with pytest.raises(InputError, match="not usable"):
        rrr.time_path(line(3), **some | {"tau_max": np.array([1.0, 0.0, 1.0])})
    with pytest.raises(InputError, match="not usable"):
        rrr.time_path(line(3), **some, start=-1.0)
    with pytest.raises(InputError, match="has 2 joints, rrr has 3"):
        rrr.time_path(line(2), **some)
    with pytest.raises(ValueError, match=r"tau_max must be 3 numbers, \(3,\), not \(2,\)"):
        rrr.time_path(line(3), tau_max=[1.0, 2.0])
    with pytest.raises(ValueError, match=r"tau_max must be 3 numbers, not \[nan, 1.0, 1.0\]"):
        rrr.time_path(line(3), tau_max=[np.nan, 1.0, 1.0])
    with pytest.raises(ValueError, match="the robot file gives no drive inertia, so Ia is not part of the model"):
        rrr.time_path(line(3), **some, Ia=[1.0, 1.0, 1.0])
    with pytest.raises(TypeError, match=r"path is of type list; rrrgen.spline_path\(waypoints\) makes a path"):
        rrr.time_path([[0, 0, 0], [1, 1, 1]])


def test_a_joint_without_inertia_along_the_path(planar):
    """At rest in one joint, and turning back in the other: rows in which the acceleration does not appear."""
    s = np.linspace(0.0, 1.0, 301)
    angle = np.sin(np.pi * s)
    path = rrrgen.Path(
        s,
        np.stack([0 * s, angle], axis=1),
        np.stack([0 * s, np.pi * np.cos(np.pi * s)], axis=1),
        np.stack([0 * s, -(np.pi**2) * angle], axis=1),
    )
    held = np.max(np.abs(planar.gravity(path.q)), axis=0)
    limits = free(2) | {"tau_max": 2 * held, "dq_max": np.full(2, 50.0)}
    coulomb = 0.1 * held
    timed = planar.time_path(path, **limits, friction=friction(planar, 0.0, coulomb))
    assert np.isfinite(timed.duration)
    assert worst(planar, timed, limits, 0.0, coulomb * [0, 1])["tau_max"] < 1.02


def test_gravity_payload_and_precision(rrr):
    path = path_of(3, 300)
    held = np.max(np.abs(rrr.gravity(path.q)), axis=0)
    limits = free(3) | {"tau_max": 2.5 * held + [50.0, 0.0, 0.0], "dq_max": np.full(3, 9.0)}
    down = rrr.time_path(path, **limits)
    g = rrr.nominal_gravity
    assert rrr.time_path(path, **limits, gravity=g).duration == pytest.approx(down.duration, rel=1e-9)
    assert rrr.time_path(path, **limits, gravity=0 * g).duration < down.duration
    loaded = rrr.add_payload(mass=0.2, com=[0, 0, 0], inertia=np.zeros((3, 3)))
    assert rrr.time_path(path, **limits, beta=loaded).duration > down.duration
    short = rrrgen.compile("rrr", real="float").time_path(path, **limits)
    assert short.ds_dt.dtype == np.float32
    assert short.duration / short.stretch == pytest.approx(down.duration / down.stretch, rel=1e-4)
    with pytest.raises(rrrgen.base.errors.BuildError, match="numpy"):
        rrrgen.compile("rrr", backend="numpy").time_path(path, **limits)


def test_the_figure_of_the_page(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    script = Path(__file__).resolve().parents[2] / "examples/path-timing/figure.py"
    folder = tmp_path / "figures"
    monkeypatch.setattr(sys, "argv", [str(script), "-o", str(folder)])
    with warnings.catch_warnings(action="error"):  # as one that took friction away where the motion ends
        runpy.run_path(str(script), run_name="__main__")
    assert {path.name for path in folder.iterdir()} == {"path-timing.png", "path-timing.svg"}
    told = capsys.readouterr().out
    assert 0.99 < float(told.split()[-1]) < 1.02, "the torques touch their limits and keep them"


@pytest.mark.parametrize(
    ("command", "real"), [("gcc", "float"), ("clang", "double"), ("g++", "double"), ("clang++", "float")]
)
@pytest.mark.sweep(but=["gcc-float", "g++-double"])
def test_the_emitted_files_compile_without_a_warning(command, real, tmp_path):
    if shutil.which(command) is None:
        pytest.skip(f"{command} is not installed")
    derived = derive(load_spec("planar2r"), groups=("model", "timing"))
    files = emit(derived, real)
    assert {"planar2r_timing.h", "planar2r_timing.c"} <= set(files)
    assert "planar2r_timing.c" in files["CMakeLists.txt"]
    for name in ("planar2r.h", "planar2r_timing.h", "planar2r_timing.c"):
        (tmp_path / name).write_text(files[name], encoding="utf-8")
    optimized = ["-O2"] if command == "gcc" else ["-fsyntax-only"]  # only gcc has warnings that need the optimizer
    language = ["-x", "c++", "-std=c++11"] if command.endswith("++") else ["-std=c99", "-Wstrict-prototypes"]
    done = subprocess.run(
        [command, *language, *WARNINGS, *optimized, "-c", "planar2r_timing.c", "-o", "out.o"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
