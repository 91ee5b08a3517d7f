"""Joints that follow others and branches: MuJoCo with constraints, and an own Newton-Euler over the tree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rrrgen
from derive.trees import PALLETISER, TREE
from rrrgen.base.errors import InputError
from rrrgen.derive import prepare
from rrrgen.derive.functions.table import recorders
from rrrgen.program.evaluation import evaluate
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.robot.model import build_model
from rrrgen.robot.spec import standard_parameters
from rrrgen.verify import verify
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of


def test_the_number_of_base_parameters_is_the_rank_of_the_regressor():
    for spec in (loads_spec(TREE.format(convention="standard")), load_spec(PALLETISER)):
        chain = chain_of(spec)
        rng = np.random.default_rng(3)
        states = rng.uniform(-3, 3, (3, 60, spec.n))
        Y = NewtonEuler(chain, np.zeros((chain.links, 10))).standard_regressor(*states).reshape(-1, 10 * chain.links)
        lengths = np.linalg.norm(Y, axis=0)
        sizes = np.linalg.svd((Y / np.maximum(lengths, 1e-9))[:, lengths > 1e-9], compute_uv=False)
        assert len(prepare(spec).compiler_basis.names) == np.sum(sizes > 1e-9 * sizes[0])


# -- the palletiser as a closed loop in MuJoCo, written down by hand ------------------------------


HAND = """\
schema: rrrgen/1
name: hand
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: roll, type: revolute, alpha: 0, a: 0, d: 0.1}
  - {name: pitch, type: revolute, alpha: 90, a: 0, d: 0, drive: {inertia: 0.01}}
  - {name: left, type: revolute, alpha: 0, a: 0, d: 0.03, theta: 70, follows: {}}
  - {name: l1, type: revolute, alpha: 90, a: 0.1, d: 0}
  - {name: l2, type: revolute, alpha: 0, a: 0.05, d: 0}
  - {name: right, type: revolute, alpha: 0, a: 0, d: -0.03, theta: 110, follows: {}, parent: pitch}
  - {name: r1, type: revolute, alpha: 90, a: 0.1, d: 0}
  - {name: r2, type: revolute, alpha: 0, a: 0.05, d: 0}
tip: r2
links:
"""
LINK = "  - {{mass: {0}, com: [0.0{0}, 0.01, 0.02], inertia: {{about: com, xx: 0.0{0}, yy: 0.0{0}2, zz: 0.0{0}1}}}}\n"
NOTHING = "  - {mass: 0, com: [0, 0, 0], inertia: {about: com, xx: 0, yy: 0, zz: 0}}\n"
MOVING = [LINK.format(k) for k in range(1, 7)]


def test_fixed_rows_need_no_link():
    """The libraries then take part: a fixed row without mass is no body of theirs."""
    pytest.importorskip("mujoco")
    short = loads_spec(HAND + "".join(MOVING))
    whole = loads_spec(HAND + "".join([*MOVING[:2], NOTHING, *MOVING[2:4], NOTHING, *MOVING[4:]]))
    assert short == whole
    report = verify(rrrgen.compile(short, backend="numpy"), samples=4)
    assert [row for row in report.rows if not row.ok] == []
    assert any("MuJoCo" in row.reference for row in report.rows)
    with pytest.raises(InputError, match="5 links for 8 joints") as raised:
        loads_spec(HAND + "".join(MOVING[1:]))
    assert "describe all 8 links, or 6 without those of fixed rows" in str(raised.value)


def test_regrouping_names_the_link_that_carries_the_joint():
    """Joint 7 stands on the fixed row 6, which stands on link 2; row 6 comes after link 5 of the other finger."""
    model = rrrgen.compile(loads_spec(HAND + "".join(MOVING)), backend="numpy").derived
    reasons = {entry.parameter: entry.reason for entry in model.regrouping}
    assert "of joint 5 is regrouped to link 4: J4 += X5" in reasons["Iyy5"]
    assert "of joint 6 is regrouped to link 2: J2 += X6" in reasons["m6"]
    assert "of joint 7 is regrouped to link 6: J6 += X7" in reasons["m7"]


def test_parameters_of_all_links_link_by_link():
    spec = loads_spec(HAND + "".join(MOVING))
    model = rrrgen.compile(spec, backend="numpy")
    phi = np.array([[float(value) for value in standard_parameters(link)] for link in spec.links])
    np.testing.assert_allclose(model.base_parameters_of(phi), model.beta, rtol=1e-12)
    np.testing.assert_allclose(model.base_parameters_of(phi.ravel()), model.beta, rtol=1e-12)
    for wrong in (phi[:6], phi.ravel()[:60]):
        with pytest.raises(ValueError, match=r"phi has shape .* expected \(8, 10\) or \(\.\.\., 80\)"):
            model.base_parameters_of(wrong)


def test_a_humanoid_has_enough_rows():
    legs = "".join(
        f"  - {{name: {leg}{k}, type: revolute, alpha: 90, a: 0.1, d: 0{', parent: base' * (k == 0)}}}\n"
        for leg in ("a", "b", "c", "d", "f")
        for k in range(8)
    )
    spec = loads_spec(HAND.partition("joints:")[0] + "joints:\n" + legs + "tip: a7\n")
    assert spec.n == 40


TREES = Path(__file__).resolve().parents[2] / "examples" / "trees"


@pytest.mark.parametrize(("name", "b"), [("torso", 85), ("hand", 50)])
def test_base_parameters_of_the_example_trees(name, b):
    """Seven for each revolute joint, one for the first about the direction of gravity."""
    spec = load_spec(TREES / f"{name}.yaml")
    assert len(prepare(spec).compiler_basis.names) == b == 7 * (spec.n - 1) + 1


def test_the_origins_of_a_branch_follow_the_rules_of_a_chain():
    """A chain with an idle stub beside it has the canonical frames of the chain."""
    chain = load_spec("rrr")
    rows = dumps(chain)
    head = rows.partition("links:")[0]
    joints, base = head.rstrip().split("\n"), [row.before for row in build_model(chain).joints]
    stub = "  - {name: stub, type: revolute, alpha: 90 deg, a: 0.1, d: 0.2, parent: base}"
    where = next(i for i, line in enumerate(joints) if line.startswith("tool:")) if "tool:" in head else len(joints)
    text = "\n".join([*joints[:where], stub, f"tip: {chain.rows[-1].name}", *joints[where:]]) + "\n"
    tree = build_model(loads_spec(text))
    assert [joint.before for joint in tree.joints[:-1]] == base
    assert tree.blocks[-1] == (chain.n,)


@pytest.mark.parametrize("tip", ["finger", "thumb"])
def test_each_tip_has_its_kinematics(tip):
    """Pose and Jacobian of both fingers against Newton-Euler; the other finger does not move the tip."""
    spec = load_spec(f"{TREES / 'hand.yaml'}@{tip}")
    recorded, q = prepare(spec), np.random.default_rng(5).uniform(-3, 3, spec.n)
    programs = [recorders(name)[0](recorded.recording()) for name in ("forward_kinematics", "jacobian")]
    T, J = (np.array(evaluate(program, q)[0], float) for program in programs)
    reference = NewtonEuler(chain_of(spec), np.zeros((len(spec.rows), 10)))
    np.testing.assert_allclose(T, reference.forward_kinematics(q[None])[0], atol=1e-14)
    np.testing.assert_allclose(J, reference.jacobian(q[None])[0], atol=1e-14)
    still = slice(5, 8) if tip == "finger" else slice(2, 5)
    assert not J[:, still].any()
    assert np.count_nonzero(np.linalg.norm(J, axis=0)) == 5
