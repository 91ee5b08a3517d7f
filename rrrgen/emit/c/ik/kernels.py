"""Adaptation of the kernels, C files with placeholder names that also compile alone, to one robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rrrgen.base.errors import InternalError
from rrrgen.base.templates import template_text
from rrrgen.emit.c.language import Dialect
from rrrgen.ik.geometry.chain import KinematicChain, Matrix
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan
from rrrgen.ik.result_layout import may_lack
from rrrgen.ik.solutions.general_6r import General6RTables, passes, shifts, tables_of
from rrrgen.ik.tolerances import FARTHEST, LONGEST_TOOL, ROUNDINGS, kernel_values, nominal_margins

_TOKEN = re.compile(
    r"""/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|\.?\d(?:[eE][+-]|[\w.])*|(?P<name>[A-Za-z_]\w*)""",
    re.DOTALL,
)
_GAP = "\0"  # marks a replacement text next to which a space may be removed
_DIRECTIVE = re.compile(r"#\s*(if|elif|else|endif)\b\s*(.*)")
_INCLUDE = re.compile(r'^#include "\w+\.h"\n', re.MULTILINE)


@dataclass(frozen=True)
class KernelSettings:
    """The adaptation of a kernel's C text to one robot: the parts that are kept, and the replacements of names.

    ``options`` are the values of the names that ``#if`` tests. ``words`` maps whole names to the text that replaces
    them, in which nothing is replaced again; ``prefixes`` maps beginnings of names. Where a name is replaced by empty
    text, one space beside it is removed too, and before text that begins with a comma the space in front, so that
    optional arguments leave no gap.
    """

    options: Mapping[str, bool]
    words: Mapping[str, str]
    prefixes: Mapping[str, str]


class SolverDialect(Dialect):
    """The dialect of ``<name>_ik.h`` and ``.c``, which have a real type of their own.

    Header and source can so be used without the model, and no header repeats the typedef of another.
    """

    @property
    def real_type(self) -> str:
        """Name of the typedef of the floating-point type, ``<name>_ik_real``."""
        return f"{self.prefix}_ik_real"


class KernelDialect(Dialect):
    """The dialect of kernel files, with placeholder names such as REAL and SQRT that :func:`specialize` replaces."""

    @property
    def real_type(self) -> str:
        """The placeholder for the floating-point type, REAL."""
        return "REAL"

    def function(self, name: str) -> str:
        """The placeholder for a function of math.h: its name in capitals, such as SQRT."""
        return name.upper()


def kernel(name: str, settings: KernelSettings) -> str:
    """The text of the kernel ``templates/c/<name>`` adapted to one robot, without the lines up to its #include."""
    text = template_text(f"c/{name}")
    include = _INCLUDE.search(text)
    if include is None:
        raise InternalError(f"the kernel {name} does not include its settings")
    return specialize(text[include.end() :], settings)


def specialize(text: str, settings: KernelSettings) -> str:
    """Adapt ``text`` to one robot: #if lines of known options are resolved, names and prefixes replaced."""
    replaced = _TOKEN.sub(
        lambda token: _replace_token(token, settings), "".join(_resolve_conditions(text, settings.options))
    )
    return re.sub(f" {_GAP}|{_GAP} ?", "", replaced)


def _replace_token(token: re.Match[str], settings: KernelSettings) -> str:
    name = token["name"]
    if name is None:
        return token[0]
    word = settings.words.get(name)
    if word is not None:
        return _GAP + word if not word or word.startswith(",") else word
    for prefix, longer in settings.prefixes.items():
        if name.startswith(prefix):
            return longer + name.removeprefix(prefix)
    return name


def _resolve_conditions(text: str, options: Mapping[str, bool]) -> Iterator[str]:
    """Yield the lines that remain after resolving the #if lines of options; other conditions stay in the text."""
    kept: list[bool | None] = []  # of each open condition: whether its lines remain; None where it stays in the text
    for line in text.splitlines(keepends=True):
        directive = _DIRECTIVE.match(line)
        if directive is None:
            if False not in kept:
                yield line
            continue
        what, condition = directive.groups()
        if what == "if":
            kept.append(_holds(condition, options))
        elif not kept or (what == "elif" and kept[-1] is not None):
            raise InternalError(f"a kernel has an #{what} that is not understood: {condition}")
        if kept[-1] is None:
            if False not in kept:
                yield line
        elif what == "else":
            kept[-1] = not kept[-1]
        if what == "endif":
            kept.pop()
    if kept:
        raise InternalError("a kernel has an #if without its #endif")


