"""``new``: an arm that moves in as many ways as its joints allow, and a comment on every field of the robot file."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from rrrgen.base.yamltext.document import FaultList, MappingNode, Place, SequenceNode, parse_document
from rrrgen.cli.main import run
from rrrgen.ik.classify import plan
from rrrgen.robot.file import RobotSpec, load_spec, loads_spec
from rrrgen.robot.file.fields import EMIT, SECTIONS
from rrrgen.robot.friction.laws import LAWS

KINDS = ["".join(letters) for n in range(1, 4) for letters in itertools.product("RP", repeat=n)]
LONG = [
    "RPPR",
    "PRRP",
    "PPPP",
    "RRRR",
    "RRRRR",
    "RRRRRR",
    "PRRRRR",
    "RRPRRR",
    "RPPRRR",
    "PPPRRR",
    "RRRRRP",
    "RPRPRP",
    "RRRRRRR",
    "PRRRRRR",
    "RRRRRRRR",
]


@pytest.fixture
def written(tmp_path, monkeypatch, capsys):
    """The file that ``new`` writes for some joints, as text."""
    monkeypatch.chdir(tmp_path)

    def call(joints: str, convention: str = "standard") -> str:
        assert run(["new", "arm", "--joints", joints, "--convention", convention, "--force"]) == 0, capsys.readouterr()
        return (tmp_path / "arm.yaml").read_text(encoding="utf-8")

    return call


@cache
def read(text: str) -> RobotSpec:
    return loads_spec(text, strict=True)


def pose(text: str, q: np.ndarray) -> np.ndarray:
    """The pose of the tip, from the Denavit-Hartenberg rows."""
    spec = read(text)
    T = np.eye(4)
    for (kind, alpha, a, d, theta), value in zip(spec.dh_table(), q, strict=True):
        theta, d = (theta + value, d) if kind == "revolute" else (theta, d + value)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
        twist = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        T = T @ turn @ twist if spec.convention == "standard" else T @ twist @ turn
    return T @ np.array(spec.tool.matrix().applyfunc(spec.nominal), dtype=float)


def jacobian_rank(text: str) -> int:
    """The rank of the Jacobian at a random configuration, by differences of poses."""
    q, h = np.random.default_rng(5).uniform(-1.5, 1.5, read(text).n), 1e-6
    columns = []
    for e in h * np.eye(len(q)):
        plus, minus = pose(text, q + e), pose(text, q - e)
        rate = (plus - minus) / (2 * h)
        spin = rate[:3, :3] @ minus[:3, :3].T
        columns.append([*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
    return int(np.linalg.matrix_rank(np.array(columns), tol=1e-4))


@pytest.mark.parametrize("joints", [*KINDS, *LONG])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_the_arm_is_not_degenerate(joints, convention, written):
    text = written(joints, convention)
    assert jacobian_rank(text) == min(6, joints.count("R") + min(3, joints.count("P")))
    assert read(text).faults == ()


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_six_joints_have_a_spherical_wrist(convention, written):
    written("RRRRRR", convention)
    found = plan(load_spec("arm.yaml"))
    assert found.solvable
    assert found.family == "spherical"


def test_both_conventions_are_the_same_arm(written):
    q = np.array([0.1, -0.7, 0.4, 1.1, -0.3, 0.9])
    standard, modified = (pose(written("RRRRRR", convention), q) for convention in ("standard", "modified"))
    assert np.allclose(standard, modified, atol=1e-12)


def fields(node: MappingNode, section: str) -> Iterator[tuple[str, str, Place]]:
    """Section, key and place of every field in ``node`` and below."""
    table = {key.name: key for key in SECTIONS[section]}
    for name, value in node.entries:
        yield section, name.text, name.place
        key = table[name.text]
        inner = "basis" if key.name == "basis" else key.section
        rows = value.items if isinstance(value, SequenceNode) else [value]
        for row in [each for _, each in value.entries] if key.kind == "transforms" else rows if inner else []:
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
