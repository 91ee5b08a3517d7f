"""The emitted inverse kinematics: ``<name>_ik.h`` and ``<name>_ik.c``, self-contained C99 that is valid C++."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import tau
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import DerivationError
from rrrgen.base.templates import render
from rrrgen.base.version import VERSION
from rrrgen.emit import Real
from rrrgen.emit.c.ik.branches import CBuilder
from rrrgen.emit.c.ik.common_code import newton_text
from rrrgen.emit.c.ik.costs import (
    ELIMINATED,
    ELIMINATION,
    SolverOperations,
    coupling_operations,
    stack_bounds,
    sum_of,
)
from rrrgen.emit.c.ik.header_comments import branch_text, explanation, opening
from rrrgen.emit.c.ik.kernels import (
    KernelDialect,
    KernelSettings,
    SolverDialect,
    kernel,
    reopening,
    settings,
    specialize,
    target_size,
)
from rrrgen.emit.c.ik.loop_nest import PASSES, LoopPass
from rrrgen.emit.c.ik.statements import CBody
from rrrgen.emit.c.language import CTarget, Dialect, LibmSinCos
from rrrgen.emit.interface import SelfTestCheck
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import plan_with_tool, tip_plans
from rrrgen.ik.plan import NominalFirst, SolverPlan
from rrrgen.ik.recording.newton_step import newton_program
from rrrgen.ik.result_layout import labels, may_lack, most_rows, opens, parts_of, reasons_of, status_texts
from rrrgen.ik.tolerances import nominal_margins, runtime
from rrrgen.program import count_operations
from rrrgen.robot.identity import identify

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class Emitted:
    """The emitted inverse kinematics of one plan: ``files`` maps names to texts.

    ``rows`` is the largest number of solutions that one call can return.
    """

    plan: SolverPlan
    files: dict[str, str]
    rows: int
    stack: dict[str, int]
    """Upper bound of the stack (bytes, callees included) of each function that returns solutions."""
    operations: SolverOperations
    """Operations of one call that finds all solutions; of an elimination, those that do not depend on their number."""


FUNCTIONS = ("inverse_kinematics", "inverse_kinematics_batch", "closest", "ik_status_string", "ik_reason")
"""Names of the public functions of the emitted files, without the prefix ``<name>_``."""


def sources(spec: RobotSpec, real: Real = "double", redundancy: int | None = None) -> dict[str, str]:
    """The emitted files, name -> text, of the tip and all named tips; :func:`manifest` says which have no solver."""
    plans = [(spec, make_plan(spec, redundancy)), *tip_plans(spec).values()]
    return {name: text for arm, plan in plans if plan.solvable for name, text in emit(arm, plan, real).files.items()}


def manifest(spec: RobotSpec, real: Real = "double", redundancy: int | None = None) -> dict[str, Any]:
    """The entry of ``manifest.json`` about the inverse kinematics; its ``solver`` is false if there is none.

    ``operations``: those of one call that finds all solutions. For a mechanism they solve the equations of its
    chain and compute q for every way in which the drives can stand. Where an elimination solves the chain
    numerically they are means over random targets, and ``operations_of_a_solution`` come on top for every solution.
    ``tolerances``: the thresholds of the emitted code by name. ``stack``: the most bytes that each function takes,
    callees included. ``tips`` has the same of every named tip.
    """
    data = _plan_data(spec, make_plan(spec, redundancy), real)
    tips = {tip: _plan_data(arm, plan, real) for tip, (arm, plan) in tip_plans(spec).items()}
    return data | ({"tips": tips} if tips else {})


def _plan_data(spec: RobotSpec, plan: SolverPlan, real: Real) -> dict[str, Any]:
    """The entry of the manifest about the solver of ``plan``."""
    data: dict[str, Any] = {
        "solver": plan.solvable,
        "family": plan.family,
        "title": plan.title,
        "task": plan.task,
        "max_solutions": plan.max_solutions * (plan.coupling.count if plan.coupling is not None else 1),
        "redundancy": plan.redundancy or None,
        "reason": plan.reason or None,
        "incomplete": plan.incomplete or None,
        "singular": [singularity.words for singularity in plan.singularities],
    }
    if plan.nominal_first is not None:
        data["nominal_first"] = _nominal_data(plan, plan.nominal_first, real)
    if plan.solvable:
        emitted = emit(spec, plan, real)
        data |= {
            "files": [f"{spec.name}_ik.c", f"{spec.name}_ik.h"],
            "functions": _public(spec),
            "branch": [{"name": name, "bit": bit, "bits": bits} for name, bit, bits in labels(plan)],
            "reasons": list(reasons_of(plan)),
            "tolerances": {name: float(value) for name, value in runtime(real).items()},
            "operations": emitted.operations.as_dict(),
            "stack": emitted.stack,
        }
        if plan.general:
            data["operations_of_a_solution"] = ELIMINATED.as_dict()
    return data


def _nominal_data(plan: SolverPlan, first: NominalFirst, real: Real) -> dict[str, Any]:
    """The entry of the manifest about the special arm whose solutions are tried first."""
    special = parts_of(plan)[-1]
    return {
        "family": special.family,
        "title": special.title,
        "deviation": first.deviation,
        "special": list(first.changes),
        "margins": nominal_margins(first.deviation, real),
        "operations_of_a_step": asdict(count_operations(newton_program(plan.chain, plan.locked))),
    }


def _public(spec: RobotSpec) -> list[str]:
    return [f"{spec.name}_{name}" for name in FUNCTIONS]


def emit(spec: RobotSpec, plan: SolverPlan, real: Real = "double", passes: Sequence[LoopPass] = PASSES) -> Emitted:
    """The emitted files of ``plan`` with their stack and operations; DerivationError if the robot has no solver.

    ``passes`` rewrite the loops of the solver in order, to make it faster.
    """
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {plan.reason}")
    dialect = SolverDialect(spec.name, real)
    bodies = [_body(plan, part, dialect, passes) for part in parts_of(plan)]
    counts = [ELIMINATION if body is None else body.operations for body in bodies]  # those of a companion too
    if plan.coupling is not None:
        counts.append(coupling_operations(plan.coupling, plan.max_solutions, plan.chain.types))
    operations = sum_of(counts)
    source, rows = _source(plan, bodies, dialect, identify(spec).model_hash)
    chain = replace(plan, coupling=None)
    stack = stack_bounds(source, spec.name, real, {"ik": (plan.n, rows), "ik_chain": (chain.n, most_rows(chain))})
    header = render("c/ik/header.h.j2", **_header_values(spec, plan, dialect, operations), stack=stack)
    files = {f"{spec.name}_ik.h": header, f"{spec.name}_ik.c": source}
    public = {name: stack[name] for name in _public(spec)[:3]}  # the others only return a text
    return Emitted(plan, files, rows, public, operations)


def _body(plan: SolverPlan, part: SolverPlan, dialect: Dialect, passes: Sequence[LoopPass]) -> CBody | None:
    """The C body that lists the candidate solutions of ``part``, or None if a numerical kernel lists them.

    ``part`` is ``plan`` itself or its companion, a simpler arm that is nearly this one.
    """
    if part.general:
        return None
    builder = CBuilder(
        CTarget(KernelDialect(dialect.prefix, dialect.real), LibmSinCos()),
        part.chain.joints,
        part.chain.reach,
        position_only=part.task == "position",
        trusted=not part.snapped,
        banded=plan.snapped or plan.companion is not None,
        margins=plan.nominal_first is not None,
    )
    part.equations.play(builder)
    return builder.body(passes)


CANDIDATES = (
    ("branches", "The candidates of every branch."),
    ("nearby", "The candidates of a simpler arm that is nearly this one."),
)
"""The C functions that list candidate solutions, with their comments: of the plan itself, and of its companion."""


def _source(plan: SolverPlan, bodies: list[CBody | None], dialect: Dialect, model_hash: str) -> tuple[str, int]:
    """The text of ``<name>_ik.c``, and the largest number of solutions that one call can return.

    ``bodies`` are the C bodies that list candidates (:func:`_body`), for the plan and its companion.
    """
    chain = replace(plan, coupling=None)
    needs = frozenset().union(*({"near"} if body is None else body.needs for body in bodies))
    chosen = settings(
        chain,
        dialect,
        needs=needs,
        opens=[opens(part) for part in parts_of(plan)],
        rows=most_rows(chain),
        reasons=reasons_of(chain),
        texts=status_texts(plan),
    )
    if plan.coupling is None:
        stem = f"{dialect.prefix}_ik"
        parts = [
            *_chain_parts(plan, bodies, chosen, stem, dialect),
            *(kernel(f"ik/{name}.c", chosen) for name in PUBLIC),
        ]
    else:
        from rrrgen.emit.c.ik.mechanisms import chain_settings, chain_type, mechanism_parts, mechanism_settings

        stem, inner = f"{dialect.prefix}_ik_chain", chain_settings(chosen, dialect)
        outer = mechanism_settings(inner, plan, plan.coupling, dialect)
        parts = [chain_type(plan, dialect), *_chain_parts(chain, bodies, inner, stem, dialect), *mechanism_parts(outer)]
    text = render(
        "c/ik/source.c.j2",
        stem=f"{dialect.prefix}_ik",
        model_hash=model_hash,
        version=VERSION,
        parts=[part.strip("\n") for part in parts if part.strip()],
    )
    return text, most_rows(plan)


def _chain_parts(
    plan: SolverPlan, bodies: list[CBody | None], chosen: KernelSettings, stem: str, dialect: Dialect
) -> list[str]:
    """The C text that solves a chain for one target: constants, kernels, lists of candidates."""
    general = ("trig_roots", "general6r", "aspect", "candidates6r") if plan.general else ()
    texts = {name: kernel(f"ik/{name}.c", chosen) for name in (*BEFORE, *general, *BEHIND)}
    open_joints = [opens(part) for part in parts_of(plan)]
    reopened = [
        kernel("ik/reopen.c", reopening(chosen, stem, name, joints))
        for (name, _), joints in zip(CANDIDATES, open_joints, strict=False)
        if joints
    ]
    lists = [
        texts["candidates6r"] if body is None else _list(name, comment, body, chosen)
        for (name, comment), body in zip(CANDIDATES, bodies, strict=False)
    ]
    parts = [kernel("ik/constants.h", chosen), *(texts[name] for name in (*BEFORE, *general[:-1]))]
    parts += [*lists, *(texts[name] for name in BEHIND[:4])]
    parts += [texts["open"], *reopened] if reopened else []
    parts += [texts[name] for name in BEHIND[5:-1]]
    parts += [newton_text(plan, dialect, chosen), kernel("ik/nominal.c", chosen)] if plan.nominal_first else []
    return [*parts, texts[BEHIND[-1]]]


BEFORE = ("angles", "roots", "error", "refine")
BEHIND = ("rows", "order", "target", "descend", "open", "settle", "finish", "solve")
PUBLIC = ("batch", "closest", "texts")
"""Names of the C kernel files, in the order in which they stand in an emitted solver: BEFORE the functions that list
candidates, BEHIND them, and PUBLIC, which build on the solver for one target: batches, closest solution, messages."""


def _list(name: str, comment: str, body: CBody, chosen: KernelSettings) -> str:
    return specialize(render("c/ik/candidates.c.j2", name=name, comment=comment, body=body.text), chosen)


def _header_values(spec: RobotSpec, plan: SolverPlan, dialect: Dialect, operations: SolverOperations) -> dict[str, Any]:
    name, position = spec.name, plan.task == "position"
    return {
        "prefix": name,
        "p": f"{name}_ik",
        "M": f"{dialect.macro}_IK",
        "macro": dialect.macro,
        "real": dialect.real,
        "n": plan.n,
        "size": target_size(plan),
        "position": position,
        "redundant": plan.locked is not None,
        "rows": most_rows(plan),
        "reach": repr(plan.chain.reach),
        "tol": runtime(dialect.real),
        "incomplete": bool(plan.incomplete),
        "unproved": may_lack(plan) and not plan.incomplete,
        "branch_text": branch_text(labels(plan)),
        "explanation": explanation(plan),
        "opening": opening(spec, plan, dialect.real, operations),
    }


# ------------------------------------------------------------------------------------------------------------------
# The emitted inverse kinematics with the tool as an input: ``<name>_tool_ik.h`` and ``.c``.
#
# Only arms of one to three joints, which are solved for positions, have it. Poses need no solver of their own: there
# another tool changes the target alone.
# ------------------------------------------------------------------------------------------------------------------


def emit_tool_solver(spec: RobotSpec, real: Real = "double") -> Emitted:
    """The files of the inverse kinematics of positions with the tool as an input; DerivationError if there is none."""
    return emit(replace(spec, name=f"{spec.name}_tool"), plan_with_tool(spec), real)


def tool_solver_files(spec: RobotSpec, real: Real) -> dict[str, str]:
    """The same files by name; none for an arm without such a solver."""
    try:
        return emit_tool_solver(spec, real).files
    except DerivationError:
        return {}


def tool_solver_check(spec: RobotSpec) -> SelfTestCheck | None:
    """The part of the self-test for this solver: every solution is checked by ``tool_kinematics``; None without it."""
    try:
        plan = plan_with_tool(spec)
    except DerivationError:
        return None
    turning = [tau * joint.revolute for joint in plan.chain.joints]
    periods = turning if plan.coupling is None else plan.coupling.periods
    text = render(
        "c/ik/tool_selftest.c.j2",
        p=spec.name,
        M=f"{spec.name.upper()}_TOOL_IK",
        reach=plan.chain.reach,
        periods=", ".join(f"R({period!r})" for period in periods),
    )
    return SelfTestCheck("tool_inverse_kinematics", f"{spec.name}_tool_ik.h", text)