def _holds(condition: str, options: Mapping[str, bool]) -> bool | None:
    """Evaluate a condition such as ``A && !B || C``; None if it contains names that are no options."""
    terms = [[factor.strip() for factor in term.split("&&")] for term in condition.split("||")]
    if any(factor.removeprefix("!") not in options for term in terms for factor in term):
        return None
    return any(all(options[f.removeprefix("!")] != f.startswith("!") for f in term) for term in terms)


# ------------------------------------------------------------------------------------------------------------------
# Settings that adapt the C kernels of the inverse kinematics (``templates/c/ik/*.c``) to one robot.
#
# Each kernel is a template with options (parts that are kept or left out), words (names replaced by text) and
# prefixes of functions; ``templates/c/ik/kernel.h`` lists them.
# ------------------------------------------------------------------------------------------------------------------

NEEDS = (
    "arcs",
    "atan2",
    "cosine",
    "feasible",
    "linear",
    "opposite",
    "power4",
    "quadratic",
    "quartic",
    "root",
    "unit",
    "wrist",
)
"""Kernel functions that the lists of candidates may call; each is emitted only if its option NEEDS_... is set."""


def settings(
    plan: SolverPlan,
    dialect: Dialect,
    *,
    needs: frozenset[str],
    opens: Sequence[tuple[tuple[int, int], ...]],
    rows: int,
    reasons: Sequence[str],
    texts: Sequence[str],
) -> KernelSettings:
    """Compute the options, words and prefixes that adapt the kernels to the robot of ``plan``.

    ``needs`` are the template functions that the candidates call; ``opens`` lists, for each list of candidates, the
    joints that a target can leave free, with their flags; ``rows`` is the largest number of solutions of one call;
    ``reasons`` and ``texts`` are the messages by stage and by status.
    """
    stem, macro = f"{dialect.prefix}_ik", f"{dialect.macro}_IK"
    n, position = plan.chain.n, plan.task == "position"
    last = "branches" if plan.companion is None else "nearby"
    banded = plan.snapped or plan.companion is not None
    locked = None if plan.locked == ARM_ANGLE else plan.locked
    options = {
        "COUPLED": False,
        "POSITION": position,
        "TOOL": plan.last_link is not None,
        "SLIDES": "P" in plan.chain.types,
        "LIMITED": any(joint.lower is not None or joint.upper is not None for joint in plan.chain.joints),
        "OFFSETS": any(joint.offset for joint in plan.chain.joints),
        "REDUNDANT": plan.locked is not None,
        "LOCKED": locked is not None,
        "LOCKED_FIRST": locked == 0,
        "LOCKED_LAST": locked == n - 1,
        "OPENED": any(opens),
        "BRANCHES_OPEN": bool(opens[0]),
        "NEARBY_OPEN": len(opens) > 1 and bool(opens[1]),
        "BANDED": banded,
        "COMPANION": plan.companion is not None,
        "VIRTUAL": bool(plan.virtual),
        "SINGLE": not banded,
        "ONE_ROW": not banded and rows == 1,
        "SOUND": not banded and not needs & {"near", "unknown"},
        "ASPECTS": plan.general,
        "INCOMPLETE": bool(plan.incomplete),
        "GENERAL": plan.general,
        "NOMINAL_FIRST": plan.nominal_first is not None,
        **{f"NEEDS_{name.upper()}": name in needs for name in NEEDS},
        "NEEDS_ATAN2": "R" in plan.chain.types or not position,
    }
    values = kernel_values(dialect.real)
    words = {
        **_dialect(dialect),
        **values,
        **_optional(options, dialect),
        **_chain(plan.chain, plan.last_link, dialect),
        "ERRORS": "3" if position else "6",
        "STACKED": str(n + (3 if position else 6)),
        "TARGET": str(target_size(plan)),
        "TARGET_READ": str(target_size(plan)) if position else "12",
        "AT_X": "0" if position else "3",
        "AT_Y": "1" if position else "7",
        "AT_Z": "2" if position else "11",
        "ROWS": str(rows),
        "LOCKED_JOINT": str(locked),
        "STEPS": values["VALUE_DESCENT_STEPS" if banded else "VALUE_STEPS"],
        "OPEN_BITS": f"{sum({256 << joint for joints in opens for joint, _ in joints})}u",
        "FAR_STAGE": str(len(reasons) - 1 - may_lack(plan)),
        "CHECK_STAGE": str(len(reasons) - 2 - may_lack(plan)),
        "OUTSIDE_STAGE": str(len(reasons) - 1),
        "REASONS": string_literals(reasons, 1),
        "REASON_COUNT": str(len(reasons)),
        "STATUS_TEXTS": string_literals(texts, 4),
        "LAST_STATUS": f"{len(texts) - 1}u",
        "UNKNOWN_STATUS": f"{len(texts)}u",
        "ik_last_candidates": f"{stem}_{last}",
    }
    if plan.nominal_first is not None and plan.companion is not None:
        margins = nominal_margins(plan.nominal_first.deviation, dialect.real)
        words |= {"LANES": str(plan.companion.max_solutions)}
        words |= {f"VALUE_{name.upper()}": repr(value) for name, value in margins.items()}
    if plan.general:
        more, tables = _general(plan, dialect)
        options, words = options | more, words | tables
    prefixes = {"ik_": f"{stem}_", "IK_": f"{macro}_", "robot_": f"{dialect.prefix}_"}
    return KernelSettings(options, words, prefixes)


