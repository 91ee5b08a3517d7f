"""The exported URDF: inertias of every link in their places, signs of rotations, links without inertia."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from emit.targets.compared import only
from rrrgen.emit.targets.rigid_bodies import numeric_chain
from rrrgen.emit.targets.urdf import roll_pitch_yaw
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import LinkSpec

KEYS = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def links_of(spec):
    root = ET.fromstring(only(export_robot(spec, "urdf")))
    return [link for link in root.iter("link") if link.get("name").startswith("link")]


def test_the_inertia_of_every_link_has_all_six_entries_in_their_places():
    """No two entries of these inertias are alike, so that none is taken for another."""
    spec = load_spec("rrr")
    links = [
        LinkSpec(k, (0.1 * k, -0.2, 0.03), (0.5 * k, 0.01 * k, 0.6 * k, -0.02 * k, 0.03 * k, 0.7 * k), "com")
        for k in (1, 2, 3)
    ]
    spec = replace(spec, links=tuple(links))
    bodies, links = numeric_chain(spec).bodies, links_of(spec)
    assert len(links) == len(bodies) == 3
    for body, link in zip(bodies, links, strict=True):
        assert len({*body.tensor[np.triu_indices(3)]}) == 6
        inertial = link.find("inertial")
        assert float(inertial.find("mass").get("value")) == body.mass
        np.testing.assert_array_equal([float(x) for x in inertial.find("origin").get("xyz").split()], body.com)
        assert inertial.find("origin").get("rpy") == "0 0 0"
        assert {k: float(v) for k, v in inertial.find("inertia").attrib.items()} == {
            key: body.tensor[place] for key, place in KEYS.items()
        }


def test_a_robot_without_links_has_none_with_inertia():
    assert all(link.find("inertial") is None for link in links_of(replace(load_spec("rrr"), links=None)))


@pytest.mark.parametrize(
    "rpy", [(0.3, -0.7, 2.1), (0.4, np.pi / 2, 0.0), (-1.1, -np.pi / 2, 0.0), (0.0, 0.0, np.pi / 2)], ids=str
)
def test_roll_pitch_and_yaw_give_their_rotation_back(rpy):
    roll, pitch, yaw = rpy
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    R = (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
    np.testing.assert_allclose(roll_pitch_yaw(R), (roll, pitch, yaw), atol=1e-12)
