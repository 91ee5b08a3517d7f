"""The exported URDF: inertias of every link in their places, signs of rotations, links without inertia."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from emit.targets.compared import only
from pages.test_pages import ROOT
from rrrgen.emit.targets.rigid_bodies import numeric_chain
from rrrgen.emit.targets.urdf import roll_pitch_yaw
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.robot.spec import LinkSpec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

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


ARM = """
schema: rrrgen/1
name: named
description: "arm --- of the lab ----"
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: tip_fixed, type: revolute, alpha: 0, a: 0, d: 0.2}
  - {name: thumb_fixed, type: revolute, alpha: 0, a: 0.3, d: 0}
tip: thumb_fixed
tips:
  thumb: {row: tip_fixed, tool: {translation: [0.1, 0, 0]}}
  link1: {row: thumb_fixed, tool: {translation: [0, 0.4, 0]}}
"""


def test_comments_and_names_make_a_valid_file():
    text = only(export_robot(loads_spec(ARM), "urdf"))
    comments = re.findall("<!--(.*?)-->", text, re.S)
    assert [comment for comment in comments if "--" in comment] == []
    assert " arm - of the lab - " in comments
    root = ET.fromstring(text)
    for kind in ("link", "joint"):
        names = [element.get("name") for element in root.iter(kind)]
        assert len(names) == len(set(names)), names


@pytest.mark.parametrize("target", ["urdf", "mjcf"])
def test_named_tips_come_back(target, tmp_path):
    spec = load_spec(ROOT / "examples" / "trees" / "hand.yaml")
    ((name, text),) = export_robot(spec, target).files.items()
    (tmp_path / name).write_text(text, encoding="utf-8")
    q = np.random.default_rng(4).uniform(-2, 2, (3, spec.n))
    for tip in ("finger", "thumb"):
        arm = import_robot(tmp_path / name, chain=ChainChoice(tip=tip, angle_tolerance=0.0)).spec
        columns = [[joint.name for joint in spec.joints].index(joint.name) for joint in arm.joints]
        wanted = NewtonEuler(chain_of(spec.at_tip(tip)), nominal_parameters(spec)).forward_kinematics(q)
        got = NewtonEuler(chain_of(arm), nominal_parameters(arm)).forward_kinematics(q[:, columns])
        np.testing.assert_allclose(got, wanted, atol=1e-9)
