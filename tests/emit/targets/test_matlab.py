"""MEX in Octave, and the C for Simulink: the numbers of an independent recursion, in the order of columns."""

from __future__ import annotations

import ctypes
import re
import shutil

import numpy as np
import pytest

import rrrgen
from emit.targets.arm import FURTHER, WITH_CONTROL, arm
from emit.targets.compared import ours
from emit.targets.rrr_library import STRICT, run
from pages.test_pages import ROOT
from pages.test_pages import blocks as blocks_of
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot

Q, DQ, DDQ = np.array([0.3, -0.8]), np.array([0.5, 0.25]), np.array([-1.0, 2.0])

PROGRAM = """
q = [0.3; -0.8]; dq = [0.5; 0.25]; ddq = [-1; 2];
T = arm.forward_kinematics(q);
frames = arm.link_frames(q);
tau = arm.inverse_dynamics(q, dq, ddq);
beta = arm.nominal_parameters();
assert(arm.inverse_dynamics(q, dq, ddq, beta), tau);
J = arm.jacobian([q, 0*q]);
assert(size(J), [6 2 2]);
[M, c, g] = arm.dynamics_terms([q, q], dq);
assert(M(:, :, 2) * ddq + c(:, 2) + g(:, 1), tau, 1e-12);
loaded = arm.add_payload(1.5, [0; 0; 0.1], diag([1 2 3]) * 1e-3);
assert(any(loaded != beta));
x = arm.inverse_kinematics(T(1:3, 4), q, 2);
assert(x(:, 1), q, 1e-9);
[x, flags, branch, status, text] = arm.inverse_kinematics([9; 9; 0]);
assert(isempty(x) && status == 1 && ! isempty(strfind(text, 'out of reach')));
gains = {400*[1;1], 40*[1;1], [0;0], [0;0]};
friction = arm.nominal_friction(); given = {beta, friction, [Inf;Inf]};
[tracked, z] = arm.computed_torque(q, dq, q + 0.01, dq, ddq, gains{:}, [0.01;0.01], 1e-3, given{:});
assert(tracked, arm.inverse_dynamics(q, dq, ddq + 4) + arm.smooth_friction(dq, friction, [0.01;0.01]), 1e-9);
Jq = arm.jacobian(q); any_speed = [Inf; Inf];
limits = {[1;1;1;0;0;0], [0;0], 1e-6, -any_speed, any_speed};
assert(arm.differential_ik(q, [0;0], Jq, Jq*dq, limits{:}, any_speed, any_speed, 1e-3), dq, 1e-6);
[slow, status] = arm.differential_ik([q q], [9 0; 9 0], Jq, Jq*dq, limits{:}, [1;1], [1e4;1e4], 1e-3);
assert(status, [0 0]);
[slow, status] = arm.differential_ik([q q], [9 0; 9 0], Jq, Jq*dq, limits{:}, [1;1], [1;1], 1e-3);
assert(status, [1 0]);
assert(slow(:, 1), [9; 9] - 1e-3, 1e-12);
s = linspace(0, 1, 101); path = {s, [s; 2*s], [1 + 0*s; 2 + 0*s], 0*[s; s]};
[ds_dt, t, share] = arm.time_path(path{:}, [60;30], [6;6], [Inf;Inf]);
assert(share > 0.98 && share < 1.02);
[q_d, dq_d, ddq_d] = arm.timed_path(path{:}, ds_dt, t, t(1:end-1));
assert(q_d, path{2}(:, 1:end-1), 1e-9);
assert(max(max(abs(arm.inverse_dynamics(q_d, dq_d, ddq_d) + arm.friction(dq_d)) ./ [60;30])) < 1.02);
[q_d, dq_d] = arm.fourier([0 2.5], 0.1, [0;0], [1;2], [0;0]);
assert(dq_d, [1 0; 2 0], 1e-12);
[q_d, dq_d] = arm.fourier([0 1], 0.1, [0;0], [1 2 3;4 5 6], zeros(2, 3));
assert(dq_d(:, 1), [6;15], 1e-12);
addpath any_gravity; build_arm_any_gravity;
assert(arm_any_gravity.inverse_dynamics(q, dq, ddq, [0;-9.81;0]), tau, 1e-12);
assert(norm(arm_any_gravity.inverse_dynamics(q, dq, ddq, [9.81;0;0]) - tau) > 1);
[~, quick] = arm_any_gravity.time_path(path{:}, [0;0;0], [60;30], [6;6], [Inf;Inf]);
assert(quick(end) < t(end));
function refused(call, id)
  try
    call();
  catch err
    assert(err.identifier, id);
    return
  end
  error('nothing was refused');
end
refused(@() arm.gravity([1; 2; 3]), 'arm:size');
refused(@() arm.gravity(single(q)), 'arm:type');
refused(@() arm.gravity(q + i), 'arm:type');
refused(@() arm.time_path(path{:}, [1;1]), 'arm:timing');
refused(@() arm.fourier(0, 0, q, q, q), 'arm:status');
refused(@() arm_mex('gravity', q), 'arm:arguments');
refused(@() arm_mex('gravitas', q), 'arm:name');
refused(@() arm.forward_dynamics(q, dq, tau, 0*beta), 'arm:status');
printf('%.17g ', T, frames, tau, J(:, :, 1)); printf('\\n');
arm_blocks();
"""

