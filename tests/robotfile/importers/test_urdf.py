"""URDF: the robot file is the chain of the tree, as Pinocchio reads it; what has no place in it is said or refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robotfile.importers.random_trees import random_tree
from rrrgen.base.errors import InputError
from rrrgen.exporting import export_robot
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import compare_with_source
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

AGREE = 1e-9  # relative; both sides compute with doubles, and a frame may lie some ten metres away

ARM = """\
<robot name="two link">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial><visual/></link>
  <link name="lower"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <link name="tool"><inertial><mass value="1"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="revolute"><origin xyz="0 0 0.3" rpy="1.5708 0 0"/>
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="0" velocity="1.5"/><dynamics damping="0.4" friction="0"/></joint>
  <joint name="fore-arm" type="continuous"><origin xyz="0.5 0 0"/>
    <parent link="upper"/><child link="lower"/><axis xyz="0 0 -1"/></joint>
  <joint name="flange" type="fixed"><origin xyz="0.2 0 0"/><parent link="lower"/><child link="tool"/></joint>
  <transmission name="t"><joint name="lift"/><actuator name="m"><mechanicalReduction>50</mechanicalReduction>
    </actuator></transmission>
</robot>
"""


def write(folder: Path, text: str, name: str = "arm.urdf") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def said(found) -> str:
    return "\n".join(str(note) for note in found.notes)


def test_exact_rows_folded_links_and_what_is_left_out(tmp_path):
    found = import_robot(write(tmp_path, ARM))
    spec = found.spec
    assert (found.format, spec.name, spec.n, found.chain.tip) == ("urdf", "two_link", 2, "tool")
    rows = [(str(j.alpha), str(j.a), str(j.d), str(j.theta)) for j in spec.joints]
    assert rows == [("pi", "1/2", "0", "0"), ("0", "0", "0", "0")]
    assert spec.base.translation == (0, 0, pytest.approx(0.3))
    assert [str(x) for x in spec.base.rotation] == ["1", "0", "0", "0", "0", "-1", "0", "1", "0"]
    assert spec.joints[0].limits.upper == 2.0
    assert spec.joints[0].limits.torque is None
    assert spec.joints[0].friction.viscous == 0.4
    assert spec.joints[0].friction.coulomb is None
    assert spec.joints[0].drive.gear_ratio == 50
    assert spec.joints[1].limits.lower is None
    assert (spec.links[1].mass, spec.links[1].com[0] * 10) == (2, 1)  # 1 kg at 0 and 1 kg at 0.2 m
    text = said(found)
    for part in ("'fore-arm' is called fore_arm", "<visual> is left out", "effort limit 0 is left out", "no gravity",
                 "1 angles were taken as multiples of 15 degrees; the largest change is 3.7e-06 rad"):  # fmt: skip
        assert part in text
    kept = import_robot(tmp_path / "arm.urdf", chain=ChainChoice(angle_tolerance=0.0))
    assert "angles were taken" not in said(kept)
    pytest.importorskip("pinocchio")
    assert compare_with_source(kept).pose < 1e-12 < compare_with_source(found).pose < 1e-5


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_random_chains_equal_pinocchio(convention, tmp_path):
    pytest.importorskip("pinocchio")
    joints = 0
    for seed in range(8):
        text, tip = random_tree(seed)
        chain = ChainChoice(tip=tip, convention=convention, angle_tolerance=1e-12)
        found = import_robot(write(tmp_path, text), chain=chain)
        compared = compare_with_source(found, seed)
        assert compared.pose < AGREE, (seed, compared)
        assert compared.torque < AGREE, (seed, compared)
        joints += found.spec.n
    assert joints > 25


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("tilt", [1e-3, 1e-5, 1e-8])
def test_nearly_parallel_axes_keep_their_tilt(tilt, convention, tmp_path):
    """Common perpendiculars up to 1e8 m away would cost the digits of torques; fixed rows hold such tilts instead."""
    pytest.importorskip("pinocchio")
    text = ARM.replace('<origin xyz="0.5 0 0"/>', f'<origin xyz="0.5 0.1 0.2" rpy="{tilt} {tilt} 0"/>')
    text = text.replace('rpy="1.5708 0 0"', 'rpy="1.2 0 0.3"')
    choice = ChainChoice(angle_tolerance=0.0, convention=convention)
    found = import_robot(write(tmp_path, text), chain=choice)
    compared = compare_with_source(found)
    assert max(compared.pose, compared.torque) < 1e-10, compared
    fixed = [row.name for row in found.spec.rows if row.name not in {joint.name for joint in found.spec.joints}]
    assert fixed == ([] if tilt > 1e-4 else ["tilt_fore_arm"])
    assert ("the fixed row tilt_fore_arm holds that tilt" in said(found)) == bool(fixed)
    if fixed:
        (text,) = export_robot(found.spec, "urdf").files.values()
        again = import_robot(write(tmp_path, text, "again.urdf"), chain=replace(choice, tip="tip"))
        assert [row.name for row in again.spec.rows] == [row.name for row in found.spec.rows]
        assert compare_with_source(again).torque < AGREE
        assert import_robot(tmp_path / "arm.urdf").spec.mechanism is None or tilt > 5e-6  # parallel within 1e-5 rad


def test_a_chain_may_begin_anywhere_and_run_towards_the_root(tmp_path):
    text, tip = random_tree(3)
    file = write(tmp_path, text)
    forth = import_robot(file, chain=ChainChoice(tip=tip, angle_tolerance=0.0)).spec
    back = import_robot(file, chain=ChainChoice(base=tip, tip="base", angle_tolerance=0.0)).spec
    q = np.random.default_rng(0).normal(size=(5, forth.n))
    there, here = (NewtonEuler(chain_of(s), np.zeros((s.n, 10))).forward_kinematics(x) for s, x in
                   ((forth, q), (back, q[:, ::-1])))  # fmt: skip
    np.testing.assert_allclose(there @ here, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12)
    assert [j.name for j in back.joints] == [j.name for j in forth.joints][::-1]


def test_a_held_joint_is_part_of_its_link(tmp_path):
    pytest.importorskip("pinocchio")
    file = write(tmp_path, ARM)
    found = import_robot(file, chain=ChainChoice(held={"lift": 0.5}, angle_tolerance=0.0))
    assert [joint.name for joint in found.spec.joints] == ["fore_arm"]
    assert "held: lift at 0.5" in said(found)
    compared = compare_with_source(found)
    assert max(compared.pose, compared.torque) < AGREE
    beside = import_robot(file, chain=ChainChoice(tip="upper", held={"fore-arm": 1.0}, angle_tolerance=0.0))
    assert float(beside.spec.links[0].mass) == 4.0
    assert compare_with_source(beside).torque < AGREE
    assert nominal_parameters(beside.spec).shape == (1, 10)


def test_mimic_joints_follow_theirs(tmp_path):
    """Limits, friction and inertia count at the joint that has the drive; poses and torques are the source's."""
    text = ARM.replace(
        '<child link="lower"/>', '<child link="lower"/><mimic joint="lift" multiplier="-0.5" offset="0.3"/>'
    )
    text = text.replace(
        '<axis xyz="0 0 -1"/>',
        '<axis xyz="0 0 -1"/><limit lower="-0.5" upper="0.6" velocity="0.5" effort="2"/><dynamics damping="0.8"/>',
    )
    text = text.replace('type="continuous"', 'type="revolute"')
    found = import_robot(write(tmp_path, text), chain=ChainChoice(angle_tolerance=0.0))
    spec = found.spec
    assert [joint.name for joint in spec.joints] == ["lift"]
    assert [[float(v) for v in row] for row in spec.mechanism.matrix] == [[1.0], [-0.5]]
    limits = spec.joints[0].limits
    assert (limits.lower, limits.upper, limits.velocity) == pytest.approx((-0.6, 1.6, 1.0))
    assert spec.joints[0].friction.viscous == pytest.approx(0.4 + 0.25 * 0.8)
    assert loads_spec(dumps(spec)) == spec
    assert "follows 'lift'" in said(found)
    assert "its torque limit is left out" in said(found)
    pytest.importorskip("pinocchio")
    compared = compare_with_source(found)
    assert max(compared.pose, compared.torque) < AGREE


