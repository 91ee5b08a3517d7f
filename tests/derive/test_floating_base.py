"""Floating bases: Pinocchio with a free flyer, MuJoCo with a free joint, and an own Newton-Euler from a moving base."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from derive.trees import PLACED_TREE
from oracles.free_base import FreeMujoco, FreePinocchio
from rrrgen.base.errors import InputError
from rrrgen.derive import parametrize_robot, prepare, record
from rrrgen.derive.functions.table import FUNCTIONS, functions_for, recorders
from rrrgen.derive.optimizer import Optimizer
from rrrgen.exporting import export_robot
from rrrgen.program import count_operations
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.runtime.floating_base import (
    FloatingState,
    from_mujoco,
    from_pinocchio,
    integrate,
    rotation,
    to_mujoco,
    to_pinocchio,
)
from rrrgen.runtime.floating_base import difference as displacement
from rrrgen.verify import verify
from rrrgen.verify.references.newton_euler import BaseState, NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from rrrgen.verify.report import rate

TREES = Path(__file__).resolve().parents[2] / "examples" / "trees"

TRUNK = (
    "floating_base: {name: trunk, mass: 6.9, com: [0.008, 0.002, -0.001], "
    "inertia: {about: com, xx: 0.022, yy: 0.078, zz: 0.088, xy: 0.0003, xz: -0.0006, yz: 0.0002}}\n"
)
SWEEP = ("hand", "torso", "random1", "random2", "random3")
LINK = (
    "  - {{mass: {0}, com: [0.0{1}, -0.02, 0.03], "
    "inertia: {{about: com, xx: 0.0{0}1, yy: 0.0{0}2, zz: 0.0{0}2, xy: 0.001, yz: -0.002}}}}\n"
)


def random_tree(seed: int, rows: int = 5) -> str:
    """A tree of some rows without special angles, on any rows before them, of which the first stands on the base."""
    rng = np.random.default_rng(seed)
    lines = ["schema: rrrgen/1", f"name: random{seed}", "convention: modified", "gravity: [0.3, -1.2, -9.7]"]
    lines.append("units: {angle: rad, length: m}")
    lines.append("joints:")
    for k in range(rows):
        parent = "base" if k == 0 else str(rng.choice(["base", *(f"j{i}" for i in range(k))]))
        kind = "prismatic" if rng.random() < 0.3 else "revolute"
        sizes = ", ".join(f"{key}: {rng.uniform(-1, 1):.3f}" for key in ("gamma", "b", "alpha", "a", "theta", "d"))
        lines.append(f"  - {{name: j{k}, type: {kind}, parent: {parent}, {sizes}}}")
    lines += [
        f"tip: j{rows - 1}",
        "tool: {translation: [0.1, -0.2, 0.3]}",
        f"tips: {{other: {{row: j{rows // 2}}}}}",
        "links:",
    ]
    return "\n".join(lines) + "\n" + "".join(LINK.format(k, 10 - k) for k in range(1, rows + 1))


def floating(name: str):
    """The quadruped, a random tree, torso or hand on a trunk, or a tree with prismatic rows, followers, odd angles."""
    if name == "quadruped":
        return load_spec(TREES / "quadruped.yaml")
    if name == "tree":
        text = re.sub(r"base: \{trans.*\n", "", PLACED_TREE)
        text += "links:\n" + "".join(LINK.format(k, 10 - k) for k in range(1, 8))
    elif name.startswith("random"):
        text = random_tree(*map(int, name.removeprefix("random").split(" of ")))
    else:
        text = (TREES / f"{name}.yaml").read_text(encoding="utf-8")
    return loads_spec(text.replace("joints:\n", f"{TRUNK}joints:\n"))


@cache
def prepared(name: str):
    """What all functions of the robot are derived from."""
    return prepare(floating(name))


def draw(n: int, seed: int) -> FloatingState:
    rng = np.random.default_rng(seed)
    orientation = rng.normal(size=4)
    return FloatingState(
        rng.normal(size=3),
        orientation / np.linalg.norm(orientation),
        *rng.normal(size=(2, 6)),
        *rng.normal(size=(3, n)),
    )


@pytest.mark.parametrize(
    ("name", "function", "most"),
    [
        ("quadruped", "floating_inverse_dynamics", 1309),
        ("quadruped", "floating_mass_matrix", 630),
        ("quadruped", "floating_regressor", 1744),
        ("quadruped", "floating_inverse_dynamics_from_imu", 1275),
        ("quadruped", "floating_regressor_from_imu", 1706),
        ("quadruped", "floating_inverse_dynamics_derivatives", 4817),
        ("hand", "floating_inverse_dynamics", 925),
        ("hand", "floating_mass_matrix", 514),
        pytest.param("hand", "floating_regressor", 1615, marks=pytest.mark.sweep),
        pytest.param("torso", "floating_inverse_dynamics", 1431, marks=pytest.mark.sweep),
        pytest.param("torso", "floating_mass_matrix", 1107, marks=pytest.mark.sweep),
        pytest.param("torso", "floating_regressor", 3440, marks=pytest.mark.sweep),
    ],
)
def test_operations_over_a_moving_base(name, function, most):
    recorded = record(prepared(name), [FUNCTIONS[function]])
    assert count_operations(Optimizer()(recorded).programs[function]).total <= most


@pytest.mark.parametrize(("name", "count"), [("quadruped", 94), ("hand", 66), ("torso", 101)])
def test_ten_base_parameters_of_the_body_and_seven_of_every_revolute_joint(name, count):
    assert len(prepared(name).compiler_basis.names) == count


@pytest.fixture(
    scope="module",
    params=["quadruped", "tree", *(pytest.param(name, marks=pytest.mark.sweep) for name in SWEEP)],
)
def model(request):
    return rrrgen.compile(floating(request.param), backend="numpy")


@pytest.mark.sweep(but=["quadruped"])  # the tree is compared with Pinocchio below
def test_every_function_agrees_with_newton_euler_from_a_moving_base(model):
    report = verify(model, samples=3, libraries=False)
    assert [row for row in report.rows if not row.ok] == []
    tips = 1 + len(model.spec.tips)
    assert sum("floating" in row.function for row in report.rows) == 26 + 2 * tips


def joined(forces) -> np.ndarray:
    return np.concatenate([forces.wrench, forces.tau], axis=-1)


def ask(model, s: FloatingState) -> np.ndarray:
    return joined(model.floating_inverse_dynamics(s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate))


def difference(found, expected) -> float:
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


@pytest.fixture(scope="module")
def free(model):
    return FreePinocchio(model.spec)


def test_torques_and_mass_matrix_of_pinocchio_with_a_free_flyer(model, free):
    for seed in range(3):
        s = draw(model.n, seed)
        q, v, a = to_pinocchio(s)
        assert difference(ask(model, s), free.inverse_dynamics(q, v, a)) < 1e-13
        assert difference(model.floating_mass_matrix(s.q), free.mass_matrix(q)) < 1e-13
        for one, other in zip(from_pinocchio(q, v, a), s, strict=True):
            np.testing.assert_array_equal(one, other)


def test_momentum_and_centre_of_mass_of_pinocchio(model, free):
    """Its momentum is about the centre of mass, in world axes."""
    pin = free.pin
    for seed in range(3):
        s = draw(model.n, seed)
        q, v, _ = to_pinocchio(s)
        rows, R = free.rows(q), rotation(s.orientation)
        pin.computeCentroidalMomentum(free.model, free.data, rows, free.S @ v)
        c = R.T @ (pin.centerOfMass(free.model, free.data, rows) - s.position)
        linear, angular = R.T @ free.data.hg.linear, R.T @ free.data.hg.angular
        expected = np.concatenate([linear, angular + np.cross(c, linear)])
        assert difference(model.floating_momentum(s.q, s.dq, s.twist), expected) < 1e-13
        A = model.floating_momentum_matrix(s.q)
        assert difference(A @ v, expected) < 1e-13
        assert difference(np.array([A[1, 5], A[2, 3], A[0, 4]]) / A[0, 0], c) < 1e-13


def test_jacobians_and_accelerations_of_all_tips_of_pinocchio(model, free):
    pin = free.pin
    for seed in range(3):
        s = draw(model.n, seed)
        q, v, a = to_pinocchio(s)
        rows, R = free.rows(q), rotation(s.orientation)
        for name, frame in free.tips.items():
            tip = {"tip": name} if name else {}
            J = model.floating_jacobian(s.q, **tip)
            pin.forwardKinematics(free.model, free.data, rows, free.S @ v, free.S @ a)
            aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            seen = pin.computeFrameJacobian(free.model, free.data, rows, frame, aligned) @ free.S
            assert difference(J, np.concatenate([R.T @ seen[:3], R.T @ seen[3:]])) < 1e-13
            moved = pin.getFrameClassicalAcceleration(free.model, free.data, frame, aligned)
            found = J @ a + model.floating_jacobian_dot_dq(s.q, s.dq, s.twist, **tip)
            assert difference(found, np.concatenate([R.T @ moved.linear, R.T @ moved.angular])) < 1e-13


def test_derivatives_of_pinocchio(model, free):
    pin, S = free.pin, free.S
    for seed in range(3):
        s = draw(model.n, seed)
        q, v, a = to_pinocchio(s)
        found = model.inverse_dynamics_derivatives(
            s.q, s.dq, s.ddq, orientation=s.orientation, twist=s.twist, twist_rate=s.twist_rate
        )
        assert difference(joined(found), ask(model, s)) < 1e-13
        by_q, by_v, M = pin.computeRNEADerivatives(free.model, free.data, free.rows(q), S @ v, S @ a)
        upper = np.triu(M)
        for one, other in (
            (found.df_dq, S.T @ by_q @ S),
            (found.df_dv, S.T @ by_v @ S),
            (found.M, S.T @ (upper + np.triu(upper, 1).T) @ S),
        ):
            assert difference(one, other) < 1e-12
        assert not found.df_dq[:, :3].any()


def test_derivatives_are_the_limits_of_differences(model):
    """Of the wrench and torques of an own Newton-Euler, with poses that are integrated."""
    ne, n = NewtonEuler(chain_of(model.spec), nominal_parameters(model.spec)), model.n
    s = draw(n, 8)

    def forces(x, u, w):
        """At a displacement of the base and of q, and at other velocities and accelerations."""
        pose = integrate(s.position, s.orientation, x[:6])
        base = BaseState(pose.orientation[None], (s.twist + u[:6])[None], (s.twist_rate + w[:6])[None])
        joints = ((value + change[6:])[None] for value, change in ((s.q, x), (s.dq, u), (s.ddq, w)))
        return np.concatenate(ne.floating_inverse_dynamics(*joints, base), axis=1)[0]

    found = model.floating_inverse_dynamics_derivatives(s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate)
    rest = np.zeros(6 + n)
    for place, one in enumerate((found.df_dq, found.df_dv, found.M)):

        def along(unit, place=place):
            return rate(lambda t: forces(*(t * unit if place == other else rest for other in range(3))), 1e-3)

        columns = np.stack([along(unit) for unit in np.eye(6 + n)], axis=1)
        assert difference(one, columns) < 1e-9


def test_the_sensors_of_the_base_take_the_place_of_orientation_and_gravity(model):
    s = draw(model.n, 9)
    v, omega = s.twist[:3], s.twist[3:]
    weight = rotation(s.orientation).T @ chain_of(model.spec).gravity
    sensors = (omega, s.twist_rate[3:], s.twist_rate[:3] + np.cross(omega, v) - weight)
    found = model.floating_inverse_dynamics_from_imu(s.q, s.dq, s.ddq, *sensors)
    assert difference(joined(found), ask(model, s)) < 1e-13
    Y = model.floating_regressor(s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate)
    assert difference(model.floating_regressor_from_imu(s.q, s.dq, s.ddq, *sensors), Y) < 1e-13
    upright = np.array([0.0, 0, 0, 1])  # sensors of a base that rests and stands upright
    at_rest = model.floating_inverse_dynamics(s.q, s.dq, s.ddq, upright, np.zeros(6), np.zeros(6))
    still = model.floating_inverse_dynamics_from_imu(
        s.q, s.dq, s.ddq, np.zeros(3), np.zeros(3), -np.array(chain_of(model.spec).gravity)
    )
    assert difference(joined(still), joined(at_rest)) < 1e-13


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-9, 1e-4, 0.1, 1.0, np.pi - 1e-7, np.pi])
def test_the_pose_of_the_base_is_integrated_as_by_pinocchio(angle):
    pin = pytest.importorskip("pinocchio")
    group, rng = pin.liegroups.SE3(), np.random.default_rng(3)
    for _ in range(5):
        s = draw(0, int(rng.integers(1000)))
        axis = rng.normal(size=3)
        step = np.concatenate([rng.normal(size=3), angle * axis / np.linalg.norm(axis)])
        pose = integrate(s.position, s.orientation, step)
        start = np.concatenate([s.position, s.orientation])
        expected = group.integrate(start, step)
        assert difference(pose.position, expected[:3]) < 1e-14
        assert min(np.abs(pose.orientation - sign * expected[3:]).max() for sign in (1, -1)) < 1e-15
        back = displacement(s.position, s.orientation, *pose)
        again = integrate(s.position, s.orientation, back)  # half a turn has two displacements
        assert difference(again.position, pose.position) < 1e-14
        assert np.abs(rotation(again.orientation) - rotation(pose.orientation)).max() < 1e-14
        if angle < 3:
            assert difference(back, step) < 1e-14
            assert difference(displacement(s.position, s.orientation, pose.position, -pose.orientation), step) < 1e-14


def test_poses_are_integrated_in_batches():
    rng = np.random.default_rng(4)
    p, orientation, steps = rng.normal(size=3), np.array([0.0, 0, 0, 1]), rng.normal(size=(2, 5, 6))
    poses = integrate(p, orientation, steps)
    assert (poses.position.shape, poses.orientation.shape) == ((2, 5, 3), (2, 5, 4))
    one = integrate(p, orientation, steps[1, 2])
    np.testing.assert_array_equal(poses.position[1, 2], one.position)
    assert displacement(p, orientation, *poses).shape == (2, 5, 6)


def test_the_rates_of_an_integrated_pose_are_its_twist():
    """Central differences, of the position and of the orientation."""
    s, h = draw(0, 6), 1e-5
    ahead, behind = (integrate(s.position, s.orientation, sign * h * s.twist) for sign in (1, -1))
    v = rotation(s.orientation).T @ (ahead.position - behind.position) / (2 * h)
    assert difference(v, s.twist[:3]) < 1e-9
    assert difference(displacement(*behind, *ahead) / (2 * h), s.twist) < 1e-9


def test_functions_take_a_moving_base_by_keyword(model):
    s = draw(model.n, 4)
    base = {"orientation": s.orientation, "twist": s.twist}
    forces = model.inverse_dynamics(s.q, s.dq, s.ddq, **base, twist_rate=s.twist_rate)
    np.testing.assert_array_equal(joined(forces), ask(model, s))
    Y = model.regressor(s.q, s.dq, s.ddq, **base, twist_rate=s.twist_rate)
    np.testing.assert_array_equal(Y, model.floating_regressor(s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate))
    h = model.bias(s.q, s.dq, **base)
    np.testing.assert_array_equal(h, model.floating_bias(s.q, s.dq, s.orientation, s.twist))
    back = model.forward_dynamics(s.q, s.dq, forces.tau, **base, wrench=forces.wrench)
    assert difference(np.concatenate(back), np.concatenate([s.twist_rate, s.ddq])) < 1e-9
    assert model.inverse_dynamics(s.q, s.dq, s.ddq).shape == (model.n,)
    with pytest.raises(ValueError, match="no floating base"):
        rrrgen.compile("pendulum", backend="numpy").inverse_dynamics([0], [0], [0], **base, twist_rate=s.twist_rate)


@pytest.mark.parametrize(("off", "expected"), [(9e-7, 0), (-9e-7, 0), (1.1e-6, 2), (-1.1e-6, 2), (np.nan, 2)])
def test_an_orientation_that_is_no_unit_quaternion_is_refused(model, off, expected):
    s = draw(model.n, 5)
    orientation = s.orientation * (1 + off)
    calls = {
        "floating_inverse_dynamics": (s.q, s.dq, s.ddq, orientation, s.twist, s.twist_rate),
        "floating_bias": (s.q, s.dq, orientation, s.twist),
        "floating_regressor": (s.q, s.dq, s.ddq, orientation, s.twist, s.twist_rate),
        "floating_forward_dynamics": (s.q, s.dq, s.ddq, orientation, s.twist, s.twist_rate),
        "floating_inverse_dynamics_derivatives": (s.q, s.dq, s.ddq, orientation, s.twist, s.twist_rate),
    }
    for name, values in calls.items():
        _, status = getattr(model, name)(*values, with_status=True)
        assert status == expected or np.isnan(off)  # forward dynamics sees no pivot that is positive
        assert (status != 0) == (expected != 0)
    if expected:
        with pytest.raises(ValueError, match="no unit quaternion"):
            model.floating_bias(s.q, s.dq, orientation, s.twist)


def test_torques_of_mujoco_with_a_free_joint(model):
    pytest.importorskip("mujoco")
    free = FreeMujoco(chain_of(model.spec), nominal_parameters(model.spec))
    for seed in range(3):
        s = draw(model.n, seed)
        packed = to_mujoco(s)
        expected = free.forces(*packed)
        expected[:3] = rotation(s.orientation).T @ expected[:3]  # its force on the base is in world axes
        assert difference(ask(model, s), expected) < 1e-13
        for one, other in zip(from_mujoco(*packed), s, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


def test_the_wrench_alone_identifies_all_base_parameters_and_flight_all_but_their_scale(model):
    """The rank of rows of the regressor over states (Ayusawa, Venture, Nakamura 2014)."""
    if model.spec.name not in ("quadruped", "hand"):
        pytest.skip("it holds for trees of revolute joints, none of which follows another")
    states = [draw(model.n, seed) for seed in range(40)]
    Y = np.stack([model.floating_regressor(s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate) for s in states])

    def rank(rows: np.ndarray) -> int:
        stacked = rows.reshape(-1, Y.shape[-1])
        sizes = np.linalg.svd(stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-9), compute_uv=False)
        return int(np.sum(sizes > 1e-10 * sizes[0]))

    b = Y.shape[-1]
    assert (rank(Y[:, :6]), rank(Y[:, 6:])) == (b, b - 10)
    # in flight the wrench is zero: forward dynamics give the acceleration of the base
    beta, flying = np.asarray(model.beta), []
    for s in states:
        tau = np.zeros(model.n)
        a = model.floating_forward_dynamics(s.q, s.dq, tau, s.orientation, s.twist, np.zeros(6))
        flying.append(model.floating_regressor(s.q, s.dq, a.ddq, s.orientation, s.twist, a.twist_rate)[:6])
    rows = np.stack(flying)
    assert np.max(np.abs(rows @ beta)) < 1e-11 * np.max(np.abs(rows))
    assert rank(rows) <= b - 1


def test_the_mass_of_a_prismatic_joint_counts_in_the_first_moments_of_the_whole_robot():
    """It is no part of the link before it, so the composite of a leg that stands beside the base origin has a mass."""
    rows = (
        "  - {name: hip, type: revolute, parent: base, gamma: 90, alpha: 90, a: 0.05, d: 0.19, theta: 0}\n"
        "  - {name: leg, type: prismatic, alpha: 90, a: 0.1, theta: 0}\n"
    )
    head = (
        "schema: rrrgen/1\nname: slides\nconvention: modified\nunits: {angle: deg, length: m}\ngravity: [0, 0, -9.81]\n"
    )
    spec = loads_spec(f"{head}{TRUNK}joints:\n{rows}tip: leg\nlinks:\n{LINK.format(1, 2)}{LINK.format(2, 3)}")
    derivation = prepare(spec)
    beta = [float(v) for v in parametrize_robot(derivation).beta_nominal]
    q = np.array([0.4, 0.3])
    (M,) = evaluate(recorders("floating_mass_matrix")[0](derivation.recording()), q, beta)
    free = FreePinocchio(spec)
    assert difference(np.array(M), free.mass_matrix(np.concatenate([np.zeros(3), [0, 0, 0, 1], q]))) < 1e-13


def test_the_file_is_written_as_it_is_read():
    for name in ("quadruped", "tree", "hand"):
        spec = floating(name)
        assert loads_spec(dumps(spec)) == spec


def test_a_chain_on_a_floating_base_has_a_tip_and_its_functions():
    text = (TREES / "hand.yaml").read_text(encoding="utf-8")
    names = [each.name for each in functions_for(loads_spec(text), ("model",))]
    assert not any("floating" in name for name in names)
    one = dumps(load_spec("planar2r")).replace("joints:\n", f"{TRUNK}joints:\n")
    spec = loads_spec(one)
    assert (spec.rows[0].name, spec.n, len(spec.rows), spec.tip_row) == ("trunk", 2, 3, 2)
    assert len(prepare(spec).compiler_basis.names) == 24


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("name: trunk", "name: q1"), "is that of a joint"),
        (("mass: 6.9", "mass: -1"), "mass of the floating base is negative"),
        (("joints:\n", "base: {translation: [0, 0, 1]}\njoints:\n"), "a robot with a floating base has no base"),
        (("links:", "lynks:"), "the file has no links"),
    ],
)
def test_faults_of_a_floating_base_are_told(change, says):
    text = dumps(load_spec("planar2r")).replace("joints:\n", f"{TRUNK}joints:\n")
    with pytest.raises(InputError, match=says):
        loads_spec(text.replace(*change))


def test_robots_without_a_floating_base_say_how_to_get_one():
    model = rrrgen.compile("planar2r", backend="numpy")
    with pytest.raises(ValueError, match="the robot has no floating base"):
        model.floating_mass_matrix([0.1, 0.2])


def test_the_exported_mjcf_moves_freely_and_weighs_as_much():
    """At rest the inverse dynamics of the whole robot are its weight."""
    mujoco = pytest.importorskip("mujoco")
    spec = floating("quadruped")
    (xml,) = export_robot(spec, "mjcf").files.values()
    free = mujoco.MjModel.from_xml_string(xml)
    assert (free.nq, free.nv) == (7 + spec.n, 6 + spec.n)
    data = mujoco.MjData(free)
    mujoco.mj_inverse(free, data)
    model = rrrgen.compile(spec, backend="numpy")
    still = np.zeros(spec.n)
    forces = model.floating_inverse_dynamics(still, still, still, [0, 0, 0, 1], np.zeros(6), np.zeros(6))
    assert difference(np.array(data.qfrc_inverse), joined(forces)) < 1e-13
