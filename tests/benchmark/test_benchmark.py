"""The benchmark: its hand-made rival against independent dynamics, its driver, its verdicts and its page."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.contenders.cases import Case, dense_bodies, make_case
from bench.contenders.contender import (
    HAND,
    OURS,
    OURS_FILE,
    PINOCCHIO,
    TITLES,
    Contender,
    DisagreementError,
    Supplier,
    deviation,
)
from bench.contenders.joint_frames import joint_frames, regrouped
from bench.measurements.batches import BatchTime
from bench.measurements.control_tick import control_ticks
from bench.measurements.growth import COMPARED, chain_text, growth
from bench.measurements.inverse_kinematics import IKScore, ik_scores
from bench.measurements.path_timing import path_timings
from bench.measurements.python_calls import BOUND_RUN, PIN, CallTime, turns
from bench.measurements.race import Effort, Score, race
from bench.measurements.trees import TreeTime
from bench.page import page
from bench.results import Results
from bench.targets import verdicts
from bench.toolchain import find_toolchain
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.verify.references.numeric_robot import chain_of, is_physical

ROUND_OFF = 1e-10
"""Thousands of operations in double, and mass matrices of random chains with conditions up to 1e4."""

SHORT = Effort(rounds=2, sample=1e3, counted=1)

needs_casadi = pytest.mark.skipif(find_spec("casadi") is None, reason="casadi is not installed")
needs_gcc = pytest.mark.skipif(not any(shutil.which(cc) for cc in ("cc", "gcc", "clang")), reason="no C compiler")


@cache
def hand_of(robot: str) -> tuple[Case, Any]:
    """A bundled robot with few states, and the rival's functions."""
    from bench.contenders.hand_casadi import hand_functions

    case = few_states(make_case(load_spec(robot)))
    return case, hand_functions(joint_frames(case.chain, case.dense))


def few_states(case: Case) -> Case:
    return replace(case, states=case.states[:4])


def values_of(case: Case, function: Any) -> np.ndarray:
    inputs = function.n_in()
    return np.array([function(*np.split(state, 4)[:inputs]).full().ravel() for state in case.states])


@needs_casadi
@pytest.mark.parametrize("robot", ["rrr", "puma560"])
def test_the_hand_made_rival_agrees_with_newton_euler_in_every_function(robot: str) -> None:
    case, hand = hand_of(robot)
    for name, function in hand.functions.items():
        values = values_of(case, function)
        contender = Contender(HAND, name, values.shape[1], "", "dense", hand.parameters.get(name))
        assert deviation(contender, values, case) < ROUND_OFF, name


@needs_casadi
@settings(max_examples=5, deadline=None)
@given(n=st.integers(1, 3), seed=st.integers(0, 1000))
def test_the_hand_made_rival_agrees_on_random_chains(n: int, seed: int) -> None:
    from bench.contenders.hand_casadi import hand_functions

    case = few_states(make_case(loads_spec(chain_text(n, seed), "chain.yaml"), seed))
    functions = hand_functions(joint_frames(case.chain, case.dense), ("inverse_dynamics", "mass_matrix")).functions
    for name, function in functions.items():
        values = values_of(case, function)
        assert deviation(Contender(HAND, name, values.shape[1], ""), values, case) < ROUND_OFF


def test_regrouping_leaves_no_mass_and_keeps_the_chain_solvable() -> None:
    chain = chain_of(load_spec("puma560"))
    P = regrouped(joint_frames(chain, dense_bodies(np.random.default_rng(0), chain.n)))
    assert np.all(P[:, 3, 3] == 0)
    assert np.all(P[:, 2, 3] == 0)
    assert np.all(P[:, 2, 2] == 0)
    assert np.count_nonzero(P[0]) == 1  # the axis is vertical: only the moment about it acts
    assert np.all(np.abs(P[1:, 0, 0]) > 0)


