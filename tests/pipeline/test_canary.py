"""One wrong sign anywhere in a program is noticed: the comparison with the oracles has no blind spot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from derive.comparison import DOUBLE, Reference
from oracles.newton_euler import Robot
from oracles.random_robots import random_link
from pipeline.optimized import bundled
from rrrgen.derive.functions.table import functions_of
from rrrgen.program import Op, Program

SWAPPED = {Op.ADD: Op.SUB, Op.SUB: Op.ADD}


@pytest.fixture(scope="module")
def reference():
    """The bundled arm with links whose first moments and products all differ from zero."""
    spec = bundled("rrr").spec
    rng = np.random.default_rng(14)
    robot = Robot(
        "standard", tuple(spec.dh_table()), np.array([0.0, 0.0, -9.81]), links=tuple(random_link(rng) for _ in range(3))
    )
    return Reference(robot, np.array(bundled("rrr").base_projection))


def with_wrong_sign(program: Program, index: int) -> Program:
    node = program.nodes[index]
    nodes = (*program.nodes[:index], node._replace(op=SWAPPED[node.op]), *program.nodes[index + 1 :])
    return replace(program, nodes=nodes)


def without_effect(program: Program) -> set[int]:
    """Sums that only decide the status: the margins of the pivots, which are the conditions of the choices."""
    return {program.nodes[k].args[0] for k in range(len(program.nodes)) if program.nodes[k].op is Op.SELECT}


@pytest.mark.parametrize("function", functions_of("model", joints=3))
def test_every_wrong_sign_is_noticed(reference, function):
    program = bundled("rrr").programs[function]
    assert reference.program_error(function, program) <= DOUBLE
    sums = [k for k, node in enumerate(program.nodes) if node.op in SWAPPED and k not in without_effect(program)]
    assert sums
    unnoticed = [k for k in sums if reference.program_error(function, with_wrong_sign(program, k)) <= 1000 * DOUBLE]
    assert unnoticed == []