FAULTS = {
    "xml": ('<link name="base"/>', '<link name="base">', "17:3", "not valid XML: mismatched tag"),
    "entity": ('<robot name="two link">', '<!DOCTYPE r [<!ENTITY a "b">]><robot>', "1:13", "document type"),
    "macro": ('<link name="base"/>', '<link name="base"/><xacro:macro/>', "2:22", "is a macro"),
    "number": ('xyz="0.5 0 0"', 'xyz="0.5 0 l"', "12:57", "'l' in xyz of <origin> is not a number"),
    "count": ('xyz="0.5 0 0"', 'xyz="0.5 0"', "12:57", "xyz of <origin> is '0.5 0'"),
    "huge": ('xyz="0.5 0 0"', 'xyz="1e999 0 0"', "12:57", "'1e999'"),
    "parent": ('<parent link="upper"/>', '<parent link="uper"/>', "13:19", "there is no link 'uper'"),
    "no parent": ('<parent link="upper"/>', "", "12:3", "joint 'fore-arm' has no <parent>"),
    "type": ('type="continuous"', 'type="continous"', "12:32", "the type of joint 'fore-arm' is 'continous'"),
    "floating": ('type="continuous"', 'type="floating"', "12:3", "is floating"),
    "mimic": ('<child link="lower"/>', '<child link="lower"/><mimic joint="fore-arm"/>', "12:3", "not a moving joint"),
    "axis": ('"0 0 -1"', '"0 0 0"', "13:59", "xyz of <axis> has no direction"),
    "twice": ('<link name="tool">', '<link name="lower">', "7:3", "there are two links 'lower'"),
    "circle": ('<parent link="base"/>', '<parent link="tool"/>', "9:3", "the links around 'upper' carry each other"),
    "mass": ('<mass value="2"/>', '<mass value="-2"/>', "3:68", "the mass is negative"),
    "friction": ('damping="0.4"', 'damping="-0.4"', "11:79", "damping of <dynamics> is -0.4"),
    "no mass": ('<mass value="2"/>', "", "3:22", "<inertial> has no <mass>"),
    "no moment": ('ixx="0.1" iyy="0.2"', 'ixx="0.1"', "4:5", "<inertia> has no attribute 'iyy'"),
    "two origins": ('<parent link="base"/>', '<origin xyz="1 0 0"/><parent link="base"/>', "10:5", "two <origin> in"),
    "two axes": ('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 -1"/><axis xyz="1 0 0"/>', "13:68", "two <axis> in one"),
    "two masses": ('<mass value="2"/>', '<mass value="2"/><mass value="3"/>', "3:72", "two <mass> in one"),
    "two inertials": ("<visual/>", '<inertial><mass value="1"/></inertial>', "4:80", "two <inertial> in"),
    "attribute": ('rpy="1.5708 0 0"', 'rpz="1.5708 0 0"', "9:65", "<origin> has no attribute 'rpz'"),
    "meant": ('velocity="1.5"', 'velocit="1.5"', "11:53", "<limit> has no attribute 'velocit'"),
    "quaternion": ('xyz="0.5 0 0"', 'xyz="0.5 0 0" quat_xyzw="0 0 1 0"', "12:77", "no attribute 'quat_xyzw'"),
    "digits": ('xyz="0.5 0 0"', 'xyz="\u0665 0 0"', "12:57", "is not a number of this file"),
}  # fmt: skip


