"""Bounds of the residual of forward dynamics: against wider and exact arithmetic, and programs of another form."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from rrrgen.derive import prepare, record
from rrrgen.derive.functions.table import find
from rrrgen.derive.optimizer import Optimizer
from rrrgen.evidence.boxes import Ranges, acceleration_range, box_of, nominal_beta
from rrrgen.evidence.certificate import residual_entry
from rrrgen.evidence.factorization import LEAST_PIVOT, factorization_facts
from rrrgen.evidence.residual import residual_bounds
from rrrgen.evidence.rounding import DOUBLE, FLOAT, NoBoundError
from rrrgen.evidence.sampling import _evaluate_nodes, _states, largest_residuals
from rrrgen.evidence.solutions import ForwardDynamics, solution_of
from rrrgen.evidence.vectors import DIGITS, exact_values
from rrrgen.program.program import Op, Role
from rrrgen.robot.file import load_spec

ARMS = ["rrr", pytest.param("puma560", marks=pytest.mark.sweep), pytest.param("panda", marks=pytest.mark.sweep)]


def model_of(name):
    """The programs of M, h and forward dynamics alone, which are derived in a second."""
    functions = [find(each) for each in ("mass_matrix", "bias", "forward_dynamics")]
    return Optimizer()(record(prepare(load_spec(name)), functions), 1, None)


def solved(name, suffix):
    """Forward dynamics with the programs of M and h, its box with the range of ddq, and the limits of ddq."""
    model = model_of(name)
    program = model.programs[f"forward_dynamics{suffix}"]
    box = box_of(program, model.spec, nominal_beta(model), Ranges())
    box["ddq"] = acceleration_range(model.spec, Ranges())
    solution = solution_of(model.programs, program.name)
    return program, solution.mass, solution.bias, box


def bounds_of(program, mass, bias, box):
    given = {name: each.bounds for name, each in box.items()}
    return residual_bounds(program, mass, bias, given, box["ddq"].upper)


@pytest.mark.parametrize("suffix", ["_nominal", ""])
@pytest.mark.parametrize("name", ARMS)
def test_residuals_stay_below_their_bounds_at_many_states_and_in_a_search_uphill(name, suffix):
    """10^5 states of every arm, in both precisions; what is found is not far below the bounds."""
    program, mass, bias, box = solved(name, suffix)
    bounds = bounds_of(program, mass, bias, box)
    for precision, rows in ((DOUBLE, bounds.double), (FLOAT, bounds.single)):
        found = largest_residuals(program, mass, bias, box, precision, 100_000, 1)
        assert (found <= rows).all()
        assert max(rows) < 300.0 * max(found)


def test_residuals_in_exact_arithmetic_stay_below_their_bounds():
    program, mass, bias, box = solved("rrr", "_nominal")
    bounds = bounds_of(program, mass, bias, box)
    ranges = {**box, "tau": box["ddq"]}
    q, dq, wanted = _states(program, ranges, 20, np.random.default_rng(3), np.float64)
    worst = np.zeros(3)
    with mpmath.workdps(DIGITS):
        for state in zip(q, dq, wanted, strict=True):
            M, h = (exact_values(other, state[: len(other.inputs)]) for other in (mass, bias))
            M = [[M[index] for index in mass.results[0][3 * i : 3 * i + 3]] for i in range(3)]
            h = [h[index] for index in bias.results[0]]
            tau = [
                float(sum(a * x for a, x in zip(row, state[2], strict=True)) + b) for row, b in zip(M, h, strict=True)
            ]
            given = [np.array([each]) for each in (*state[:2], tau)]
            values = _evaluate_nodes(program, given, DOUBLE, None)
            ddq = [float(np.asarray(values[index]).ravel()[0]) for index in program.results[0]]
            for i in range(3):
                worst[i] = max(worst[i], abs(sum(a * x for a, x in zip(M[i], ddq, strict=True)) + h[i] - tau[i]))
    assert (worst <= bounds.double).all()
    assert worst.max() > 0.02 * max(bounds.double)


def test_constant_pivots_of_one_joint_and_the_entry_of_the_certificate():
    program, mass, bias, box = solved("pendulum", "_nominal")
    inputs = {name: each for name, each in box.items() if name != "ddq"}
    entry = residual_entry(ForwardDynamics(program, mass, bias), load_spec("pendulum"), inputs, Ranges(), 500, 1)
    assert set(entry["double"]["box"]) == {"q", "dq", "ddq"}
    assert entry["double"]["bounds"] == {"ddq": list(bounds_of(program, mass, bias, box).double)}
    assert entry["double"]["sampled"]["within"]
    assert entry["float"]["sampled"]["ratio"] < 20.0


def test_a_constant_mass_matrix_has_no_facts():
    program, mass, _, box = solved("pendulum", "_nominal")
    assert factorization_facts(program, mass, {port: each.bounds for port, each in box.items()}) == []


@pytest.mark.parametrize("suffix", ["_nominal", ""])
@pytest.mark.parametrize("name", ARMS)
def test_facts_about_the_factors_hold_where_the_status_is_ok(name, suffix):
    """At 20000 states of the box, with parameters that need not be those of a body; none is wide of the mark."""
    program, mass, _, box = solved(name, suffix)
    facts = factorization_facts(program, mass, {port: each.bounds for port, each in box.items()})
    states = _states(program, {**box, "tau": box["ddq"]}, 20_000, np.random.default_rng(4), np.float64)
    values = _evaluate_nodes(program, states, DOUBLE, None)
    ok = np.broadcast_to(values[program.results[1][0]] == 0, (20_000,)).copy()
    pivots = {fact.after for fact in facts}
    for pivot in pivots:
        ok &= values[pivot] >= LEAST_PIVOT
    assert ok.mean() > 0.5
    assert {fact.node for fact in facts} > pivots
    for fact in facts:
        found = np.broadcast_to(values[fact.node], (20_000,))[ok]
        assert fact.low <= found.min()
        assert found.max() <= fact.high
        if fact.node in pivots:
            assert fact.high < 100.0 * found.max()


def changed(program, index, **fields):
    nodes = list(program.nodes)
    nodes[index] = nodes[index]._replace(**fields)
    return program.with_fields(nodes=tuple(nodes))


def test_a_program_of_another_form_has_no_bound():
    """Each sum, product or quotient that is made another one, of those that only the solution has."""
    program, mass, bias, box = solved("rrr", "_nominal")
    quotients = [index for index, node in enumerate(program.nodes) if node.op is Op.DIV]
    others = {Op.ADD: Op.SUB, Op.SUB: Op.ADD, Op.MUL: Op.ADD, Op.DIV: Op.MUL}
    tried = 0
    for index in range(quotients[0], len(program.nodes)):
        node = program.nodes[index]
        if node.op not in others or any(
            other.op is Op.SELECT and other.args[0] == index for other in program.nodes
        ):  # how the status is decided does not matter to the residual, as long as pivots are positive
            continue
        tried += 1
        with pytest.raises(NoBoundError):
            bounds_of(changed(program, index, op=others[node.op]), mass, bias, box)
    assert tried > 20


def test_the_status_must_imply_that_pivots_are_positive():
    """A margin that adds a number, or a multiple of the diagonal entry, says nothing about the sign of the pivot."""
    program, mass, bias, box = solved("rrr", "_nominal")
    margins = {node.args[0] for node in program.nodes if node.op is Op.SELECT}
    differences = [index for index in margins if program.nodes[index].op is Op.SUB]
    assert len(differences) >= 2
    for index in differences:
        with pytest.raises(NoBoundError, match="order of operations"):
            bounds_of(changed(program, index, op=Op.ADD), mass, bias, box)


def test_other_functions_are_not_forward_dynamics():
    programs = model_of("pendulum").programs
    assert solution_of(programs, "bias") is None
    assert solution_of({"forward_dynamics": programs["forward_dynamics"]}, "forward_dynamics") is None
    solution = solution_of(programs, "forward_dynamics_nominal")
    assert (solution.mass.name, solution.bias.name) == ("mass_matrix_nominal", "bias_nominal")
    assert not any(port.role is Role.BASE_PARAMETERS for port in solution.mass.inputs)
