"""Which geometric parameters a calibration can tell: counts, gains, lengths, and words for what it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.calibrate.virtual import turned
from rrrgen.lab.calibrate.geometry import Fixture, geometry_of, rigid
from rrrgen.lab.calibrate.measurements import Measurements
from rrrgen.lab.calibrate.minimal_set import minimal_set
from rrrgen.robot.file import load_spec

# rank over a finite field at random rational angles, computed apart from this code, with a tool off the axes and the
# world frame off the base: pose 4R + 2P + 6, point 3 less, distance and height over a tilted plane; then wires of
# unknown length, which count with their four parameters, a tilted plane that is touched, and a point
COUNTS = {
    "rrr": (18, 15, 12, 12, 13),
    "puma560": (30, 27, 24, 24, 25, 23, 23),
    "ur10e": (30, 27, 24, 24, 25, 23, 23),
    "scara": (20, 17, 14, 14, 15),
    "panda": (34, 31, 28, 28, 29),
    "stanford": (28, 25, 22, 22, 23),
}
WITHOUT_BETA = {"rrr": 17, "puma560": 29, "ur10e": 28, "scara": 17, "panda": 34, "stanford": 27}
FIXTURES = (
    Fixture("wire", "w", np.array([0.1, 0.2, -0.3]), 0.05),
    Fixture("plane", "p", np.array([0.6, 0.0, 0.8]), 0.35),
    Fixture("contact", "c", np.array([0.2, 0.3, 0.4])),
)


def sets(geometry, count):
    """The minimal sets of all kinds of measurements, ``count`` of them, those with fixtures at 60 positions."""
    found = [minimal_set(geometry, kind) for kind in ("pose", "point", "distance", "height")]
    q = np.random.default_rng(0).uniform(-2, 2, (60, geometry.joints))
    p = geometry.forward(q)[:, :3, 3]
    for each in FIXTURES[: count - len(found)]:
        values = each.predict(p)[:, 0] if each.kind == "wire" else np.zeros(60)
        seen = Measurements(each.kind, q, values, 1.0, 1.0, fixture=np.zeros(60, int), names=(each.name,))
        found.append(minimal_set(replace(geometry, fixtures=(each,)), seen))
    return found


@pytest.mark.parametrize("name", COUNTS)
def test_minimal_sets(name):
    found = sets(turned(name), len(COUNTS[name]))
    assert tuple(len(each.kept) for each in found) == COUNTS[name]
    entries = [each for each in turned(name).entries() if each.key != "beta"]
    q = np.random.default_rng(1).uniform(-2, 2, (100, turned(name).joints))
    J = turned(name).jacobian(q, entries).reshape(-1, len(entries))
    assert np.linalg.matrix_rank(J, tol=1e-9 * np.linalg.norm(J)) == WITHOUT_BETA[name]


@pytest.mark.parametrize("name", ["puma560", "ur10e", "panda"])
def test_gains_add_one_parameter_a_joint(name):
    geometry = turned(name).with_gains()
    found = sets(geometry, len(COUNTS[name]))
    assert tuple(len(each.kept) - geometry.joints for each in found) == COUNTS[name]
    assert all(f"gain{j + 1}" in [entry.name for entry in each.kept] for each in found for j in range(geometry.joints))


def test_a_plane_across_the_first_axis_sees_less_and_known_lengths_see_the_size():
    geometry, plane = geometry_of(load_spec("puma560")), Fixture("plane", "floor", np.array([0.0, 0.0, 1.0]), -0.3)
    q = np.random.default_rng(0).uniform(-2, 2, (60, 6))
    seen = Measurements("plane", q, np.zeros(60), 1.0, 1.0, fixture=np.zeros(60, int), names=("floor",))
    geometry = replace(geometry, tool=rigid([0.1, 0.05, 0.15, 0.3, 0, 0]), fixtures=(plane,))
    touched = minimal_set(geometry, seen)
    assert len(touched.kept) < 23
    assert touched.left_out["base_z"].startswith("acts like")
    blocks = replace(seen, values=np.resize([0.0, 0.05], 60))
    assert len(minimal_set(geometry, blocks).kept) == len(touched.kept) + 1


def test_what_cannot_be_told_apart_is_named():
    left_out = minimal_set(geometry_of(load_spec("ur10e")), "pose").left_out
    assert left_out["theta1"] == "acts like +1 base_rz"
    assert left_out["d6"] == "acts like +1 tool_z"
    assert left_out["d3"] == left_out["d4"] == "acts like +1 d2"
    assert "beta2" not in left_out
