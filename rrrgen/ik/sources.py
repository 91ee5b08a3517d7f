"""The emitted inverse kinematics: ``<name>_ik.h`` and ``<name>_ik.c``, self-contained C99 that is valid C++."""

from __future__ import annotations

import hashlib
import re
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rrrgen.backends.c.call_stack import STACK_RULE, stack_bounds
from rrrgen.errors import DerivationError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.derive import ARM_ANGLE
from rrrgen.ik.interpreters.c_builder import CBuilder
from rrrgen.ik.interpreters.c_statements import CBody
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.operations import SolverOperations, count_solver, sum_of
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.general6r import ASPECT, branches, root_stage, tables_of
from rrrgen.ik.solutions.general6r import render as render_general6r
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


def sources(spec: RobotSpec, real: str = "double", redundancy: int | None = None) -> dict[str, str]:
    """The emitted files, name -> text; empty for a chain without a solver (see :func:`manifest` for the reason)."""
    plan = make_plan(spec, redundancy)
    return emit(spec, plan, real).files if plan.solvable else {}


def manifest(spec: RobotSpec, real: str = "double", redundancy: int | None = None) -> dict[str, Any]:
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


def emit(spec: RobotSpec, plan: SolverPlan, real: str = "double") -> Emitted:
    """Files and branch labels of ``plan``; :class:`DerivationError` with the reason where there is no solver."""
    if not plan.solvable:
        raise DerivationError(f"{spec.name}: no inverse kinematics is emitted: {plan.reason}")
    values = _values(spec, plan, real)
    prefix = f"{spec.name}_ik"
    source = _spelled(render("c/ik/source.c.j2", **values), spec.name, real)
    stack = stack_bounds(source, spec.name, real, plan.chain.n, values["rows"])
    header = render("c/ik/header.h.j2", **values, stack=stack)
    files = {f"{prefix}.h": header, f"{prefix}.c": source}
    public = {name: stack[name] for name in _public(spec)[:3]}  # the others only return a text
    return Emitted(plan, files, values["rows"], public)


def _parts(plan: SolverPlan) -> list[SolverPlan]:
    return [plan] if plan.companion is None else [plan, plan.companion]


def _body(spec: RobotSpec, plan: SolverPlan, *, banded: bool) -> CBody:
    chain = plan.chain
    if plan.general:
        return branches(plan.solving, f"{spec.name}_ik", plan.locked)
    builder = CBuilder(
        f"{spec.name}_ik",
        chain.joints,
        chain.reach,
        position_only=plan.task == "position",
        trusted=not plan.snapped,
        banded=banded,
    )
    plan.equations.play(builder)
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


