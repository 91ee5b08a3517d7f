"""Equations of a function: small matrices stay matrices, large entries and common subexpressions become equations."""

from __future__ import annotations

import pytest
import sympy as sp

from emit.formula_reading import compute, read_plain
from emit.transcribed import TRANSCRIBED, VALUES, S, value_of
from rrrgen.emit.latex.equations import latex, plain


def test_small_matrix_stays_a_matrix_and_large_entries_become_equations() -> None:
    q2, p3, p12 = S["q2"], S["p3"], S["p12"]
    small = sp.Matrix([[p12, p3 * sp.cos(q2)], [p3 * sp.cos(q2), 0]])
    assert r"\begin{bmatrix}" in latex({"mass_matrix": small})
    left = [line.split(" = ")[0].strip() for line in plain({"mass_matrix": small}).splitlines() if " = " in line]
    assert left == ["M[1,1]", "M[1,2]", "M[2,1]", "M[2,2]"]
    long = sum((p3**k * sp.cos(k * q2) for k in range(1, 15)), sp.S.Zero)
    text = plain({"mass_matrix": sp.Matrix([[long, p3], [p3, 0]])})
    assert "symmetric" in text
    assert "M[1,2] = p3" in text
    assert "M[2,1]" not in text
    assert max(map(len, text.splitlines())) <= 120


def test_common_subexpressions_keep_the_meaning() -> None:
    """Definitions and equations together compute the entries, and no angle is taken apart."""
    q2, q3, p3, p12 = S["q2"], S["q3"], S["p3"], S["p12"]
    shared = (p3 + p12 * sp.cos(q2 + q3)) ** 2
    entries = sp.Matrix([shared * sp.sin(2 * q2 + q3) + p3, shared + sp.sin(2 * q2)])
    values = dict(VALUES)
    for line in plain({"coriolis": entries}, cse_limit=1).splitlines()[1:]:
        if " = " in line:
            left, right = line.strip().split(" = ")
            values[left] = compute(read_plain(right), values)
    assert any(name.startswith("t") and name != "tau1" for name in values)
    for k in range(2):
        assert values[f"c[{k + 1}]"] == pytest.approx(value_of(entries[k]), rel=TRANSCRIBED)


def test_single_entry_carries_its_indices() -> None:
    assert plain({"mass_matrix[3,3]": S["p12"]}).splitlines()[1].strip() == "M[3,3] = p12"
