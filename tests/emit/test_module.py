"""The CasADi side of derived robots: functions, rebuilt module, external C with derivatives, IPOPT."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emit.casadi_cases import arguments, as_matrices, build, call
from pipeline.optimized import bundled
from rrrgen.derive import derive
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit.casadi.files import (
    casadi_programs,
    derivatives_of,
    is_reproducible,
    leftover_files,
    serialize,
    sources,
)
from rrrgen.emit.casadi.function import function
from rrrgen.program import Program, Role, evaluate
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.spec import MAX_NAME

ca = pytest.importorskip("casadi")
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc to build the emitted C")

# the same operations in the same order, relative to values of size up to 100 (torques of large robots)
ROUND_OFF = 1e-11
CONVERGED = 1e-6  # two runs of IPOPT with tolerance 1e-9 on problems that differ in round-off

FRICTION_ARM = """
schema: rrrgen/1
name: friction_arm
convention: modified
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
  - {name: lift, type: prismatic, alpha: 0, a: 0, d: 100, theta: 0, friction: {viscous: 3.0, coulomb: 2.0}}
  - {name: swing, type: revolute, alpha: 90, a: 0, d: 0, theta: 0,
     friction: {viscous: 0.4, coulomb: 0.7, offset: 0.1}, drive: {inertia: 0.25}}
links:
  - {mass: 4.0, com: [0, 0, 50], inertia: {about: com, xx: 0.02, yy: 0.02, zz: 0.01, xy: 0, xz: 0, yz: 0}}
  - {mass: 1.5, com: [150, 0, 0], inertia: {about: com, xx: 0.001, yy: 0.02, zz: 0.02, xy: 0, xz: 0, yz: 0}}
"""


@cache
def model(name: str) -> Any:
    if name == "friction_arm":
        return derive(loads_spec(FRICTION_ARM, file="friction_arm.yaml"))
    if name == "bare_gantry":
        return derive(replace(load_spec("gantry"), name=name, links=None))
    return bundled(name)


def imported(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def physical_arguments(derived: Any, program: Program, rng: np.random.Generator) -> list[np.ndarray]:
    """A random state with the robot's own parameters: random ones may make the mass matrix singular."""
    own = {"beta": derived.nominal.get(Role.BASE_PARAMETERS), "eps": 0.01}
    return [
        np.array(own[port.name], float) if own.get(port.name) is not None else value
        for port, value in zip(program.inputs, arguments(program, rng), strict=True)
    ]


def close(got: list[np.ndarray], expected: list[np.ndarray]) -> None:
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=ROUND_OFF, atol=ROUND_OFF * max(1.0, np.abs(other).max()))


@pytest.mark.parametrize(
    "name", ["rrr", "scara", "pendulum", "bare_gantry", "friction_arm", pytest.param("panda", marks=pytest.mark.sweep)]
)
def test_every_function_and_its_rebuilt_twin_equal_the_program(name: str, tmp_path: Path) -> None:
    derived = model(name)
    text = sources(derived)[f"{name}_casadi.py"]
    (tmp_path / f"{name}_casadi.py").write_text(text, encoding="utf-8")
    module = imported(tmp_path / f"{name}_casadi.py")
    rng = np.random.default_rng(4)
    programs = casadi_programs(derived)
    assert list(module.FUNCTIONS) == list(programs)
    for public, program in programs.items():
        values = physical_arguments(derived, program, rng)
        expected = as_matrices(list(evaluate(program, *values)))
        close(call(function(program), values), expected)
        close(call(module.FUNCTIONS[public](), values), expected)
    assert [p.name for p in listing(derived).beta] == [name for name, _ in module.BASE_PARAMETERS]
    if derived.beta_nominal is None:
        assert module.BETA_NOMINAL is None
        assert not any(public.endswith("_nominal") for public in programs)
    else:
        np.testing.assert_array_equal(module.BETA_NOMINAL, [float(v) for v in derived.nominal[Role.BASE_PARAMETERS]])


def test_the_module_of_a_robot_with_a_long_name_is_python() -> None:
    derived = model("pendulum")
    longest = "a" * MAX_NAME + "_any_gravity"
    text = sources(replace(derived, spec=replace(derived.spec, name=longest)))[f"{longest}_casadi.py"]
    returned = [line.strip() for line in text.splitlines() if line.startswith("    return")]
    assert any(len(line) > 116 for line in returned)
    compile(text, "module", "exec")


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    built = {}
    for name in ("rrr", "friction_arm"):
        files = {file: text for file, text in sources(model(name)).items() if not file.endswith(".py")}
        built[name] = build(tmp_path_factory.mktemp(name), files, extra=("-O0",))
    return built


@needs_gcc
@pytest.mark.parametrize("name", ["rrr", "friction_arm"])
def test_external_functions_equal_the_programs(name: str, libraries: dict[str, Path]) -> None:
    rng = np.random.default_rng(8)
    programs = casadi_programs(model(name))
    for public, program in programs.items():
        if not derivatives_of(public, programs):
            continue
        external = ca.external(f"{name}_casadi_{public}", str(libraries[name]))
        values = physical_arguments(model(name), program, rng)
        close(call(external, values), as_matrices(list(evaluate(program, *values))))


