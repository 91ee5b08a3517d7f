"""What an answer of a solver looks like, in every language: rows, stages, branch labels, texts."""

from __future__ import annotations

from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.general6r import ASPECT, root_stage

STATUS_TEXTS = (
    "ok",
    "the target is out of reach",
    "every solution is outside the joint limits",
    "a number of the target, of the reference or of the redundancy parameter is not finite",
    "the rotation of the target is not orthonormal and right-handed",
    "the arm has no complete solver: there may be more configurations",
)
"""What the statuses of an answer mean, by their numbers."""


def parts_of(plan: SolverPlan) -> list[SolverPlan]:
    """The plan, and the simpler arm nearby that is solved beside it, if there is one."""
    return [plan] if plan.companion is None else [plan, plan.companion]


def stages(plan: SolverPlan) -> tuple[Stage, ...]:
    """The choices of a root of ``plan``, which ``stage`` of an answer counts from 1."""
    return (root_stage(plan.solving, plan.locked),) if plan.general else plan.equations.stages


def most_rows(plan: SolverPlan) -> int:
    """The rows that an answer has room for."""
    return max(part.max_solutions for part in parts_of(plan))


def labels(plan: SolverPlan) -> tuple[tuple[str, int, int], ...]:
    """The parts of a branch number: name, lowest bit, bits."""
    return (ASPECT,) if plan.general else plan.equations.leaf.labels


def opens(plan: SolverPlan) -> tuple[tuple[int, int], ...]:
    """Joints that the target may leave open, with the bits of the branch label that mean nothing then."""
    return () if plan.general else plan.equations.opens


def reasons_of(plan: SolverPlan) -> tuple[str, ...]:
    """One text per stage; then one for rows that fail the check and one for targets out of range.

    Where the solver is incomplete, no text claims that there is no configuration; the last one is for the limits.
    """
    near = bool(plan.incomplete)
    texts = ["no reason"]
    for stage in stages(plan):
        names = {j.index: j.name for j in plan.solving.joints}
        joint = names.get(stage.joint) or f"joint {stage.joint + 1}"
        so = " on the special arm that is nearly this one" if near else ": the target is out of reach"
        texts.append(f"the {stage.label} equation of {joint} has no real root{so}")
    so = ", and there may be others" if near else ": it lies off the set that the arm can reach"
    texts.append(f"no candidate meets the whole target{so}")
    texts.append("the target is farther than a million reaches: its coordinates drown the arm")
    if near:
        texts.append("every configuration that was found lies outside the joint limits, and there may be others")
    return tuple(texts)
