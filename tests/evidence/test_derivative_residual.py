"""Bounds of the residuals of the derivatives of forward dynamics: against wider arithmetic, and other programs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rrrgen.derive import prepare, record
from rrrgen.derive.functions.table import find
from rrrgen.derive.optimizer import Optimizer
from rrrgen.evidence.boxes import Ranges, box_of, nominal_beta
from rrrgen.evidence.certificate import rounding_entries
from rrrgen.evidence.rounding import DOUBLE, FLOAT, NoBoundError
from rrrgen.evidence.solutions import INVERSE, solution_of
from rrrgen.evidence.statements import rounded_up, statement
from rrrgen.program.program import Op
from rrrgen.robot.file import load_spec

ARMS = [
    "rrr",
    *(pytest.param(name, marks=pytest.mark.sweep) for name in ("puma560", "panda", "iiwa14")),
]
FUNCTIONS = ("mass_matrix", "bias", "inverse_dynamics_derivatives", "forward_dynamics_derivatives")


def model_of(name):
    """These functions alone, which are derived in seconds."""
    return Optimizer()(record(prepare(load_spec(name)), [find(each) for each in FUNCTIONS]), 1, None)


def solved(name, suffix, ranges=None):
    model, ranges = model_of(name), ranges or Ranges()
    solution = solution_of(model.programs, f"forward_dynamics_derivatives{suffix}")
    return solution, solution.box(box_of(solution.program, model.spec, nominal_beta(model), ranges), model.spec, ranges)


@pytest.mark.parametrize("suffix", ["_nominal", ""])
@pytest.mark.parametrize("name", ARMS)
def test_residuals_stay_below_their_bounds_at_many_states_and_in_a_search_uphill(name, suffix):
    """In both precisions. Weights that bound every product lose more the worse M is conditioned."""
    solution, box = solved(name, suffix)
    proven = solution.bounds(box)
    for precision in (DOUBLE, FLOAT):
        rows = proven.bounds[precision]
        bounds = [bound for row in rows.values() for bound in row]
        found = solution.largest(box, precision, 3000, 1)
        assert len(found) == len(bounds)
        assert (found <= bounds).all()
        first = 0
        for name_of, row in rows.items():
            largest = max(found[first : first + len(row)])
            assert max(row) < (3e3 if name == "rrr" else 1e6) * largest, name_of
            first += len(row)


def test_a_bound_grows_with_the_limits_of_the_inverse():
    solution, box = solved("rrr", "_nominal")
    more_of_it = tuple(4.0 * each for each in box[INVERSE].upper)
    wide = {**box, INVERSE: replace(box[INVERSE], upper=more_of_it)}
    usual, more = (solution.bounds(each).bounds[DOUBLE]["dddq_dtau"] for each in (box, wide))
    assert all(4.0 * a < b < 9.0 * a for a, b in zip(usual, more, strict=True))


def changed(program, index, **fields):
    nodes = list(program.nodes)
    nodes[index] = nodes[index]._replace(**fields)
    return program.with_fields(nodes=tuple(nodes))


def test_a_program_of_another_form_has_no_bound():
    """Each sum, product or quotient behind the first quotient that is made another one."""
    solution, box = solved("rrr", "_nominal")
    program = solution.program
    first = next(index for index, node in enumerate(program.nodes) if node.op is Op.DIV)
    others = {Op.ADD: Op.SUB, Op.SUB: Op.ADD, Op.MUL: Op.ADD, Op.DIV: Op.MUL}
    tried = 0
    for index in range(first, len(program.nodes)):
        node = program.nodes[index]
        if node.op not in others or any(
            other.op is Op.SELECT and other.args[0] == index for other in program.nodes
        ):  # how the status is decided is the subject of the next test
            continue
        tried += 1
        with pytest.raises(NoBoundError):
            type(solution)(changed(program, index, op=others[node.op]), solution.mass, solution.derivatives).bounds(box)
    assert tried > 100


def test_a_product_that_one_row_leaves_out_is_noticed():
    """All rows take the same right side; one in which a product with it is replaced by zero is another sum."""
    solution, box = solved("rrr", "_nominal")
    program = solution.program
    zero = next(index for index, node in enumerate(program.nodes) if node.op is Op.CONST and node.number == 0)
    sums = [index for row in program.results[:3] for index in row if program.nodes[index].op in (Op.ADD, Op.SUB)]
    assert len(sums) > 10
    for index in sums:
        fewer = changed(program, index, args=(program.nodes[index].args[0], zero))
        with pytest.raises(NoBoundError):
            type(solution)(fewer, solution.mass, solution.derivatives).bounds(box)


def test_the_status_must_imply_that_pivots_are_positive():
    """A margin that adds a number, or a multiple of the diagonal entry, says nothing about the sign of the pivot."""
    solution, box = solved("rrr", "_nominal")
    program = solution.program
    margins = {node.args[0] for node in program.nodes if node.op is Op.SELECT}
    differences = [index for index in margins if program.nodes[index].op is Op.SUB]
    assert len(differences) >= 2
    for index in differences:
        with pytest.raises(NoBoundError, match="order of operations"):
            type(solution)(changed(program, index, op=Op.ADD), solution.mass, solution.derivatives).bounds(box)


@pytest.mark.sweep
def test_a_margin_of_which_a_number_is_split_off_supposes_a_diagonal_entry_of_m_above_rounding():
    """The derivatives of the Panda write M_33 as a sum with a number, which the margin subtracts by itself."""
    solution, box = solved("panda", "_nominal")
    least = solution.bounds(box).least
    assert 1e-16 < least[DOUBLE] < 1e-13
    assert 1e-8 < least[FLOAT] < 1e-4


def test_the_entry_of_the_certificate_has_a_bound_where_rounding_errors_have_none():
    model = model_of("rrr")
    entries = rounding_entries(model, "inline", Ranges(), 200, 1)
    entry = entries["forward_dynamics_derivatives"]
    assert set(entry["double"]["bounds"]) == {"ddq", "dddq_dq", "dddq_dv", "dddq_dtau"}
    assert entry["double"]["sampled"]["within"]
    assert entry["float"]["sampled"]["within"]
    assert "quantity" not in entries["forward_dynamics_derivatives_nominal"]
    stated = statement(model.programs["forward_dynamics_derivatives"], entry, "double")
    largest = max(entry["double"]["bounds"]["dddq_dtau"])
    assert f"|M dddq_dtau - 1| {rounded_up(largest)}, with exact M" in stated.sentence
    assert INVERSE in stated.data["box"]
