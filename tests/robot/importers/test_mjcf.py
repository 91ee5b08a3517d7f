"""MJCF: the robot file is the chain of the bodies, as MuJoCo reads them; what has no place in it is said or refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.robot.importers.mjcf import ATTRIBUTES
from rrrgen.verify.references.imported_source import compare_with_source
from samples.draws import draws

AGREE = 1e-9  # relative; both sides compute with doubles

SHAPES = (
    'type="sphere" size="0.05"',
    'type="box" size="0.1 0.05 0.02" pos="0.1 0 0" euler="10 20 30"',
    'type="capsule" size="0.04" fromto="0 0 0 0.1 0.2 0.3"',
    'type="cylinder" size="0.05 0.1" axisangle="1 1 0 40"',
    'type="ellipsoid" size="0.1 0.05 0.03" mass="0.7"',
    'type="capsule" size="0.03 0.1" zaxis="0 1 0" density="300"',
    'class="heavy"',
)
TURNS = ("", 'quat="0.707107 0 0.707107 0"', 'euler="90 0 0"', 'xyaxes="0 1 0 0 0 1"', 'axisangle="0.3 0.2 1 25"',
         'zaxis="1 0 0"', 'euler="0 -90 45"', 'quat="0.3 0.5 -0.2 0.7"')  # fmt: skip
AXES = ("0 0 1", "0 1 0", "-1 0 0", "0.3 0.4 -0.5")


def random_mjcf(seed: int) -> str:
    random = np.random.default_rng(seed)
    radian, extrinsic = random.random() < 0.3, random.random() < 0.3
    text = f'<mujoco model="r{seed}"><compiler angle="{"radian" if radian else "degree"}"'
    text += ' eulerseq="ZYX"/>' if extrinsic else "/>"
    text += '<option gravity="1 -2 -9"/><default><geom density="800"/><joint damping="0.5" armature="0.1"/>'
    text += '<default class="heavy"><geom type="box" size="0.1 0.1 0.1" density="3000"/></default></default><worldbody>'
    bodies = int(random.integers(2, 6))
    for i in range(bodies):
        xyz = " ".join(f"{x:.3g}" for x in random.choice([0, 0, 0.1, -0.3], 3))
        text += f'<body name="b{i}" pos="{xyz}" {random.choice(TURNS)}>'
        for k in range(int(random.integers(1, 3))):
            kind, axis = random.choice(["hinge", "hinge", "slide"]), random.choice(AXES)
            at, ref = random.choice(["", 'pos="0.1 0.02 -0.3"']), random.choice(["", 'ref="0.3"'])
            text += f'<joint name="j{i}{k}" type="{kind}" axis="{axis}" {at} {ref} range="-1 1"/>'
        if random.random() < 0.3:
            text += '<inertial pos="0.1 0.2 0" mass="2" euler="10 0 5" diaginertia="0.1 0.2 0.25"/>'
        text += f"<geom {random.choice(SHAPES)}/>"
        text += f'<frame pos="0 0 0.1" euler="0 15 0"><geom {random.choice(SHAPES)}/></frame>'
        if random.random() < 0.3:
            text += f'<body name="side{i}" pos="0.1 0 0"><joint name="s{i}"/><geom {random.choice(SHAPES)}/></body>'
    return text + '<site name="end" pos="0.1 0 0.2" euler="0 30 0"/>' + "</body>" * bodies + "</worldbody></mujoco>"


def write(folder: Path, text: str) -> Path:
    (folder / "arm.xml").write_text(text, encoding="utf-8")
    return folder / "arm.xml"


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_random_chains_equal_mujoco(convention, tmp_path):
    pytest.importorskip("mujoco")
    for seed in range(draws(4)):
        chain = ChainChoice(tip="end", convention=convention, angle_tolerance=0.0)
        found = import_robot(write(tmp_path, random_mjcf(seed)), chain=chain)
        compared = compare_with_source(found, seed)
        assert compared.torque is not None, compared
        assert compared.pose < AGREE, (seed, compared)
        assert compared.torque < AGREE, (seed, compared)


ARM = """\
<mujoco model="arm">
  <compiler angle="degree"/>
  <worldbody>
    <body name="upper" pos="0 0 0.3" quat="0.707107 0.707107 0 0">
      <joint name="lift" range="-90 45" damping="0.4" frictionloss="0.2" armature="0.3" actuatorfrcrange="-20 20"/>
      <inertial pos="0.1 0 0" mass="2" fullinertia="0.1 0.2 0.2 0.01 0 0"/>
      <body name="lower" pos="0.5 0 0">
        <joint name="bend" axis="0 0 -1" stiffness="3"/>
        <geom type="mesh" mesh="forearm"/>
      </body>
    </body>
  </worldbody>
  <asset><mesh name="forearm" file="forearm.stl"/></asset>
  <actuator><motor joint="bend" gear="30" ctrlrange="-2 3"/><muscle site="s"/></actuator>
