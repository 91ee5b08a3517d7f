"""Run-time errors: EVA finds none in a controller and a model function, and finds one where there is one."""

from __future__ import annotations

import subprocess

import pytest

from rrrgen.controller.files import standalone_files
from rrrgen.controller.table import GROUPS, unit_of
from rrrgen.derive import prepare, record
from rrrgen.derive.functions.table import find
from rrrgen.derive.optimizer import Optimizer
from rrrgen.emit.c.ik.files import sources
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.evidence import value_analysis
from rrrgen.evidence.boxes import PortRange, Ranges, box_of, nominal_beta
from rrrgen.evidence.factorization import Fact
from rrrgen.evidence.value_analysis import (
    ENTRIES,
    FAST_OPTIONS,
    OPTIONS,
    WITH_FACTS,
    Alarm,
    _of_function,
    _part,
    analysed_with_eva,
    controller_alarms,
    function_alarms,
    known_facts,
    run_time_errors_entry,
    solver_alarms,
)
from rrrgen.ik.classify import plan
from rrrgen.program import Builder, Port
from rrrgen.robot.file import bundled_path, read

needs_frama_c = pytest.mark.skipif(not value_analysis.is_available(), reason="Frama-C is not installed")


@pytest.fixture(scope="module")
def model():
    return derived_model(read("pendulum"), GROUPS)[0]


@needs_frama_c
@pytest.mark.parametrize("entry", ENTRIES)
def test_the_controller_has_no_run_time_error_and_stays_finite(model, entry, tmp_path):
    """Of the pendulum, with one law; `rrrgen certify --value-analysis` does so with all modes and parts."""
    unit = unit_of(model, ["computed_torque"], ["observer"])
    assert controller_alarms(unit, tmp_path, entry) == []


@needs_frama_c
@pytest.mark.sweep
def test_a_tick_of_few_modes_needs_more_states(model, tmp_path, monkeypatch):
    """With the first number of states alone EVA joins what the gates have checked with what they have not."""
    analyse, each = value_analysis.alarms, []

    def alarms(*given, **options):
        each.append(analyse(*given, **options))
        return each[-1]

    monkeypatch.setattr(value_analysis, "alarms", alarms)
    assert controller_alarms(unit_of(model, ["gravity"], ["observer"]), tmp_path, "step") == []
    assert [bool(found) for found in each] == [True, False]


@needs_frama_c
def test_without_its_gate_the_controller_is_not_finite(model, tmp_path, monkeypatch):
    readable = value_analysis._readable
    gate = "(pendulum_controller_finite(&tick.ratio, 1) != 0) ? tick.ratio : ZERO"
    monkeypatch.setattr(value_analysis, "_readable", lambda text, p: readable(text, p).replace(gate, "tick.ratio"))
    monkeypatch.setattr(value_analysis, "APART", value_analysis.APART[:1])  # more states take as long again
    open_ = controller_alarms(unit_of(model, ["computed_torque"], ["observer"]), tmp_path, "step")
    assert [each.property for each in open_] == ["\\is_finite(output.contact_ratio)"]


@needs_frama_c
def test_the_kernel_of_sine_and_cosine_has_no_run_time_error_in_its_range(tmp_path):
    assert value_analysis.kernel_alarms(tmp_path) == []
    assert "0.63661977236758134308" in (tmp_path / "analysed.c").read_text(encoding="utf-8")  # 2/pi of the reduction


@needs_frama_c
def test_a_model_function_within_its_limits_and_a_division_by_zero(model, tmp_path):
    program = model.programs["inverse_dynamics_nominal"]
    assert function_alarms(program, box_of(program, model.spec, None, Ranges()), tmp_path) == []
    b = Builder()
    (x,) = b.input(Port("x", (1,)))
    quotient = b.program("quotient", [(Port("y", (1,)), [1 / x])])
    found = function_alarms(quotient, {"x": PortRange((-1.0,), (1.0,), "")}, tmp_path)
    assert found
    entry = run_time_errors_entry([("quotient", found)])
    assert entry["alarms"] == len(found)
    assert entry["rows"][0][0] == "quotient"


@needs_frama_c
@pytest.mark.parametrize("name", ["smooth_friction", "pd_gravity_nominal"])
def test_a_law_and_smooth_friction_within_the_ranges_of_their_gains(model, name, tmp_path):
    program = model.programs[name]
    assert function_alarms(program, box_of(program, model.spec, nominal_beta(model), Ranges()), tmp_path) == []


