"""``new``: an arm that moves in as many ways as its joints allow, and a comment on every field of the robot file."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from rrrgen.base.yamltext.document import FaultList, MappingNode, Place, SequenceNode, parse_document
from rrrgen.robot.file import loads_spec
from rrrgen.robot.file.fields import EMIT, SECTIONS
from rrrgen.robot.friction.laws import LAWS


def fields(node: MappingNode, section: str) -> Iterator[tuple[str, str, Place]]:
    """Section, key and place of every field in ``node`` and below."""
    table = {key.name: key for key in SECTIONS[section]}
    for name, value in node.entries:
        yield section, name.text, name.place
        key = table[name.text]
        inner = {"basis": "basis", "pins": ""}.get(key.name, key.section)  # pins are named by the user's joints
        rows = value.items if isinstance(value, SequenceNode) else [value]
        for row in (
            [each for _, each in value.entries if not isinstance(each, SequenceNode)]
            if key.kind == "transforms"
            else rows
            if inner
            else []
        ):
            yield from fields(row, inner)


@pytest.mark.parametrize("joints", ["RRRRRR", "PP"])
def test_every_field_of_a_robot_file_is_there_with_a_comment(joints, written):
    """Fields that are comments count: their signs are taken away, and what remains is read as YAML."""
    text = written(joints)
    names = "|".join(sorted({key.name for table in SECTIONS.values() for key in table}))
    text = re.sub(rf"^( *)# ( *(?:- )?(?:{names}):(?: .*)?)$", r"\1\2", text, flags=re.M)
    faults = FaultList("arm.yaml", text)
    found = list(fields(parse_document(text, faults), "robot"))
    assert faults.errors == []
    lines = text.splitlines()
    explained = {
        (section, name)
        for section, name, place in found
        if "# " in lines[place.line - 1] or (place.column == 1 and lines[place.line - 2].startswith("# "))
    }
    assert {(section, key.name) for section, table in SECTIONS.items() for key in table} == explained


def test_what_can_be_chosen_is_listed(written):
    text = written("RR")
    for word in (*LAWS, *EMIT):
        assert re.search(rf"#.*\b{word}\b", text), word


def test_commented_fields_are_valid(written):
    """Friction, drive and limits of the first joint, with their comment signs taken away."""
    text = re.sub(r"^(    (?:  )?)# ( *(?:friction|viscous|coulomb|offset|drive|inertia|gear_ratio|torque_constant|"
                  r"encoder_resolution|acceleration|torque):)", r"\1\2", written("RRRRRR"), flags=re.M)  # fmt: skip
    joint = loads_spec(text).joints[0]
    assert joint.friction is not None
    assert joint.drive is not None
    assert (joint.friction.viscous, joint.drive.gear_ratio, joint.limits.torque) == (0.1, 100, 100)


def test_lines_fit_a_screen(written):
    assert max(map(len, written("RRRRRRR").splitlines())) <= 132
