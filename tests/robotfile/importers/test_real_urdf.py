"""URDFs of real arms: imported, equal to the source as Pinocchio reads it, and solved for inverse kinematics."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from rrrgen.robotfile.importers.importing import Imported, import_robot
from rrrgen.robotfile.importers.interface import ChainChoice
from rrrgen.verify.references.chain import chain_of
from rrrgen.verify.references.imported_source import compare_with_source
from rrrgen.verify.references.newton_euler import NewtonEuler

AGREE = 1e-9  # relative
TOOLBOX = {
    "irb140": ("abb_irb140_description/urdf/irb140.urdf", ""),
    "kr16": ("kuka_description/kuka_kr16/urdf/kr16_2.urdf", ""),
    "kr120": ("kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf", ""),
    "kr210": ("kuka_description/kuka_kr210/urdf/kr210l150.urdf", "tool0"),
    "iiwa14": ("kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", ""),
    "puma560": ("unimation_puma560_description/urdf/puma560_robot.urdf", ""),
    "al5d": ("lynxmotion_al5d_description/urdf/al5d_robot.urdf", ""),
    "panda": ("qut_frankie_description/robots/panda_arm.urdf.xacro", ""),
    "px100": ("trossen_descriptions/urdf/px100.urdf.xacro", "px100/ee_gripper_link"),
    "wx250s": ("trossen_descriptions/urdf/wx250s.urdf.xacro", "wx250s/ee_gripper_link"),
    "vx300s": ("trossen_descriptions/urdf/vx300s.urdf.xacro", "vx300s/ee_gripper_link"),
}
"""Files of rtb-data, which the Robotics Toolbox brings; those with macros are expanded by its xacro."""
OTHERS = {
    "panda with inertia": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "ee_link"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "j2s6s200": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ""),
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "tiago": ("tiago_description/robots/tiago.urdf", "hand_tool_link"),
    "baxter": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
}
"""Files of example-robot-data, 130 MB that no extra installs."""


def toolbox_file(name: str, folder: Path) -> Path:
    data = pytest.importorskip("rtbdata", reason="needs rtb-data, which roboticstoolbox-python installs")
    root = Path(next(iter(data.__path__))) / "xacro"
    file = root / TOOLBOX[name][0]
    if file.suffix == ".urdf":
        return file
    xacrodoc = pytest.importorskip("xacrodoc", reason="needs xacrodoc, which roboticstoolbox-python installs")
    xacrodoc.packages.update_package_cache({each.name: str(each) for each in root.iterdir() if each.is_dir()})
    document = xacrodoc.XacroDoc.from_file(str(file), subargs={"robot_name": name, "robot_model": name})
    (folder / f"{name}.urdf").write_text(document.to_urdf_string(), encoding="utf-8")
    return folder / f"{name}.urdf"


def other_file(name: str) -> Path:
    for place in sys.path:
        file = Path(place) / "cmeel.prefix/share/example-robot-data/robots" / OTHERS[name][0]
        if file.exists():
            return file
    pytest.skip("needs 130 MB of robots: pip install --no-deps example-robot-data")


def check_against_source(file: Path, tip: str) -> Imported:
    pytest.importorskip("pinocchio")
    as_written = import_robot(file, name="arm", chain=ChainChoice(tip=tip, angle_tolerance=0.0))
    compared = compare_with_source(as_written)
    assert compared.pose < 2 * AGREE, compared  # al5d: axes parallel to 3.6e-9 rad are taken as parallel
    assert compared.torque is None or compared.torque < AGREE, compared
    found = import_robot(file, name="arm", chain=ChainChoice(tip=tip))
    assert compare_with_source(found).pose < 5e-5
    return found


@pytest.mark.parametrize("name", TOOLBOX)
def test_arms_of_the_toolbox(name, tmp_path):
    check_against_source(toolbox_file(name, tmp_path), TOOLBOX[name][1])


@pytest.mark.parametrize("name", OTHERS)
def test_arms_with_inertia(name):
    check_against_source(other_file(name), OTHERS[name][1])


@pytest.mark.parametrize("name", ["kr210", "puma560"])
def test_they_are_solved_for_inverse_kinematics(name, tmp_path):
    import rrrgen

    found = import_robot(toolbox_file(name, tmp_path), name="arm", chain=ChainChoice(tip=TOOLBOX[name][1]))
    model = rrrgen.compile(found.spec, backend="numpy")
    q = np.random.default_rng(4).uniform(-1, 1, found.spec.n)
    T = NewtonEuler(chain_of(found.spec), np.zeros((found.spec.n, 10))).forward_kinematics(q[None])[0]
    solutions = model.inverse_kinematics(T)
    assert np.abs(np.asarray(solutions.q) - q).max(axis=1).min() < 1e-9
