"""The emitted inverse kinematics: ``<name>_ik.h`` and ``<name>_ik.c``, self-contained C99 that is valid C++."""

from __future__ import annotations

import hashlib
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rrrgen.backends import Real
from rrrgen.backends.c.call_stack import STACK_RULE, stack_bounds
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.kernels import Settings, kernel, specialize
from rrrgen.errors import DerivationError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.interpreters.c_builder import CBuilder
from rrrgen.ik.interpreters.c_statements import CBody
from rrrgen.ik.kernel_settings import reopening, settings
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.operations import SolverOperations, count_solver, sum_of
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.general6r import ASPECT, root_stage
from rrrgen.ik.tolerances import runtime
from rrrgen.resources import render
from rrrgen.version import VERSION

if TYPE_CHECKING:
    from rrrgen.robotfile.robot_spec import RobotSpec


@dataclass(frozen=True)
class Emitted:
    """The files, and the rows that an answer has room for."""

    plan: SolverPlan
    files: dict[str, str]
    rows: int
    stack: dict[str, int]
    """Bytes of stack that the functions with solutions take at most, callees included."""


FUNCTIONS = ("inverse_kinematics", "inverse_kinematics_batch", "closest", "ik_status_string", "ik_reason")
"""Public functions of the emitted files, after the robot's name and an underscore."""


STATUS_TEXTS = (
    "ok",
    "the target is out of reach",
    "every solution is outside the joint limits",
    "a number of the target, of the reference or of the redundancy parameter is not finite",
    "the rotation of the target is not orthonormal and right-handed",
    "the arm has no complete solver: there may be more configurations",
)
"""What the statuses of an answer mean, by their numbers."""


def sources(spec: RobotSpec, real: Real = "double", redundancy: int | None = None) -> dict[str, str]:
    """The emitted files, name -> text; empty for a chain without a solver (see :func:`manifest` for the reason)."""
    plan = make_plan(spec, redundancy)
    return emit(spec, plan, real).files if plan.solvable else {}


def manifest(spec: RobotSpec, real: Real = "double", redundancy: int | None = None) -> dict[str, Any]:
    """What ``manifest.json`` says about the inverse kinematics; ``solver`` is false where there is none.

    ``operations`` are those of one call with all its rows (:mod:`rrrgen.ik.recording.operations`); null where an
    elimination solves the chain in numbers. ``tolerances``: see :func:`rrrgen.ik.tolerances.runtime`. ``stack``: bytes
    that a function takes at most, callees included (:mod:`rrrgen.backends.c.call_stack`).
    """
    plan = make_plan(spec, redundancy)
    data: dict[str, Any] = {
        "solver": plan.solvable,
        "family": plan.family,
        "title": plan.title,
        "task": plan.task,
        "max_solutions": plan.max_solutions,
        "redundancy": plan.redundancy or None,
        "reason": plan.reason or None,
        "incomplete": plan.incomplete or None,
        "singular": [singularity.words for singularity in plan.singularities],
    }
    if plan.solvable:
        counted = operations(plan)
        data |= {
            "files": [f"{spec.name}_ik.c", f"{spec.name}_ik.h"],
            "functions": _public(spec),
            "branch": [{"name": name, "bit": bit, "bits": bits} for name, bit, bits in labels(plan)],
            "reasons": list(reasons_of(plan)),
            "tolerances": {name: float(value) for name, value in runtime(real).items()},
            "operations": None if counted is None else counted.as_dict(),
            "stack": emit(spec, plan, real).stack,
        }
    return data


def _public(spec: RobotSpec) -> list[str]:
    return [f"{spec.name}_{name}" for name in FUNCTIONS]


def operations(plan: SolverPlan) -> SolverOperations | None:
    """What one call computes with all its rows; nothing where an elimination solves the chain in numbers.

    Of a simpler arm that is solved beside the chain, the operations are counted too.
    """
    if any(part.general for part in _parts(plan)):
        return None
    return sum_of(count_solver(part.equations, part.solving.reach) for part in _parts(plan))


