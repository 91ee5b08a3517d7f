"""The figures of trees, floating bases and loops keep their limits; a full run takes minutes."""

from __future__ import annotations

import pytest

from bench.measurements.mechanisms import PALLETISER, PARTS, Row, of_hessians, of_loops, robot


def test_a_four_bar_keeps_its_limits():
    rows = list(of_loops(["linkages/four_bar"]))
    assert [row.what for row in rows] == ["base parameters", "inverse_dynamics", "relative error of inverse dynamics"]
    assert all(row.met for row in rows), rows


@pytest.mark.sweep
@pytest.mark.parametrize("part", ["trees", "floating", "loops"])
def test_every_figure_keeps_its_limit(part):
    missed = [row for row in PARTS[part]() if not row.met]
    assert missed == []


@pytest.mark.sweep
def test_second_derivatives_of_the_hand_keep_their_limits():
    """Its product is the closest to its limit. All robots take four minutes."""
    missed = [row for row in of_hessians(["hand"], []) if not row.met]
    assert missed == []


@pytest.mark.sweep
def test_second_derivatives_on_the_base_of_the_quadruped_keep_their_limits():
    rows = list(of_hessians([]))
    assert len(rows) == 6
    assert all(row.met for row in rows), rows


def test_a_figure_that_has_to_equal_its_limit_may_not_be_below_it():
    assert Row("hand", "operations", 900, 925).met
    assert not Row("hand", "base parameters", 65, 66, exactly=True).met


def test_robots_are_cut_and_stand_on_a_trunk():
    assert [row.name for row in robot(PALLETISER).rows] == ["column", "shoulder", "elbow", "rod", "forearm"]
    assert robot("hand", floating=True).rows[0].name == "trunk"
    assert robot("quadruped", floating=True) == robot("quadruped")
