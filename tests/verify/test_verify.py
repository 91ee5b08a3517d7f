"""verify accepts a right model, and rejects every way of being wrong that was thought of."""

from __future__ import annotations

import ast
import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import rrrgen.verify as package
from oracles import chapter14
from oracles.newton_euler import Link
from oracles.random_robots import random_robot
from rrrgen.robot.spec import FrictionSpec
from rrrgen.verify import Report, Row, verify
from verify.oracle_model import OracleModel

SAMPLES = 4
FRICTION = FrictionSpec(viscous=0.3, coulomb=0.2, offset=0.1)


def arm(**options) -> OracleModel:
    """The reference arm with random physical links."""
    return OracleModel(chapter14.rrr(random_robot(1, 3).links), **options)


@pytest.fixture(scope="module")
def complete() -> OracleModel:
    return arm(drive=(0.1, 0.2, 0.05), friction=FRICTION)


def test_right_model_passes_against_everything(complete):
    report = verify(complete, samples=SAMPLES)
    assert report.ok, report.to_text()
    asked = {row.reference.split()[0] for row in report.rows}
    skipped = {name.split()[0] for name, _ in report.skipped}
    assert {"Newton-Euler", "identity"} <= asked
    assert asked | skipped >= {"Pinocchio", "MuJoCo", "Robotics"}


@pytest.mark.parametrize("seed", range(6))
def test_random_models_pass(seed):
    report = verify(OracleModel(random_robot(seed, max_joints=5)), samples=SAMPLES)
    assert report.ok, report.to_text()


def test_model_without_links_is_verified_with_random_parameters():
    report = verify(OracleModel(chapter14.rrr()), samples=SAMPLES)
    assert report.ok, report.to_text()
    assert {row.parameters for row in report.rows} == {"-", "random"}


class Broken:
    """A model in which one function is distorted."""

    def __init__(self, model: OracleModel, name: str, distort) -> None:
        self._model, self._name, self._distort = model, name, distort

    def __getattr__(self, name: str):
        attribute = getattr(self._model, name)
        if name != self._name:
            return attribute
        if not callable(attribute):
            return self._distort(attribute)
        return lambda *states, **options: self._distort(attribute(*states, **options))


def flip_largest(value):
    """One sign error, in one entry, at every state: the entry that is largest on average."""
    value = np.array(value)
    entries = value.reshape(len(value), -1)
    k = int(np.argmax(np.mean(np.abs(entries), axis=0)))
    entries[:, k] *= -1
    return entries.reshape(value.shape)


FUNCTIONS = [
    "forward_kinematics",
    "link_frames",
    "jacobian",
    "link_jacobians",
    "jacobian_dot_dq",
    "mass_matrix",
    "coriolis_matrix",
    "coriolis",
    "bias",
    "coriolis_transpose",
    "gravity",
    "inverse_dynamics",
    "forward_dynamics",
    "regressor",
    "standard_regressor",
    "regressor_transpose",
    "identification_regressor",
    "friction",
]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_one_wrong_sign_fails_and_is_named(complete, name):
    report = verify(Broken(complete, name, flip_largest), samples=SAMPLES, libraries=False)
    assert not report.ok
    assert any(name in row.function for row in report.failures), report.to_text()


@pytest.mark.parametrize(
    ("name", "part", "row"),
    [("kinematics", 0, "T"), ("kinematics", 1, "J"), *(("dynamics_terms", k, "Mcg"[k]) for k in range(3))],
)
def test_one_wrong_sign_in_one_of_several_results_fails(complete, name, part, row):
    def distort(values):
        return tuple(flip_largest(value) if k == part else value for k, value in enumerate(values))

    report = verify(Broken(complete, name, distort), samples=SAMPLES, libraries=False)
    assert {r.function for r in report.failures} == {f"{name}: {row}"}


@pytest.mark.parametrize("part", [0, 1])
def test_wrong_energy_fails(complete, part):
    def distort(energies):
        return tuple(-e if k == part else e for k, e in enumerate(energies))

    report = verify(Broken(complete, "energy", distort), samples=SAMPLES, libraries=False)
    assert {"energy, kinetic", "energy, potential"} & {row.function for row in report.failures}
    assert "d(K + U)/dt = tau.dq" in {row.function for row in report.failures}


def test_a_constant_added_to_the_potential_is_no_fault(complete):
    shifted = Broken(complete, "energy", lambda energies: (energies[0], energies[1] + 7.0))
    assert verify(shifted, samples=SAMPLES, libraries=False).ok


@pytest.mark.parametrize("error", [1e-6, 1e-9])
def test_small_errors_fail_too(complete, error):
    report = verify(Broken(complete, "coriolis", lambda c: c * (1 + error)), samples=SAMPLES, libraries=False)
    assert not report.ok


