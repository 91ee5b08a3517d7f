"""Layout of the result of an IK solver in every language: number of solutions, stages, branch labels, status texts."""

from __future__ import annotations

from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.general_6r import ASPECT, root_stage
from rrrgen.ik.tolerances import LONGEST_TOOL

STATUS = ("ok", "unreachable", "outside limits", "not finite", "not a rotation", "incomplete")
"""What the numbers of :attr:`IKBatch.statuses` mean. Where an arm has no complete solver, ``plan.incomplete`` says why;
the status is "incomplete" whether solutions were found or not, except for targets beyond a million times the reach.
A general six-joint chain has it for targets, mostly beside singular configurations, for which the solver cannot prove
that it has found all solutions."""

OK, UNREACHABLE, OUTSIDE_LIMITS, NOT_FINITE, NOT_A_ROTATION, INCOMPLETE = range(len(STATUS))

LIMITS, NEAREST, RESIDUAL = 1, 2, 4
"""Option bits of the emitted functions, as in the emitted header: respect limits, sort by distance, keep residual."""

STATUS_TEXTS = (
    "ok",
    "the target is out of reach",
    "every solution is outside the joint limits",
    "a number of the target, of the reference or of the redundancy parameter is not finite",
    "the rotation of the target is not orthonormal and right-handed",
    "the arm has no complete solver: there may be more configurations",
)
"""Texts of the status codes of the solver, indexed by code."""

UNPROVED = "there may be more configurations: close to singular ones, rounding hides how many there are"
"""Text of the last status for a complete solver that cannot prove for a target that it has found all solutions."""


def status_texts(plan: SolverPlan) -> tuple[str, ...]:
    """Texts of the status codes that the solver of ``plan`` returns, indexed by code."""
    if plan.incomplete:
        return STATUS_TEXTS
    return (*STATUS_TEXTS[:-1], UNPROVED) if plan.general else STATUS_TEXTS[:-1]


def may_lack(plan: SolverPlan) -> bool:
    """Whether the solver can answer that solutions may be missing: on every target, or where its proof fails."""
    return bool(plan.incomplete) or plan.general


def parts_of(plan: SolverPlan) -> list[SolverPlan]:
    """List the plans whose solutions make up a result: ``plan`` and, if it has one, its companion.

    The companion solves an arm of slightly different, simpler geometry; see :class:`SolverPlan`.
    """
    return [plan] if plan.companion is None else [plan, plan.companion]


def stages(plan: SolverPlan) -> tuple[Stage, ...]:
    """The root selections of ``plan``; the field ``stage`` of a result numbers them from 1."""
    return (root_stage(plan.solving, plan.locked),) if plan.general else plan.equations.stages


def most_rows(plan: SolverPlan) -> int:
    """The largest number of solutions that a result can hold."""
    most = max(part.max_solutions for part in parts_of(plan))
    return most if plan.coupling is None else most * plan.coupling.count


def labels(plan: SolverPlan) -> tuple[tuple[str, int, int], ...]:
    """The bit fields of a branch number, one for each choice between roots: (name, lowest bit, number of bits).

    The branch number of a solution is an integer that says which root the solution took at each choice.
    """
    return (ASPECT,) if plan.general else plan.equations.leaf.labels


def opens(plan: SolverPlan) -> tuple[tuple[int, int], ...]:
    """Joints that some targets leave undetermined, each as (joint index, mask).

    ``mask`` holds the bits of the branch number that have no meaning while the joint is free.
    """
    return () if plan.general else plan.equations.opens


def reasons_of(plan: SolverPlan) -> tuple[str, ...]:
    """Texts that say why there is no solution, indexed by the field ``stage`` of a result.

    One per root selection, then one for candidates that miss the target and one for targets too far away. Where the
    solver is incomplete, no text claims that there is no solution, and there is one more text for the case that all
    solutions lie outside the joint limits. For a mechanism the last text is for the case that the chain to the tip has
    solutions, but none in which the joints that follow others are where these put them.
    """
    near, unproved = bool(plan.incomplete), plan.general and not plan.incomplete
    texts = ["no reason"]
    for stage in stages(plan):
        names = {j.index: j.name for j in plan.solving.joints}
        joint = names.get(stage.joint) or f"joint {stage.joint + 1}"
        so = " on the special arm that is nearly this one" if near else ": the target is out of reach"
        texts.append(f"the {stage.label} equation of {joint} has no real root{so}")
    so = ", and there may be others" if near else ": it lies off the set that the arm can reach"
    texts.append(f"no candidate meets the whole target{so}")
    far = "the target is farther than a million reaches: its coordinates drown the arm"
    texts.append(far if plan.last_link is None else f"{far}; or the tool is longer than {LONGEST_TOOL} reaches")
    if unproved:
        texts.append("no configuration within the joint limits was found, and rounding hides whether there is one")
    if near:
        texts.append("every configuration that was found lies outside the joint limits, and there may be others")
    if plan.coupling is not None:
        texts.append("no configuration of the rows to the tip keeps the coupling of the joints")
    return tuple(texts)