def emit(spec: RobotSpec, plan: SolverPlan, real: Real = "double") -> Emitted:
    """Files and branch labels of ``plan``; :class:`DerivationError` with the reason where there is no solver."""
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {plan.reason}")
    dialect = Dialect(spec.name, real)
    source, rows = _source(plan, dialect)
    stack = stack_bounds(source, spec.name, real, plan.chain.n, rows)
    header = render("c/ik/header.h.j2", **_header_values(spec, plan, dialect), stack=stack)
    files = {f"{spec.name}_ik.h": header, f"{spec.name}_ik.c": source}
    public = {name: stack[name] for name in _public(spec)[:3]}  # the others only return a text
    return Emitted(plan, files, rows, public)


def _parts(plan: SolverPlan) -> list[SolverPlan]:
    return [plan] if plan.companion is None else [plan, plan.companion]


def _body(plan: SolverPlan, part: SolverPlan) -> CBody | None:
    """The list of candidates of ``part``, which is ``plan`` or its companion; None where a kernel lists them."""
    if part.general:
        return None
    builder = CBuilder(
        part.chain.joints,
        part.chain.reach,
        position_only=part.task == "position",
        trusted=not part.snapped,
        banded=plan.snapped or plan.companion is not None,
    )
    part.equations.play(builder)
    return builder.body()


def stages(plan: SolverPlan) -> tuple[Stage, ...]:
    """The choices of a root of ``plan``, which ``stage`` of an answer counts from 1."""
    return (root_stage(plan.solving, plan.locked),) if plan.general else plan.equations.stages


def most_rows(plan: SolverPlan) -> int:
    """The rows that an answer has room for."""
    return max(part.max_solutions for part in _parts(plan))


def labels(plan: SolverPlan) -> tuple[tuple[str, int, int], ...]:
    """The parts of a branch number: name, lowest bit, bits."""
    return (ASPECT,) if plan.general else plan.equations.leaf.labels


def _opens(plan: SolverPlan) -> tuple[tuple[int, int], ...]:
    return () if plan.general else plan.equations.opens


CANDIDATES = (
    ("branches", "The candidates of every branch."),
    ("nearby", "The candidates of a simpler arm that is nearly this one."),
)
"""Functions that list candidate rows, and the comments that open them: of the plan, and of its companion."""


def _source(plan: SolverPlan, dialect: Dialect) -> tuple[str, int]:
    """The text of ``<name>_ik.c`` and the rows that an answer has room for."""
    stem, parts = f"{dialect.prefix}_ik", _parts(plan)
    bodies = [_body(plan, part) for part in parts]
    needs = frozenset().union(*({"near"} if body is None else body.needs for body in bodies))
    opens = [_opens(part) for part in parts]
    chosen = settings(
        plan,
        dialect,
        needs=needs,
        opens=opens,
        rows=most_rows(plan),
        reasons=reasons_of(plan),
        texts=STATUS_TEXTS if plan.incomplete else STATUS_TEXTS[:-1],
    )
    general = ("trig_roots", "general6r", "aspect", "candidates6r") if plan.general else ()
    texts = {name: kernel(f"ik/{name}.c", chosen) for name in (*BEFORE, *general, *BEHIND)}
    reopened = [
        kernel("ik/reopen.c", reopening(chosen, stem, name, each))
        for (name, _), each in zip(CANDIDATES, opens, strict=False)
        if each
    ]
    lists = [
        texts["candidates6r"] if body is None else _list(name, comment, body, chosen)
        for (name, comment), body in zip(CANDIDATES, bodies, strict=False)
    ]
    found = [kernel("ik/constants.h", chosen), *(texts[name] for name in (*BEFORE, *general[:-1]))]
    found += [*lists, *(texts[name] for name in BEHIND[:3])]
    found += [texts["open"], *reopened] if reopened else []
    found += [texts["settle"], texts["solve"]]
    text = render(
        "c/ik/source.c.j2",
        stem=stem,
        hash=hashlib.sha256(repr(plan.chain).encode()).hexdigest(),
        version=VERSION,
        parts=[part.strip("\n") for part in found if part.strip()],
    )
    return text, most_rows(plan)


