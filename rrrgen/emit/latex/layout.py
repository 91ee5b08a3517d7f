"""The layout of closed forms as equations of readable size, before any markup.

A matrix whose entries are all short is shown as a matrix. Otherwise every entry becomes an equation; zeros and the
lower triangle of a symmetric matrix are left out, and a remark says so. Long quantities are written with common
subexpressions.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import sympy as sp

from rrrgen.derive.closed_forms.shared_form import LETTER, SharedForm
from rrrgen.emit.latex.notation import Quantity, quantity

ENTRY_LIMIT = 12  # largest number of operations of an entry in a quantity shown as a matrix
COLUMNS_LIMIT = 6  # largest number of columns of such a matrix
CSE_LIMIT = 400  # operations of a quantity beyond which common subexpressions get names


@dataclass(frozen=True)
class Equation:
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
    quantity: Quantity
    shape: tuple[int, int]
    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    equations: tuple[Equation, ...]
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
        definitions, entries = _shared(entries)
    matrix = sp.Matrix(*matrix.shape, entries)
    function, place = _place(name)
    about = quantity(function)
    if place or not isinstance(value, sp.MatrixBase):
        return Display(name, about, (1, 1), definitions, (Equation(about.letter, place, entries[0]),), ())
    short = max((int(sp.count_ops(entry)) for entry in entries), default=0) <= ENTRY_LIMIT
    if short and matrix.cols <= COLUMNS_LIMIT:
        return Display(name, about, matrix.shape, definitions, (Equation(about.letter, (), matrix),), ())
    equations, remarks = _entrywise(about.letter, matrix)
    return Display(name, about, matrix.shape, definitions, equations, remarks)


def _place(name: str) -> tuple[str, tuple[int, ...]]:
    """Split a name such as ``mass_matrix[1,2]`` into the function and the indices (1, 2)."""
    match = re.fullmatch(r"([\w.]+)\[(\d+(?:,\d+)*)\]", name)
    return (match[1], tuple(int(index) for index in match[2].split(","))) if match else (name, ())


def _shared(entries: list[sp.Expr]) -> tuple[tuple[tuple[sp.Symbol, sp.Expr], ...], list[sp.Expr]]:
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


def _entrywise(letter: str, matrix: sp.MatrixBase) -> tuple[tuple[Equation, ...], tuple[str, ...]]:
    symmetric = matrix.rows > 1 and matrix.rows == matrix.cols and matrix == matrix.T
    equations, zeros = [], 0
    for r in range(matrix.rows):
        for c in range(r if symmetric else 0, matrix.cols):
            if matrix[r, c] == 0:
                zeros += 1
                continue
            indices = (r + 1,) if matrix.cols == 1 else (r + 1, c + 1)
            equations.append(Equation(letter, indices, matrix[r, c]))
    remarks = ["The matrix is symmetric; the upper triangle is written."] if symmetric else []
    remarks += ["Entries that are not written are zero."] if zeros else []
    return tuple(equations), tuple(remarks)
