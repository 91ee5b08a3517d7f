"""``rrrgen import``: a robot file from one of another program."""

from __future__ import annotations

import re

import pytest

from rrrgen.cli.main import run
from rrrgen.robot.file import load_spec
from rrrgen.robot.importers.importing import importers
from tests.robot.file.par_files import SLIDING, inertia, text


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = {**SLIDING, **inertia(3, 1), "FX": "0,0,1,0"}
    (tmp_path / "slider.par").write_text(text(columns, "slider"), encoding="utf-8")
    return tmp_path


def test_a_robot_file_is_written_and_never_overwritten_by_chance(folder, capsys):
    assert run(["import", "slider.par", "--set", "L2=350 mm"]) == 0
    said = capsys.readouterr()
    assert "slider.yaml written from symoro" in said.out
    assert "slider.par:" in said.err
    assert "FX left out" in said.err
    assert load_spec("./slider.yaml").n == 3
    before = (folder / "slider.yaml").read_bytes()
    assert run(["import", "slider.par", "--set", "L2=400 mm"]) == 3
    assert (folder / "slider.yaml").read_bytes() == before
    assert run(["import", "slider.par", "--set", "L2=400 mm", "--force", "--name", "longer", "-o", "slider.yaml"]) == 0
    spec = load_spec("./slider.yaml")
    assert (spec.name, float(spec.parameters["L2"])) == ("longer", 0.4)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["slider.par"], 3, "'L2' has no value"),
        (["missing.par"], 3, "missing.par: error: the file cannot be read"),
        (["slider.par", "--format", "sdf"], 3, "formats are"),
        (["slider.par", "--set", "L2"], 2, "NAME=VALUE"),
        (["slider.par", "--set", "L2=0.4", "--name", "while"], 3, "--name"),
    ],
)
def test_faults_end_with_their_code_and_write_nothing(folder, capsys, arguments, code, message):
    assert run(["import", *arguments]) == code
    assert message in capsys.readouterr().err
    assert list(folder.glob("*.yaml")) == []


def test_help_names_every_format(capsys):
    assert run(["import", "--help"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in importers())


def test_a_chain_of_a_urdf_is_compared_with_its_source(folder, capsys):
    pytest.importorskip("pinocchio")
    ends = '<parent link="{}"/><child link="{}"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>'
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    body = "".join(f'<link name="l{k}">{inertial}</link>' for k in range(3))
    joints = "".join(
        f'<joint name="j{k}" type="continuous">{ends.format(f"l{k}", f"l{k + 1}")}</joint>' for k in (0, 1)
    )
    (folder / "arm.urdf").write_text(f'<robot name="arm">{body}{joints}</robot>', encoding="utf-8")
    assert run(["import", "arm.urdf", "--tip", "l2", "--hold", "j0=30 deg", "--convention", "modified"]) == 0
    said = capsys.readouterr()
    assert "reads the source: poses agree to" in said.out
    assert "held: j0 at 0.523599" in said.err
    spec = load_spec("./arm.yaml")
    assert (spec.n, spec.convention) == (1, "modified")
    assert run(["import", "arm.urdf", "--tip", "l3", "--force"]) == 3
    assert "there is no link 'l3'" in capsys.readouterr().err
    assert run(["import", "slider.par", "--tip", "l3"]) == 3


MESH = """<mujoco model="arm"><asset><mesh name="m" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/></asset>
<worldbody><body name="a"><joint name="j" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>{}</body></worldbody></mujoco>"""


@pytest.mark.parametrize("left_out", [False, True])
def test_a_robot_that_moves_otherwise_is_a_failed_check(folder, capsys, left_out):
    """Here it is a mesh whose points stand in the file: MuJoCo knows its inertia."""
    pytest.importorskip("mujoco")
    geom = '<geom type="mesh" mesh="m" pos=".5 0 0"/>' if left_out else ""
    (folder / "arm.xml").write_text(MESH.format(geom), encoding="utf-8")
    assert run(["import", "arm.xml"]) == (1 if left_out else 0)
    said = capsys.readouterr()
    assert load_spec("./arm.yaml").n == 1
    assert ("torques agree to" in said.out, "torques differ by 6.7e-02" in said.out) == (not left_out, left_out)
    assert ("arm.yaml: warning: the robot file does not move as arm.xml: torques differ" in said.err) == left_out
    assert said.err.index("the inertia of a mesh is left out") if left_out else True


def test_rounded_angles_explain_a_difference(folder, capsys):
    pytest.importorskip("mujoco")
    text = MESH.format('<body name="b" pos=".4 0 0" euler="0.03 0.02 0"><joint name="k"/><geom size=".1 .2"/></body>')
    (folder / "arm.xml").write_text(text, encoding="utf-8")
    assert run(["import", "arm.xml", "--angle-tolerance", "1e-3"]) == 0
    said = capsys.readouterr()
    assert re.search(r"poses agree to \d\.\de-04, torques agree to", said.out)
    assert "taken as" in said.err


SHAPED = """<robot name="shaped"><link name="b"><visual/><visual /><collision/></link>
<link name="c"><visual/><collision/></link>
<joint name="j" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/></joint></robot>"""


@pytest.mark.parametrize("verbose", [False, True])
def test_the_result_comes_first_and_shapes_in_one_line(folder, capsys, verbose):
    (folder / "shaped.urdf").write_text(SHAPED, encoding="utf-8")
    assert run(["import", "shaped.urdf", *["--verbose"] * verbose]) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[0].startswith("shaped.yaml written from urdf")
    assert ("<visual> is left out, 3 times" in said.err) == verbose
    assert ("5 visual and collision elements left out (--verbose lists them)" in said.err) != verbose
    assert "a URDF has no gravity" in said.err


PLAIN = """<robot name="plain"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="lift" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint>
<joint name="last" type="continuous"><parent link="c"/><child link="d"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ("lift=90 deg", "joint 'lift' is prismatic: it cannot be held at a value in deg"),
        ("turn=250 mm", "joint 'turn' is revolute: it cannot be held at a value in mm"),
        ("turn=1 N*m", "a value in N*m"),
        ("turn=90 deg", ""),
        ("lift=250 mm", ""),
        ("lift=0.25", ""),
    ],
)
def test_held_values_have_units_of_their_joint(folder, capsys, held, message):
    (folder / "plain.urdf").write_text(PLAIN, encoding="utf-8")
    assert run(["import", "plain.urdf", "--hold", held]) == (3 if message else 0)
    assert message in capsys.readouterr().err
