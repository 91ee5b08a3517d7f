"""MISRA C:2012 rule by rule for emitted code, in the categories of MISRA Compliance:2020, checked with cppcheck.

:data:`DEVIATIONS` states every rule of which cppcheck's checker may report findings, with the reason; a finding of any
other rule is a fault of rrrgen (``tests/evidence/test_coding_rules.py``). The self-test and its calls of stdio are not
checked. "Checked with cppcheck" is the whole claim: the checker does not look at the rules in :data:`UNCHECKED`,
decides others in part, and is not qualified.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rrrgen.base.errors import InternalError

if TYPE_CHECKING:
    from rrrgen.base.files import Contents

_RULES_PER_SECTION = (3, 7, 2, 2, 9, 2, 4, 14, 5, 8, 9, 5, 6, 4, 7, 7, 8, 8, 2, 14, 20, 10)
"""Number of rules of sections 1 to 22, with Amendment 1."""

RULES = tuple(f"{section}.{rule + 1}" for section, n in enumerate(_RULES_PER_SECTION, 1) for rule in range(n))
_MANDATORY = frozenset(
    (
        "9.1",
        "12.5",
        "13.6",
        "17.3",
        "17.4",
        "17.6",
        "19.1",
        "21.13",
        "21.17",
        "21.18",
        "21.19",
        "21.20",
        "22.2",
        "22.4",
        "22.5",
        "22.6",
    )
)
_ADVISORY = frozenset(
    (
        "1.2",
        "2.3",
        "2.4",
        "2.5",
        "2.6",
        "2.7",
        "4.2",
        "5.9",
        "8.7",
        "8.9",
        "8.11",
        "8.13",
        "10.5",
        "11.4",
        "11.5",
        "12.1",
        "12.3",
        "12.4",
        "13.3",
        "13.4",
        "15.1",
        "15.4",
        "15.5",
        "17.5",
        "17.8",
        "18.4",
        "18.5",
        "19.2",
        "20.1",
        "20.5",
        "21.12",
    )
)

DEVIATIONS: Mapping[str, str] = {
    "2.3": "types of the interface are for the user; each emitted file need not use them",
    "2.4": "tags of the interface are for the user",
    "2.5": "macros of the interface are for the user",
    "5.9": "every source has its own copy of the kernel of sine and cosine, so that the compiler inlines it",
    "8.7": "functions of the interface are called by the user alone",
    "8.9": "constant tables stand above their function, where a reader sees their shape",
    "10.5": "truth values of the interface are int, as in C99 without stdbool.h",
    "11.5": "the fields of the parameters are reached by the offsets of one table, which the checks read too",
    "13.3": "indices advance where they are used, in short loops",
    "13.4": "equal starts of several variables are assigned together",
    "15.4": "loops end where they fail and where they are done",
    "15.5": "guards at the top of a function return at once",
    "17.8": "arguments that are passed by value are clamped in place",
    "18.4": "rows of arrays are passed as pointer and offset",
}
"""Rules with findings, and the reason why they are accepted. All of them are advisory."""

UNCHECKED = frozenset(("1.1", "1.2", "12.5"))
"""Rules that the checker does not look at: language standard, extensions, sizeof of array parameters."""

LONGEST_FILE = 600
"""Lines up to which a file of straight-line functions is checked as a whole. cppcheck's time grows faster than the
length, so longer ones are checked a few functions at a time."""

LONGEST_FUNCTION = 1500
"""Lines up to which a straight-line function is checked: one of 1200 takes cppcheck half a minute, one of 3000 ten."""

_TOGETHER = 300
"""Lines of functions that are checked together."""

_ONE_CONFIGURATION = (
    "-D__GNUC__=12",
    *(f"-U{macro}" for macro in ("__AVX512F__", "__OPTIMIZE__", "__cplusplus", "_MSC_VER")),
    *(f"-U{macro}" for macro in ("_M_FP_FAST", "__FAST_MATH__", "__ASSOCIATIVE_MATH__", "__FLT_EVAL_METHOD__")),
)
"""The macros of a C99 compiler with strict arithmetic on x86-64. They choose pragmas, attributes, the spelling of
``restrict`` and a call of ``ceil``; cppcheck would check the whole file once more for each."""


_NOT_CHECKED = r"(?m)^.*\|(syntaxError|internalError|internalAstError|unknownMacro|cppcheckError)$"
"""What cppcheck reports where it leaves a file out."""


class RuleFinding(NamedTuple):
    """A finding of the checker: file, line, and the number of the rule, such as "10.3"."""

    file: str
    line: int
    rule: str


def category(rule: str) -> str:
    """The published category of a rule: "mandatory", "required" or "advisory"."""
    return "mandatory" if rule in _MANDATORY else "advisory" if rule in _ADVISORY else "required"


def is_available() -> bool:
    """Whether cppcheck is installed."""
    return shutil.which("cppcheck") is not None


def checked_files(files: Mapping[str, Contents]) -> list[str]:
    """The C sources among emitted ``files`` that are checked: all but self-tests and what CasADi writes."""
    return [path for path in sorted(files) if path.endswith(".c") and "/" not in path and "selftest" not in path]


class _Function(NamedTuple):
    """A function of a source: its name, the index of its first line, and that after its last one."""

    name: str
    first: int
    end: int


def _public_functions(lines: Sequence[str]) -> list[_Function]:
    """The functions with external linkage, which start behind an empty line and end with a brace at the margin."""
    functions = []
    for at, line in enumerate(lines):
        if line != "{":
            continue
        first = at
        while lines[first - 1] and not lines[first - 1].startswith("#") and not lines[first - 1].endswith("*/"):
            first -= 1
        if not lines[first].startswith("static"):
            name = re.findall(r"(\w+)\(", lines[first])[0]
            functions.append(_Function(name, first, lines.index("}", at) + 1))
    return functions


def pieces(text: str) -> tuple[list[str], list[_Function]]:
    """A source in pieces that are short enough for cppcheck, and the functions that are too long for it.

    A long file of straight-line functions falls into pieces with a few of its functions each. What precedes the
    functions stands in every piece, and empty lines stand for the functions of other pieces, so that all lines keep
    their numbers. All other files are one piece.
    """
    lines = text.splitlines()
    if len(lines) <= LONGEST_FILE or re.search(r"\b(for|while) \(", text):
        return [text], []
    functions = _public_functions(lines)
    groups: list[list[_Function]] = []
    for function in (candidate for candidate in functions if candidate.end - candidate.first <= LONGEST_FUNCTION):
        if not groups or sum(member.end - member.first for member in (*groups[-1], function)) > _TOGETHER:
            groups.append([])
        groups[-1].append(function)
    parts = []
    for group in groups:
        kept = list(lines)
        for function in functions:
            if function not in group:
                kept[function.first : function.end] = [""] * (function.end - function.first)
        parts.append("\n".join([*kept, ""]))
    return parts, [candidate for candidate in functions if candidate.end - candidate.first > LONGEST_FUNCTION]


def findings(directory: Path, sources: Iterable[str], jobs: int = 1) -> list[RuleFinding]:
    """What cppcheck's MISRA checker finds in the ``sources`` below ``directory``, in order and without repetitions.

    Pieces of long files (:func:`pieces`) are checked as if they stood in their file, ``jobs`` at a time.
    """
    with tempfile.TemporaryDirectory(prefix="rrrgen-rules-") as name:
        place = Path(name)
        build = place / "build"  # the checker's files for rules about several sources
        build.mkdir()
        for header in directory.glob("*.h"):
            shutil.copy(header, place)
        texts = {path: (directory / path).read_text(encoding="utf-8") for path in sources}
        checked = []
        for path, text in texts.items():
            for k, part in enumerate(pieces(text)[0]):
                checked.append(f"{Path(path).stem}-{k}.c")
                (place / checked[-1]).write_text(f'#line 1 "{path}"\n{part}', encoding="utf-8", newline="\n")
        command = [
            *("cppcheck", "--addon=misra", "--std=c99", "--platform=unix64", "--quiet"),
            *(f"--cppcheck-build-dir={build.name}", f"-j{jobs}", *_ONE_CONFIGURATION),
            *("--enable=style", "--suppress=missingIncludeSystem", "--template={file}|{line}|{column}|{id}", *checked),
        ]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        texts |= {header.name: header.read_text(encoding="utf-8") for header in directory.glob("*.h")}
    fault = re.search(_NOT_CHECKED, done.stderr)
    if done.returncode or fault:
        raise InternalError(f"cppcheck cannot read emitted code: {fault[0] if fault else done.stderr[-500:]}")
    columns: dict[RuleFinding, set[int]] = {}
    for file, row, column, rule in re.findall(
        r"^(.*)\|(\d+)\|(\d+)\|misra-c2012-(\d+\.\d+)$", done.stderr, re.MULTILINE
    ):
        if file in texts:
            columns.setdefault(RuleFinding(file, int(row), rule), set()).add(int(column))
    lines = {finding: texts[finding.file].splitlines()[finding.line - 1] for finding in sorted(columns)}
    internal = Counter(_identifier(line) for finding, line in lines.items() if finding.rule == "5.9")
    ones = set(re.findall(r"^#define ([A-Z][A-Z0-9_]*_N) 1\b", "\n".join(texts.values()), re.MULTILINE))
    return [
        finding for finding, line in lines.items() if not _is_mistaken(finding, line, columns[finding], internal, ones)
    ]


def _is_mistaken(
    finding: RuleFinding, line: str, columns: Iterable[int], internal: Mapping[str, int], ones: Container[str]
) -> bool:
    """Whether a finding is about something that does not stand on its ``line``, which the checker cannot know.

    It gives enumerations without a tag numbered names, the same in every file, and takes them for tags. It takes the
    product of an index with the number of joints for an operation without effect where that number is one: ``ones`` are
    the names of such numbers, ``columns`` the places on the line. It names one place of a line only, so that no other
    number on the line may be a factor or summand of 0 or 1. And it counts what stands in several pieces of one file as
    several identifiers with internal linkage; ``internal`` has the number of places of each.
    """
    if finding.rule == "2.2":
        products = [re.search(r"\* ([A-Z][A-Z0-9_]*_N)$", line[: _end(line, column)]) for column in columns]
        others = re.search(r"[-+*/] \(*(\(\w+\))?[01]u?\b|\b[01]u?\)* [-+*]", line)
        return others is None and all(factor is not None and factor[1] in ones for factor in products)
    if finding.rule in ("2.4", "5.7"):
        return re.match(r"(typedef )?(enum|struct) \{", line) is not None
    return finding.rule == "5.9" and internal[_identifier(line)] == 1


def _end(line: str, column: int) -> int:
    """Where the name ends that begins at ``column``, counted from 1."""
    name = re.match(r"\w*", line[column - 1 :])
    return column - 1 + (name.end() if name else 0)


def _identifier(line: str) -> str:
    """The name that a line declares: what stands in front of its parameters, size or value."""
    declaration = re.search(r"(\w+)\s*[(\[=;]", line)
    return declaration[1] if declaration else line


def coding_rules_entry(rule_findings: Iterable[RuleFinding], sources: Iterable[str]) -> dict[str, Any]:
    """The entry ``coding_rules`` of the certificate: one row for each rule, with its category and what holds."""
    counts = Counter(finding.rule for finding in rule_findings)
    rows = []
    for rule in RULES:
        if rule in UNCHECKED:
            rows.append([rule, category(rule), "not checked", ""])
        elif not counts[rule]:
            rows.append([rule, category(rule), "compliant", ""])
        elif rule in DEVIATIONS:
            rows.append([rule, category(rule), f"deviation, {counts[rule]} places", DEVIATIONS[rule]])
        else:
            rows.append([rule, category(rule), f"{counts[rule]} findings", "none is accepted: please report this"])
    unaccepted = sum(number for rule, number in counts.items() if rule not in DEVIATIONS)
    return {
        "summary": f"MISRA C:2012 with Amendment 1, checked with cppcheck in {', '.join(sources)}: "
        f"{unaccepted} findings without a recorded deviation.",
        "unaccepted": unaccepted,
        "headings": ["rule", "category", "state", "reason"],
        "rows": rows,
    }


def checked_with_cppcheck(files: Mapping[str, Contents], jobs: int = 1) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """The certificate's entries about coding rules of emitted ``files``; what was not checked, with the reason."""
    if not is_available():
        return {}, [("coding rules", "cppcheck is not installed")]
    sources = checked_files(files)
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        for path, text in files.items():
            if "/" not in path and path.endswith((".c", ".h")) and isinstance(text, str):
                (directory / path).write_text(text, encoding="utf-8", newline="\n")
        entry = coding_rules_entry(findings(directory, sources, jobs), sources)
    reason = (
        f"has more than {LONGEST_FUNCTION} lines, too many for cppcheck: a test checks what the same printer writes"
    )
    left = [function for path in sources for function in pieces(str(files[path]))[1]]
    return {"coding_rules": entry}, [(f"coding rules of {function.name}", reason) for function in left]
