"""Trees of bodies: a joint that is held is part of its link."""

from __future__ import annotations

import pytest

from robot.importers.urdf_files import AGREE, ARM, said, write
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import compare_with_source
from rrrgen.verify.references.numeric_robot import nominal_parameters


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