@needs_frama_c
def test_facts_settle_what_depends_on_relations_that_eva_does_not_know(tmp_path):
    """A quotient by a sum that a fact keeps away from zero, behind the declaration of the node that it waits for."""
    b = Builder()
    x, y = b.input(Port("x", (2,)))
    program = b.program("quotient", [(Port("z", (2,)), [1 / (x + y), x + y])])
    (divisor,) = program.results[0][1:]
    box = {"x": PortRange((-1.0, -1.0), (1.0, 1.0), "")}
    assert function_alarms(program, box, tmp_path)
    assert function_alarms(program, box, tmp_path, facts=[Fact(divisor, divisor, 0.5, 2.0)]) == []
    text = (tmp_path / "analysed.c").read_text(encoding="utf-8")
    assert f"/*@ admit 0.5 <= factor_{divisor} <= 2.0; */\n" in text


@needs_frama_c
@pytest.mark.sweep
@pytest.mark.parametrize("name", ["puma560", "panda"])
def test_forward_dynamics_of_six_and_seven_joints_stays_finite_where_the_status_is_ok(name, tmp_path):
    """Without the facts about the factorization every divisor is open; with them nothing is."""
    functions = [find(each) for each in ("mass_matrix", "bias", "forward_dynamics")]
    derived = Optimizer()(record(prepare(read(name)), functions), 1, None)
    for function in ("forward_dynamics", "forward_dynamics_nominal"):
        program = derived.programs[function]
        n = derived.spec.n
        box = {"tau": PortRange((-100.0,) * n, (100.0,) * n, "")}
        box |= box_of(program, derived.spec, nominal_beta(derived), Ranges())
        facts = known_facts(derived, function, box)
        assert len({fact.after for fact in facts}) == n
        assert function_alarms(program, box, tmp_path, facts=facts) == []
    assert function_alarms(program, box, tmp_path)
    assert known_facts(derived, "bias", box) == []


def test_elastic_joints_factorize_the_mass_matrix_of_the_links_without_drive_inertia(tmp_path):
    text = bundled_path("rrr").read_text(encoding="utf-8")
    text = text.replace("encoder_resolution: 1e-5", "encoder_resolution: 1e-5, inertia: 0.05")
    (tmp_path / "driven.yaml").write_text(text, encoding="utf-8")
    names = ("elastic_forward_dynamics", "elastic_feedback_linearization")
    functions = [find(name) for name in ("mass_matrix", "bias", *names)]
    derived = Optimizer()(record(prepare(read(tmp_path / "driven.yaml")), functions), 1, None)
    for name in names:
        program = derived.programs[name]
        box = box_of(program, derived.spec, nominal_beta(derived), Ranges())
        facts = known_facts(derived, name, box)
        assert len({fact.after for fact in facts}) == 3
        if value_analysis.is_available():
            assert function_alarms(program, box, tmp_path, facts=facts, options=FAST_OPTIONS) == []
    if value_analysis.is_available():
        assert function_alarms(program, box, tmp_path, options=FAST_OPTIONS)


BITS = """#include "pendulum_controller.c"
#include <stdio.h>
int main(void)
{
    uint64_t high, low, differ = 0;
    for (high = 0; high < 4096; ++high) {
        for (low = 0; low < 64; ++low) {
            const uint64_t bits = (high << 52) | (low < 52 ? (uint64_t)1 << low : (low == 52 ? 0 : (((uint64_t)1 << 52) - low + 52)));
            double x[3] = {1.0, 2.0, 3.0};
            int k;
            for (k = 0; k < 3; ++k) {
                const double before = x[k];
                memcpy(&x[k], &bits, sizeof bits);
                differ += (pendulum_controller_finite(x, 3) != 0) != (x[k] == x[k] && x[k] > -INFINITY && x[k] < INFINITY);
                x[k] = before;
            }
        }
    }
    return differ != 0;
}
"""  # noqa: E501