</mujoco>
"""


def test_what_is_read_and_what_is_said(tmp_path):
    found = import_robot(write(tmp_path, ARM))
    lift, bend = found.spec.joints
    assert (str(lift.alpha), str(lift.a), str(bend.theta)) == ("pi", "1/2", "0")
    assert lift.limits.lower == pytest.approx(-np.pi / 2)
    assert (lift.limits.torque, lift.friction.viscous, lift.friction.coulomb, lift.drive.inertia) == (20, 0.4, 0.2, 0.3)
    assert (bend.limits.lower, bend.limits.torque) == (None, 60)
    assert (found.spec.links[0].mass, found.spec.links[1].mass) == (2, 0)
    said = "\n".join(str(note) for note in found.notes)
    for part in ("arm.xml:9:9: warning: the inertia of a mesh is left out", "the spring of joint 'bend' is left out",
                 "the actuator <muscle> is left out", "<asset> is left out"):  # fmt: skip
        assert part in said, part
    pytest.importorskip("mujoco")
    assert "cannot load the file alone" in str(compare_with_source(found))


FAULTS = {
    "include": ("<worldbody>", '<include file="a.xml"/><worldbody>', "3:3", "<include> is not read"),
    "ball": ('name="bend"', 'name="bend" type="ball"', "8:9", "joint 'bend' on the chain is ball"),
    "type": ('name="bend"', 'name="bend" type="hing"', "8:34", "the type of joint 'bend' is 'hing'"),
    "two": ('axis="0 0 -1"', 'axis="0 0 -1" pos="0 0"', "8:47", "pos of <joint> is '0 0'"),
    "rotations": ('quat="0.7', 'euler="0 0 0" quat="0.7', "4:45", "quat and euler are both given"),
    "range": ('range="-90 45"', 'range="90 45"', "5:33", "range of <joint> is 90 to 45"),
    "damping": ('damping="0.4"', 'damping="-0.4"', "5:50", "damping of <joint> is -0.4"),
    "frictionloss": ('frictionloss="0.2"', 'frictionloss="-1"', "5:69", "frictionloss of <joint> is -1"),
    "armature": ('armature="0.3"', 'armature="-3"', "5:84", "armature of <joint> is -3"),
    "masses": ('angle="degree"', 'settotalmass="3"', "2:27", "settotalmass is '3'"),
    "root": ("<mujoco ", "<mujocoo ", "1:1", "the root is <mujocoo>"),
    "size": ('type="mesh" mesh="forearm"', 'type="box" size="0.1"', "9:32", "size of a box has 1 numbers"),
    "shell": ('type="mesh" mesh="forearm"', 'size="1" shellinertia="true"', "9:38", "the inertia of a shell"),
    "class": ('name="bend"', 'name="bend" class="mian"', "8:35", "there is no default class 'mian'"),
    "equality": (
        "<asset>",
        '<equality><joint joint1="lift" joint2="bent"/></equality><asset>',
        "13:42",
        "there is no joint 'bent'",
    ),
    "frame": (
        '<geom type="mesh" mesh="forearm"/>',
        '<geom size="1"/><frame pos="1 0 0"><joint name="turn"/></frame>',
        "9:44",
        "<joint> in a <frame> is not read",
    ),
    "twice": ('name="lower"', 'name="upper"', "7:7", "there are two bodies 'upper'"),
    "inertials": (
        '<body name="lower"',
        '<inertial mass="1"/><body name="lower"',
        "7:7",
        "two <inertial> in one <body>",
    ),
    "attribute": ('frictionloss="0.2"', 'frictionlos="0.2"', "5:68", "<joint> has no attribute 'frictionlos'"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_located(case, tmp_path):
    old, new, place, message = FAULTS[case]
    assert ARM.count(old) == 1
    text = ARM.replace(old, new).replace("</mujoco>", "</mujocoo>" if case == "root" else "</mujoco>")
    file = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        import_robot(file, form="mjcf")
    assert any(str(f).startswith(f"{file}:{place}: error") and message in f.message for f in caught.value.faults), str(
        caught.value
    )


@pytest.mark.parametrize("zero", [".0", "-.0", ".00"])
def test_spellings_of_zero(zero, tmp_path):
    found = import_robot(write(tmp_path, ARM.replace('pos="0.5 0 0"', f'pos="0.5 {zero} {zero}"'))).spec
    plain = import_robot(write(tmp_path, ARM)).spec
    assert (found.joints, found.links, found.tool) == (plain.joints, plain.links, plain.tool)


@pytest.mark.parametrize("name", ["", " "])
def test_a_joint_with_an_empty_name_has_none(name, tmp_path):
    """As MuJoCo reads it: such a joint gets a number."""
    text = ARM.replace('joint name="bend"', f'joint name="{name}"').replace(
        '<motor joint="bend"', '<motor joint="lift"'
    )
    assert import_robot(write(tmp_path, text)).spec.joints[1].name == "lower_joint1"


UNNAMED = """<mujoco model="unnamed"><worldbody>
  <body name="crate"><freejoint/><geom size=".1"/></body>
  <body name="b1"><joint name=" " axis="0 0 1"/><geom size=".1" pos=".2 0 0"/>
    <body name="" pos=".3 0 0"><joint axis="0 1 0"/><joint type="slide" axis="1 0 0"/><geom size=".1" pos=".2 0 0"/>
      <body pos="0 0 .1"><geom size=".2" pos="0 .1 0"/></body></body></body></worldbody></mujoco>"""


def test_names_are_optional(tmp_path):
    """Bodies without a name have the number that MuJoCo gives them, also a free one beside the chain."""
    found = import_robot(write(tmp_path, UNNAMED), chain=ChainChoice(base="b1", tip="body 4"))
    assert found.chain.joints == ("body 3_joint1", "body 3_joint2")
    assert "crate_joint1" in found.chain.held
    pytest.importorskip("mujoco")
    for chain in (ChainChoice(base="b1", tip="body 4"), ChainChoice(tip="body 3")):
        compared = compare_with_source(import_robot(tmp_path / "arm.xml", chain=chain))
        assert compared.torque is not None, compared
        assert max(compared.pose, compared.torque) < AGREE


def test_invented_names_are_none_of_the_file(tmp_path):
    text = UNNAMED.replace("crate", "body 3").replace('axis="0 1 0"', 'axis="0 1 0" name="b1_joint1"')
    found = import_robot(write(tmp_path, text), chain=ChainChoice(tip="body 4"))
    assert found.chain.joints == ("b1_joint1_", "b1_joint1", "body 3__joint2")


def test_a_body_that_mujoco_fuses_is_not_compared(tmp_path):
    pytest.importorskip("mujoco")
    text = UNNAMED.replace("<worldbody>", '<compiler fusestatic="true"/><worldbody>')
    compared = compare_with_source(import_robot(write(tmp_path, text), chain=ChainChoice(tip="body 4")))
    assert "reads the file without body 4" in str(compared)


def test_attributes_are_those_of_mujoco():
    """Every word of the schema that MuJoCo prints for these elements is read or left out, none is a fault."""
    mujoco = pytest.importorskip("mujoco")
    found: dict[str, set[str]] = {}
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if start := re.match(r" *(\w+) \((\S)\) *(.*)", line):
            words = found.setdefault(start[1], set())
        words |= set((start[3] if start else line).split())
    for tag in ("inertial", "frame", "freejoint"):
        assert found.get(tag, set()) <= set(ATTRIBUTES[tag]), tag
    assert set(ATTRIBUTES["joint"]) <= found["joint"]


SITES = ('<site name="tip" pos="0.2 0 0.1" euler="0 90 0"/>', '<site name="cam" pos="0 0 0.3"/>')


def test_the_only_site_on_the_last_body_is_the_tip(tmp_path):
    """It is where an export puts the tool; a choice among several sites is left to the user, and said."""
    end = '<geom type="mesh" mesh="forearm"/>'
    found = import_robot(write(tmp_path, ARM.replace(end, end + SITES[0])))
    assert found.chain.tip == "tip"
    named = import_robot(tmp_path / "arm.xml", chain=ChainChoice(tip="tip"))
    assert (found.spec.joints, found.spec.tool) == (named.spec.joints, named.spec.tool)
    assert "the tip is the site 'tip' on 'lower'" in "\n".join(map(str, found.notes))
    body = import_robot(tmp_path / "arm.xml", chain=ChainChoice(tip="lower"))
    assert body.spec.tool.translation == (0, 0, 0)
    several = import_robot(write(tmp_path, ARM.replace(end, end + "".join(SITES))))
    assert several.chain.tip == "lower"
    assert "--tip takes a site: tip, cam" in "\n".join(map(str, several.notes))


def test_equalities_of_two_joints_make_one_follow_the_other(tmp_path):
    text = """<mujoco><compiler angle="degree"/><worldbody>
      <body name="a" pos="0 0 0.3"><joint name="lead" axis="0 1 0" armature="0.2"/>
        <inertial pos="0.1 0 0.05" mass="2" diaginertia="0.1 0.2 0.2"/>
        <body name="b" pos="0.4 0 0"><joint name="follow" axis="0 1 0.5" ref="10" damping="0.8" armature="0.1"/>
          <inertial pos="0.2 0.03 0" mass="1" diaginertia="0.05 0.1 0.1"/></body></body></worldbody>
      <equality><joint joint1="follow" joint2="lead" polycoef="0.1 -2"/></equality></mujoco>"""
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    found = import_robot(tmp_path / "arm.xml")
    spec = found.spec
    assert [joint.name for joint in spec.joints] == ["lead"]
    assert [float(row[0]) for row in spec.mechanism.matrix] == [1.0, -2.0]
    assert spec.joints[0].friction.viscous == pytest.approx(4 * 0.8)
    assert spec.joints[0].drive.inertia == pytest.approx(0.2 + 4 * 0.1)
    pytest.importorskip("mujoco")
    compared = compare_with_source(found)
    assert max(compared.pose, compared.torque) < 1e-9


def test_a_joint_called_null_gets_another_name(tmp_path):
    (tmp_path / "arm.xml").write_text(
        '<mujoco model="arm"><worldbody><body name="upper"><joint name="null" axis="0 0 1"/>'
        '<geom type="box" size="0.1 0.1 0.1"/></body></worldbody></mujoco>'
    )
    imported = import_robot(tmp_path / "arm.xml")
    assert imported.spec.joints[0].name == "q1"
    assert any("joint 'null' is called q1" in note.message for note in imported.notes)


PENDULUM = """<mujoco model="arm"><worldbody><body name="upper"><joint name="lift" axis="0 1 0"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("option", "gravity"),
    [
        ('<option gravity="0 1 -9"><flag gravity="disable"/></option>', (0, 0, 0)),
        ('<option gravity="0 1 -9"><flag gravity="enable"/></option>', (0, 1, -9)),
        ('<option><flag gravity="disable"/></option><option><flag gravity="enable"/></option>', (0, 0, -9.81)),
        ('<option><flag gravity="disable"/></option><option gravity="0 1 -9"/>', (0, 0, 0)),
    ],
)
def test_gravity_can_be_disabled(option, gravity, tmp_path):
    found = import_robot(write(tmp_path, PENDULUM.replace("<worldbody>", option + "<worldbody>")))
    assert tuple(map(float, found.spec.gravity)) == gravity
    pytest.importorskip("mujoco")
    assert compare_with_source(found).torque < AGREE