def test_any_coriolis_matrix_with_the_right_product_but_no_skew_symmetry_fails(complete):
    """C dq = c is not enough: the columns (c 0 0)/dq1 give the same product."""

    class Wrong(OracleModel):
        def coriolis_matrix(self, q, dq, *, beta=None):
            C = np.zeros((*q.shape, q.shape[-1]))
            C[..., 0] = self.coriolis(q, dq, beta=beta) / dq[..., :1]
            return C

    report = verify(Wrong(complete.robot), samples=SAMPLES, libraries=False)
    failed = {row.function for row in report.failures}
    assert "dM/dt - 2C skew" in failed
    assert "coriolis_matrix dq" not in failed


def test_misread_inertia_fails_for_nominal_parameters_only():
    """A model whose nominal links have products of the wrong sign is consistent in itself, and still wrong."""
    right = arm()
    signs = np.array([[1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    links = tuple(Link(link.mass, link.com, link.inertia * signs) for link in right.robot.links)
    wrong = OracleModel(right.robot.with_links(links))
    wrong.spec = right.spec
    report = verify(wrong, samples=SAMPLES, libraries=False)
    assert {row.parameters for row in report.failures} == {"nominal"}
    assert "beta = K phi" in {row.function for row in report.failures}


def test_wrong_gravity_direction_fails():
    right = arm()
    wrong = OracleModel(dataclasses.replace(right.robot, gravity=-right.robot.gravity))
    wrong.spec = right.spec
    failed = {row.function for row in verify(wrong, samples=SAMPLES, libraries=False).failures}
    assert {"gravity", "inverse_dynamics", "energy, potential"} <= failed
    assert "mass_matrix" not in failed


def test_too_few_or_too_many_base_parameters_fail():
    count = "number of base parameters (rank)"
    missing = arm()
    missing.base_projection = missing.base_projection[:-1]
    missing.base_parameter_names = missing.identification_parameter_names = missing.base_parameter_names[:-1]
    missing.beta = missing.beta[:-1]
    assert {count, "regressor K"} <= {row.function for row in verify(missing, samples=2, libraries=False).failures}
    doubled = arm()
    K = doubled.base_projection
    doubled.base_projection = np.vstack([K[:1] / np.sqrt(2), K[:1] / np.sqrt(2), K[1:]])
    doubled.base_parameter_names = doubled.identification_parameter_names = (*doubled.base_parameter_names, "p16")
    doubled.beta = doubled.base_projection @ doubled.robot.phi
    assert [row.function for row in verify(doubled, samples=2, libraries=False).failures] == [count]


def test_a_model_that_raises_or_answers_nonsense_fails_without_ending_the_run(complete):
    def refuse(_):
        raise ArithmeticError("M is singular")

    refusing = verify(Broken(complete, "forward_dynamics", refuse), samples=2, libraries=False)
    assert "M is singular" in refusing.to_text()
    assert len(refusing.rows) == len(verify(complete, samples=2, libraries=False).rows)
    shape = verify(Broken(complete, "gravity", lambda g: g[..., :2]), samples=2, libraries=False)
    assert "shape (2, 2) instead of (2, 3)" in shape.to_text()
    undefined = verify(Broken(complete, "jacobian", lambda J: J * np.nan), samples=2, libraries=False)
    assert [row.function for row in undefined.failures] == ["jacobian"]
    row = next(r for r in json.loads(undefined.to_json())["rows"] if r["verdict"] == "fail")
    assert row["max_relative_difference"] is None
    silent = verify(Broken(complete, "mass_matrix", refuse), samples=2, libraries=False)
    assert {"mass_matrix", "identities"} <= {row.function for row in silent.failures}
    assert [name for name, _ in silent.skipped] == ["inverse_kinematics"]


class Without:
    """A model that lacks one function, or answers to every other name through ``__getattr__`` as a wrapper does."""

    def __init__(self, model: OracleModel, name: str) -> None:
        self._model, self._name = model, name

    def __getattr__(self, name: str):
        if name == self._name:
            raise AttributeError(f"no function {name}")
        return getattr(self._model, name)


@pytest.fixture(scope="module")
def whole(complete) -> Report:
    return verify(Without(complete, "nothing"), samples=1, libraries=False)


DERIVATIVES = ["inverse_dynamics_derivatives", "forward_dynamics_derivatives"]


SOME = ["forward_kinematics", "kinematics", "mass_matrix", "regressor", "energy", "friction", *DERIVATIVES]


@pytest.mark.parametrize("name", SOME)
def test_a_function_that_is_not_there_fails_and_nothing_of_ours_is_left_out(complete, whole, name):
    """A check of our own that cannot be made is a failure; only libraries may be left out."""
    report = verify(Without(complete, name), samples=1, libraries=False)
    assert not report.ok
    assert any(name in row.function for row in report.failures), report.to_text()
    assert f"no function {name}" in report.to_text()
    assert [name for name, _ in report.skipped] == ["inverse_kinematics"]  # the oracle solves none
    assert {row.function for row in whole.rows if row.reference != "identity"} <= {row.function for row in report.rows}


def test_derivatives_are_checked_behind_a_wrapper(whole):
    """An object that answers through ``__getattr__`` has no attributes for a static look, as from Python 3.12 on."""
    assert whole.ok, whole.to_text()
    for name in DERIVATIVES:
        assert sum(row.function.startswith(name) for row in whole.rows) == 2 * 4


@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize("name", DERIVATIVES)
def test_one_wrong_sign_in_a_derivative_fails(complete, name, part):
    def distort(values):
        return tuple(flip_largest(value) if k == part else value for k, value in enumerate(values))

    report = verify(Broken(complete, name, distort), samples=1, libraries=False)
    assert {row.function.split(":")[0] for row in report.failures} == {name}


def indefinite_arm() -> OracleModel:
    links = (*chapter14.rrr(random_robot(1, 3).links).links[:2], Link(1.0, np.zeros(3), -2.0 * np.eye(3)))
    return OracleModel(chapter14.rrr(links))


def test_an_indefinite_mass_matrix_must_be_refused():
    report = verify(indefinite_arm(), samples=SAMPLES)
    assert report.ok, report.to_text()
    asked = {row.function for row in report.rows if row.parameters == "nominal"}
    assert {f"{name} refuses an indefinite M" for name in ("forward_dynamics", DERIVATIVES[1])} <= asked
    assert {name for name, _ in report.skipped} <= {"Pinocchio", "MuJoCo", "Robotics Toolbox", "inverse_kinematics"}


@pytest.mark.parametrize("name", ["forward_dynamics", "forward_dynamics_derivatives"])
def test_accelerations_from_an_indefinite_mass_matrix_fail(name):
    class Careless(OracleModel):
        def _accelerations(self, q, dq, tau, phi):
            return np.linalg.solve(self._mass(q, phi), tau - self._bias(q, dq, phi))

    model = indefinite_arm()
    report = verify(Careless(model.robot), samples=SAMPLES, libraries=False)
    assert f"{name} refuses an indefinite M" in {row.function for row in report.failures}


def test_massless_link_is_left_to_the_built_in_reference():
    links = list(random_robot(1, 3).links)
    links[0] = Link(0.0, np.zeros(3), np.diag([0.0, 0.35, 0.0]))
    report = verify(OracleModel(chapter14.rrr(tuple(links))), samples=SAMPLES)
    assert report.ok, report.to_text()
    assert any("no mass" in reason for _, reason in report.skipped)


@pytest.mark.parametrize("module", ["pinocchio", "mujoco", "roboticstoolbox"])
def test_missing_library_is_reported_and_is_no_failure(monkeypatch, complete, module):
    monkeypatch.setitem(sys.modules, module, None)
    report = verify(complete, samples=1)
    assert report.ok
    assert ["not installed" in reason for name, reason in report.skipped if name != "inverse_kinematics"] == [True]
    assert "not asked" in report.to_text()


class Single(OracleModel):
    """Answers rounded to single precision."""

    def __getattribute__(self, name: str):
        attribute = super().__getattribute__(name)
        if name in {*FUNCTIONS, "energy"}:
            return lambda *states, **options: _single(attribute(*states, **options))
        return attribute


def _single(value):
    return tuple(map(np.float32, value)) if isinstance(value, tuple) else np.asarray(value, dtype=np.float32)


def test_single_precision_has_its_own_tolerances(complete):
    report = verify(Single(complete.robot), samples=SAMPLES, libraries=False)
    assert report.ok, report.to_text()
    rounded = Broken(complete, "inverse_dynamics", lambda tau: np.float64(np.float32(tau)))
    assert not verify(rounded, samples=SAMPLES, libraries=False).ok


def test_report_is_reproducible_and_complete(complete):
    first, second = (verify(complete, samples=2, seed=5, libraries=False) for _ in range(2))
    assert first.to_json() == second.to_json()
    assert verify(complete, samples=2, seed=6, libraries=False).to_json() != first.to_json()
    data = json.loads(first.to_json())
    assert data["ok"] is True
    assert data["seed"] == 5
    assert len(data["rows"]) == len(first.rows)
    text = str(first)
    assert text.endswith("rrr: all comparisons pass (2 states, seed 5)\n")
    assert text.count("\n") == len(first.rows) + len(first.skipped) + 3
    with pytest.raises(ValueError, match="samples"):
        verify(complete, samples=0)


def test_verdict_of_a_row():
    def row(difference: float) -> Row:
        return Row("f", "reference", "-", 1, difference, 1e-11)

    assert row(1e-12).ok
    assert not row(1e-10).ok
    assert not row(float("nan")).ok
    assert not Report("robot", 1, 0, ()).ok
    assert "1 of 2 comparisons FAIL" in Report("robot", 1, 0, (row(0.0), row(1.0))).to_text()


def test_nothing_of_the_compiler_is_imported():
    """The references would prove nothing if they shared code with the derivation."""
    allowed = {"rrrgen.base.errors", "rrrgen.robot.spec", "rrrgen.base.tables"}
    for file in Path(package.__file__).parent.glob("*.py"):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for block in [node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node)]:
            tree.body.remove(block)  # names for the type checker, of the model that is judged; nothing of it runs
        for node in ast.walk(tree):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            ours = {name for name in names if name.startswith("rrrgen") and not name.startswith("rrrgen.verify")}
            assert ours <= allowed, f"{file.name}: {ours - allowed}"