@needs_casadi
@pytest.mark.parametrize("robot", ["rrr", "puma560"])
def test_operation_counts_of_the_rival_are_those_of_a_serious_one(robot: str) -> None:
    from bench.contenders.casadi_code import operations

    known = {  # multiplications and additions together of the best hand-written codes
        "rrr": {"inverse_dynamics": 196, "mass_matrix": 74, "regressor": 159},
        "puma560": {"inverse_dynamics": 487, "mass_matrix": 302, "regressor": 660, "gravity": 78},
    }
    functions = hand_of(robot)[1].functions
    for name, limit in known[robot].items():
        count = operations(functions[name])
        assert count["mul"] + count["add"] <= 1.05 * limit, name


def test_dense_bodies_are_possible_and_have_no_zero() -> None:
    bodies = dense_bodies(np.random.default_rng(3), 5)
    assert is_physical(bodies)
    assert np.all(bodies != 0)


def copying_party(wrong: bool) -> Supplier:
    """Two contenders that return q as gravity, the first of them off by one if ``wrong``."""
    statements = "for (int i = 0; i < 2; i++) out[i] = in[i]" + (" + 1.0;" if wrong else ";")
    return Supplier([Contender("one", "gravity", 2, statements), Contender("two", "gravity", 2, "run0(in, out);")])


def copying_case() -> Case:
    """A case whose reference gravity is q itself, so that the driver is tested without any robot code."""
    case = make_case(loads_spec(chain_text(2), "chain.yaml"))
    case.references["dense"].values = dict.fromkeys(("gravity", "inverse_dynamics"), case.parts()[0])
    return case


@needs_gcc
def test_growth_measures_the_compared_functions_of_every_size() -> None:
    scores, seconds = growth([1, 2], find_toolchain(("-O1",)), SHORT, 60.0, lambda case: [], lambda words: None)
    assert [(s.robot, s.contender.function) for s in scores] == [
        (f"chain{n}", function) for n in (1, 2) for function in sorted(COMPARED, key=list(TITLES).index)
    ]
    assert len(seconds) == 2
    assert all(score.deviation < 1e-9 for score in scores)


@needs_gcc
def test_the_driver_times_and_counts_and_refuses_wrong_contenders() -> None:
    case, toolchain = copying_case(), find_toolchain(("-O1",))
    one, two = race(case, [copying_party(wrong=False)], toolchain, SHORT)
    assert one.deviation == 0
    assert one.nanoseconds > 0
    if one.instructions is not None and two.instructions is not None:
        assert 3 < one.instructions <= two.instructions + 1 < 100  # one more jump at most
    with pytest.raises(DisagreementError, match="gravity of one differs"):
        race(case, [copying_party(wrong=True)], toolchain, SHORT)


def results_with(own: float, hand: float, pinocchio: float) -> Results:
    results = Results("a machine", "cc -O3", {"pin": "4"}, "few rounds")
    for label, count in ((OURS, own), (OURS_FILE, 200), (HAND, hand), (PINOCCHIO, pinocchio)):
        operations = {"mul": 54, "add": 42, "div": 0, "sincos": 2}
        contender = Contender(label, "inverse_dynamics", 3, "", operations=operations)
        results.scores.append(Score("rrr", contender, 1e-16, count / 10, count))
    results.calls = [CallTime("rrr", BOUND_RUN, 100.0), CallTime("rrr", PIN, 500.0)]
    results.batches = {"rrr": BatchTime(5.0, 20.0)}
    results.ik = [IKScore("rrr", "rrrgen", 150.0, 4.0, 700.0, 20.0), IKScore("rrr", "C by hand", 300.0, 4.0, 1000.0)]
    return results


@needs_gcc
def test_inverse_kinematics_by_hand_finds_the_same_four_rows() -> None:
    scores = {score.solver: score for score in ik_scores(load_spec("rrr"), find_toolchain(), SHORT)}
    assert set(scores) == {OURS, "C by hand"}
    assert scores[OURS].rows == scores["C by hand"].rows == 4.0  # every row was checked by forward kinematics


