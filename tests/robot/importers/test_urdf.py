"""URDF: the robot file is the chain of the tree, as Pinocchio reads it; what has no place in it is said or refused."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robot.importers.random_trees import random_tree
from robot.importers.urdf_files import AGREE, ARM, said, write
from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import compare_with_source
from samples.draws import draws


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
                 "1 angle was taken as a multiple of 15 degrees; the largest change is 3.7e-06 rad"):  # fmt: skip
        assert part in text
    kept = import_robot(tmp_path / "arm.urdf", chain=ChainChoice(angle_tolerance=0.0))
    assert "15 degrees" not in said(kept)
    pytest.importorskip("pinocchio")
    assert compare_with_source(kept).pose < 1e-12 < compare_with_source(found).pose < 1e-5


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


@pytest.mark.parametrize("number", ["1e16", "1e30", "1.7976931348623157e+308"])
def test_huge_limits_are_none(number, tmp_path):
    """Files write them where the format demands a number."""
    limit = f'<limit lower="-{number}" upper="{number}" velocity="{number}" effort="{number}"/>'
    text = ARM.replace('type="continuous"', 'type="revolute"')
    text = text.replace('<axis xyz="0 0 -1"/>', f'<axis xyz="0 0 -1"/>{limit}')
    limits = import_robot(write(tmp_path, text)).spec.joints[1].limits
    assert (limits.lower, limits.upper, limits.velocity, limits.torque) == (None,) * 4


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_the_hint_for_a_free_joint_can_be_followed(kind, tmp_path):
    file = write(tmp_path, ARM.replace('type="continuous"', f'type="{kind}"'))
    with pytest.raises(InputError, match="begin behind it with --base lower"):
        import_robot(file)


def test_a_chain_towards_the_root_is_compared_with_its_base_at_rest(tmp_path):
    """Both the reversed chain and one that begins inside; a wrong mass still shows."""
    pytest.importorskip("pinocchio")
    for seed in range(draws(3)):
        text, tip = random_tree(seed)
        file = write(tmp_path, text.replace('joint name="j0"', 'joint name="root_joint"'))
        for base, end in ((tip, "base"), (tip, "link0"), ("link0", tip)):
            imported = import_robot(file, chain=ChainChoice(base=base, tip=end, angle_tolerance=0.0))
            compared = compare_with_source(imported, seed)
            assert max(compared.pose, compared.torque) < AGREE, (seed, base, end, compared)
            last = imported.spec.links[-1]
            links = (*imported.spec.links[:-1], replace(last, mass=2 * last.mass))
            wrong = compare_with_source(replace(imported, spec=replace(imported.spec, links=links)), seed)
            assert "torques differ" in wrong.contradictions


def test_a_mimic_joint_of_multiplier_zero_is_fixed_and_loses_its_limits(tmp_path):
    text = ARM.replace(
        '<child link="lower"/>', '<child link="lower"/><mimic joint="lift" multiplier="0" offset="0.7"/>'
        '<limit lower="-0.5" upper="0.9" velocity="0.5" effort="2"/>'
    ).replace('type="continuous"', 'type="revolute"')  # fmt: skip
    imported = import_robot(write(tmp_path, text), chain=ChainChoice(angle_tolerance=0.0))
    assert [[float(v) for v in row] for row in imported.spec.mechanism.matrix] == [[1.0], [0.0]]
    assert imported.spec.joints[0].limits.velocity == 1.5
    pytest.importorskip("pinocchio")
    compared = compare_with_source(imported)
    assert max(compared.pose, compared.torque) < AGREE