BEFORE = ("angles", "roots", "refine")
BEHIND = ("rows", "target", "descend", "open", "settle", "solve")
"""The kernels of every solver, before the lists of candidates and behind them."""


def _list(name: str, comment: str, body: CBody, chosen: Settings) -> str:
    return specialize(render("c/ik/candidates.c.j2", name=name, comment=comment, body=body.text), chosen)


def _header_values(spec: RobotSpec, plan: SolverPlan, dialect: Dialect) -> dict[str, Any]:
    name, position = spec.name, plan.task == "position"
    return {
        "prefix": name,
        "p": f"{name}_ik",
        "M": f"{dialect.macro}_IK",
        "macro": dialect.macro,
        "real": dialect.real,
        "n": plan.chain.n,
        "size": 3 if position else 16,
        "position": position,
        "redundant": plan.locked is not None,
        "rows": most_rows(plan),
        "reach": repr(plan.chain.reach),
        "tol": runtime(dialect.real),
        "incomplete": bool(plan.incomplete),
        "branch_text": _branch_text(labels(plan)),
        "explanation": _explanation(plan),
        "opening": _opening(spec, plan, dialect.real),
    }


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


def _branch_text(labels: tuple[tuple[str, int, int], ...]) -> str:
    if not labels:
        return "always 0"
    parts = [
        f"bit{'s' if bits > 1 else ''} {bit}{f'-{bit + bits - 1}' if bits > 1 else ''} {name}"
        for name, bit, bits in labels
    ]
    return ", ".join(parts) + "; a two-way choice is 0 on its plus side"


def _explanation(plan: SolverPlan) -> list[str]:
    text = (
        f"Family: {plan.title}; at most {plan.max_solutions} solutions. `target` is "
        + ("the position (m)" if plan.task == "position" else "the row-major 4x4 pose (m)")
        + " of the tip in the base frame. `q_ref` (may be null: zeros, no turns added) gives free angles at singular "
        "configurations and the turn to which angles are taken. Every row satisfies forward kinematics. With no row "
    )
    if plan.incomplete:
        text += (
            "`stage` says what was found out, and `distance` how far the target is from the nearest configuration "
            f"that was found. INCOMPLETE: {plan.incomplete}."
        )
    else:
        text += "the status says why, and `distance` how far the target is from the nearest that can be reached."
    return textwrap.wrap(text, 116)


def _opening(spec: RobotSpec, plan: SolverPlan, real: str) -> list[str]:
    lines = [f"{spec.name}_ik.h: inverse kinematics of {spec.name}, joints {' '.join(plan.chain.types)}", ""]
    lines += textwrap.wrap(f"Family: {plan.title}.", 116)
    if plan.incomplete:
        lines += textwrap.wrap(f"Incomplete: {plan.incomplete}.", 116)
    for singularity in plan.singularities:
        lines += textwrap.wrap(f"Singular: {singularity.words}", 116)
    counted = operations(plan)
    if counted is not None:
        lines += textwrap.wrap(
            f"Operations of one call with all its rows, without the check of the target and the limits: {counted}.", 116
        )
    lines += [
        "",
        f"Generated by rrrgen {VERSION}. The generated code belongs to you.",
        f"Precision: {real}.",
    ]
    lines += textwrap.wrap(
        "No function has state, allocates, or loops without bound; all may be called from several threads at once. "
        "What stands in rows beyond count has no meaning.",
        116,
    )
    lines += textwrap.wrap(STACK_RULE, 116)
    return lines