GROUPS = """<mujoco model="arm"><compiler inertiagrouprange="{}"/><default><default class="looks">
  <geom group="2"/></default></default><worldbody><body name="upper"><joint name="lift" axis="0 1 0"/>
  <geom class="looks" size=".2" pos=".5 0 0"/><geom group="3" size=".1" pos=".1 0 0"/><geom size=".15"/></body>
  </worldbody></mujoco>"""


@pytest.mark.parametrize(("groups", "radii"), [("3 3", [0.1]), ("0 2", [0.2, 0.15]), ("0 5", [0.2, 0.1, 0.15])])
def test_geoms_of_other_groups_have_no_mass(groups, radii, tmp_path):
    found = import_robot(write(tmp_path, GROUPS.format(groups)))
    assert found.spec.links[0].mass == pytest.approx(sum(1000 * 4 / 3 * np.pi * r**3 for r in radii))
    pytest.importorskip("mujoco")
    assert compare_with_source(found).torque < AGREE


COUPLED = """<mujoco model="arm"><compiler angle="radian"/>{before}<worldbody><site name="wall" pos="1 0 0"/>
  <body name="a"><joint name="lead" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
    <body name="b" pos=".4 0 0"><joint name="follow" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>
      <body name="left"><joint name="left"/><geom size=".01"/></body>
      <body name="right"><joint name="right"/><geom size=".01"/></body><site name="hand" pos=".2 0 0"/></body></body>
  <body name="crate" pos="1 0 0"><freejoint/><geom size=".1"/></body><body name="target" mocap="true"/></worldbody>
  <equality>{equality}</equality></mujoco>"""