def test_attributes_of_other_programs_are_said(tmp_path):
    """They do not change the motion: a limit of acceleration, the prefix of another vocabulary on the root."""
    text = ARM.replace('velocity="1.5"', 'velocity="1.5" acceleration="7"')
    text = text.replace("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" xmlns="x" ')
    found = import_robot(write(tmp_path, text))
    assert found.spec.joints[0].limits.velocity == 1.5
    assert "the attribute 'acceleration' of <limit> is left out" in said(found)
    assert "attribute 'xmlns" not in said(found)


@pytest.mark.parametrize("zero", [".0", "-.0", ".00", "+.0", "0.", "-.000", ".0e3"])
def test_spellings_of_zero(zero, tmp_path):
    found = import_robot(write(tmp_path, ARM.replace('xyz="0.5 0 0"', f'xyz="0.5 {zero} {zero}"'))).spec
    plain = import_robot(write(tmp_path, ARM, "plain.urdf")).spec
    assert (found.joints, found.links, found.base, found.tool) == (plain.joints, plain.links, plain.base, plain.tool)


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_located(case, tmp_path):
    old, new, place, message = FAULTS[case]
    assert ARM.count(old) == 1
    file = write(tmp_path, ARM.replace(old, new))
    with pytest.raises(InputError) as caught:
        import_robot(file)
    assert caught.value.exit_code == 3
    assert any(str(f).startswith(f"{file}:{place}: error") and message in f.message for f in caught.value.faults), str(
        caught.value
    )


CHOICES = {
    "tip": (ChainChoice(tip="tol"), "the tip: there is no link 'tol'"),
    "base": (ChainChoice(base="bas"), "the base: there is no link 'bas'"),
    "hold": (ChainChoice(held={"lit": 0}), "there is no joint 'lit' to hold"),
    "nothing moves": (ChainChoice(tip="tool", base="lower"), "no joint moves between 'lower' and 'tool'"),
}


@pytest.mark.parametrize("case", CHOICES)
def test_a_wrong_choice_is_refused(case, tmp_path):
    choice, message = CHOICES[case]
    with pytest.raises(InputError, match=message):
        import_robot(write(tmp_path, ARM), chain=choice)


def test_several_tips_are_listed(tmp_path):
    more = '<link name="cup"/><joint name="c" type="fixed"><parent link="lower"/><child link="cup"/></joint></robot>'
    with pytest.raises(InputError, match=r"2 chains from 'base'(.|\n)*cup \(2 joints\), tool \(2 joints\)"):
        import_robot(write(tmp_path, ARM.replace("</robot>", more)))


def test_a_choice_of_a_chain_needs_a_tree(tmp_path):
    file = write(tmp_path, "dh_theta: [0]\n", "arm.yaml")
    with pytest.raises(InputError, match="ur-calibration is one chain already"):
        import_robot(file, chain=ChainChoice(tip="tool"))