def test_the_bits_of_the_gate_say_what_the_analysed_comparisons_say(model, tmp_path):
    """For both signs, all exponents and 64 mantissas: bits of the mantissa matter nowhere else."""
    files = standalone_files(unit_of(model, ["gravity"], []), "double") | {"main.c": BITS}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    sources = [name for name in files if name.endswith(".c") and name != "pendulum_controller.c"]
    subprocess.run(["gcc", "-std=c99", "-O1", *sources, "-lm", "-o", "gate"], cwd=tmp_path, check=True)
    subprocess.run(["./gate"], cwd=tmp_path, check=True)


@needs_frama_c
def test_an_analysis_that_takes_too_long_is_listed(model, monkeypatch):
    monkeypatch.setattr(value_analysis, "LIMIT", 1e-3)
    entry, skipped = analysed_with_eva(model, None, Ranges())
    assert entry["run_time_errors"]["rows"] == []
    reasons = dict(skipped)
    assert "did not come to an end" in reasons["run-time errors of inverse_kinematics"]
    assert {f"run-time errors of {name}" for name in model.programs} <= set(reasons)


def solver_of(name, tmp_path):
    spec = read(name)
    return solver_alarms(spec, plan(spec), tmp_path)


@needs_frama_c
def test_inverse_kinematics_has_no_run_time_error(tmp_path):
    assert solver_of("pendulum", tmp_path) == []


FAULTS = {
    "error": ("e[i] = (T[i] - ", "e[i + 2] = (T[i] - ", "mem_access"),
    "step": ("d[k] = t / A[k][k];", "d[k + 1] = t / A[k][k];", "mem_access"),
    "branches": ("++rows;", "rows += 2;", "user assertion"),
    "apart": ("a[i] - b[i]", "a[i + 5] - b[i]", "mem_access"),
    "descend": ("int kept = 0;", "int kept;", "initialization"),
}


@needs_frama_c
@pytest.mark.parametrize(
    "function", ["branches", *(pytest.param(name, marks=pytest.mark.sweep) for name in FAULTS if name != "branches")]
)
def test_a_fault_of_the_solver_is_found_where_it_stands(function, tmp_path, monkeypatch):
    """In the functions that are analysed by themselves, and in those around their stand-ins."""
    before, after, kind = FAULTS[function]
    files = sources(read("pendulum"))
    text = files["pendulum_ik.c"]
    start = text.index(f"pendulum_ik_{function}(")
    place = text.index(before, start)
    changed = text[:place] + after + text[place + len(before) :]
    monkeypatch.setattr(value_analysis, "sources", lambda spec: {**files, "pendulum_ik.c": changed})
    found = solver_of("pendulum", tmp_path)
    assert kind in {alarm.kind for alarm in found}
    lines = [alarm.line for alarm in found if alarm.kind == kind and alarm.file == "pendulum_ik.c"]
    end = changed[:place].count("\n") + 60
    assert kind == "user assertion" or any(changed[:start].count("\n") < line < end for line in lines)


def test_a_part_is_read_with_its_arguments():
    source = sources(read("pendulum"))["pendulum_ik.c"]
    part = _part(source, "pendulum", "error")
    assert [each.name for each in part.arguments] == ["T", "q", "e", "J", "held"]
    stand_in = part.stand_in("PENDULUM")
    assert stand_in.count("\n") == part.text.count("\n")
    assert "Frama_C_make_unknown((char *)J, 3 * 1 * sizeof(double));" in stand_in


def test_more_states_and_facts_are_tried_only_where_something_stays_open(model, monkeypatch, tmp_path):
    """First few states, then many; then the same with facts, of which the row has the condition."""
    tried = []

    def analysed(program, box, directory, facts, options):
        tried.append((bool(facts), options))
        return [] if tried[-1] == settled else [Alarm("analysed.c", 1, "overflow", "x")]

    monkeypatch.setattr(value_analysis, "function_alarms", analysed)
    monkeypatch.setattr(value_analysis, "known_facts", lambda model, name, box: [Fact(0, 0, 0.0, 1.0)])
    orders = [(False, FAST_OPTIONS), (False, OPTIONS), (True, FAST_OPTIONS), (True, OPTIONS)]
    for count, settled in enumerate(orders, start=1):
        tried.clear()
        name, found = _of_function(model, "gravity", {}, tmp_path)
        assert (tried, found) == (orders[:count], [])
        assert (WITH_FACTS in name) == settled[0]
    tried.clear()
    monkeypatch.setattr(value_analysis, "_LONG", 1)
    _of_function(model, "gravity", {}, tmp_path)
    assert tried == orders[2:]