JOINTS = '<joint joint1="follow" joint2="lead" polycoef="0.1 -2 0 0 0" {}/>'
INACTIVE = {
    "attribute": ("", JOINTS.format('active="false"')),
    "flag": ('<option><flag equality="disable"/></option>', JOINTS.format("")),
    "constraints": ('<option><flag constraint="disable"/></option>', JOINTS.format("")),
    "default": ('<default><equality active="false"/></default>', JOINTS.format("")),
    "class": ('<default><default class="c"><equality active="false"/></default></default>', JOINTS.format('class="c"')),
    "weld": ("", '<weld body1="b" active="false"/>'),
}


def coupled(folder, equality, before="", **choice):
    chain = ChainChoice(**{"tip": "b", **choice})
    return import_robot(write(folder, COUPLED.format(before=before, equality=equality)), chain=chain)


@pytest.mark.parametrize("case", INACTIVE)
def test_inactive_equalities_couple_nothing(case, tmp_path):
    before, equality = INACTIVE[case]
    found = coupled(tmp_path, equality, before)
    assert (found.spec.n, found.spec.mechanism) == (2, None)
    assert "is left out: it is not active" in "\n".join(map(str, found.notes))


def test_an_equality_of_a_class_may_be_active(tmp_path):
    classes = '<default><equality active="false"/><default class="c"><equality active="true"/></default></default>'
    found = coupled(tmp_path, JOINTS.format('class="c"'), classes)
    assert found.spec.n == 1