def test_verdicts_compare_with_the_limits() -> None:
    met = {(v.work, v.met) for v in verdicts(results_with(200, 500, 2600))}
    assert ("inverse dynamics against hand CasADi", True) in met
    assert ("inverse dynamics against Pinocchio", True) in met
    scaled = "inverse kinematics against Pinocchio's inverse dynamics of the RRR"
    assert (scaled, False) in met  # 150 ns where the reference takes 260 ns: 0.58 x instead of 0.32 x
    assert (scaled, True) in {(v.work, v.met) for v in verdicts(results_with(200, 500, 5000))}
    assert ("inverse kinematics against C by hand", True) in met
    assert ("Python call, bound buffers, against pin.rnea", True) in met
    missed = {(v.work, v.met) for v in verdicts(results_with(240, 500, 2300))}
    assert ("inverse dynamics against hand CasADi", False) in missed
    assert ("inverse dynamics against Pinocchio", False) in missed


def test_page_and_json_hold_what_was_found() -> None:
    results = results_with(200, 500, 2600)
    text = page(results)
    assert "| inverse dynamics | 200, 20.0 ns, 54/42 |" in text
    assert "| 0.40 | 0.08 |" in text
    assert "a machine" in text
    assert "cc -O3" in text
    assert all(line.count("|") == 6 for line in text.splitlines() if line.startswith("| inverse dynamics against"))
    assert json.loads(json.dumps(results.as_dict()))["functions"][0]["instructions"] == 200


def test_plot_is_written(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from bench.plot import plot

    plot(results_with(200, 500, 2600), tmp_path)
    assert (tmp_path / "benchmark.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert (tmp_path / "benchmark.png").stat().st_size > 1000


def test_turns_give_the_least_time_of_each_call() -> None:
    best = turns({"short": lambda: None, "long": lambda: sum(range(2000))}, 3, 1e-4)
    assert 0 < best["short"] < best["long"]


@pytest.mark.parametrize("n", [1, 6, 12])
def test_random_chains_are_valid_robot_files(n: int) -> None:
    assert loads_spec(chain_text(n), "chain.yaml").n == n


@needs_gcc
def test_the_timing_of_a_path_is_timed():
    from rrrgen.derive import derive
    from rrrgen.robot.file import read

    spec = read("planar2r")
    model, along = (derive(spec, groups=(group,)) for group in ("model", "timing"))
    found = path_timings(model, along, find_toolchain(("-O1",)), 1)
    assert [each.friction for each in found] == ["none", "viscous and Coulomb"]
    assert all(each.microseconds > 0.0 and each.duration > 0.0 for each in found)
    assert found[0].duration != found[1].duration
    assert "Timing of a path" in page(Results("m", "c", {}, "e", paths=found))


def test_trees_and_loops_stand_on_the_page_beside_pinocchio():
    times = [TreeTime("torso", "mass_matrix", 744, 200.0, 1000.0)]
    text = page(Results("m", "c", {}, "e", mechanisms=times))
    assert "| torso | mass matrix | 744 | 200 | 1000 | 0.20 |" in text


@needs_gcc
def test_a_tick_of_the_controller_is_timed_part_by_part():
    """The parts in their order on the page and in the verdict; how long they take is not asserted."""
    from rrrgen.runtime import load

    toolchain = find_toolchain(("-O1",))
    found = control_ticks(load.compile("rrr").derived, toolchain, 1)
    works = ["Kalman filter", "friction", "RLS", "gradient"]
    assert [each.work.split(" + ") for each in found] == [works[:1], works[:2], works[:3], [*works[:2], works[3]]]
    assert all(each.nanoseconds > 0.0 and each.parameters == 15 for each in found)
    results = Results(
        "m", "c", {}, "e", ticks=[replace(found[2], nanoseconds=1999.0), replace(found[2], nanoseconds=2001.0)]
    )
    assert [verdict.met for verdict in verdicts(results)] == [True, False]
    assert "One tick of the controller" in page(results)


@needs_gcc
def test_a_tick_of_a_whole_loop_is_timed():
    from bench.measurements.control_loop import GROUPS, WORK, loop_tick
    from rrrgen.derive import derive
    from rrrgen.robot.file import read

    tick = loop_tick(derive(read("pendulum"), groups=GROUPS), find_toolchain(("-O0",)), 1)
    assert tick.work == WORK
    assert tick.nanoseconds > 0
    slow = [replace(tick, robot="panda", nanoseconds=time) for time in (699.0, 701.0)]
    assert [verdict.met for verdict in verdicts(Results("m", "c", {}, "e", ticks=slow))] == [True, False]
