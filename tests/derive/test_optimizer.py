"""Lengths as they stand in the robot file: constants go into sums where that is free."""

from fractions import Fraction

import pytest

from rrrgen.derive import derive_model
from rrrgen.derive.optimizer import Optimizer, SpellLengths, lengths_of
from rrrgen.program import Builder, Op, Port, count_operations
from rrrgen.robot.file import load_spec

LENGTHS = frozenset({Fraction(1, 2), Fraction(3, 4), Fraction(2, 5)})
RATIO = Fraction(3, 2)  # of 3/4 and 1/2


def program(make):
    builder = Builder()
    x, y, z = builder.input(Port("v", (3,)))
    return builder.program("f", [(Port("r", ()), [make(x, y, z)])])


def expected(make):
    return program(make).dump()


def test_a_ratio_becomes_a_length():
    found = SpellLengths(LENGTHS)(program(lambda x, y, z: Fraction(1, 2) * (x + RATIO * y)))
    assert found.dump() == expected(lambda x, y, z: Fraction(1, 2) * x + Fraction(3, 4) * y)


def test_nested_sums_and_differences():
    found = SpellLengths(LENGTHS)(program(lambda x, y, z: Fraction(1, 2) * (x - RATIO * (y - Fraction(8, 15) * z))))
    assert found.dump() == expected(lambda x, y, z: Fraction(1, 2) * x - (Fraction(3, 4) * y - Fraction(2, 5) * z))


@pytest.mark.parametrize(
    "make",
    [
        lambda x, y, z: Fraction(1, 2) * (x + y),  # two products for one
        lambda x, y, z: Fraction(1, 2) * (x + Fraction(1, 7) * y),  # no length
        lambda x, y, z: (Fraction(1, 2) * (x + RATIO * y)) * (x + RATIO * y),  # the sum is used again
        lambda x, y, z: Fraction(1, 2) * (x + Fraction(3, 4) * y),  # stands as it is
    ],
)
def test_nothing_changes_where_it_would_cost_or_say_nothing(make):
    before = program(make)
    assert SpellLengths(LENGTHS)(before) is before


@pytest.mark.parametrize(("robot", "most"), [("ur10e", 59), ("stanford", 67)])
def test_forward_kinematics_is_written_in_the_lengths_of_the_file(robot, most):
    spec = load_spec(robot)
    recorded = derive_model(spec)
    only = recorded.only({"forward_kinematics": recorded.alternatives["forward_kinematics"]})
    found = Optimizer()(only).programs["forward_kinematics"]
    constants = {abs(Fraction(node.number)) for node in found.nodes if node.op is Op.CONST}
    assert constants <= lengths_of(spec) | {0, 1}
    assert count_operations(found).total <= most