CLOSED = (
    '<weld body1="b"/>',
    '<weld body1="b" body2="world"/>',
    '<weld site1="wall" site2="hand"/>',
    '<connect body1="left" body2="a" anchor="0 0 0"/>',
    '<joint joint1="follow" polycoef="0.3 0 0 0 0"/>',
    '<joint joint1="follow" joint2="lead" polycoef="0 1 2 0 0"/>',
)


@pytest.mark.parametrize("equality", CLOSED)
def test_equalities_that_hold_the_chain_are_refused(equality, tmp_path):
    with pytest.raises(InputError, match=f"the equality {equality.split()[0]}> constrains joint '(lead|follow)'"):
        coupled(tmp_path, equality)


BESIDE = (
    '<weld body1="b" body2="crate"/>',
    '<weld body1="target" body2="b"/>',
    '<connect body1="left" body2="right" anchor="0 0 0"/>',
    '<joint joint1="left" joint2="lead" polycoef="0 1 2 0 0"/>',
    '<weld body1="crate"/>',
)


@pytest.mark.parametrize("equality", BESIDE)
def test_equalities_beside_the_chain_are_left_out(equality, tmp_path):
    found = coupled(tmp_path, equality)
    assert (found.spec.n, found.spec.mechanism) == (2, None)
    assert f"the equality {equality.split()[0]}> is left out" in "\n".join(map(str, found.notes))


