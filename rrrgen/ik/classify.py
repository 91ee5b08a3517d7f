"""Choice of the solver of a chain: the cheapest family whose equations reproduce the configurations of random poses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product as cartesian
from random import Random
from typing import TYPE_CHECKING

from rrrgen.base.errors import DerivationError
from rrrgen.base.small_matrices import singular_values
from rrrgen.ik import families
from rrrgen.ik.families import complete_plan, works
from rrrgen.ik.geometry.chain import KinematicChain, Matrix, extend_chain, numeric_chain
from rrrgen.ik.geometry.mechanism import coupling_of, largest_tilt, solved_chain
from rrrgen.ik.geometry.nearly_special import changes, deviation, nearest_special, snap_chain, with_near_frames
from rrrgen.ik.plan import ARM_ANGLE, NominalFirst, SolverPlan
from rrrgen.ik.tolerances import EXACT, NEARLY, RANK, SPECIAL
from rrrgen.robot.model.mechanism import chain_to_tip, tip_arm
from rrrgen.robot.spec import FixedTransform

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


TRIALS = 3
"""Number of random configurations that a plan must find again from their poses."""

SPLITS = 13
"""Largest cost of a plan whose equations are at most quadratic. Costs rank plans and have no unit; lower is better."""

WITHOUT_EFFECT = "ik: nominal_first has no effect"

UNSOLVED = 1000
"""Cost reported where no plan exists; larger than the cost of every plan."""


def plan(spec: RobotSpec, redundancy: int | None = None) -> SolverPlan:
    """Plan the inverse kinematics of ``spec``; ``redundancy`` (from 0) prescribes that joint of a redundant arm.

    For a chain that cannot be solved, the plan has the family ``"none"`` and its ``reason`` says why. A mechanism is
    planned as the chain of its rows from base to tip, with a ``coupling``; ``redundancy`` then counts these rows.
    """
    if spec.mechanism is not None:
        solver_plan = _plan_mechanism(spec, redundancy)
        return (
            replace(solver_plan, approach=f"{WITHOUT_EFFECT} on a mechanism")
            if spec.ik == "nominal_first"
            else solver_plan
        )
    solver_plan = _plan_once(with_near_frames(numeric_chain(spec)), redundancy)
    return with_nominal_first(solver_plan) if spec.ik == "nominal_first" else solver_plan


def tip_plans(spec: RobotSpec) -> dict[str, tuple[RobotSpec, SolverPlan]]:
    """For every named tip of ``spec`` the robot of the joints that move it alone, and the plan that solves it."""
    plans = {}
    for tip in spec.tips:
        try:
            arm = tip_arm(spec, tip).spec
            plans[tip] = arm, plan(arm)
        except DerivationError as reason:
            one = spec.at_tip(tip)
            chain = numeric_chain(chain_to_tip(one)) if spec.loops else solved_chain(one)[0]
            plans[tip] = one, _none(chain, str(reason))
    return plans


def with_nominal_first(solver_plan: SolverPlan) -> SolverPlan:
    """Let ``solver_plan`` refine the solutions of a nearby special arm before it solves its own equations.

    The general equations are then solved only for targets where those solutions may not be all. Plans that do not
    solve general equations, and arms near no special one, keep their equations; ``approach`` of the result says why.
    """
    companion = _quadratic_companion(solver_plan) if solver_plan.general else None
    if companion is None:
        why = (
            "no special arm is near this one"
            if solver_plan.general
            else "no general equations of six joints are solved"
        )
        return replace(solver_plan, approach=f"{WITHOUT_EFFECT}: {why}")
    special = companion.solving
    first = NominalFirst(deviation(solver_plan.chain, special), changes(solver_plan.chain, special))
    words = (
        f"nominal first: the at most {companion.max_solutions} solutions of the nearest special arm "
        f"({companion.title}) are refined by Newton steps on this arm; where they may not be all, the general "
        f"equations are solved. The special arm has {', '.join(first.changes)}; poses differ by up to "
        f"{first.deviation:.2g} (rad, or parts of the reach of {solver_plan.chain.reach:.3g} m)"
    )
    return replace(solver_plan, companion=companion, nominal_first=first, approach=words)


def _quadratic_companion(solver_plan: SolverPlan) -> SolverPlan | None:
    """Plan the nearest special arm that is solved by equations of degree 1 and 2; None if there is none nearby.

    Quartics are excluded: whether a nearby arm has more real roots is judged by discriminants of quadratic equations.
    """
    for tolerance in NEARLY:
        _, nearby = _best(solver_plan.chain, nearest_special(solver_plan.chain, tolerance), solver_plan.locked)
        quadratic = nearby.solver is not None and all(stage.most <= 2 for stage in nearby.solver.stages)
        if quadratic and nearby.locked == solver_plan.locked:
            return replace(nearby, snapped=True)
    return None


def _plan_mechanism(spec: RobotSpec, redundancy: int | None) -> SolverPlan:
    """Plan a mechanism from its rows of the DH table from base to tip, solved as if each had a drive.

    The plan has a ``coupling``, which converts solutions of these rows to joint positions.
    """
    if spec.loops:
        names = ", ".join(loop.name for loop in spec.loops)
        reason = f"a tip that closed loops move is not solved for ({names})"
        return _none(numeric_chain(chain_to_tip(spec)), reason)
    chain, S = solved_chain(spec)
    solver_plan = _with_tilts(_plan_once(chain, redundancy))
    if not solver_plan.solvable:
        return solver_plan
    try:
        coupling = coupling_of(spec, chain, S)
    except DerivationError as error:
        return _none(chain, str(error))
    if solver_plan.locked is None or solver_plan.locked == ARM_ANGLE or coupling.leader(solver_plan.locked) is not None:
        return replace(solver_plan, coupling=coupling)
    if redundancy is not None:
        return _none(chain, f"{chain.joints[redundancy].name} cannot be prescribed, because it follows several joints")
    leading = (k for k in range(chain.n) if coupling.leader(k) is not None)
    plans = (_with_tilts(_plan_once(chain, k)) for k in leading)
    return next(
        (replace(candidate, coupling=coupling) for candidate in plans if candidate.solvable),
        _none(chain, "the rows to the tip are redundant, and none that follows one joint can be prescribed"),
    )


def _with_tilts(solver_plan: SolverPlan) -> SolverPlan:
    """Mark the plan of a chain with fixed rows: its equations are those of the arm without their tilts."""
    tilt = largest_tilt(solver_plan.chain)
    if tilt == 0.0 or not solver_plan.solvable:
        return solver_plan
    why = f"its fixed rows hold tilts of up to {tilt:.1g}, and equations are known without them only"
    incomplete = solver_plan.incomplete or ("" if tilt < SPECIAL else _only_nearby(why))
    return replace(solver_plan, snapped=True, incomplete=incomplete)


@lru_cache(maxsize=16)
def _plan_once(chain: KinematicChain, redundancy: int | None) -> SolverPlan:
    """Plan a chain as :func:`plan_chain` does, and remember the plans of the last 16 chains.

    The writers of the sources, of the self-test and of the manifest all ask for the plan of the same chain.
    """
    return plan_chain(chain, redundancy)


def plan_chain(chain: KinematicChain, redundancy: int | None = None) -> SolverPlan:
    """Plan the inverse kinematics of a chain in normal form; ``redundancy`` (from 0) prescribes that joint.

    The chain is first planned as it is. Where that needs a quartic or a polynomial of higher degree, or fails, small
    lengths and sines (up to 1e-2, lengths relative to the reach) are set to zero, and the resulting simpler arm is
    planned instead of the chain, or in addition to it.
    """
    cost, general = _best(chain, snap_chain(chain, EXACT), redundancy)
    if cost <= SPLITS:
        return general
    seen = snap_chain(chain, EXACT)
    for tolerance in (SPECIAL, *NEARLY):
        special = snap_chain(chain, tolerance) if tolerance == SPECIAL else nearest_special(chain, tolerance)
        if special == seen:
            continue
        seen = special
        beside = general.solvable and tolerance != SPECIAL
        simpler, nearby = _best(chain, special, general.locked if beside else redundancy)
        if simpler >= cost or (beside and nearby.locked != general.locked):
            continue
        nearby = replace(nearby, snapped=True)
        if beside:
            general = replace(general, companion=nearby)
            return replace(general, companion=_quadratic_companion(general) or nearby) if chain.slides else general
        return nearby if tolerance == SPECIAL else replace(nearby, incomplete=_only_nearby(general.reason))
    return general


def _best(chain: KinematicChain, special: KinematicChain, redundancy: int | None) -> tuple[int, SolverPlan]:
    """Find the cheapest plan for the chain ``special`` that finds random configurations again: (cost, plan).

    ``special`` is ``chain``, or a simpler arm close to it. Where no plan works, the result is (UNSOLVED, a plan of the
    family "none" with the reason).
    """
    position_rank, pose_rank = generic_ranks(special)
    options: Iterable[tuple[int, SolverPlan]]
    if redundancy is None and chain.n <= 3 and position_rank == chain.n:
        options = families.position_plans(special)
    elif pose_rank == chain.n and redundancy is None:
        options = _pose_plans(special)
    elif pose_rank == chain.n - 1:
        options = _redundant_plans(special, redundancy)
    else:
        return UNSOLVED, _none(chain, _dependent(chain, pose_rank, redundancy))
    for cost, option in sorted(options, key=lambda entry: entry[0]):
        complete = families.complete_plan(replace(option, chain=chain))
        if complete is not None and families.works(complete, TRIALS):
            return cost, complete
    return UNSOLVED, _none(chain, families.reason(special, pose_rank, redundancy))


def _pose_plans(chain: KinematicChain) -> list[tuple[int, SolverPlan]]:
    options = list(families.pose_plans(chain))
    if chain.n < 6:
        for solving, count in _virtual_chains(chain):
            for score, option in families.pose_plans(solving):
                options.append((score + 20 + count, replace(option, virtual=count)))
    return options


def _virtual_chains(chain: KinematicChain) -> Iterator[tuple[KinematicChain, int]]:
    """Extend a chain to six joints (to three, if it has one or two) by virtual joints at its tip or its base."""
    wanted = 3 if chain.n < 3 else 6
    count = wanted - chain.n
    offsets = (0.0, 0.37 * chain.reach)
    for at_base, shift, turn in cartesian((False, True), offsets, (0, 1)):
        yield extend_chain(chain, count, at_base=at_base, shift=shift, turn=turn), count


def _redundant_plans(chain: KinematicChain, redundancy: int | None) -> list[tuple[int, SolverPlan]]:
    options: list[tuple[int, SolverPlan]] = []
    if redundancy is None:
        options += families.arm_angle_plans(chain)
    joints = range(chain.n) if redundancy is None else (redundancy,)
    for k in joints:
        # the ends of the arm are preferred: locking them leaves the geometry of the rest constant
        end = 0 if k in (0, chain.n - 1) else 3
        for score, option in families.pose_plans(chain, locked=k):
            words = f"joint {chain.joints[k].name or k + 1} is prescribed"
            options.append((score + 5 + end, replace(option, locked=k, redundancy=words)))
    return options


def generic_ranks(chain: KinematicChain) -> tuple[int, int]:
    """Largest ranks, over three random configurations, of the Jacobians of the tip position and of the tip pose."""
    draw = Random(7)
    position = pose = 0
    for _ in range(3):
        motion = chain.tip_motion([draw.uniform(-2.0, 2.0) for _ in chain.joints])
        columns = [
            [x / chain.reach for x in column[:3]] + column[3:] if joint.revolute else column
            for joint, column in zip(chain.joints, motion, strict=True)
        ]
        position = max(position, _rank([column[:3] for column in columns]))
        pose = max(pose, _rank(columns))
    return position, pose


def _rank(rows: list[list[float]]) -> int:
    values = singular_values(rows)
    return sum(value > RANK * max(values[0], 1e-300) for value in values)


def _dependent(chain: KinematicChain, rank: int, redundancy: int | None) -> str:
    if redundancy is not None and rank == chain.n:
        return "no joint can be prescribed: the arm is not redundant"
    free = chain.n - rank
    return (
        f"the {chain.n} joints move the tip in only {rank} independent directions, so every target that can be reached "
        f"is reached by a {free}-dimensional continuum; at most one joint can be prescribed"
    )


def _only_nearby(reason: str) -> str:
    """Text that says why solutions may be missing: a simpler arm close to the true one is solved instead of it."""
    return (
        "the arm has no complete solver; the configurations of a special arm that is nearly this one are refined on "
        f"it, and those that only this arm has are not found ({reason})"
    )


def _none(chain: KinematicChain, reason: str) -> SolverPlan:
    task = "position" if chain.n <= 3 else "pose"
    return SolverPlan("none", "no closed form", task, chain, chain, reason=reason)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------------------------
# Inverse kinematics of positions with the tool as an input: the same equations, with the point they move unknown.
# ------------------------------------------------------------------------------------------------------------------


def plan_with_tool(spec: RobotSpec) -> SolverPlan:
    """Plan the inverse kinematics of a position task in which the position of the tool is an input.

    A target is six numbers, the position of the tool in the base frame and its position in the frame of the last link.
    The family is that of the arm with the tool of its robot file, since it depends on the axes and not on the point
    that they move. Raises DerivationError with the reason for an arm that has no such solver.
    """
    solver_plan = plan(spec)
    if not solver_plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {solver_plan.reason}")
    if solver_plan.task != "position":
        raise DerivationError(
            f"{spec.name}: its inverse kinematics solves for poses, and a tool only changes its target: see tool_target"
        )
    tooled = _with_tool(solver_plan, solved_chain(replace(spec, tool=FixedTransform()))[0].tip)
    if tooled is None or not works(tooled, TRIALS):
        raise DerivationError(f"{spec.name}: {solver_plan.title}: its equations do not hold for other tools")
    return tooled


def _with_tool(part: SolverPlan, last_link: Matrix) -> SolverPlan | None:
    """The plan ``part``, and its companion, with the tool as an input; None where the equations degenerate."""
    companion = part.companion and _with_tool(part.companion, last_link)
    if part.companion is not None and companion is None:
        return None
    return complete_plan(replace(part, companion=companion, last_link=last_link))