def _values(spec: RobotSpec, plan: SolverPlan, real: str) -> dict[str, Any]:
    chain, name = plan.chain, spec.name
    prefix, macro = f"{name}_ik", name.upper()
    position = plan.task == "position"
    banded = plan.snapped or plan.companion is not None
    parts = _parts(plan)
    bodies = [_body(spec, part, banded=banded) for part in parts]
    reasons = reasons_of(plan)
    needs = frozenset().union(*(body.needs for body in bodies))
    comments = ("The candidates of every branch.", "The candidates of a simpler arm that is nearly this one.")
    functions = [
        {"name": name, "comment": comment, "body": body.text, "opens": _opens(part)}
        for name, comment, body, part in zip(("branches", "nearby"), comments, bodies, parts, strict=False)
    ]
    mask = sum(1 << k for k, joint in enumerate(chain.joints) if not joint.revolute)
    limits = [(joint.lower, joint.upper) for joint in chain.joints]
    limited = [lower is not None or upper is not None for lower, upper in limits]
    offsets = [float(joint.offset) for joint in chain.joints]
    model = hashlib.sha256(repr(chain).encode()).hexdigest()
    single = len(bodies) == 1 and not banded
    return {
        # names
        "prefix": name, "p": prefix, "P": prefix, "M": f"{macro}_IK", "K": f"{macro}_IK_TOL", "macro": macro,
        # the task
        "real": real, "n": chain.n, "m": 3 if position else 6, "size": 3 if position else 16, "position": position,
        "redundant": plan.locked is not None, "locked": None if plan.locked == ARM_ANGLE else plan.locked,
        "virtual": plan.virtual,
        # the chain
        "types": chain.types, "prismatic": _mask(mask, "k"), "prismatic_i": _mask(mask, "i"),
        "prismatic_k": _mask(mask, "k"), "fixed": _tables(plan),
        "offsets": ", ".join(_number(x) for x in offsets) if any(offsets) else "",
        "limited": any(limited),
        "lower": ", ".join(_limit(low, -1) for low, _ in limits),
        "upper": ", ".join(_limit(high, 1) for _, high in limits),
        # the equations
        "functions": functions, "opened": any(map(_opens, parts)),
        "open_bits": sum({256 << joint for part in parts for joint, _ in _opens(part)}),
        "needs": needs, "fragment": _fragment(plan, prefix, real), "banded": banded,
        "rows": most_rows(plan), "single": single,
        "sound": single and not needs & {"near", "unknown"},
        "aspects": plan.general,
        # numbers
        "rounding": repr(64.0 * chain.scale / chain.reach),
        "reach": repr(chain.reach), "far": repr(1e6 * chain.scale), "tol": runtime(real),
        "steps": 200 if banded else 12, "starts": 6, "spread": "2.0",
        # words
        "reasons": reasons, "texts": STATUS_TEXTS,
        "far_stage": len(reasons) - 1 - bool(plan.incomplete), "outside_stage": len(reasons) - 1,
        "incomplete": bool(plan.incomplete), "branch_text": _branch_text(labels(plan)),
        "explanation": _explanation(plan), "opening": _opening(spec, plan, real), "version": VERSION,
        "hash": model,
    }  # fmt: skip


def _fragment(plan: SolverPlan, prefix: str, real: str) -> str:
    """Functions that the candidates need beside the usual ones."""
    if not plan.general:
        return ""
    return render_general6r(tables_of(plan.solving, plan.locked), prefix, real, shorthand=True)


def _mask(mask: int, index: str) -> str:
    return f"((0x{mask:x}u >> {index}) & 1u) != 0u"


def _number(x: float) -> str:
    return f"(REAL){x!r}" if x >= 0 else f"-(REAL){-x!r}"


def _limit(x: float | None, side: int) -> str:
    return _number(side * 1e30 if x is None else float(x))


def _tables(plan: SolverPlan) -> list[str]:
    chain = plan.chain
    matrices = [chain.base, *(link.matrix() for link in chain.links), chain.tip]
    return [", ".join(_number(float(x) + 0.0) for row in matrix for x in row) for matrix in matrices]


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


_FUNCTIONS = {
    "SQRT": "sqrt",
    "FABS": "fabs",
    "COPYSIGN": "copysign",
    "SIN": "sin",
    "COS": "cos",
    "FLOOR": "floor",
    "CEIL": "ceil",
}


def _spelled(text: str, name: str, real: str) -> str:
    """The shorthands of the templates in the robot's own names."""
    suffix = "f" if real == "float" else ""
    words = {key: value + suffix for key, value in _FUNCTIONS.items()}
    words |= {
        "REAL": f"{name}_real",
        "WRAP": f"{name}_ik_wrap",
        "ATAN2": f"{name}_ik_atan2",
        "ARCS": f"{name}_ik_arcs",
        "ROOT0": f"{name}_ik_root0",
        **{flag: f"(unsigned){name.upper()}_IK_{flag}" for flag in ("FREE", "MULTIPLE", "NEAR")},
    }
    return re.sub(r"\b(" + "|".join(words) + r")\b", lambda match: words[match[1]], text)
