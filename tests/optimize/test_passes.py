"""Every pass keeps the values and never raises what it minimises; the choice takes the cheapest."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings

from optimize.programs import ARITHMETIC, PORTS, STATE, precise, programs, same_values
from rrrgen.optimize.collecting import collect
from rrrgen.optimize.doubling import double_by_addition
from rrrgen.optimize.expansion import MAX_TERMS, Cutting
from rrrgen.optimize.folding import fold
from rrrgen.optimize.passes import Choice, _Log, cheapest, cost
from rrrgen.optimize.rewriting import factored
from rrrgen.program import Builder, Op, OperationCount, Port, Program, Role, Status, count_operations, evaluate


@pytest.mark.parametrize("cutting", Cutting)
def test_expanding_and_factoring_keeps_the_values(cutting):
    @settings(max_examples=120)
    @given(programs())
    def check(program):
        result = factored(program, cutting)
        if result is not None:
            assert result.inputs == program.inputs
            assert result.outputs == program.outputs
            assert same_values(program, result)

    check()


@given(programs())
def test_the_choice_never_costs_more(program):
    log = _Log()
    best, choice = cheapest([program], "random", log)
    assert cost(best)[0] <= cost(program)[0]
    assert choice.way == 0
    assert same_values(program, best)
    for report in log.reports:
        assert report.function == "random"
        assert report.after.total <= report.before.total


@given(programs(ARITHMETIC), programs(ARITHMETIC))
def test_the_choice_takes_the_cheapest_way(one, two):
    trials = [Choice(0, None), Choice(1, None)]
    best, choice = cheapest([one, two], "random", _Log(), trials)
    assert choice == trials[int(cost(two) < cost(one))]
    assert cost(best)[0] <= min(cost(one)[0], cost(two)[0])


@given(programs())
def test_doubling_by_addition_is_exact(program):
    result = double_by_addition(program)
    state = [np.array([float(v) for v in row]) for row in STATE]
    with np.errstate(all="ignore"):
        assert np.array_equal(evaluate(result, *state)[0], evaluate(program, *state)[0], equal_nan=True)
    before, after = count_operations(program), count_operations(result)
    assert after.mul + after.add <= before.mul + before.add
    assert after.mul <= before.mul
    twos = {k for k, node in enumerate(result.nodes) if node.op is Op.CONST and node.value == 2}
    assert not any(node.op is Op.MUL and twos & set(node.args) for node in result.nodes)


@given(programs())
def test_collecting_keeps_the_values_and_saves_or_changes_nothing(program):
    result = collect(program)
    assert same_values(program, result)
    assert result is program or count_operations(result).total < count_operations(program).total


@given(programs())
def test_folding_keeps_the_values(program):
    folded = fold(program, {Role.BASE_PARAMETERS: STATE[2]})
    assert folded.inputs == PORTS[:2]
    x, y = precise(program, STATE), precise(folded, STATE[:2])
    size = max([1, *map(abs, x)])
    assert all(abs(u - v) <= size * 1e-20 for u, v in zip(x, y, strict=True))
    assert count_operations(folded).total <= count_operations(program).total


def test_folding_everything_leaves_numbers():
    b = Builder()
    x, y = b.input(Port("x", (2,), role=Role.FRICTION))
    folded = fold(b.program("f", [(Port("y", ()), [x * y + x])]), {Role.FRICTION: [Fraction(2, 3), Fraction(1, 5)]})
    assert [node.op for node in folded.nodes] == [Op.CONST]
    assert folded.nodes[0].value == Fraction(4, 5)


# -- examples whose best form is known ---------------------------------------------------------------------------------


def recorded(function) -> Program:
    b = Builder()
    q, dq, beta = (b.input(port) for port in PORTS)
    values = function(b, q, dq, beta)
    return b.program("f", [(Port("y", (len(values),)), values)])


def test_squares_of_one_angle_add_up_to_one():
    program = recorded(lambda b, q, dq, beta: [beta[0] * (b.sin(q[0]) * b.sin(q[0]) + b.cos(q[0]) * b.cos(q[0]))])
    result = factored(program, Cutting.NOTHING)
    assert count_operations(result) == OperationCount()
    assert [node.op for node in result.nodes] == [Op.INPUT]


def test_a_factor_is_taken_out_of_a_sum_of_sums():
    """x a + y - (z - x b) is x (a + b) + y - z, also where the parts were recorded in any order."""

    def function(b, q, dq, beta):
        x, (y, z), (a, c, d) = b.sin(q[0]), dq, beta
        return [x * a + y - (z - x * c) - y * d, (z + x * d) * 3]

    program = recorded(function)
    result = collect(program)
    assert same_values(program, result)
    before, after = count_operations(program), count_operations(result)
    assert (before.mul, before.add) == (5, 5)
    assert (after.mul, after.add) == (4, 5)


def test_shared_products_are_not_taken_apart():
    def function(b, q, dq, beta):
        one, other = b.sin(q[0]) * beta[0], b.sin(q[0]) * beta[1]
        return [one + other, one, other]

    program = recorded(function)
    assert collect(program) is program


def test_absolute_rates_stay_sums():
    """A sum of inputs is one literal, so that (dq1 + dq2)^2 is not torn into three products."""

    def function(b, q, dq, beta):
        W = dq[0] + dq[1]
        return [beta[0] * (W * W) * b.sin(q[0]), beta[1] * (W * W) * b.cos(q[0])]

    count = count_operations(factored(recorded(function), Cutting.NOTHING))
    assert (count.mul, count.add) == (5, 1)


def test_angles_with_a_constant_stay_angles():
    program = recorded(lambda b, q, dq, beta: [b.sin(q[0] + q[1] + Fraction(1, 3)) * dq[0]])
    for cutting in Cutting:
        result = factored(program, cutting)
        assert count_operations(result).sincos == 1
        assert same_values(program, result)


def test_what_is_too_large_is_left_alone():
    def function(b, q, dq, beta):
        value = 1
        for _ in range(4):
            value = value * (dq[0] * beta[0] + dq[1] * beta[1] + b.sin(q[0]) * beta[2] + b.sin(q[1]))
        return [value]

    assert factored(recorded(function), Cutting.NOTHING) is not None
    program = recorded(lambda *inputs: [function(*inputs)[0] * function(*inputs)[0] + MAX_TERMS])
    assert factored(program, Cutting.NOTHING) is None


def test_passes_know_ports_by_their_roles():
    """Other names for the ports change nothing: neither where an expansion is cut nor what is folded in."""

    def function(b, q, dq, beta):
        shared = beta[0] * b.sin(q[0]) + beta[1] * b.cos(q[0])
        return [shared * dq[0] * dq[0], shared * dq[1] + beta[2]]

    program = recorded(function)
    renamed = program.described(inputs=tuple(replace(port, name=f"x{k}") for k, port in enumerate(program.inputs)))
    passes = [lambda each, cutting=cutting: factored(each, cutting) for cutting in Cutting]
    for run in (*passes, lambda each: fold(each, {Role.BASE_PARAMETERS: STATE[2]})):
        one, other = run(program), run(renamed)
        assert (one.nodes, one.results) == (other.nodes, other.results)


def test_a_status_survives():
    b = Builder()
    (x, y), (k,) = b.input(PORTS[1]), b.input(Port("k", (), role=Role.BASE_PARAMETERS))
    status = Status(1, "too slow", "the speed is too low", "the first speed is not positive")
    outputs = [(Port("y", ()), [x * k + y * k + 2 * x]), (Port("status", ()), [b.select(x, 0, 1)])]
    program = b.program("f", outputs, status=status)
    for run in (
        lambda p: factored(p, Cutting.NOTHING),
        collect,
        double_by_addition,
        lambda p: fold(p, {PORTS[2].role: [3]}),
    ):
        changed = run(program)
        assert changed is not program
        assert changed.status == status
        assert [port.name for port in changed.data_outputs] == ["y"]


def test_labels_survive():
    program = recorded(lambda b, q, dq, beta: [b.label(b.sin(q[0] + q[1]), "s12") * dq[0] + dq[1]])
    for result in (
        factored(program, Cutting.NOTHING),
        double_by_addition(program),
        fold(program, {Role.BASE_PARAMETERS: STATE[2]}),
    ):
        assert "s12" in result.labels.values()


def test_angles_weigh_more_than_operations():
    cheap = recorded(lambda b, q, dq, beta: [dq[0] * dq[1] * beta[0] * beta[1] + beta[2]])
    angle = recorded(lambda b, q, dq, beta: [b.sin(q[0])])
    assert cost(cheap) < cost(angle)


# -- determinism -------------------------------------------------------------------------------------------------------

DIGEST = """
import hashlib
from rrrgen.pipeline import derive
from rrrgen.robotfile import load_spec
for name in ("scara",):
    derived = derive(load_spec(name))
    for program in derived.programs.values():
        text = repr((program, sorted(program.labels.items())))
        print(program.name, hashlib.sha256(text.encode()).hexdigest())
    print(derived.passes, derived.regrouping, derived.base_parameters)
"""


def test_programs_do_not_depend_on_the_hash_seed():
    texts = set()
    for seed in ("0", "31337"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        run = subprocess.run(
            [sys.executable, "-c", DIGEST], env=environment, check=True, capture_output=True, text=True
        )
        texts.add(run.stdout)
    assert len(texts) == 1
    assert "inverse_dynamics_nominal" in texts.pop()