LEGACY_CODE = """
function block = legacy_code(task, block)
  if strcmp(task, 'initialize')
    block = struct('Options', struct());
  elseif strcmp(task, 'sfcn_cmex_generate')
    printf('block %s %s\\n', block.SFunctionName, block.OutputFcnSpec);
  end
end
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("matlab")
    for name, text in export_robot(
        arm(), "matlab", options=ExportOptions(further=(*WITH_CONTROL, *FURTHER))
    ).files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return place


@pytest.mark.skipif(shutil.which("mkoctfile") is None, reason="needs Octave and its headers (octave-dev)")
def test_octave(folder):
    (folder / "legacy_code.m").write_text(LEGACY_CODE, encoding="utf-8")
    (page,) = blocks_of((ROOT / "docs/sockets.md").read_text(encoding="utf-8"), "matlab")
    first, *others = page.replace("rrr", "arm").splitlines()
    assert first.split(";")[1].split("%")[0].strip() == "build_arm"
    build, example = blocks_of((folder / "README.md").read_text(encoding="utf-8"), "matlab")
    assert build.strip() == "build_arm"
    (folder / "use.m").write_text("\n".join(["1;", PROGRAM, *others, example, ""]), encoding="utf-8")
    out = run("octave-cli", "-q", "--eval", "setenv('CFLAGS', '-O0'); build_arm; use", cwd=folder)
    numbers, *blocks = out.splitlines()
    T, tau = (each[0] for each in ours(arm(), Q[None], DQ[None], DDQ[None]))
    found = np.array(numbers.split(), dtype=float)
    np.testing.assert_allclose(found[:16].reshape(4, 4).T, T, atol=1e-14)
    np.testing.assert_allclose(found[32:48].reshape(4, 4).T, T, atol=1e-14)  # of the last link, which has no tool
    np.testing.assert_allclose(found[48:50], tau, rtol=1e-12)
    np.testing.assert_allclose(found[50:].reshape(2, 6)[0, :2], [-T[1, 3], T[0, 3]], atol=1e-14)  # z x p
    check_blocks(blocks, (folder / "src" / "arm_simulink.h").read_text(encoding="utf-8"))


def check_blocks(blocks: list[str], header: str) -> None:
    """Every specification of legacy_code has the name, the number and the sizes of arguments of a declaration."""
    declared = dict(re.findall(r"^\w+ (arm_sl_\w+)\((.*)\);$", header, re.M))
    assert len(blocks) > 30
    assert {"arm_sl_time_path", "arm_sl_timed_path", "arm_sl_fourier"} <= declared.keys()
    for block in blocks:
        name, arguments = re.search(r"(arm_sl_\w+)\((.*)\)$", block).groups()
        sizes = [size_of_block(each) for each in arguments.split(", ")]
        wanted = [size_of_declaration(each) for each in declared[name].split(", ")]
        assert sizes == wanted, block


def size_of_block(argument: str) -> int:
    """The number of elements of an argument in the syntax of legacy_code; 0 where another argument says it."""
    of_another = "[]" in argument or re.search(r"\[size\(u\d,\d\)\]", argument)
    return 0 if of_another else int(np.prod([int(s) for s in re.findall(r"\[(\d+)\]", argument)]))


def size_of_declaration(argument: str) -> int:
    return 0 if "[]" in argument else int((re.findall(r"\[(\d+)\]", argument) or ["1"])[0])


def test_matrices_of_simulink_go_by_columns(folder):
    source = folder / "src"
    files = [each.name for each in source.glob("*.c") if not re.search(r"_mex|_calls|arm_ik", each.name)]
    run("gcc", "-std=c99", *STRICT, "-O0", "-fPIC", "-shared", *files, "-lm", "-o", "simulink.so", cwd=source)
    library, J = ctypes.CDLL(str(source / "simulink.so")), np.zeros((2, 6))
    library.arm_sl_jacobian(*addresses(Q, J))
    T = ours(arm(), Q[None], DQ[None], DDQ[None])[0][0]
    np.testing.assert_allclose(J[0], [-T[1, 3], T[0, 3], 0, 0, 0, 1], atol=1e-14)
    beta, ddq = np.zeros(8), np.zeros(2)
    assert library.arm_sl_forward_dynamics(*addresses(Q, DQ, DDQ, beta, ddq)) == 1
    check_motions(library)


def addresses(*arrays: np.ndarray) -> list[ctypes.c_void_p]:
    return [ctypes.c_void_p(each.ctypes.data) for each in arrays]


def check_motions(library: ctypes.CDLL) -> None:
    """Timing of a path and Fourier series: the motions of Python, from columns of points and of harmonics."""
    m = rrrgen.compile(arm())
    path = rrrgen.spline_path([[0.0, 0.0], [1.0, -0.5], [0.3, 0.4]], points=41)
    limits, friction, beta = ([60.0, 30.0], [6.0, 6.0], [np.inf, np.inf]), m.friction_parameters, np.zeros(8)
    library.arm_sl_nominal_parameters(*addresses(beta))
    timed = m.time_path(path, tau_max=limits[0], dq_max=limits[1], ddq_max=limits[2])
    points = len(path.s)
    samples = addresses(*(np.ascontiguousarray(each) for each in (path.s, path.q, path.q_s, path.q_ss)))
    work, ds_dt, t, shares = np.zeros((8, points)), np.zeros(points), np.zeros(points), np.zeros(4)
    given = [np.array(each, dtype=float) for each in (*limits, friction, beta)]
    call = library.arm_sl_time_path
    assert call(points, *samples, *addresses(*given, work, ds_dt, t, shares)) == 0
    np.testing.assert_allclose(t, timed.t, rtol=1e-12)
    np.testing.assert_allclose(
        shares, [timed.torque_share, timed.speed_share, timed.acceleration_share, timed.stretch], rtol=1e-9
    )
    found = np.zeros((3, 2))
    for now in (0.0, 0.4 * timed.duration, 2 * timed.duration):
        library.arm_sl_timed_path(points, *samples, *addresses(ds_dt, t), ctypes.c_double(now), *addresses(*found))
        np.testing.assert_allclose(found, timed.sample(now), atol=1e-9)
    assert call(points, *samples, *addresses(np.zeros(2), *given[1:], work, ds_dt, t, shares)) == 1
    q0, a, b = (
        np.array([0.1, -0.2]),
        np.array([[1.0, -0.5, 0.2], [0.3, 0.4, 0.1]]),
        np.array([[0.2, 0.1, 0], [0, 0, 0.3]]),
    )
    now, rate, series = (
        ctypes.c_double(3.7),
        ctypes.c_double(0.2),
        addresses(*(np.ascontiguousarray(x.T) for x in (a, b))),
    )
    library.arm_sl_fourier(now, rate, *addresses(q0), 3, *series, *addresses(*found))
    w = 2 * np.pi * 0.2 * np.arange(1, 4)
    sine, cosine = np.sin(3.7 * w), np.cos(3.7 * w)
    expected = [q0 + (a * sine - b * cosine) @ (1 / w), a @ cosine + b @ sine, (b * cosine - a * sine) @ w]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    library.arm_sl_fourier(ctypes.c_double(np.nan), rate, *addresses(q0), 3, *series, *addresses(*found))
    np.testing.assert_array_equal(found, [q0, [0, 0], [0, 0]])
