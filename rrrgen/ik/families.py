"""The families of closed forms: which ones apply to a chain, at what cost, and whether their equations work on it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from random import Random
from statistics import median
from typing import Any

from rrrgen.base.errors import DerivationError, InternalError
from rrrgen.base.small_matrices import singular_values
from rrrgen.ik.geometry.chain import KinematicChain, arm_angle, multiply, translation
from rrrgen.ik.geometry.loop import Loop, commute_joints, straighten
from rrrgen.ik.geometry.rigid_transforms import Crossing, rigid
from rrrgen.ik.plan import ARM_ANGLE, Singularity, SolverPlan, record, solving_loop
from rrrgen.ik.recording.float_builder import FloatBuilder, every_branch, wrap
from rrrgen.ik.singularities import describe_singularities
from rrrgen.ik.solutions.general_6r import MAX_SOLUTIONS, is_general, tables_of
from rrrgen.ik.solutions.parallel import Frame, better
from rrrgen.ik.solutions.planar import triple_of
from rrrgen.ik.solutions.position import UNUSABLE, Arm, simplest
from rrrgen.ik.solutions.reduced import turning_axes
from rrrgen.ik.solutions.spherical_triples import arm_of, is_elbow7, is_spherical
from rrrgen.ik.tolerances import ALONG, DEPENDENT, FOUND, NEARLY_DEPENDENT

Options = Iterator[tuple[int, SolverPlan]]


def position_plans(chain: KinematicChain) -> Options:
    """Plans, each with its cost, for the position of the tip of a chain with one to three joints."""
    if chain.n == 3:
        base, tip = rigid(chain.base), rigid(chain.tip)
        links = tuple(Crossing.of(link) for link in chain.links)
        joints = (chain.joints[0], chain.joints[1], chain.joints[2])
        cost = simplest(Arm(joints, links[0], links[1], tip.t, base.t))[0]
        if cost < UNUSABLE:
            title = f"position of the tip by three joints {chain.types}"
            yield 10 + cost, SolverPlan("position", title, "position", chain, chain)
    else:
        yield (
            0,
            SolverPlan("point", f"position of the tip by {chain.n} joint(s) {chain.types}", "position", chain, chain),
        )


def pose_plans(chain: KinematicChain, locked: int | None = None) -> Options:
    """Plans for the pose of the tip with the joints of ``chain`` (without the locked one), each with its cost."""
    loop = structure(chain, locked)
    yield from _structured_plans(chain, loop, locked, None)
    if is_general(chain, locked):
        yield from _general_plans(chain, locked)
    for i, joint in enumerate(loop.joints):
        for direction in (1, -1) if not joint.revolute else ():
            moved = commute_joints(loop, i, direction)
            if moved is not None:
                yield from _structured_plans(chain, moved, locked, (i, direction))


def _general_plans(chain: KinematicChain, locked: int | None) -> Options:
    """Plan for six joints without special geometry, solved by variable elimination; none where they are dependent.

    The cost is lower for six revolute joints than with a prismatic one; on a seven-joint arm lower where the last joint
    is prescribed than the first, and lower where the Jacobian of the other six is far from singular.
    """
    steepness = 1.0 if locked is None else _steepness(chain, locked)
    if steepness < DEPENDENT:
        return
    slides = any(not joint.revolute for k, joint in enumerate(chain.joints) if k != locked)
    joints = "five revolute joints and a prismatic one" if slides else "six revolute joints"
    title = f"{joints} without special structure: the roots of a polynomial of degree 16"
    plan = SolverPlan("general5r1p" if slides else "general6r", title, "pose", chain, chain, locked=locked)
    yield 40 + 2 * slides + (locked == 0) + 4 * (steepness < NEARLY_DEPENDENT), plan


def _steepness(chain: KinematicChain, locked: int) -> float:
    """Measure how independent the joints besides ``locked`` are: between 0 (dependent) and 1.

    The result is the median, over nine random configurations, of the ratio of the smallest to the largest singular
    value of the pose Jacobian without column ``locked``; lengths are divided by the reach.
    """
    draw = Random(5)
    ratios = []
    for _ in range(9):
        columns = []
        for k, column in enumerate(chain.tip_motion([draw.uniform(-pi, pi) for _ in chain.joints])):
            scale = 1 / chain.reach if chain.joints[k].revolute else 1.0
            if k != locked:
                columns.append([scale * x for x in column[:3]] + column[3:])
        values = singular_values(columns)
        ratios.append(values[-1] / values[0])
    return median(ratios)


def _structured_plans(
    chain: KinematicChain, loop: Loop, locked: int | None, commute: tuple[int, int] | None
) -> Options:
    names = [f"{joint.index + 1}" for joint in loop.joints]
    m = len(loop.joints)
    straight = straighten(loop)

    def family_plan(family: Any, title: str, first: int = 0) -> SolverPlan:
        return SolverPlan(family, title, "pose", chain, chain, first=first, locked=locked, commute=commute)

    def triple(k: int) -> str:
        return "-".join(names[(k + i) % m] for i in range(3))

    for k in range(m if m == 6 else 0):
        if is_spherical(loop, k):
            cost = simplest(arm_of(straighten(loop.start_at((k + 3) % 6))))[0]
            arm = "".join(loop.types[(k + 3 + i) % 6] for i in range(3))
            if cost < UNUSABLE:
                yield 10 + cost, family_plan("spherical", f"spherical triple {triple(k)} on the arm {arm}", k)
        cost = better(straight, k)[0]
        if cost < UNUSABLE:
            yield 11 + cost, family_plan("parallel", f"planar triple {triple(k)} (parallel axes)", k)
    if turning_axes(loop) is not None and (loop.types == "RRR" or (m == 6 and loop.types.count("P") == 3)):
        yield (
            12,
            family_plan(
                "orientation", "rotation by three joints" + (", then three linear equations" if m == 6 else "")
            ),
        )
    if m == 3 and triple_of(straight, 0) is not None:
        yield 5, family_plan("planar", f"planar arm {loop.types}: position and angle in its plane")
    for k in range(m if m == 4 else 0):
        frame = Frame.of(straight, k)
        if frame is not None and _lifts(frame):
            yield 5, family_plan("lift", f"planar triple {triple(k)} with a lift (SCARA type)", k)


def _lifts(frame: Frame) -> bool:
    """Whether the fourth joint is a lift: prismatic, along the normal of the plane in which the other three move."""
    if frame.loop.joints[0].revolute:
        return False
    trail = frame.trail.rigid().R
    axis = (trail[0][2], trail[1][2], trail[2][2])
    return abs(abs(float(axis[2])) - 1) < ALONG


def arm_angle_plans(chain: KinematicChain) -> Options:
    """Plan for a seven-joint arm with spherical shoulder and wrist, whose redundancy parameter is the arm angle."""
    loop = structure(chain, None)
    if is_elbow7(loop):
        title = "spherical shoulder and wrist with one elbow, prescribed by the arm angle"
        words = "the arm angle psi (rad) of the stereographic reference, see the header"
        yield 0, SolverPlan("elbow7", title, "pose", chain, chain, locked=ARM_ANGLE, redundancy=words)


def structure(chain: KinematicChain, locked: int | None) -> Loop:
    """Build the loop without joint ``locked`` at an arbitrary pose, to classify the arm by its constant links."""
    # any pose will do; an irregular one avoids accidental zeros
    T = chain.tip_pose([0.1 + 0.37 * k for k in range(1, 2 + max(j.index for j in chain.joints))])
    builder = FloatBuilder(T, [0.0] * (chain.n + 1), [], redundancy=0.6180339)
    return solving_loop(builder, chain, locked)


def works(plan: SolverPlan, trials: int) -> bool:
    """Whether the equations of ``plan`` are usable: random configurations are found again from their poses.

    ``trials`` configurations are drawn. For an elimination its own test on sample poses decides.
    """
    chain, draw = plan.solving, Random(11)
    if plan.general:
        return _eliminates(chain, plan.locked)
    tool = (0.31 * chain.reach, 0.17 * chain.reach, -0.23 * chain.reach)  # as good as any other
    if plan.last_link is not None:
        chain = replace(chain, tip=multiply(plan.last_link, translation(tool)))
    size = 1 + max(joint.index for joint in chain.joints)
    for _ in range(trials):
        q = [draw.uniform(-1.4, 1.4) for _ in range(size)]
        for joint in chain.joints:
            if not joint.revolute:
                q[joint.index] *= chain.reach
            if joint.name.startswith("virtual"):
                q[joint.index] = 0.0
        T = chain.tip_pose(q)
        given = parameter(plan, q)
        # the reference differs from q: otherwise a joint that is only copied from the reference would seem solved
        elsewhere = [draw.uniform(-1.4, 1.4) for _ in range(size)]
        rows = every_branch(
            plan.equations.play,
            lambda script, T=T, away=elsewhere, given=given: FloatBuilder(  # type: ignore[misc]
                T, away, script, redundancy=given, tool=tool
            ),
        )
        if not any(_same(chain, row, q) for row in rows):
            return False
    return True


def _eliminates(chain: KinematicChain, locked: int | None) -> bool:
    """Whether some elimination for six joints is usable on this chain, as judged on sample poses."""
    try:
        tables_of(chain, locked)
    except DerivationError:
        return False
    return True


def parameter(plan: SolverPlan, q: Any) -> float:
    """The redundancy parameter of the configuration ``q``.

    It is the value of the prescribed joint (rad or m), or the arm angle (rad); 0 for an arm that has none.
    """
    if plan.locked is None:
        return 0.0
    return arm_angle(plan.solving, q) if plan.locked == ARM_ANGLE else float(q[plan.locked])


def _same(chain: KinematicChain, row: list[float], q: Any) -> bool:
    if len(row) < len(q):
        return False
    return all(
        abs(wrap(row[joint.index] - q[joint.index])) < FOUND
        if joint.revolute
        else abs(row[joint.index] - q[joint.index]) < FOUND * chain.reach
        for joint in chain.joints
    )


def complete_plan(plan: SolverPlan) -> SolverPlan | None:
    """Add equations, number of solutions and singularities to ``plan``; None where the equations degenerate."""
    if plan.general:
        words = "det J(q) = 0" + (", J without the prescribed joint" if plan.locked is not None else "")
        words += ": two or more of the up to sixteen solutions meet"
        return replace(plan, max_solutions=MAX_SOLUTIONS, singularities=(Singularity(words),))
    try:
        solver = record(plan)
    except (InternalError, ZeroDivisionError):
        return None
    return describe_singularities(replace(plan, solver=solver, max_solutions=solver.max_solutions), solver.stages)


def reason(chain: KinematicChain, rank: int, redundancy: int | None = None) -> str:
    """Text that says why no closed form fits a chain whose joints move the tip in ``rank`` independent directions."""
    if redundancy is not None:
        return f"with joint {redundancy + 1} prescribed, the others fit none of the families"
    if rank < chain.n:
        return (
            f"the {chain.n} joints move the tip in only {rank} independent directions, and no joint can be prescribed "
            "so that the others fit a family"
        )
    if "P" in chain.types and chain.n in (5, 6, 7):
        return (
            f"the joints {chain.types} have no three revolute axes through one point, no planar triple and no rotation "
            "decided by three joints alone; without such a structure six joints are solved, or seven with the first or "
            "last one prescribed, of which one slides at most"
        )
    if chain.n <= 3:
        return (
            f"the {chain.n} joints {chain.types} move the tip along a set that is neither a position task (the tip "
            "does not move in as many directions) nor planar nor a pure rotation"
        )
    return f"the {chain.n} joints {chain.types} fit none of the families, even with virtual joints"