@needs_gcc
def test_jacobians_are_the_model(libraries: dict[str, Path]) -> None:
    """d tau/d ddq = M, d tau/d beta = Y, dU/dq = g, d(position)/dq = the linear rows of J."""
    derived, path = model("rrr"), str(libraries["rrr"])
    rng = np.random.default_rng(2)
    q, dq, ddq = rng.uniform(-2, 2, (3, 3))
    beta = np.array([float(v) for v in derived.nominal[Role.BASE_PARAMETERS]])

    def blocks(public: str, *inputs: np.ndarray) -> dict[str, np.ndarray]:
        F = ca.external(f"rrr_casadi_{public}", path)
        results = F.jacobian().call([*inputs, *([0] * F.n_out())])
        return {F.jacobian().name_out(i): np.asarray(ca.DM(r).full()) for i, r in enumerate(results)}

    def program(public: str, *inputs: np.ndarray) -> np.ndarray:
        return evaluate(derived.programs[public], *inputs)[-1]

    tau = blocks("inverse_dynamics", q, dq, ddq, beta)
    close([tau["jac_tau_ddq"]], [program("mass_matrix", q, beta)])
    close([tau["jac_tau_beta"]], [program("regressor", q, dq, ddq)])
    still = blocks("energy", q, 0 * dq, beta)["jac_potential_q"]
    close([still[0]], [program("gravity", q, beta)])
    T = blocks("forward_kinematics", q)["jac_T_q"]
    close([T[12:15]], [program("jacobian", q)[:3]])


def least_effort(kinematics: Any, dynamics: Any) -> dict[str, Any]:
    """The posture that holds the tip at a given height and distance with the least torque."""
    q = ca.MX.sym("q", 3)
    T = kinematics(q)
    tau = dynamics(q, ca.DM.zeros(3), ca.DM.zeros(3))
    reach = T[0, 3] ** 2 + T[1, 3] ** 2
    problem = {"x": q, "f": ca.sumsqr(tau) + 1e-3 * ca.sumsqr(q), "g": ca.vertcat(T[2, 3] - 0.8, reach - 0.2)}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    solution = solver(x0=[0.3, 0.4, 0.5], lbg=0, ubg=0)
    return {"q": solution["x"].full().ravel(), **solver.stats()}


@needs_gcc
def test_ipopt_with_external_functions_takes_the_same_iterations(libraries: dict[str, Path]) -> None:
    names = ("forward_kinematics", "inverse_dynamics_nominal")
    symbolic = least_effort(*(function(model("rrr").programs[name], name) for name in names))
    external = least_effort(*(ca.external(f"rrr_casadi_{name}", str(libraries["rrr"])) for name in names))
    assert symbolic["success"]
    assert external["success"]
    assert external["iter_count"] == symbolic["iter_count"]
    np.testing.assert_allclose(external["q"], symbolic["q"], atol=CONVERGED)


def test_friction_comes_with_a_smooth_twin() -> None:
    programs = casadi_programs(model("friction_arm"))
    dq = np.array([0.8, -0.5])
    expected = [3.0 * 0.8 + 2.0, -0.4 * 0.5 - 0.7 + 0.1]
    np.testing.assert_allclose(evaluate(programs["friction"], dq)[0], expected, rtol=ROUND_OFF)
    smooth = function(programs["friction_smooth"])
    np.testing.assert_allclose(smooth(dq, 1e-3).full().ravel(), expected, rtol=ROUND_OFF)
    slopes = smooth.jacobian()(np.zeros(2), 0.5, 0)[0].full()
    np.testing.assert_allclose(np.diag(slopes), [3.0 + 2.0 / 0.5, 0.4 + 0.7 / 0.5], rtol=ROUND_OFF)


def test_saved_functions_load_and_are_kept_out_of_checks(tmp_path: Path) -> None:
    files = serialize(model("friction_arm"))
    assert files == serialize(model("friction_arm"))
    assert not any(is_reproducible(file) for file in files)
    assert all(is_reproducible(file) for file in sources(model("friction_arm")))
    file = "friction_arm_casadi_gravity_nominal.casadi"
    (tmp_path / file).write_bytes(files[file])
    loaded = ca.Function.load(str(tmp_path / file))
    q = np.array([0.2, 0.7])
    close(call(loaded, [q]), as_matrices(list(evaluate(model("friction_arm").programs["gravity_nominal"], q))))


def test_second_derivatives_come_with_the_nominal_twin() -> None:
    names = ("energy", "standard_regressor")
    without = {name: Program(name, (), (), (), ()) for name in names}
    with_links = without | {
        "energy_nominal": without["energy"].with_fields(name="energy_nominal", specializes="energy")
    }
    assert "fwd1_adj1" in derivatives_of("energy_nominal", with_links)
    assert "fwd1_adj1" not in derivatives_of("energy", with_links)
    assert "fwd1_adj1" in derivatives_of("energy", without)
    assert derivatives_of("standard_regressor", without) == ()


_HASH = """
import hashlib
from rrrgen.emit.casadi.files import sources
from rrrgen.derive import derive
from rrrgen.robot.file import load_spec
print(hashlib.sha256("".join(sources(derive(load_spec("rrr"))).values()).encode()).hexdigest())
"""


def test_sources_repeat_in_a_fresh_process() -> None:
    here = hashlib.sha256("".join(sources(model("rrr")).values()).encode()).hexdigest()
    environment = os.environ | {"PYTHONHASHSEED": "99", "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", _HASH], env=environment, check=True, capture_output=True, text=True, timeout=120
    )
    assert done.stdout.strip() == here


def test_leftover_functions_are_those_of_the_modules(tmp_path):
    module = 'f = ca.Function("a_casadi_f", [q], [x])\ng = ca.Function("a_casadi_g", [q], [x])\n'
    files = {"casadi/a_casadi.py": module, "casadi/a_casadi_g.casadi": b"new"}
    (tmp_path / "casadi").mkdir()
    assert leftover_files(files, tmp_path) == []
    for name in ("a_casadi_f", "a_casadi_g", "a_casadi_mine", "b_casadi_f"):
        (tmp_path / "casadi" / f"{name}.casadi").touch()
    assert leftover_files(files, tmp_path) == ["casadi/a_casadi_f.casadi"]