def target_size(plan: SolverPlan) -> int:
    """How many numbers a target has: a pose, or a position, and that of the tool where it is an input."""
    return 16 if plan.task == "pose" else 3 if plan.last_link is None else 6


def reopening(base: KernelSettings, stem: str, name: str, opens: Iterable[tuple[int, int]]) -> KernelSettings:
    """The settings of the kernel ``reopen``, which chooses the values of joints that a target leaves free.

    The kernel is emitted once for each function ``<stem>_<name>`` that lists candidates. ``opens`` are the joints that
    may be free there: (joint index, bits of the branch number without meaning while it is free).
    """
    bits = [f"bits |= (((held >> {joint}) & 1u) != 0u) ? {mask}u : 0u;" for joint, mask in opens if mask]
    words = {
        f"ik_{function}": f"{stem}_{function}_{name}" for function in ("merged", "with", "search", "fit", "reopen")
    }
    words |= {"ik_candidates": f"{stem}_{name}", "MERGED_BITS": "\n    ".join(bits)}
    return KernelSettings({**base.options, "MERGES": bool(bits)}, {**base.words, **words}, base.prefixes)


def literals(values: Iterable[float], dialect: Dialect) -> str:
    """Numbers as constants of the real type in braces: an initial value of an array."""
    return "{" + ", ".join(f"({dialect.real_type}){float(v) + 0.0!r}" for v in values) + "}"


def _doubles(values: Iterable[float]) -> str:
    """Numbers as constants of the type double in braces: an initial value of an array."""
    return "{" + ", ".join(repr(float(v) + 0.0) for v in values) + "}"


def _dialect(dialect: Dialect) -> dict[str, str]:
    functions = ("sqrt", "fabs", "copysign", "sin", "cos", "floor", "ceil")
    words = {name.upper(): dialect.function(name) for name in functions}
    return {
        **words,
        "REAL": dialect.real_type,
        "RESTRICT": f"{dialect.macro}_RESTRICT",
        "LOCAL": "static",
        "LOCAL_INLINE": "static inline",
        "SHARED": "",
    }


def _optional(options: dict[str, bool], dialect: Dialect) -> dict[str, str]:
    """The C text of the parameters and arguments that only some robots' functions have; empty where not needed."""
    real = dialect.real_type
    banded, opened = options["BANDED"], options["OPENED"]
    redundant, aspects = options["REDUNDANT"], options["ASPECTS"]
    return {
        "BAND_PARAMETER": f", {real} band" if banded else "",
        "BAND": ", band" if banded else "",
        "NO_BAND": f", ({real})0" if banded else "",
        "HELD_PARAMETER": ", unsigned held" if opened else "",
        "HELD": ", held" if opened else "",
        "NONE_HELD": ", 0u" if opened else "",
        "LOCK_PARAMETER": f", {real} lock" if redundant else "",
        "LOCK": ", lock" if redundant else "",
        "REDUNDANCY_PARAMETER": f", {real} redundancy" if redundant else "",
        "REDUNDANCY": ", redundancy" if redundant else "",
        "REDUNDANCIES_PARAMETER": f", const {real} *{dialect.macro}_RESTRICT redundancy" if redundant else "",
        "REDUNDANCY_K": ", redundancy[k]" if redundant else "",
        "TARGET_PARAMETER": f"const {real} *T," if aspects else "",
        "TARGET_FIRST": "T," if aspects else "",
    }


