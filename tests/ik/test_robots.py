"""The robots of the benchmark table on 10^4 random reachable poses each: every seed, every row, the right counts."""

import numpy as np
import pytest

from ik.checks import sample
from ik.robots import ROWS

POSES = 10_000

CLOSED_FORM = {  # name: (family, most solutions, whether they are always all real)
    "rrr": ("position", 4, True),
    "ortho3r": ("position", 4, False),
    "puma": ("spherical", 8, True),
    "irb6640": ("spherical", 8, False),
    "irb120": ("spherical", 8, True),
    "kr6": ("spherical", 8, False),
    "stanford": ("spherical", 8, True),
    "ur5": ("parallel", 8, False),
    "ur10e": ("parallel", 8, False),
    "scara": ("lift", 2, True),
    "panda": ("spherical", 8, False),
    "iiwa14": ("elbow7", 8, True),
}


@pytest.mark.parametrize("name", CLOSED_FORM)
@pytest.mark.sweep(but=[*list(CLOSED_FORM)[::2]])
def test_random_poses(name):
    family, most, always = CLOSED_FORM[name]
    result = sample(name, N=POSES if len(ROWS[name]) < 7 else POSES // 5)
    assert result.solver.plan.family == family
    assert result.solver.max_solutions == most
    result.assert_right()
    counts = result.batch.counts
    assert counts.max() == most
    # real solutions come in pairs; an odd count is a double root, which random poses all but never hit
    assert np.mean(counts % 2) <= 1e-3
    if always:
        assert np.mean(counts == most) >= 0.999
    assert (result.batch.statuses == 0).all()


def test_counts_of_the_ur_arm_are_those_of_independent_solvers():
    # EAIK finds 2, 4, 6, 8 solutions on 3.0, 15.1, 5.2, 76.7 % of random poses of this arm (10^4 poses)
    counts = sample("ur5", N=POSES).batch.counts
    shares = [np.mean(counts == k) for k in (2, 4, 6, 8)]
    assert shares == pytest.approx([0.0296, 0.1514, 0.0524, 0.7666], abs=0.02)


def test_chapter_case_has_the_four_branches_of_the_complete_inverse():
    """q1 = atan2(Dx + rho y, rho x - Dy) and so on, for both signs of rho and of sin q3 (14.45)."""
    result = sample("rrr", N=2000)
    a2, a3, d1, D = 0.2, 0.415, 0.56, 0.169 + 0.09
    x, y, z = result.T[:, :3, 3].T
    for front in (1, -1):
        for up in (1, -1):
            rho = front * np.sqrt(x**2 + y**2 - D**2)
            height = z - d1
            C = (rho**2 + height**2 - a2**2 - a3**2) / (2 * a2 * a3)
            S = up * np.sqrt(1 - C**2)
            wanted = np.stack(
                [
                    np.arctan2(D * x + rho * y, rho * x - D * y),
                    np.arctan2((a2 + a3 * C) * height - a3 * S * rho, (a2 + a3 * C) * rho + a3 * S * height),
                    np.arctan2(S, C),
                ],
                axis=1,
            )
            apart = np.abs(result.wrapped(result.batch.q - wanted[:, None])).max(axis=2)
            row = apart.argmin(axis=1)
            assert apart.min(axis=1).max() < 1e-9
            labels = [result.solver.branch_names(b) for b in result.batch.branch[np.arange(len(row)), row]]
            assert {(b["shoulder"], b["elbow"]) for b in labels} == {(int(front < 0), int(up < 0))}
