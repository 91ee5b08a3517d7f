"""Geometric calibration on virtual measurements: counts of parameters, held-out errors, deviations, outliers, files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from calibrate.virtual import NOISE, measure, off_the_table, positions, touching
from rrrgen.calibrate.estimation import calibrate
from rrrgen.calibrate.fixtures import Fixture
from rrrgen.calibrate.geometry import Geometry, geometry_of, rigid, rotation_vectors
from rrrgen.calibrate.measurement_file import read_measurements
from rrrgen.calibrate.measurements import Measurements
from rrrgen.calibrate.minimal_set import minimal_set
from rrrgen.calibrate.pose_choice import choose_poses
from rrrgen.calibrate.robot_file import calibrated_spec
from rrrgen.cli.main import cli
from rrrgen.errors import DerivationError, InputError
from rrrgen.robotfile import dumps, load_spec, loads_spec
from rrrgen.verify.references.chain import chain_of, nominal_parameters
from rrrgen.verify.references.newton_euler import NewtonEuler

# rank over a finite field at random rational angles, computed apart from this code, with a tool off the axes and the
# world frame off the base: pose 4R + 2P + 6, point 3 less, distance and height over a tilted plane; then wires of
# unknown length, which count with their four parameters, a tilted plane that is touched, and a point
COUNTS = {
    "rrr": (18, 15, 12, 12, 13),
    "puma560": (30, 27, 24, 24, 25, 23, 23),
    "ur10e": (30, 27, 24, 24, 25, 23, 23),
    "scara": (20, 17, 14, 14, 15),
    "panda": (34, 31, 28, 28, 29),
    "stanford": (28, 25, 22, 22, 23),
}
WITHOUT_BETA = {"rrr": 17, "puma560": 29, "ur10e": 28, "scara": 17, "panda": 34, "stanford": 27}
FIXTURES = (
    Fixture("wire", "w", np.array([0.1, 0.2, -0.3]), 0.05),
    Fixture("plane", "p", np.array([0.6, 0.0, 0.8]), 0.35),
    Fixture("contact", "c", np.array([0.2, 0.3, 0.4])),
)


def sets(geometry, count):
    """The minimal sets of all kinds of measurements, ``count`` of them, those with fixtures at 60 positions."""
    found = [minimal_set(geometry, kind) for kind in ("pose", "point", "distance", "height")]
    q = np.random.default_rng(0).uniform(-2, 2, (60, geometry.joints))
    p = geometry.forward(q)[:, :3, 3]
    for each in FIXTURES[: count - len(found)]:
        values = each.computed(p)[:, 0] if each.kind == "wire" else np.zeros(60)
        seen = Measurements(each.kind, q, values, 1.0, 1.0, fixture=np.zeros(60, int), names=(each.name,))
        found.append(minimal_set(replace(geometry, fixtures=(each,)), seen))
    return found


def turned(name):
    """A robot with its base off the world frame and its tool off the axes."""
    found = geometry_of(load_spec(name))
    base = rigid([0.3, -0.2, 0.5, 0.2, 0.3, 0.1]) @ found.base
    return replace(found, base=base, tool=found.tool @ rigid([0.1, 0.05, 0.15, 0.3, 0, 0]))


@pytest.mark.parametrize("name", COUNTS)
def test_minimal_sets(name):
    found = sets(turned(name), len(COUNTS[name]))
    assert tuple(len(each.kept) for each in found) == COUNTS[name]
    entries = [each for each in turned(name).entries() if each.key != "beta"]
    q = np.random.default_rng(1).uniform(-2, 2, (100, turned(name).joints))
    J = turned(name).jacobian(q, entries).reshape(-1, len(entries))
    assert np.linalg.matrix_rank(J, tol=1e-9 * np.linalg.norm(J)) == WITHOUT_BETA[name]


@pytest.mark.parametrize("name", ["puma560", "ur10e", "panda"])
def test_gains_add_one_parameter_a_joint(name):
    geometry = turned(name).with_gains()
    found = sets(geometry, len(COUNTS[name]))
    assert tuple(len(each.kept) - geometry.joints for each in found) == COUNTS[name]
    assert all(f"gain{j + 1}" in [entry.name for entry in each.kept] for each in found for j in range(geometry.joints))


def test_a_plane_across_the_first_axis_sees_less_and_known_lengths_see_the_size():
    geometry, plane = geometry_of(load_spec("puma560")), Fixture("plane", "floor", np.array([0.0, 0.0, 1.0]), -0.3)
    q = np.random.default_rng(0).uniform(-2, 2, (60, 6))
    seen = Measurements("plane", q, np.zeros(60), 1.0, 1.0, fixture=np.zeros(60, int), names=("floor",))
    geometry = replace(geometry, tool=rigid([0.1, 0.05, 0.15, 0.3, 0, 0]), fixtures=(plane,))
    touched = minimal_set(geometry, seen)
    assert len(touched.kept) < 23
    assert touched.left_out["base_z"].startswith("acts like")
    blocks = replace(seen, values=np.resize([0.0, 0.05], 60))
    assert len(minimal_set(geometry, blocks).kept) == len(touched.kept) + 1


def test_what_cannot_be_told_apart_is_named():
    left_out = minimal_set(geometry_of(load_spec("ur10e")), "pose").left_out
    assert left_out["theta1"] == "acts like +1 base_rz"
    assert left_out["d6"] == "acts like +1 tool_z"
    assert left_out["d3"] == left_out["d4"] == "acts like +1 d2"
    assert "beta2" not in left_out


@pytest.mark.parametrize("name", ["rrr", "panda", "scara"])
def test_geometry_is_that_of_the_robot_file(name):
    spec = load_spec(name)
    geometry, q = geometry_of(spec), np.random.default_rng(0).normal(size=(5, spec.n))
    reference = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)))
    np.testing.assert_allclose(geometry.forward(q), reference.forward_kinematics(q), atol=1e-14)
    entries = geometry.entries()
    J, step = geometry.jacobian(q, entries), np.random.default_rng(1).normal(size=len(entries)) * 1e-6
    after, before = geometry.moved(entries, step).forward(q), geometry.moved(entries, -step).forward(q)
    np.testing.assert_allclose((after - before)[:, :3, 3] / 2, J[:, :3] @ step, atol=1e-14)
    turned = after[:, :3, :3] @ np.swapaxes(before[:, :3, :3], 1, 2)
    np.testing.assert_allclose(rotation_vectors(turned) / 2, J[:, 3:] @ step, atol=1e-14)


def held_out(found, true, spec, random):
    q = positions(spec, 1000, random)
    return np.linalg.norm((found.geometry.forward(q) - true.forward(q))[:, :3, 3], axis=1)


@pytest.mark.parametrize("name", ["ur10e", "puma560"])
def test_held_out_errors_and_deviations(name):
    spec, inside, total = load_spec(name), 0, 0
    for seed in range(6):
        random = np.random.default_rng(seed)
        nominal, true = off_the_table(spec, random)
        found = calibrate(nominal, measure("pose", true, positions(spec, 50, random), random))
        errors = held_out(found, true, spec, random)
        assert errors.mean() < 0.05e-3
        assert errors.max() < 0.12e-3
        assert 0.8 < found.chi2_per_dof < 1.2
        exact = calibrate(nominal, measure("pose", true, positions(spec, 50, random), _Silent()))
        assert held_out(exact, true, spec, random).max() < 1e-9
        score = np.abs(found.change - exact.change) / found.deviation
        inside, total = inside + int(np.sum(score < 3)), total + len(score)
    assert inside / total > 0.98


class _Silent:
    """A source of noise without any."""

    def normal(self, size):
        return np.zeros(size)


@pytest.mark.parametrize("kind", ["point", "distance", "height"])
def test_other_measurements(kind):
    spec, random = load_spec("rrr"), np.random.default_rng(3)
    nominal, true = off_the_table(spec, random)
    lift = rigid([0.4, -0.3, 0.6, 0.3, 0.2, 0.0])
    nominal, true = (Geometry(lift @ g.base, g.rows, g.tool, g.revolute) for g in (nominal, true))
    measured = measure(kind, true, positions(spec, 80, random), random)
    found = calibrate(nominal, measured)
    again = measure(kind, true, positions(spec, 500, random), _Silent())
    assert np.abs(again.residuals(found.geometry)).max() < 5 * NOISE
    assert 0.6 < found.chi2_per_dof < 1.4


PLANES = (([0.6, 0.0, 0.8], 0.35), ([0.0, 0.8, 0.6], 0.3), ([0.8, -0.6, 0.0], 0.25))
TOUCHED = {
    "plane": (PLANES, (0.0, 0.05, 0.1)),
    "contact": (([0.4, 0.3, 0.3], [-0.3, 0.4, 0.5]), (0.0,)),
    "wire": ((([0.5, 0.4, -0.3], 0.05), ([-0.6, 0.2, 0.3], -0.02)), (0.0,)),
}


@pytest.mark.parametrize("kind", TOUCHED)
def test_fixtures_of_unknown_place(kind):
    spec, random = load_spec("puma560"), np.random.default_rng(3)
    nominal, true = off_the_table(spec, random)
    fixtures, lifts = TOUCHED[kind]
    measured = touching(kind, true, positions(spec, 160, random), fixtures, random, lifts)
    found = calibrate(nominal, measured)
    assert 0.8 < found.chi2_per_dof < 1.2
    assert measured.kind == kind
    again = touching(kind, true, positions(spec, 80, random), fixtures, random, lifts)
    errors = again.residuals(found.geometry)
    assert np.sqrt(np.mean(errors**2)) < 1.5 * NOISE  # noise itself, and the errors of the parameters
    assert np.sqrt(np.mean(again.residuals(again.with_fixtures(nominal)) ** 2)) > 10 * NOISE


def test_gains_are_estimated_and_written(tmp_path):
    spec, random = load_spec("puma560"), np.random.default_rng(4)
    nominal, true = off_the_table(spec, random, gains=True)
    q = positions(spec, 60, random)
    found = calibrate(nominal, measure("pose", true, q, random))
    assert held_out(found, true, spec, random).mean() < 0.05e-3
    gains = [k for k, entry in enumerate(found.chosen.kept) if entry.place == "gain"]
    assert len(gains) == spec.n
    assert np.all(np.abs(found.change[gains] - (true.gains - 1)) < 4 * found.deviation[gains])
    again = loads_spec(dumps(calibrated_spec(spec, found.geometry, "test")))
    assert again.joints == calibrated_spec(spec, found.geometry, "test").joints
    reference = NewtonEuler(chain_of(again), np.zeros((spec.n, 10)))
    np.testing.assert_allclose(reference.forward_kinematics(q), found.geometry.forward(q), atol=2e-11)


def test_outliers_are_set_aside():
    spec, random = load_spec("ur10e"), np.random.default_rng(2)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 60, random)
    clean = calibrate(nominal, measure("pose", true, q, np.random.default_rng(7)))
    spoilt = measure("pose", true, q, np.random.default_rng(7), outliers=3)
    plain, robust = calibrate(nominal, spoilt), calibrate(nominal, spoilt, robust=True)
    errors = [held_out(each, true, spec, np.random.default_rng(9)).mean() for each in (clean, plain, robust)]
    assert errors[1] > 3 * errors[0]
    assert errors[2] < 1.3 * errors[0]
    assert robust.outliers == [0, 1, 2]


def test_it_converges_from_afar():
    spec, random = load_spec("puma560"), np.random.default_rng(5)
    nominal, true = off_the_table(spec, random, frames=0.05)
    true = Geometry(rigid([1, -0.5, 0.3, 0.4, -0.5, 1.3]) @ true.base, true.rows, true.tool, true.revolute)
    found = calibrate(nominal, measure("pose", true, positions(spec, 40, random), random))
    assert held_out(found, true, spec, random).mean() < 0.06e-3


@pytest.mark.parametrize("name", ["rrr", "puma560", "ur10e", "panda", "stanford"])
def test_the_robot_file_has_the_calibrated_geometry_and_the_same_bodies(name):
    spec, random = load_spec(name), np.random.default_rng(6)
    geometry = geometry_of(spec)
    entries = minimal_set(geometry, "pose").kept
    moved = geometry.moved(entries, random.normal(size=len(entries)) * 1e-3)
    again = loads_spec(dumps(calibrated_spec(spec, moved, "test")))
    q = positions(spec, 20, random)
    found = NewtonEuler(chain_of(again), nominal_parameters(again))
    np.testing.assert_allclose(found.forward_kinematics(q), moved.forward(q), atol=2e-11)
    assert again.source == "test"
    same = loads_spec(dumps(calibrated_spec(spec, geometry, "test")))
    before = NewtonEuler(chain_of(spec), nominal_parameters(spec))
    still = np.zeros_like(q)
    expected = before.inverse_dynamics(q, still, q)
    after = NewtonEuler(chain_of(same), nominal_parameters(same)).inverse_dynamics(q, still, q)
    np.testing.assert_allclose(after, expected, atol=1e-9 * np.abs(expected).max())
    close = found.inverse_dynamics(q, still, q)  # bodies stay with their joints: torques change as little as the table
    np.testing.assert_allclose(close, expected, atol=0.03 * np.abs(expected).max())


def test_chosen_poses_are_better_than_random_ones():
    spec = load_spec("puma560")
    nominal = geometry_of(spec)
    q, gain = choose_poses(spec, nominal, "pose", 20, 0)
    assert q.shape == (20, 6)
    assert gain > 1.1
    entries = minimal_set(nominal, "pose").kept
    ratios = []
    for seed in range(5):
        blocks = [nominal.jacobian(each, entries) for each in (q, positions(spec, 20, np.random.default_rng(seed)))]
        blocks = [J / np.array([5e-5] * 3 + [1e-4] * 3)[:, None] for J in blocks]
        chosen, drawn = (np.linalg.slogdet(np.einsum("nij,nik->jk", J, J))[1] for J in blocks)
        ratios.append(np.exp((chosen - drawn) / (2 * len(entries))))
    assert np.mean(ratios) > 1.1
    with pytest.raises(InputError, match="4 poses for 30 parameters; choose 6 to"):
        choose_poses(spec, nominal, "pose", 4, 0)


def test_poses_that_do_not_determine_the_parameters_are_refused():
    spec, random = load_spec("puma560"), np.random.default_rng(1)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 40, random)
    q[:, 2] = 0.3
    with pytest.raises(DerivationError, match="these poses do not determine"):
        calibrate(nominal, measure("pose", true, q, random))
    with pytest.raises(DerivationError, match="12 measured numbers for 30 parameters"):
        calibrate(nominal, measure("pose", true, q[:2], random))


HEADER = "q1 [deg],q2,q3,x [mm],y [mm],z [mm]\n"


def test_files_in_other_units(tmp_path):
    file = tmp_path / "m.csv"
    file.write_text("# laser tracker\n" + HEADER + "90,0.1,0.2,100,200,300\n\n")
    found = read_measurements(file, ["a", "b", "c"], 1e-4, 1e-3)
    np.testing.assert_allclose(found.q, [[np.pi / 2, 0.1, 0.2]])
    np.testing.assert_allclose(found.values, [[0.1, 0.2, 0.3]])
    half = np.sqrt(0.5)
    file.write_text(f"a,b,c,x,y,z,qw,qx,qy,qz\n0,0,0,1,2,3,{half},0,0,{half}\n")
    quaternion = read_measurements(file, ["a", "b", "c"], 1e-4, 1e-3).values
    file.write_text("a,b,c,plane,height [mm]\n0,0,0,table,20\n0,0,1,wall,0\n1,0,0,table,0\n")
    planes = read_measurements(file, ["a", "b", "c"], 1e-4, 1e-3)
    assert (planes.kind, planes.names, planes.fixture.tolist()) == ("plane", ("table", "wall"), [0, 1, 0])
    np.testing.assert_allclose(planes.values, [0.02, 0, 0])
    file.write_text("a,b,c,nx,ny,nz,height\n0,0,0,0,0.6,0.8,0.3\n")
    np.testing.assert_allclose(read_measurements(file, ["a", "b", "c"], 1e-4, 1e-3).normals, [[0, 0.6, 0.8]])
    file.write_text("a,b,c,x,y,z,roll [deg],pitch,yaw [deg]\n0,0,0,1,2,3,0,0,90\n")
    np.testing.assert_allclose(read_measurements(file, ["a", "b", "c"], 1e-4, 1e-3).values, quaternion, atol=1e-12)


FAULTS = {
    "word": (HEADER + "1,2,3,4,x,6\n", ":2:9: error: 'x' is not a number"),
    "short": (HEADER + "1,2,3\n", ":2:1: error: 3 values instead of 6"),
    "joint": ("q1,q3,x,y,z\n1,1,1,1,1\n", ":1:1: error: there is no column for joint 'q2'"),
    "kind": ("q1,q2,q3,x\n1,1,1,1\n", ":1:1: error: no column says what was measured"),
    "unit": (HEADER.replace("[mm]", "[cm]") + "1,1,1,1,1,1\n", ":1:1: error: no unit 'cm' of column 'x'"),
    "more": (HEADER.replace("\n", ",torque\n") + "1,1,1,1,1,1,1\n", ":1:1: error: the column 'torque' is not used"),
    "twice": (HEADER.replace("q2", "q1") + "1,1,1,1,1,1\n", ":1:1: error: two columns are called 'q1'"),
    "empty": (HEADER, "error: the file has no measurements"),
    "name": ("q1,q2,q3,plane\n1,1,1,the table\n", ":2:7: error: 'the table' is no name of what was touched"),
    "normal": ("q1,q2,q3,nx,ny,nz,height\n1,1,1,0,0,2,1\n", ":2:1: error: the direction nx ny nz has the length 2"),
    "quaternion": (
        "q1,q2,q3,x,y,z,qw,qx,qy,qz\n1,1,1,1,1,1,1,1,0,0\n",
        ":2:1: error: the quaternion has the length",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_of_files_are_located(case, tmp_path):
    (tmp_path / "m.csv").write_text(FAULTS[case][0])
    with pytest.raises(InputError) as caught:
        read_measurements(tmp_path / "m.csv", ["q1", "q2", "q3"], 1e-4, 1e-3)
    assert FAULTS[case][1] in str(caught.value)


def test_command(tmp_path):
    def run(*arguments):
        return CliRunner().invoke(cli, ["calibrate", "rrr", *map(str, arguments)], standalone_mode=False)

    assert "poses, " in run("--choose", "30", "-o", tmp_path / "poses.csv").output
    q = np.loadtxt(tmp_path / "poses.csv", delimiter=",", skiprows=1)
    spec, random = load_spec("rrr"), np.random.default_rng(0)
    nominal = geometry_of(spec)
    entries = minimal_set(nominal, "point").kept
    true = nominal.moved(entries, random.normal(size=len(entries)) * 1e-3)
    p = measure("point", true, q, random).values
    rows = "\n".join(",".join(f"{x!r}" for x in map(float, [*a, *b])) for a, b in zip(q, p, strict=True))
    (tmp_path / "m.csv").write_text(f"q1,q2,q3,x,y,z\n{rows}\n")
    out = run("--poses", tmp_path / "m.csv", "-o", tmp_path / "c.yaml", "--figure", tmp_path / "errors")
    assert out.exception is None, out.output
    assert "not told apart by these measurements" in out.output
    assert (tmp_path / "errors.svg").exists()
    found = geometry_of(loads_spec((tmp_path / "c.yaml").read_text()))
    assert np.linalg.norm((found.forward(q) - true.forward(q))[:, :3, 3], axis=1).max() < 2e-4
    data = json.loads(run("--poses", tmp_path / "m.csv", "--json").output)
    assert data["measured"] == "point"
    assert len(data["parameters"]) == len(entries)
    assert isinstance(run("--poses", tmp_path / "m.csv", "-o", tmp_path / "c.yaml").exception, InputError)


# a wrist whose last drive turns two joints, a gear of 1/2, and parallel axes 2 and 3, which get an angle beta
COUPLED = """\
schema: rrrgen/1
name: coupled
convention: {convention}
units: {{angle: deg, length: m}}
gravity: [0, 0, -9.81]
joints:
  - {{name: j1, type: revolute, alpha: 90, a: 0, d: 0.4}}
  - {{name: j2, type: revolute, alpha: 0, a: 0.43, d: 0}}
  - {{name: j3, type: revolute, alpha: -90, a: 0.02, d: 0.1, follows: {{j3: 1, j2: -1}}, limits: {{lower: -100, upper: 100}}}}
  - {{name: j4, type: revolute, alpha: 90, a: 0, d: 0.43, follows: {{j4: 1/2}}}}
  - {{name: j5, type: revolute, alpha: -90, a: 0, d: 0}}
  - {{name: j6, type: revolute, alpha: 0, a: 0, d: 0.06, follows: {{j6: 1, j5: 1}}}}
  - {{name: twin, type: revolute, alpha: 70, a: 0.1, d: 0.05, follows: {{j6: -1}}, limits: {{lower: -60, upper: 60}}}}
