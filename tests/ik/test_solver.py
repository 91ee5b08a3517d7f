"""The recorded solver: its text, and that every interpreter of the record gives what the derivation itself gives."""

import numpy as np
import pytest

from ik.chains import planar, position, spherical
from ik.robots import ROWS, make, robot
from rrrgen.ik.classify import plan
from rrrgen.ik.families import parameter
from rrrgen.ik.plan import derive
from rrrgen.ik.recording.float_builder import FloatBuilder, every_branch

RRR = """\
inverse kinematics of 3 joints: at most 4 solutions
  px, py, pz = target
  pz_2 = pz - 0.56
  for each of up to 2 roots of pair(-py, px, 0.259), shoulder: c1, s1
  r = px*px + py*py + pz_2*pz_2
    for each of up to 2 roots of pair(0.166, 0, r - 0.279306), elbow: c3, s3
    ux = px*c1 + py*s1
    uz = px*s1 - py*c1
      vx = 0.415*c3 + 0.2
      vy = 0.415*s3
      c2, s2 = onto(vx, vy, 0.259, ux, pz_2, uz)
"""

GENERAL = ("crx10ia", "jaco2", "manseur_doty")
"""Robots without a record. They are named, since the choice of their elimination takes seconds."""

ARMS = {
    **{name: robot(name) for name in ROWS if name not in GENERAL},
    "sliding": make("sliding", position("PRP", 1)),
    "spherical first": make("spherical", spherical(0, "RPR", 1)),
    "planar": make("planar", planar(2, "RPR", "RRR", 1)),
}


def test_text():
    assert plan(robot("rrr")).equations.dump() == RRR


@pytest.mark.parametrize("name", ARMS)
def test_the_record_is_the_derivation(name):
    """Row by row and branch by branch, to rounding: the record is simplified while it is made."""
    found = plan(ARMS[name])
    chain, rng = found.chain, np.random.default_rng(3)
    q = rng.uniform(-1.2, 1.2, chain.n)
    T, given = chain.forward(q), parameter(found, q)

    def rows(run):
        return every_branch(run, lambda script: FloatBuilder(T, [0.1] * chain.n, script, redundancy=given))

    recorded, derived = rows(found.equations.play), rows(lambda b: derive(b, found))
    assert len(recorded) == len(derived) > 0
    np.testing.assert_allclose([row[: chain.n] for row in recorded], [row[: chain.n] for row in derived], atol=1e-6)


@pytest.mark.parametrize("name", ARMS)
def test_what_is_counted_from_the_record(name):
    found = plan(ARMS[name])
    solver = found.equations
    assert found.max_solutions == solver.max_solutions == np.prod([stage.most for stage in solver.stages])
    lowest = [bit for _, bit, _ in solver.leaf.labels]
    assert [name for name, _, _ in solver.leaf.labels] == [stage.label for stage in solver.stages]
    assert lowest == sorted(set(lowest))
    for joint, step in enumerate(solver.leaf.values):
        assert joint in [each.index for each in solver.steps[step].joints]
    assert all(joint < found.chain.n for joint, _ in solver.opens)
