"""The emitted C of the inverse kinematics of a mechanism: the solver of its chain, with the coupling y = S q."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from rrrgen.emit.c.ik.kernels import KernelSettings, kernel, literals, string_literals, table
from rrrgen.emit.c.language import Dialect
from rrrgen.ik.geometry.mechanism import Coupling
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan
from rrrgen.ik.result_layout import may_lack, most_rows, reasons_of

KERNELS = ("coupling", "order", "refine", "finish", "coupled", "descend", "solve", "batch", "closest", "texts")
"""The kernels that a mechanism has in addition to those of its chain, in the order in which they are emitted."""


def chain_settings(chosen: KernelSettings, dialect: Dialect) -> KernelSettings:
    """Change the settings ``chosen`` such that the kernels become the solver of the chain inside a mechanism.

    Its functions are static and have names with ``_chain_``; the mechanism has the public ones.
    """
    stem = f"{dialect.prefix}_ik"
    words = {
        "SHARED": "static",
        "ik_status": f"{stem}_status",
        "ik_last_candidates": chosen.words["ik_last_candidates"].replace(f"{stem}_", f"{stem}_chain_"),
        "robot_inverse_kinematics": f"{stem}_chain_solve",
    }
    return KernelSettings(chosen.options, {**chosen.words, **words}, {**chosen.prefixes, "ik_": f"{stem}_chain_"})


def chain_type(plan: SolverPlan, dialect: Dialect) -> str:
    """The C definition of the struct that holds the solutions of the chain, as if each of its rows had a drive."""
    stem, real = f"{dialect.prefix}_ik", dialect.real_type
    n, rows = plan.chain.n, most_rows(replace(plan, coupling=None))
    return "\n".join(
        [
            "/* Solutions of the chain of rows from base to tip, as if each had a drive. */",
            f"typedef struct {stem}_chain_solutions {{",
            "    int count;",
            "    int stage;",
            f"    {real} distance;",
            f"    {real} q[{rows}][{n}];",
            f"    unsigned flags[{rows}];",
            f"    unsigned branch[{rows}];",
            f"    {real} residual[{rows}];",
            f"}} {stem}_chain_solutions;",
        ]
    )


def mechanism_settings(chain: KernelSettings, plan: SolverPlan, coupling: Coupling, dialect: Dialect) -> KernelSettings:
    """The settings of the kernels that work on joint positions, from those of the chain."""
    stem = f"{dialect.prefix}_ik"
    locked = None if plan.locked in (None, ARM_ANGLE) else plan.locked
    leader = None if locked is None else coupling.leader(locked)
    slides = not all(coupling.revolute)
    options = {
        "COUPLED": True,
        "LIMITED": True,
        "SLIDES": slides,
        "CHAIN_SLIDES": chain.options["SLIDES"],
        "MIXED": slides or chain.options["SLIDES"],
        "GEARED": coupling.count > 1,
        "FOLLOWERS_LIMITED": bool(coupling.followers),
        "LOCKED": leader is not None,
        "LOCKED_LAST": leader == coupling.n - 1,
        **dict.fromkeys(("OPENED", "ONE_ROW", "ASPECTS"), False),
    }
    words = {
        "SHARED": "",
        "ROWS": str(most_rows(plan)),
        "JOINTS": str(coupling.n),
        "LAST_JOINT": str(coupling.n - 1),
        "STACKED": str(coupling.n + int(chain.words["ERRORS"])),
        "SLIDING": f"0x{sum(1 << k for k, turning in enumerate(coupling.revolute) if not turning):x}u",
        "CHAIN_JOINTS": chain.words["JOINTS"],
        "CHAIN_SLIDING": chain.words["SLIDING"],
        "CHAIN_HELD_PARAMETER": chain.words["HELD_PARAMETER"],
        "CHAIN_NONE_HELD": chain.words["NONE_HELD"],
        "CHAIN_ROWS": chain.words["ROWS"],
        **dict.fromkeys(("HELD_PARAMETER", "HELD", "NONE_HELD", "TARGET_PARAMETER", "TARGET_FIRST"), ""),
        **_tables(plan, coupling, dialect),
        **_messages(plan),
        "ik_far": f"{stem}_chain_far",
    }
    if locked is not None and leader is not None:
        words |= {"LOCKED_JOINT": str(leader), "LOCKED_FACTOR": repr(coupling.matrix[locked][leader])}
    kept = {name: text for name, text in chain.words.items() if not name.startswith(("ik_", "robot_"))}
    prefixes = {**chain.prefixes, "ik_": f"{stem}_", "chain_": f"{stem}_chain_"}
    return KernelSettings({**chain.options, **options}, {**kept, **words}, prefixes)


def mechanism_parts(chosen: KernelSettings) -> list[str]:
    """The C text of the kernels of the mechanism, which follows the text of its chain."""
    return [kernel(f"ik/{name}.c", chosen) for name in KERNELS]


def _tables(plan: SolverPlan, coupling: Coupling, dialect: Dialect) -> dict[str, str]:
    units = [1.0 if turning else plan.chain.reach for turning in coupling.revolute]
    rows = [1.0 if joint.revolute else plan.chain.reach for joint in plan.chain.joints]
    rates = [
        [factor * unit / row for factor, unit in zip(factors, units, strict=True)]
        for factors, row in zip(coupling.matrix, rows, strict=True)
    ]
    followers, far = coupling.followers, 1e30

    def numbers(values: Iterable[float]) -> str:
        return literals(values, dialect)

    def matrix(values: Sequence[Sequence[float]]) -> str:
        return table([numbers(row) for row in values])

    def ends(values: Iterable[float | None], side: int) -> str:
        return numbers(side * far if value is None else value for value in values)

    return {
        "MATRIX": matrix(coupling.matrix),
        "RATES": matrix(rates),
        "INVERSE": matrix(coupling.inverse),
        "PERIODS": numbers(coupling.periods),
        "PIVOTS": "{" + ", ".join(map(str, coupling.pivots)) + "}",
        "TURNS": "{" + ", ".join(map(str, coupling.counts)) + "}",
        "COMBINATIONS": str(coupling.count),
        "LOWER": ends((low for low, _ in coupling.limits), -1),
        "UPPER": ends((high for _, high in coupling.limits), 1),
        "FOLLOWERS": str(len(followers)),
        "FOLLOWER_FACTORS": matrix([follower.factors for follower in followers]),
        "FOLLOWER_LOWER": ends((follower.lower for follower in followers), -1),
        "FOLLOWER_UPPER": ends((follower.upper for follower in followers), 1),
    }


def _messages(plan: SolverPlan) -> dict[str, str]:
    """Texts that replace names of the kernels: the list of reasons for a missing solution, and indices into it.

    The list begins with the reasons of the chain and ends with that of the mechanism, a violated coupling.
    """
    reasons = reasons_of(plan)
    count = len(reasons)
    return {
        "REASONS": string_literals(reasons, 1),
        "REASON_COUNT": str(count),
        "UNFIT_STAGE": str(count - 1),
        "OUTSIDE_STAGE": str(count - 2),
        "FAR_STAGE": str(count - 2 - may_lack(plan)),
    }
