"""MEX in Octave, and the C for Simulink: the numbers of an independent recursion, in the order of columns."""

from __future__ import annotations

import ctypes
import re
import shutil

import numpy as np
import pytest

from export.arm import FURTHER, WITH_CONTROL, arm
from export.compared import ours
from export.rrr_library import STRICT, run
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
    for block in blocks:
        name, arguments = re.search(r"(arm_sl_\w+)\((.*)\)$", block).groups()
        sizes = [np.prod([int(s) for s in re.findall(r"\[(\d+)\]", each)]) for each in arguments.split(", ")]
        wanted = [int((re.findall(r"\[(\d+)\]", each) or ["1"])[0]) for each in declared[name].split(", ")]
        assert sizes == wanted, block


def test_matrices_of_simulink_go_by_columns(folder):
    source = folder / "src"
    files = [each.name for each in source.glob("*.c") if not re.search(r"_mex|_calls|arm_ik", each.name)]
    run("gcc", "-std=c99", *STRICT, "-O0", "-fPIC", "-shared", *files, "-lm", "-o", "simulink.so", cwd=source)
    library, J = ctypes.CDLL(str(source / "simulink.so")), np.zeros((2, 6))
    library.arm_sl_jacobian(*(ctypes.c_void_p(each.ctypes.data) for each in (Q, J)))
    T = ours(arm(), Q[None], DQ[None], DDQ[None])[0][0]
    np.testing.assert_allclose(J[0], [-T[1, 3], T[0, 3], 0, 0, 0, 1], atol=1e-14)
    beta, ddq = np.zeros(8), np.zeros(2)
    refused = library.arm_sl_forward_dynamics(*(ctypes.c_void_p(x.ctypes.data) for x in (Q, DQ, DDQ, beta, ddq)))
    assert refused == 1
