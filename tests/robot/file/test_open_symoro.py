"""OpenSYMORO files: the robot is the one that the file describes, and whatever is wrong or left out is said."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from oracles import khalil
from rrrgen.base.errors import InputError
from rrrgen.robot.file import load_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from tests.robot.file.par_files import ELBOW, LOOPS, SLIDING, TREE, VALUES, inertia, numbers, text

ARMS = {"elbow": (ELBOW, 6, 0, "0,0,-9.81"), "sliding": (SLIDING, 3, 1, "1.5,-2,-9.5")}


def columns_of(arm: str) -> tuple[dict[str, str], str]:
    geometry, moving, fixed, gravity = ARMS[arm]
    return {**geometry, **inertia(moving, fixed)}, gravity


def given(arm: str) -> dict[str, str]:
    return {name: value for name, value in VALUES.items() if name in "".join(ARMS[arm][0].values())}


def write(folder: Path, content: str, name: str = "arm.par") -> Path:
    (folder / name).write_text(content, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("arm", ARMS)
def test_kinematics_and_energies_are_those_of_the_file(arm, tmp_path):
    columns, gravity = columns_of(arm)
    found = import_robot(write(tmp_path, text(columns, arm, gravity)), values=given(arm))
    assert (found.spec.name, found.spec.convention, found.format) == (arm, "modified", "symoro")
    file = write(tmp_path, found.text, "arm.yaml")
    assert load_spec(file) == found.spec
    model = rrrgen.compile(file, backend="numpy")
    numeric = numbers(columns, gravity)
    rng = np.random.default_rng(0)
    q, dq = rng.uniform(-2, 2, (2, 6, model.n))
    frames = np.array([khalil.frames(numeric, state).real for state in q])
    np.testing.assert_allclose(model.link_frames(q), frames[:, : model.n], atol=1e-13)
    np.testing.assert_allclose(model.forward_kinematics(q), frames[:, -1], atol=1e-13)
    kinetic, potential = np.transpose([khalil.energies(numeric, *state) for state in zip(q, dq, strict=True)])
    K, U = model.energy(q, dq)
    np.testing.assert_allclose(K, kinetic, rtol=1e-12)
    np.testing.assert_allclose(U - U[0], potential - potential[0], atol=1e-12 * np.abs(potential).max())


def test_decimals_of_right_angles_are_right_angles(tmp_path):
    """Six digits of pi/2 would make a general arm of one that has a closed form."""
    columns, gravity = columns_of("elbow")
    content = text(columns, "elbow", gravity)
    rounded = re.sub(r"(?i)\bpi/2", "1.5707963", content)
    assert rounded != content
    exact = import_robot(write(tmp_path, content), values=given("elbow"))
    found = import_robot(write(tmp_path, rounded), values=given("elbow"))
    assert found.spec == exact.spec
    (warning,) = [str(each) for each in found.notes if "15 degrees" in str(each)]
    assert re.search(r"angles were taken as multiples of 15 degrees; the largest change is 2\.7e-08 rad", warning)
    kept = import_robot(write(tmp_path, rounded), values=given("elbow"), chain=ChainChoice(angle_tolerance=0.0))
    assert kept.spec != exact.spec
    with pytest.raises(InputError, match=r"1e.?320"):  # larger than any double
        import_robot(write(tmp_path, content.replace("th2-Pi/2", "th2-1e320")), values=given("elbow"))


def test_a_tree_is_the_one_of_the_file(tmp_path):
    """Every frame is a row, placed by gamma and b; frames, energies and the fixed frame's inertia are the file's."""
    columns, gravity = {**TREE, **inertia(6)}, "1.5,-2,-9.5"
    content = text(columns, "tree", gravity).replace("Type = 0", "Type = 1")
    found = import_robot(write(tmp_path, content), values={"L2": "0.35"})
    file = write(tmp_path, found.text, "tree.yaml")
    assert load_spec(file) == found.spec
    assert [row.name for row in found.spec.rows] == ["t1", "t2", "r3", "fixed4", "t5", "t6"]
    assert found.spec.mechanism.parents == (-1, 0, 1, 0, 3, -1)
    model = rrrgen.compile(file, backend="numpy")
    numeric = numbers(columns, gravity)
    q, dq = np.random.default_rng(0).uniform(-2, 2, (2, 5, model.n))
    frames = np.array([khalil.frames(numeric, state).real for state in q])
    np.testing.assert_allclose(model.link_frames(q), frames, atol=1e-13)
    kinetic, potential = np.transpose([khalil.energies(numeric, *state) for state in zip(q, dq, strict=True)])
    K, U = model.energy(q, dq)
    np.testing.assert_allclose(K, kinetic, rtol=1e-12)
    np.testing.assert_allclose(U - U[0], potential - potential[0], atol=1e-12 * np.abs(potential).max())


def closed(columns: dict[str, str], gravity: str = "0,0,-9.81") -> str:
    """A file of type 2 with the links, joints and frames of LOOPS."""
    content = text(columns, "closed", gravity).replace("Type = 0", "Type = 2")
    return content.replace("NL = 1 (* not used *)", "NL = 7\nNJ = 9\nNF = 11")


def test_closed_loops_are_those_of_the_file(tmp_path):
    """Frames of the cut joints meet their counterparts at any q, and energies are those of the tree at W dq."""
    gravity, friction = "1.5,-2,-9.5", {"FV": "1,2,0,0,0,0,0", "IA": "0,0,3,0,0,0,0"}
    content = closed({**LOOPS, **inertia(7), **friction}, gravity)
    found = import_robot(write(tmp_path, content), values={"L2": "0.6"})
    said = "\n".join(map(str, found.notes))
    for part in (
        "loop1 is taken with assembly: +1",
        "friction of the passive joint 2 is",
        "IA of the passive joint 3 is",
    ):
        assert part in said
    file = write(tmp_path, found.text, "closed.yaml")
    assert load_spec(file) == found.spec
    assert [joint.name for joint in found.spec.joints] == ["t1", "r4", "t5"]
    assert [loop.passive for loop in found.spec.loops] == [(1, 2), (5, 6)]
    numeric = numbers({**LOOPS, **inertia(7, 4)}, gravity)
    numeric["d"][9] = 0.6
    reference = NewtonEuler(chain_of(found.spec), nominal_parameters(found.spec))
    rng = np.random.default_rng(0)
    q, dq = rng.uniform([-2, 0.05, -0.5], [2, 0.3, 0.5], (4, 3)), rng.uniform(-2, 2, (4, 3))
    x, solved = reference.loops.solve(q)
    assert solved.all()
    rates = np.einsum("nij,nj->ni", reference.loops.passive_rates(x), dq)
    kinetic = np.einsum("ni,nij,nj->n", dq, reference.mass_matrix(q), dq) / 2
    weight, epsilon = reference.inverse_dynamics(q, 0 * dq, 0 * dq), 1e-30
    for k, frames in enumerate(reference.link_frames(q)):
        y, dy = (np.insert(own[:3], [1, 1, 3, 3], beyond) for own, beyond in ((x[k], x[k, 3:]), (dq[k], rates[k])))
        poses = khalil.frames(numeric, [*y, 0, 0]).real
        np.testing.assert_allclose(frames, poses[:7], atol=1e-12)
        for cut, counterpart in ((7, 9), (8, 10)):
            gap = poses[cut, :3, 3] - poses[counterpart, :3, 3]
            assert np.abs(np.cross(poses[1, :3, 2], gap)).max() < 1e-12
        assert kinetic[k] == pytest.approx(khalil.energies(numeric, [*y, 0, 0], [*dy, 0, 0])[0], rel=1e-10)
        moved = khalil.frames(numeric, [*(y + 1j * epsilon * dy), 0, 0])  # power of the weight, by the complex step
        power = sum(
            (moved[j] @ [*(numeric[name][j] for name in ("MX", "MY", "MZ")), numeric["M"][j]])[:3].imag / epsilon
            for j in range(7)
        )
        gravity_0 = np.reshape(numeric["Z"], (4, 4))[:3, :3] @ numeric["G"]
        assert weight[k] @ dq[k] == pytest.approx(-power @ gravity_0, rel=1e-10)


def test_a_parallelogram_becomes_rows_that_follow(tmp_path):
    """The pin of its cut joint stays closed at any q, and the other loop stays one."""
    content = closed({**LOOPS, **inertia(7)}).replace("0.2,0,0,0,0,0.3,", "0.2,0,0,0,0,0,")
    content = content.replace("0.9,0.5,0.3,0.03,0.45,L2,-0.2", "0.9,0.7,0.25,0.03,0.2,L2,-0.25")
    found = import_robot(write(tmp_path, content), values={"L2": "0.6"})
    assert "loop2 is a parallelogram: t6 and t7 follow the drives" in "\n".join(map(str, found.notes))
    spec = load_spec(write(tmp_path, found.text, "closed.yaml"))
    assert spec == found.spec
    assert [loop.name for loop in spec.loops] == ["loop1"]
    assert [[float(v) for v in row[:3]] for row in spec.mechanism.matrix[5:]] == [[0, 0, 1], [0, 0, -1]]
    assert str(spec.rows[5].theta) == "1/5 - pi"
    rng = np.random.default_rng(0)
    q = rng.uniform([-2, 0.05, -0.5], [2, 0.3, 0.5], (4, 3))
    c, s = np.cos(0.2), np.sin(0.2)
    for frames in NewtonEuler(chain_of(spec), nominal_parameters(spec)).link_frames(q):
        gap = frames[6] @ [0.2, 0, 0.02, 1] - frames[4] @ [-0.25 * c, -0.25 * s, 0, 1]
        assert np.abs(np.cross(frames[1, :3, 2], gap[:3])).max() < 1e-12


CLOSED_FAULTS = [
    ("NJ = 9", "NJ = 7", "NL = 7 and NJ = 7 with 11 frames", "2 NJ - NL frames"),
    ("0,0,0,1,0,0,0,0,0,2,2", "0,0,0,1,0,0,0,1,0,2,2", "the cut joint of frame 8 is prismatic", "revolute joints"),
    ("0,0,0,1,0,0,0,0,0,2,2", "0,0,0,1,0,0,0,0,0,0,2", "frame 10 is not fixed", "sigma = 2"),
    ("0,1,1,3,2,2,6,4,7,2,5", "0,1,1,3,2,2,6,4,8,2,5", "frame 9 of a cut joint follows frame 8", "0 to 7"),
    ("1,0,0,1,1,0,0,0,0,0,0", "1,0,0,0,1,0,0,0,0,0,0", "the loop of frame 8 has passive joints: 2, 3, 4", "mu = 0"),
    ("1,0,0,1,1,0,0,0,0,0,0", "1,1,1,1,1,0,0,0,0,0,0", "the loop of frame 8 has passive joints: none", "mu = 0"),
    ("mu = {", "nu = {", "there is no list 'mu'", "11 entries"),
    ("0,pi/2,pi/2,-pi/2,0,0,0,pi/2,0,0,0", "0,pi/2,pi/2,-pi/2,0,0,0,0,0,0,0",
     "the axis of the cut joint of frame 8 is not parallel to that of joint 3", "parallel"),
    ("L2", "L9", "d of frame 10: 'L9' has no value", "--set L9=VALUE"),
    ("0,0.1,0.4,0,0.9,0.5,0.3,0.03,0.45", "0,0.1,0.4,0,0.9,0.7,0.2,0.03,0.2", "parallelogram", "follows"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message", "hint"), CLOSED_FAULTS)
def test_faults_of_closed_loops_are_located(old, new, message, hint, tmp_path):
    content = closed(LOOPS)
    assert content.count(old) == 1
    content = content.replace(old, new)
    if message == "parallelogram":
        content = content.replace("0.2,0,0,0,0,0.3,", "0.2,0,0,0,0,0,")
    with pytest.raises(InputError) as caught:
        import_robot(write(tmp_path, content), values={"L2": "0.6"} if "L2" in content else {})
    fault = next((f for f in caught.value.faults if message in f.message), None)
    assert fault is not None, str(caught.value)
    assert hint in fault.hint
    assert fault.line > 0 or message == "parallelogram" or "list" in message


def test_lengths_stay_parameters_and_joint_variables_name_the_joints(tmp_path):
    spec = import_robot(write(tmp_path, text(ELBOW)), values=given("elbow")).spec
    assert {name: float(value) for name, value in spec.parameters.items()} == {"D3": 0.45, "RL4": 0.45}
    assert [str(joint.a) for joint in spec.joints] == ["0", "0", "D3", "0", "0", "0"]
    assert [joint.name for joint in spec.joints] == [f"th{k + 1}" for k in range(6)]
    assert [str(joint.theta) for joint in spec.joints] == ["0", "-pi/2", "pi/2", "0", "0", "0"]
    assert import_robot(write(tmp_path, text(ELBOW)), name="my_arm", values=given("elbow")).spec.name == "my_arm"


def test_drives_and_friction_and_what_is_left_out(tmp_path):
    more = {"IA": "0.5,0,0,0,0,IA6", "FV": "1.5,0,0,0,0,0", "FS": "0,2.5,0,0,0,0", "FX": "0,0,0,0,0,FX6"}
    links = {"M": "M1,M2,M3,M4,M5,M6", "mu": "1,1,0,1,1,1", "k": "0,0,0,0,0,0"}
    found = import_robot(write(tmp_path, text({**ELBOW, **more, **links})), values=given("elbow"))
    spec = found.spec
    assert spec.links is None
    assert spec.joints[0].drive.inertia == 0.5
    assert (spec.joints[0].friction.viscous, spec.joints[0].friction.coulomb) == (1.5, None)
    assert (spec.joints[1].friction.viscous, spec.joints[1].friction.coulomb) == (None, 2.5)
    assert spec.joints[2].friction is None
    said = "\n".join(map(str, found.notes))
    for part in (
        "IA of joint 6 is left out: 'IA6'",
        "FX left out",
        "no mass has a value",
        "joint 3 is passive",
        "'k' is",
    ):
        assert part in said
    assert all(note.line > 0 and note.severity == "warning" for note in found.notes)


def test_millimetres_without_a_unit_are_noticed(tmp_path):
    found = import_robot(write(tmp_path, text(ELBOW)), values={"D3": "450", "RL4": "450 mm"})
    assert [note.message for note in found.notes] == ["d of frame 3 is 450 m"]


def spoilt(old: str, new: str) -> str:
    content = text({**columns_of("elbow")[0]}, "arm")
    assert content.count(old) == 1, old
    return content.replace(old, new)


POSE = "Z = {{{},0,0,0,0,1,0,0,0,0,1,0,0,0,0,1}}"
FAULTS = {
    "later frame": ("0,1,2,3,4,5", "0,1,2,5,4,5", "frame 4 follows frame 5", "0 to 3; 0 is the base"),
    "structure": ("Type = 0", "Type = 3", "Type 3: no known structure", "Type = 2"),
    "closed loop": ("Type = 0", "Type = 2", "NL = 1 and NJ = none with 6 frames", "two of every cut joint"),
    "mobile base": ("is_mobile = 0", "is_mobile = 1", "a base that moves", "fixed base"),
    "fixed frame inside": (
        "sigma = {0,0,0,0,0,0}",
        "sigma = {0,0,2,0,0,0}",
        "frame 3 is fixed to a moving link",
        "row",
    ),
    "unknown sigma": ("sigma = {0,0,0,0,0,0}", "sigma = {0,0,3,0,0,0}", "sigma is 3", "0 revolute"),
    "nothing moves": ("sigma = {0,0,0,0,0,0}", "sigma = {2,2,2,2,2,2}", "no joint moves", "sigma is 0"),
    "branch": ("gamma = {0,0,0", "gamma = {0,0,pi/2", "gamma of frame 3 is not 0", "theta and r"),
    "too few": ("0,0,D3,0,0,0", "0,0,D3,0,0", "d has 5 entries instead of 6", ""),
    "sigma too short": ("sigma = {0,0,0,0,0,0}", "sigma = {0,0,0,0,0}", "sigma has 5 entries instead of 6", ""),
    "empty entry": ("0,0,D3,0,0,0", "0,0,,0,0,0", "an entry is empty", ""),
    "no number": ("0,0,D3,0,0,0", "0,0,D3*,0,0,0", "not an expression", "allowed are"),
    "evaluation": ("0,0,D3,0,0,0", "0,0,__import__('os'),0,0,0", "d:", ""),
    "no value": ("0,0,D3,0,0,0", "0,0,D9,0,0,0", "'D9' has no value", "--set D9=VALUE"),
    "wrong sign": ("th4", "-th4", "is not 'th4' plus a constant", "no other sign"),
    "two variables": ("th4", "th4+th7", "several names without a value: th4, th7", "--set"),
    "massless": ("4.0,3.5,", "0,3.5,", "frame 1 has first moments and no mass", "centre of mass"),
    "negative mass": ("4.0,3.5,", "4.0,-3.5,", "the mass of frame 2 is negative", ""),
    "negative friction": ("is_mobile = 0", "is_mobile = 0\nFV = {0,-1,0,0,0,0}", "FV of joint 2 is -1", "0 or more"),
    "too large": ("0,0,D3,0,0,0", "0,0,D3,9e300*9e300,0,0", "d: an entry is about 1e+601", "at most 1e+15"),
    "name": ("Robotname = '", "Robotname = '7", "the robot name '7arm' is not an identifier", "--name"),
    "gravity": ("0,0,-9.81", "0,0,-981", "gravity is 981 m/s^2", "at most 50"),
    "no rotation": ("is_mobile = 0", f"is_mobile = 0\n{POSE.format(2)}", "rotation in Z is not orthonormal", "by row"),
    "reflection": ("is_mobile = 0", f"is_mobile = 0\n{POSE.format(-1)}", "rotation in Z is a reflection", "by row"),
    "moving base": ("0,0,0}\n\n(* End", "0,0,1}\n\n(* End", "the base moves", "fixed base"),
    "twice": ("is_mobile = 0", "is_mobile = 0\nd = {0}", "'d' is given twice", ""),
    "division by zero": ("4.0,3.5,", "1/(D3-0.45),3.5,", "M of frame 1 is not finite", "division by zero"),
    "no assignment": ("is_mobile = 0", "mobile", "'mobile' is no assignment", "NAME = VALUE"),
    "no gravity": ("G = {", "GG = {", "there is no list 'G'", "3 entries"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_located(case, tmp_path):
    old, new, message, hint = FAULTS[case]
    file = write(tmp_path, spoilt(old, new))
    with pytest.raises(InputError) as caught:
        import_robot(file, values=given("elbow"))
    assert caught.value.exit_code == 3
    fault = next((f for f in caught.value.faults if message in f.message), None)
    assert fault is not None, str(caught.value)
    assert hint in fault.hint
    assert fault.file == str(file)
    assert fault.line > 0 or case == "no gravity"


def test_the_place_of_a_fault_is_that_of_the_entry(tmp_path):
    with pytest.raises(InputError) as caught:
        import_robot(write(tmp_path, spoilt("0,0,D3,0,0,0", "0,0, D3*(,0,0,0")), values={"RL4": "0.45"})
    place = text(columns_of("elbow")[0]).splitlines().index("d = {0,0,D3,0,0,0}") + 1
    (fault,) = [fault for fault in caught.value.faults if fault.message.startswith("d: ")]
    assert fault.line == place
    assert fault.source_line[fault.column - 1 :].startswith(("D3", "*", "(", ",")), fault


def test_values_that_nobody_asked_for_and_formats_that_nobody_knows(tmp_path):
    file = write(tmp_path, text(ELBOW))
    for options, message in (
        ({"values": {**VALUES, "D3": "0.45", "X9": "1"}}, "--set X9: the file has no such name"),
        ({"values": {"D3": "os.getcwd()"}}, "value of D3"),
        ({"form": "sdf"}, "no format 'sdf'"),
    ):
        with pytest.raises(InputError) as caught:
            import_robot(file, **options)
        assert message in str(caught.value)
    with pytest.raises(InputError, match="of no format that can be imported"):
        import_robot(write(tmp_path, "solid cube", "cube.stl"))