def _chain(chain: KinematicChain, last_link: Matrix | None, dialect: Dialect) -> dict[str, str]:
    """Replacement texts for the chain's data: sizes, joint limits, offsets, constant transforms, magnitudes.

    Where there is a ``last_link``, the tool is an input, and the last constant transform ends at the last link frame.
    """
    fixed = (chain if last_link is None else replace(chain, tip=last_link)).transforms

    def finite_limit(x: float | None, side: int) -> float:
        return side * 1e30 if x is None else float(x)

    sliding = sum(1 << k for k, joint in enumerate(chain.joints) if not joint.revolute)
    return {
        "JOINTS": str(chain.n),
        "LAST_JOINT": str(chain.n - 1),
        "SLIDING": f"0x{sliding:x}u",
        "TRANSFORMS": str(chain.n + 1),
        "FIXED": table([_array_literal((x for row in matrix for x in row), dialect) for matrix in fixed]),
        "OFFSET_VALUES": _array_literal((joint.offset for joint in chain.joints), dialect),
        "LOWER": _array_literal((finite_limit(joint.lower, -1) for joint in chain.joints), dialect),
        "UPPER": _array_literal((finite_limit(joint.upper, 1) for joint in chain.joints), dialect),
        "VALUE_REACH": repr(chain.reach),
        "ROUNDINGS": str(ROUNDINGS),
        "ROUNDING_UNITS": repr(ROUNDINGS * chain.scale / chain.reach),
        "FAR_AWAY": repr(FARTHEST * chain.scale),
        "TOOL_AWAY": repr(LONGEST_TOOL * chain.reach),
    }


def _general(plan: SolverPlan, dialect: Dialect) -> tuple[dict[str, bool], dict[str, str]]:
    """Options and replacement texts of the kernels that solve a general chain of six joints by elimination."""
    chain, tables = plan.solving, tables_of(plan.solving, plan.locked)
    options, words = elimination(tables, dialect)
    shifted = shifts(chain, plan.locked)
    options["DH_SHIFTED"] = any(shifted)
    words |= {
        "DH_BEFORE": literals(_inverse(chain.base), dialect),
        "DH_AFTER": literals(_inverse(chain.tip), dialect),
        "DH_SHIFTS": literals(shifted, dialect),
        "FREE_K": "k + 1" if plan.locked == 0 else "k",
    }
    if plan.locked is not None:
        joint, link = chain.joints[plan.locked], chain.links[0 if plan.locked == 0 else -1]
        offset = float(joint.offset)
        options["LOCKED_SLIDES"] = not joint.revolute
        words["LOCKED_OFFSET"] = f"+ ({dialect.real_type}){offset!r}" if offset else ""
        words["LOCKED_LINK"] = literals(_inverse(link.matrix()), dialect)
    return options, words


def elimination(tables: General6RTables, dialect: Dialect) -> tuple[dict[str, bool], dict[str, str]]:
    """Options and replacement texts of the kernels ``trig_roots`` and ``general6r`` for one chain of six joints."""
    rows = passes(tables, dialect.real)
    words = {
        "DH": table([_doubles(row) for row in tables.rows]),
        "DH_TURN": _doubles(tables.turn),
        "DH_SLIDE": str(tables.slide),
        "DH_SPAN": _doubles(tables.span or ()),
        "PASSES": str(len(rows)),
        "PASS": table(["{" + ", ".join(map(str, roles)) + "}" for roles, _ in rows]),
        "PASS_NOISE": _doubles(noise for _, noise in rows),
        "LENGTH": repr(tables.length),
        "PER_LENGTH": repr(1 / tables.length),
    }
    return {"DH_SLIDES": tables.slide is not None, "NARROW": dialect.real == "float"}, words


def _inverse(matrix: Matrix) -> list[float]:
    """The inverse of a rigid transform as 12 numbers, rows of 3x4."""
    R = [[float(matrix[j][i]) for j in range(3)] for i in range(3)]
    t = [float(matrix[i][3]) for i in range(3)]
    return [x for row in R for x in (*row, -sum(r * y for r, y in zip(row, t, strict=True)))]


def _array_literal(values: Iterable[float], dialect: Dialect) -> str:
    """Print a C array of numbers, negative ones as ``-(REAL)x``, with the sign in front of the cast."""
    numbers = (float(value) + 0.0 for value in values)
    real = dialect.real_type
    return "{" + ", ".join(f"({real}){x!r}" if x >= 0 else f"-({real}){-x!r}" for x in numbers) + "}"


def table(rows: Sequence[str]) -> str:
    """Rows of a table in braces, one on a line."""
    return "{\n" + ",\n".join(f"    {row}" for row in rows) + "\n}"


def string_literals(texts: Sequence[str], columns: int) -> str:
    """The elements of a C array of strings, in ``columns`` columns."""
    quoted = [f'"{text}"' for text in texts]
    lines = [", ".join(quoted[k : k + columns]) for k in range(0, len(quoted), columns)]
    return ",\n        ".join(lines)
