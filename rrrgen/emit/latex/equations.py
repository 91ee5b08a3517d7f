"""Printing of closed forms as a LaTeX fragment or as plain text."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import sympy as sp

from rrrgen.derive.closed_forms import LETTER, SharedForm
from rrrgen.emit.latex.formulas import (
    LatexMarkup,
    Notation,
    QuantityNotation,
    TextMarkup,
    Walk,
    join_terms,
    notation,
    quantity,
)

if TYPE_CHECKING:
    from rrrgen.derive.parameters.listing import ParameterListing


# ------------------------------------------------------------------------------------------------------------------
# The layout of closed forms as equations of readable size, before any markup.
#
# A matrix whose entries are all short is shown as a matrix. Otherwise every entry becomes an equation; zeros and the
# lower triangle of a symmetric matrix are left out, and a remark says so. Long quantities are written with common
# subexpressions.
# ------------------------------------------------------------------------------------------------------------------

ENTRY_LIMIT = 12  # largest number of operations of an entry in a quantity shown as a matrix
COLUMNS_LIMIT = 6  # largest number of columns of such a matrix
CSE_LIMIT = 400  # operations of a quantity beyond which common subexpressions get names


@dataclass(frozen=True)
class PrintedEquation:
    """One printed equation, ``letter[indices] = value``; without indices the value may be a matrix."""

    letter: str
    indices: tuple[int, ...]
    value: sp.Expr | sp.MatrixBase


@dataclass(frozen=True)
class Display:
    """The printed form of one quantity: common subexpressions, then equations, then remarks on what was left out.

    ``name`` is that of the model function or entry, ``shape`` the size of the matrix (rows, columns).
    """

    name: str
    quantity: QuantityNotation
    shape: tuple[int, int]
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    equations: tuple[PrintedEquation, ...]
    remarks: tuple[str, ...]


Form: TypeAlias = sp.Expr | sp.MatrixBase | SharedForm
"""A formula to be printed: one entry, a matrix, or a matrix with named intermediate results."""


def lay_out(closed_forms: Mapping[str, Form], cse_limit: int = CSE_LIMIT) -> list[Display]:
    """Arrange closed forms as displays, one per quantity, in the order given.

    Keys are names of functions, or of single entries as in ``mass_matrix[1,2]``. Quantities of more than ``cse_limit``
    operations are written with common subexpressions.
    """
    return [_display(name, value, cse_limit) for name, value in closed_forms.items()]


def _display(name: str, value: Form, cse_limit: int) -> Display:
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...] = ()
    if isinstance(value, SharedForm):
        definitions, value = value.definitions, value.matrix
    matrix = value if isinstance(value, sp.MatrixBase) else sp.Matrix([value])
    entries = list(matrix)
    if not definitions and sum(int(sp.count_ops(entry)) for entry in entries) > cse_limit:
        definitions, entries = _extract_common(entries)
    matrix = sp.Matrix(*matrix.shape, entries)
    function, place = _place(name)
    about = quantity(function)
    if place or not isinstance(value, sp.MatrixBase):
        return Display(name, about, (1, 1), definitions, (PrintedEquation(about.letter, place, entries[0]),), ())
    short = max((int(sp.count_ops(entry)) for entry in entries), default=0) <= ENTRY_LIMIT
    if short and matrix.cols <= COLUMNS_LIMIT:
        return Display(name, about, matrix.shape, definitions, (PrintedEquation(about.letter, (), matrix),), ())
    equations, remarks = _entrywise(about.letter, matrix)
    return Display(name, about, matrix.shape, definitions, equations, remarks)


def _place(name: str) -> tuple[str, tuple[int, ...]]:
    """Split a name such as ``mass_matrix[1,2]`` into the function and the indices (1, 2)."""
    match = re.fullmatch(r"([\w.]+)\[(\d+(?:,\d+)*)\]", name)
    return (match[1], tuple(int(index) for index in match[2].split(","))) if match else (name, ())


def _extract_common(entries: list[sp.Expr]) -> tuple[tuple[tuple[sp.Symbol, sp.Expr], ...], list[sp.Expr]]:
    """Extract common subexpressions of ``entries``: (definitions, entries written with them).

    Sines and cosines stay whole, so that sums of angles remain readable.
    """
    waves = sorted(set().union(*(entry.atoms(sp.sin, sp.cos) for entry in entries)), key=sp.default_sort_key)
    masks = {wave: sp.Symbol(f"wave{k:04d}", real=True) for k, wave in enumerate(waves)}
    back = {mask: wave for wave, mask in masks.items()}
    taken = {str(symbol) for entry in entries for symbol in entry.free_symbols}
    names = (symbol for symbol in sp.numbered_symbols(LETTER, start=1, real=True) if str(symbol) not in taken)
    shared, reduced = sp.cse([entry.xreplace(masks) for entry in entries], symbols=names, order="canonical")
    return tuple((s, value.xreplace(back)) for s, value in shared), [entry.xreplace(back) for entry in reduced]


def trig_abbreviates(closed_forms: Mapping[str, Form]) -> bool:
    """Whether c2, s23, ... abbreviate cosines and sines: the formulas hold some, and no symbol has such a name."""
    names = {str(symbol) for value in closed_forms.values() for symbol in value.free_symbols}
    taken = any(re.fullmatch(r"[cs]_?[1-9]+", name) for name in names)
    return not taken and any(part.has(sp.sin, sp.cos) for value in closed_forms.values() for part in _parts(value))


def _parts(form: Form) -> list[sp.Basic]:
    return [form.matrix, *(value for _, value in form.definitions)] if isinstance(form, SharedForm) else [form]


def _entrywise(letter: str, matrix: sp.MatrixBase) -> tuple[tuple[PrintedEquation, ...], tuple[str, ...]]:
    symmetric = matrix.rows > 1 and matrix.rows == matrix.cols and matrix == matrix.T
    equations, zeros = [], 0
    for r in range(matrix.rows):
        for c in range(r if symmetric else 0, matrix.cols):
            if matrix[r, c] == 0:
                zeros += 1
                continue
            indices = (r + 1,) if matrix.cols == 1 else (r + 1, c + 1)
            equations.append(PrintedEquation(letter, indices, matrix[r, c]))
    remarks = ["The matrix is symmetric; the upper triangle is written."] if symmetric else []
    remarks += ["Entries that are not written are zero."] if zeros else []
    return tuple(equations), tuple(remarks)


# ------------------------------------------------------------------------------------------------------------------
# Printing of closed forms as a LaTeX fragment or as plain text
# ------------------------------------------------------------------------------------------------------------------

LINE = 96  # plain characters on one line of a broken sum
_ABBREVIATION = r"% c_{ij} = \cos(q_i + q_j), s_{ij} = \sin(q_i + q_j)"


def latex(closed_forms: Mapping[str, Form], short_trig: bool = True, cse_limit: int = CSE_LIMIT) -> str:
    r"""A LaTeX fragment (amsmath) with one display per quantity.

    ``closed_forms`` maps names of model functions to exact expressions or matrices in q1, dq1, ddq1, ..., the base
    parameters and the named parameters. ``short_trig`` writes c_{23} for cos(q2 + q3), unless a symbol has such a name.
    Quantities of more than ``cse_limit`` operations are written through common subexpressions t_1, t_2, ... Raises
    :class:`rrrgen.base.errors.BackendError` for a mathematical function that cannot occur in a closed form.
    """
    walk = Walk(LatexMarkup(), short_trig and trig_abbreviates(closed_forms))
    parts = [_ABBREVIATION] if walk.short_trig else []
    for display in lay_out(closed_forms, cse_limit):
        parts.append(f"% {display.name}: {display.quantity.meaning}")
        lines = [line for symbol, value in display.definitions for line in _latex_lines(walk, str(symbol), value)]
        for equation in display.equations:
            lines += _latex_equation(walk, display.quantity, equation)
        parts.append("\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}")
        parts += [f"% {remark}" for remark in display.remarks]
    return "\n".join(parts) + "\n"


def latex_base_parameters(parameters: ParameterListing) -> str:
    """Print the definitions of the base parameters as a LaTeX fragment; a comment states the convention of symbols."""
    walk = Walk(LatexMarkup(), short_trig=False)
    said = textwrap.wrap(f"Base parameters. {parameters.statement}", LINE, break_on_hyphens=False)
    lines = [line for p in parameters.rows for line in _latex_lines(walk, p.name, p.expression)]
    display = "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"
    return "\n".join([*(f"% {line}" for line in said), display]) + "\n"


def _latex_lines(walk: Walk, symbol: str, value: sp.Expr) -> list[str]:
    return _align_terms(walk, walk.markup.symbol(notation(symbol)), value)


def _latex_equation(walk: Walk, about: QuantityNotation, equation: PrintedEquation) -> list[str]:
    left = _latex_left(walk, about, equation)
    if not isinstance(equation.value, sp.MatrixBase):
        return _align_terms(walk, left, equation.value)
    rows = [" & ".join(walk.write(entry) for entry in equation.value.row(r)) for r in range(equation.value.rows)]
    return [left + " &= \\begin{bmatrix}\n  " + " \\\\\n  ".join(rows) + "\n\\end{bmatrix}"]


def _latex_left(walk: Walk, about: QuantityNotation, equation: PrintedEquation) -> str:
    parts = notation(equation.letter)  # bold, which also keeps the vector c apart from the cosines c_1, c_2
    letter = rf"\boldsymbol{{{walk.markup.symbol(Notation(parts.base))}}}"
    if parts.subscript:
        letter += f"_{{{','.join(parts.subscript)}}}"
    if equation.indices:
        return f"{letter}_{{{','.join(map(str, equation.indices))}}}"
    arguments = {"q": "q", "dq": r"\dot{q}", "ddq": r"\ddot{q}"}
    return f"{letter}({', '.join(arguments[a] for a in about.arguments)})" if about.arguments else letter


def _align_terms(walk: Walk, left: str, value: sp.Expr) -> list[str]:
    first, *others = break_sum(value, walk)
    lines = [f"{left} &= {join_terms(first)}"]
    return lines + [rf"&\quad {'-' if row[0][0] else '+'} {_after_sign(row)}" for row in others]


def _after_sign(row: Sequence[tuple[bool, str]]) -> str:
    return join_terms([(False, row[0][1]), *row[1:]])


def break_sum(value: sp.Expr, walk: Walk, width: int = LINE) -> list[list[tuple[bool, str]]]:
    """The terms of a sum in ``walk``'s markup, in rows of at most ``width`` plain characters where terms allow it.

    A term that is too long for a row is multiplied out, one factor at a time.
    """
    counter = Walk(TextMarkup(), walk.short_trig)
    rows: list[list[tuple[bool, str]]] = [[]]
    used = 0
    for term in _pieces(value, counter, width):
        size = len(counter.write(term))
        if rows[-1] and used + size > width:
            rows.append([])
            used = 0
        rows[-1] += walk.terms(term)
        used += size + 3
    return rows


def _pieces(value: sp.Expr, counter: Walk, width: int) -> list[sp.Expr]:
    pieces: list[sp.Expr] = []
    number, rest = value.as_coeff_Mul()
    if rest.is_Add:  # no parentheses around a whole right-hand side
        value = sp.Add(*(number * term for term in rest.args))
    for term in counter.sort_terms(value):
        sums = [factor for factor in term.args if factor.is_Add] if term.is_Mul else []
        if sums and len(counter.write(term)) > width:
            longest = max(sums, key=lambda factor: len(factor.args))
            rest = term / longest
            pieces += _pieces(sp.Add(*(rest * part for part in longest.args)), counter, width)
        else:
            pieces.append(term)
    return pieces


def plain(closed_forms: Mapping[str, Form], short_trig: bool = True, cse_limit: int = CSE_LIMIT) -> str:
    """Print closed forms as plain text, entry by entry; ``short_trig`` writes c23 for cos(q2 + q3).

    Quantities of more than ``cse_limit`` operations are written with common subexpressions.
    """
    walk = Walk(TextMarkup(), short_trig and trig_abbreviates(closed_forms))
    lines: list[str] = []
    for display in lay_out(closed_forms, cse_limit):
        size = "x".join(map(str, display.shape))
        lines += [f"{display.name} ({size}): {display.quantity.meaning}"]
        for symbol, value in display.definitions:
            lines += _plain_lines(walk, str(symbol), value)
        for equation in display.equations:
            lines += _plain_equation(walk, display, equation)
        lines += [f"  ({remark})" for remark in display.remarks] + [""]
    return "\n".join(lines)


def _plain_equation(walk: Walk, display: Display, equation: PrintedEquation) -> list[str]:
    if not isinstance(equation.value, sp.MatrixBase):
        return _plain_lines(walk, equation.letter + _indices(equation.indices), equation.value)
    lines = []
    for r in range(equation.value.rows):
        for c in range(equation.value.cols):
            indices = (r + 1,) if equation.value.cols == 1 else (r + 1, c + 1)
            lines += _plain_lines(walk, equation.letter + _indices(indices), equation.value[r, c])
    return lines


def _indices(indices: tuple[int, ...]) -> str:
    return f"[{','.join(map(str, indices))}]" if indices else ""


def _plain_lines(walk: Walk, left: str, value: sp.Expr) -> list[str]:
    first, *others = break_sum(value, walk)
    indent = " " * (len(left) + 3)
    lines = [f"  {left} = {join_terms(first)}"]
    return lines + [f"  {indent}{'-' if row[0][0] else '+'} {_after_sign(row)}" for row in others]