def test_ends_of_an_equality_exist(tmp_path):
    with pytest.raises(InputError, match="there is no body 'craet'"):
        coupled(tmp_path, '<weld body1="b" body2="craet"/>')


FORCE = '<position joint="lift" forcerange="-5 6" {}/>'
MOTOR = '<motor joint="lift" gear="2" ctrlrange="-3 3" {}/>'
GENERAL = '<default><general forcerange="-4 4"/></default>'
LIMITS = {
    "forcerange": ("", "", FORCE.format(""), 5),
    "no force": ("", "", FORCE.format('forcelimited="false"'), None),
    "ctrlrange": ("", "", MOTOR.format(""), 6),
    "no ctrl": ("", "", MOTOR.format('ctrllimited="false"'), None),
    "no auto": ('<compiler autolimits="false"/>', "", MOTOR.format(""), None),
    "stated": ('<compiler autolimits="false"/>', "", MOTOR.format('ctrllimited="true"'), 6),
    "joint": ("", 'actuatorfrcrange="-7 7"', FORCE.format(""), 7),
    "no joint": ("", 'actuatorfrcrange="-7 7" actuatorfrclimited="false"', FORCE.format(""), 5),
    "default position": (GENERAL, "", '<position joint="lift"/>', 4),
    "default motor": (GENERAL, "", '<motor joint="lift"/>', 4),
    "default velocity": (GENERAL.replace("general", "motor"), "", '<velocity joint="lift"/>', 4),
    "two": ("", "", FORCE.format("") + MOTOR.format(""), 11),
    "one of two": ("", "", FORCE.format("") + '<motor joint="lift"/>', None),
}


@pytest.mark.parametrize("case", LIMITS)
def test_torque_limits_are_those_of_the_actuators(case, tmp_path):
    before, joint, actuators, limit = LIMITS[case]
    text = PENDULUM.replace("<worldbody>", before + "<worldbody>").replace('axis="0 1 0"', f'axis="0 1 0" {joint}')
    found = import_robot(write(tmp_path, text.replace("</mujoco>", f"<actuator>{actuators}</actuator></mujoco>")))
    assert found.spec.joints[0].limits.torque == limit


@pytest.mark.parametrize("joint", ['<freejoint name="root"/>', '<joint type="ball"/><joint type="slide"/>'])
def test_the_hint_for_a_free_base_can_be_followed(joint, tmp_path):
    lower = '<body name="hand" pos=".3 0 0"><joint name="bend"/><geom size=".1" pos=".1 0 0"/></body>'
    text = PENDULUM.replace('<joint name="lift" axis="0 1 0"/>', joint).replace("</body>", lower + "</body>")
    with pytest.raises(InputError) as caught:
        import_robot(write(tmp_path, text))
    (hint,) = {fault.hint for fault in caught.value.faults if fault.severity == "error"}
    assert hint.endswith("; begin behind it with --base upper")
    found = import_robot(tmp_path / "arm.xml", chain=ChainChoice(base="upper"))
    assert [joint.name for joint in found.spec.joints] == ["bend"]
    pytest.importorskip("mujoco")
    assert compare_with_source(found).torque < AGREE


GEARED = """<mujoco model="arm">{option}<default><motor damping="0.0002"/></default><worldbody>
  <body name="a"><joint name="j1" axis="0 1 0" damping="0.1" frictionloss="0.2" {joint}/><geom size=".1" pos=".3 0 0"/>
    <body name="b" pos=".4 0 0"><joint name="j2" axis="0 1 0" armature="0.5"/><geom size=".1" pos=".2 0 0"/></body>
  </body></worldbody><tendon><fixed name="t" armature="0.1"><joint joint="j1" coef="1"/><joint joint="j2" coef="2"/>
  </fixed><fixed name="u"><joint joint="j1" coef="1"/></fixed></tendon><actuator>{actuator}</actuator></mujoco>"""
TENDONS = re.compile(r"<tendon>.*</tendon>", re.DOTALL)
MOTOR = '<motor joint="j1" gear="50" armature="0.001"/>'


