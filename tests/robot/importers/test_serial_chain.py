"""URDFs of real arms: imported, equal to the source as Pinocchio reads it, and solved for inverse kinematics.

``python -m bench.measurements.real_urdfs`` asks the same on more poses, and verifies every function of the arms.
"""

from __future__ import annotations

import pytest

from bench.measurements.real_urdfs import ARMS, TOOLBOX, MissingDataError, agrees, imported, solved
from rrrgen.verify.references.imported_source import compare_with_source

POSES, POSES_COMPILED = 5, 300
COMPILED = ("irb140",)
"""Arms without special geometry, which are solved in C only."""


def taken(name, folder, **choice):
    try:
        return imported(name, folder, **choice)
    except MissingDataError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", ARMS)
def test_poses_and_torques_are_those_of_the_source(name, tmp_path):
    pytest.importorskip("pinocchio")
    difference = compare_with_source(taken(name, tmp_path, angle_tolerance=0.0))
    assert agrees(difference), difference
    assert compare_with_source(taken(name, tmp_path)).pose < 5e-5  # with exact angles


@pytest.mark.parametrize("name", [name for name, arm in ARMS.items() if arm.package == TOOLBOX])
def test_they_are_solved_for_inverse_kinematics(name, tmp_path):
    compiled = name in COMPILED
    found = solved(
        taken(name, tmp_path).spec, POSES_COMPILED if compiled else POSES, 4, backend="c" if compiled else "numpy"
    )
    assert found.ok, found


def test_the_tilt_of_nearly_parallel_axes_is_kept_and_solved(tmp_path):
    """The axes of the AL5D are parallel to 6e-10 rad; a fixed row holds that tilt where no angle is rounded."""
    found = taken("al5d", tmp_path, angle_tolerance=0.0)
    assert [row.name for row in found.spec.rows if row.name.startswith("tilt")] == ["tilt_j4"]
    assert solved(found.spec, POSES, 4, backend="numpy").ok
