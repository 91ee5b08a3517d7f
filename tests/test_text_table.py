"""Tables as text: columns align, lines fit where words allow, and nothing is lost."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from rrrgen.text_table import text_table

ROWS = [
    ("function", "reference", "verdict"),
    ("inverse_dynamics", "independent Newton-Euler recursion over all states", "pass"),
    ("gravity", "-", "FAIL"),
]


def test_columns_align():
    assert text_table(ROWS, indent="") == [
        "function          reference                                           verdict",
        "inverse_dynamics  independent Newton-Euler recursion over all states  pass",
        "gravity           -                                                   FAIL",
    ]


def test_the_widest_column_is_folded():
    assert text_table(ROWS, width=50) == [
        "  function          reference              verdict",
        "  inverse_dynamics  independent            pass",
        "                    Newton-Euler",
        "                    recursion over all",
        "                    states",
        "  gravity           -                      FAIL",
    ]


def test_words_are_not_broken():
    assert text_table([("inverse_dynamics_derivatives", "a b c d e f")], width=10) == [
        "  inverse_dynamics_derivatives  a b c d",
        "                                e f",
    ]


def test_nothing_to_show():
    assert text_table([]) == []


cells = st.text(alphabet="ab cd_", max_size=30).map(lambda text: " ".join(text.split()))


@given(st.lists(st.tuples(cells, cells, cells), min_size=1, max_size=5), st.integers(20, 100))
def test_nothing_is_lost_and_lines_fit_where_words_allow(rows, width):
    lines = text_table(rows, width)
    written = sorted(word for line in lines for word in line.split())
    assert written == sorted(word for row in rows for cell in row for word in cell.split())
    longest = [max((len(word) for row in rows for word in row[k].split()), default=0) for k in range(3)]
    natural = [max(len(row[k]) for row in rows) for k in range(3)]
    least = sum(min(n, max(w, 8)) for n, w in zip(natural, longest, strict=True)) + 6
    assert max(map(len, lines)) <= max(width, least)