def geared(folder, option="", joint="", actuator="", tendons=False):
    text = GEARED.format(option=option, joint=joint, actuator=actuator)
    return import_robot(write(folder, text if tendons else TENDONS.sub("", text)))


def agrees(imported):
    pytest.importorskip("mujoco")
    compared = compare_with_source(imported)
    return max(compared.pose, compared.torque) < AGREE


def test_inertia_and_damping_of_an_actuator_act_on_its_joint(tmp_path):
    imported = geared(tmp_path, actuator=MOTOR + MOTOR.replace("50", "-10"))
    assert imported.spec.joints[0].drive.inertia == pytest.approx(2.5 + 0.1)
    assert imported.spec.joints[0].friction.viscous == pytest.approx(0.1 + 0.5 + 0.02)
    assert imported.spec.joints[1].drive.inertia == 0.5
    assert agrees(imported)


def test_inertia_and_damping_of_an_actuator_act_on_its_tendon(tmp_path):
    imported = geared(tmp_path, actuator=MOTOR.replace('joint="j1"', 'tendon="t"'), tendons=True)
    motor = imported.spec.drives.motors[0]
    assert (motor.inertia, motor.friction.viscous) == (pytest.approx(2.6), pytest.approx(0.5))


def test_the_comparison_sees_inertia_that_an_import_misses(tmp_path):
    pytest.importorskip("mujoco")
    imported = geared(tmp_path, actuator=MOTOR)
    drive = replace(imported.spec.joints[0].drive, inertia=0.0)
    joints = (replace(imported.spec.joints[0], drive=drive), *imported.spec.joints[1:])
    compared = compare_with_source(replace(imported, spec=replace(imported.spec, joints=joints)))
    assert "torques differ" in compared.contradictions


LEFT_OUT = {
    "springdamper": ("", 'springdamper="0.1 1"', (None, 0.2), "spring and damper of joint 'j1' are left out"),
    "medium": ('<option density="1.2" viscosity="0" wind="0 0 1"/>', "", (0.1, 0.2), "left out: density, wind of"),
    "damper": ('<option><flag damper="disable"/></option>', "", (None, 0.2), "damping of all joints is left out"),
    "frictionloss": ('<option><flag frictionloss="disable"/></option>', "", (0.1, None), "frictionloss of all joints"),
    "constraint": ('<option><flag constraint="disable"/></option>', "", (0.1, None), "frictionloss of all joints"),
}


@pytest.mark.parametrize("case", LEFT_OUT)
def test_what_is_disabled_or_has_no_place_is_left_out_and_said(case, tmp_path):
    option, joint, friction, note = LEFT_OUT[case]
    imported = geared(tmp_path, option, joint)
    spec = imported.spec.joints[0].friction
    assert (spec.viscous, spec.coulomb) == friction
    assert note in "\n".join(map(str, imported.notes))
    assert agrees(imported)


def test_a_chain_towards_the_world_is_compared_in_poses_only(tmp_path):
    """MuJoCo holds the world, the robot file the base: torques of the two differ, and neither is wrong."""
    pytest.importorskip("mujoco")
    geared(tmp_path)
    for base, tip, compares in (("b", "a", False), ("a", "b", True)):
        compared = compare_with_source(import_robot(tmp_path / "arm.xml", chain=ChainChoice(base=base, tip=tip)))
        assert (compared.pose < AGREE, compared.torque is not None) == (True, compares)
        assert ("torques not compared: MuJoCo" in str(compared), compared.contradictions) == (not compares, "")


@pytest.mark.parametrize(("group", "mass"), [("", 1000 * 4 / 3 * np.pi * 0.1**3), ('group="2"', 5.0)])
def test_a_body_without_massive_geoms_keeps_its_inertia_where_geoms_come_first(group, mass, tmp_path):
    stated = '<inertial pos="0.1 0 0" mass="5" diaginertia="1 1 1"/><geom ' + group
    text = PENDULUM.replace("<worldbody>", '<compiler inertiafromgeom="true" inertiagrouprange="0 1"/><worldbody>')
    imported = import_robot(write(tmp_path, text.replace("<geom", stated)))
    assert imported.spec.links[0].mass == pytest.approx(mass)
    assert agrees(imported)
