"""XML of robot descriptions: faults at their line, attributes of other programs, spellings of zero."""

from __future__ import annotations

import pytest

from robot.importers.urdf_files import ARM, said, write
from rrrgen.base.errors import InputError
from rrrgen.robot.importers.importing import import_robot

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


def test_the_shown_line_is_the_counted_one(tmp_path):
    """XML counts no line at the separators of Unicode, which end a line in YAML."""
    text = ARM.replace('<link name="base"/>', '<!-- \u2028 \x85 --><link name="base">')
    with pytest.raises(InputError, match=r":17:3: error: not valid XML(.|\n)*    </robot>"):
        import_robot(write(tmp_path, text))


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
