"""Adaptation of the kernels, C files with placeholder names that also compile alone, to one robot."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rrrgen.base.errors import InternalError
from rrrgen.base.templates import template_text
from rrrgen.emit.c.dialect import Dialect

_TOKEN = re.compile(
    r"""/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|\.?\d(?:[eE][+-]|[\w.])*|(?P<name>[A-Za-z_]\w*)""",
    re.DOTALL,
)
_GAP = "\0"  # marks a replacement text next to which a space may be removed
_DIRECTIVE = re.compile(r"#\s*(if|elif|else|endif)\b\s*(.*)")
_INCLUDE = re.compile(r'^#include "\w+\.h"\n', re.MULTILINE)


@dataclass(frozen=True)
class Settings:
    """The adaptation of a kernel's C text to one robot: the parts that are kept, and the replacements of names.

    ``options`` are the values of the names that ``#if`` tests. ``words`` maps whole names to the text that replaces
    them, in which nothing is replaced again; ``prefixes`` maps beginnings of names. Where a name is replaced by empty
    text, one space beside it is removed too, and before text that begins with a comma the space in front, so that
    optional arguments leave no gap.
    """

    options: Mapping[str, bool]
    words: Mapping[str, str]
    prefixes: Mapping[str, str]


class KernelDialect(Dialect):
    """The dialect of kernel files, with placeholder names such as REAL and SQRT that :func:`specialize` replaces."""

    @property
    def real_type(self) -> str:
        """The placeholder for the floating-point type, REAL."""
        return "REAL"

    def function(self, name: str) -> str:
        """The placeholder for a function of math.h: its name in capitals, such as SQRT."""
        return name.upper()


def kernel(name: str, settings: Settings) -> str:
    """The text of the kernel ``templates/c/<name>`` adapted to one robot, without the lines up to its #include."""
    text = template_text(f"c/{name}")
    include = _INCLUDE.search(text)
    if include is None:
        raise InternalError(f"the kernel {name} does not include its settings")
    return specialize(text[include.end() :], settings)


def specialize(text: str, settings: Settings) -> str:
    """Adapt ``text`` to one robot: #if lines of known options are resolved, names and prefixes replaced."""
    replaced = _TOKEN.sub(lambda token: _replaced(token, settings), "".join(_settled(text, settings.options)))
    return re.sub(f" {_GAP}|{_GAP} ?", "", replaced)


def _replaced(token: re.Match[str], settings: Settings) -> str:
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


def _settled(text: str, options: Mapping[str, bool]) -> Iterator[str]:
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
