"""Denavit-Hartenberg rows of joint axes in space: random chains, nearly parallel axes, any end first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot.importers.random_trees import random_tree
from robot.importers.urdf_files import AGREE, ARM, said, write
from rrrgen.exporting import export_robot
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import compare_with_source
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of


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