"""  # noqa: E501


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_mechanism_is_calibrated_in_joint_positions(convention):
    spec, random = loads_spec(COUPLED.format(convention=convention)), np.random.default_rng(8)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 60, random)
    assert q.shape[1] == nominal.joints == 6
    found = calibrate(nominal, measure("pose", true, q, random))
    away = positions(spec, 300, random)
    error = np.linalg.norm((found.geometry.forward(away) - true.forward(away))[:, :3, 3], axis=1)
    before = np.linalg.norm((nominal.forward(away) - true.forward(away))[:, :3, 3], axis=1)
    assert error.mean() < 5e-5 < 1e-3 < before.mean()
    assert 0.7 < found.chi2_per_dof < 1.3
    told = loads_spec(dumps(calibrated_spec(spec, found.geometry, "measured")))
    assert told.mechanism.matrix == spec.mechanism.matrix
    assert [joint.limits for joint in told.joints] == [joint.limits for joint in spec.joints]
    reference = NewtonEuler(chain_of(told), np.zeros((len(told.rows), 10)))
    assert np.abs(reference.forward_kinematics(away) - found.geometry.forward(away)).max() < 1e-9


def test_poses_of_a_mechanism_keep_rows_that_follow_in_their_range():
    text = COUPLED.format(convention="standard").replace("{j6: -1}", "{j6: -1, j5: 1}")
    spec = loads_spec(text)
    q, gain = choose_poses(spec, geometry_of(spec), "pose", 20, 1)
    assert np.degrees(np.abs(q[:, 4] - q[:, 5])).max() <= 60
    assert gain > 1


def test_branches_are_not_calibrated_and_named():
    spec = load_spec(Path(__file__).resolve().parents[2] / "examples" / "palletiser" / "robot.yaml")
    with pytest.raises(DerivationError, match="elbow, rod do not lie between base and tip"):
        geometry_of(spec)
