"""A complete benchmark run: all robots and parts, within a time limit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import util
from typing import TYPE_CHECKING

from bench.contenders.cases import ROBOTS, Case, make_case
from bench.measurements.race import QUICK, Effort, race
from bench.results import Results
from bench.toolchain import FLAGS, find_toolchain, machine
from rrrgen.base.errors import RrrgenError
from rrrgen.base.parallel import Tell

if TYPE_CHECKING:
    from bench.contenders.contender import Supplier
    from bench.toolchain import Toolchain
    from rrrgen.robot.spec import RobotSpec

Say = Callable[[str], None]
GROWTH_SECONDS = {True: 20.0, False: 120.0}
"""No further chain is begun after this; long chains take long to derive."""


@dataclass(frozen=True)
class Plan:
    """The contents of a run: robots, flags, rivals and parts."""

    robots: tuple[str, ...] = ROBOTS
    quick: bool = False
    flags: tuple[str, ...] = FLAGS
    pinocchio: bool = True
    parts: frozenset[str] = frozenset(
        {"functions", "python", "ik", "growth", "generation", "control", "mechanisms", "hessians"}
    )

    @property
    def effort(self) -> Effort:
        """The number of repetitions and the shortest time of a measurement."""
        return QUICK if self.quick else Effort()


def bench(plan: Plan, tell: Tell) -> Results:
    """Run ``plan``; ``tell(done, total, message)`` is called at every step. Raises BuildError without a C compiler."""
    from bench.contenders.rivals import installed_versions

    toolchain = find_toolchain(plan.flags)
    effort = plan.effort
    words = f"{effort.rounds} rounds of {effort.sample / 1e3:.0f} us per contender"
    results = Results(machine(), toolchain.describe(), installed_versions(), words)
    by_robot = bool(plan.parts & {"functions", "python"})
    stages: list[Callable[..., None]] = [partial(_robot, robot) for robot in plan.robots if by_robot]
    others = {"ik": _inverse_kinematics, "growth": _growth, "generation": _generation, "control": _control}
    others |= {"mechanisms": _mechanisms, "hessians": _hessians}
    stages += [stage for part, stage in others.items() if part in plan.parts]
    for done, stage in enumerate(stages):
        stage(plan, toolchain, results, partial(tell, done, len(stages)))
    return results


def _robot(robot: str, plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.contenders.emitted import emitted_contenders
    from rrrgen.derive import derive_once
    from rrrgen.robot.file import read

    spec = read(robot)
    case = make_case(spec)
    if "functions" in plan.parts:
        say(f"{robot}: deriving")
        derived = derive_once(spec)
        groups = [emitted_contenders(case, derived), *_rivals(case, plan, toolchain, results)]
        say(f"{robot}: compiling and measuring (Pinocchio's headers take minutes, once)")
        results.scores += race(case, groups, toolchain, plan.effort)
    if "python" in plan.parts and case.file is not None:
        say(f"{robot}: calls from Python")
        _python(case, plan, toolchain, results)


def _rivals(
    case: Case, plan: Plan, toolchain: Toolchain, results: Results, names: Collection[str] | None = None
) -> list[Supplier]:
    """The installed rivals that can take part; the report names the others."""
    from bench.contenders.rivals import hand_contenders, pinocchio_contenders

    groups = []
    rivals = {
        "CasADi": hand_contenders(case, names),
        "Pinocchio C++": pinocchio_contenders(case) if plan.pinocchio else None,
    }
    for name, rival in rivals.items():
        if rival is None:
            asked = plan.pinocchio or name == "CasADi"
            why = "not installed, or the robot has sliding joints" if asked else "not asked for"
            _leave_out(results, f"{name}: {why}")
        elif rival.cpp is not None and toolchain.cxx is None:
            _leave_out(results, f"{name}: no C++ compiler")
        else:
            groups.append(rival)
    return groups


def _python(case: Case, plan: Plan, toolchain: Toolchain, results: Results) -> None:
    from bench.measurements.batches import batch_time
    from bench.measurements.python_calls import python_calls
    from rrrgen.runtime import load

    model = load.compile(case.spec)
    rounds = max(10, plan.effort.rounds // 2)
    results.calls += python_calls(case, model, toolchain, rounds)
    results.batches[case.name] = batch_time(case, model, toolchain, rounds)


def _inverse_kinematics(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.measurements.inverse_kinematics import GENERAL, ik_scores
    from rrrgen.robot.file import load_spec, loads_spec

    specs: Sequence[RobotSpec] = [load_spec(robot) for robot in plan.robots]
    for spec in [*(spec for spec in specs if spec.n <= 6), loads_spec(GENERAL, "general6r.yaml")]:
        say(f"{spec.name}: inverse kinematics")
        try:
            results.ik += ik_scores(spec, toolchain, plan.effort)
        except RrrgenError as error:
            _leave_out(results, f"inverse kinematics of {spec.name}: {error}")


def _growth(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.measurements.growth import COMPARED, growth

    sizes = [1, 2, 4, 6, 8] if plan.quick else list(range(1, 13))
    say(f"random chains of {sizes[0]} to {sizes[-1]} joints")
    results.growth, results.derivations = growth(
        sizes,
        toolchain,
        plan.effort,
        GROWTH_SECONDS[plan.quick],
        lambda case: _rivals(case, plan, toolchain, results, COMPARED),
        say,
    )
    done = len(results.derivations)
    if done < len(sizes):
        _leave_out(results, f"chains of {sizes[done]} and more joints: the time for growth was used up")


def _generation(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.measurements.generation import ROUNDS, generations

    say("generation in fresh processes")
    if plan.quick:
        results.generations += generations(plan.robots[:1], toolchain, 1)
    else:
        results.generations += generations(plan.robots, toolchain, ROUNDS)


def _control(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.measurements.control_loop import GROUPS, SEVEN_JOINTS, loop_tick
    from bench.measurements.control_tick import control_ticks
    from bench.measurements.path_timing import path_timings
    from rrrgen.derive import derive_once
    from rrrgen.robot.file import read

    for robot in plan.robots:
        say(f"{robot}: one tick of the controller")
        spec = read(robot)
        derived = derive_once(spec)
        results.ticks += control_ticks(derived, toolchain, max(10, plan.effort.rounds // 4))
        say(f"{robot}: timing of a path")
        along = derive_once(spec, ("timing",))
        results.paths += path_timings(derived, along, toolchain, max(10, plan.effort.rounds // 4))
    for robot in dict.fromkeys((*plan.robots, SEVEN_JOINTS)):
        say(f"{robot}: one tick of a whole loop")
        derived = derive_once(read(robot), GROUPS)
        results.ticks.append(loop_tick(derived, toolchain, max(10, plan.effort.rounds // 4)))


def _mechanisms(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    from bench.contenders.rivals import pinocchio_includes
    from bench.measurements.trees import ROBOTS as MECHANISMS
    from bench.measurements.trees import measured

    if not plan.pinocchio or pinocchio_includes() is None or toolchain.cxx is None:
        _leave_out(results, "trees, floating bases and closed loops: no Pinocchio to compare with")
        return
    for name in MECHANISMS[-1:] if plan.quick else MECHANISMS:
        say(f"{name}: compiling and measuring (Pinocchio's headers take minutes, once)")
        results.mechanisms += measured(name, toolchain)


def _hessians(plan: Plan, toolchain: Toolchain, results: Results, say: Say) -> None:
    if util.find_spec("casadi") is None:
        _leave_out(results, "second derivatives: no CasADi to compare with")
        return
    from bench.measurements.second_derivatives import MOST_JOINTS, measured
    from rrrgen.robot.file import read

    compilers = toolchain if plan.pinocchio else replace(toolchain, cxx=None)
    for robot in plan.robots:
        case = make_case(read(robot))
        if case.file is None or case.n > MOST_JOINTS or not all(case.chain.revolute):
            _leave_out(
                results, f"second derivatives of {robot}: for arms of at most {MOST_JOINTS} revolute joints with links"
            )
            continue
        say(f"{robot}: second derivatives")
        results.hessians += measured(case, compilers, plan.effort)


def _leave_out(results: Results, text: str) -> None:
    if text not in results.left_out:
        results.left_out.append(text)
