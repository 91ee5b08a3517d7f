"""Tables as text: columns align, lines fit where words allow, and nothing is lost."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.tables import fold_lines, text_table

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
        "  function          reference           verdict",
        "  inverse_dynamics  independent         pass",
        "                    Newton-Euler",
        "                    recursion over all",
        "                    states",
        "  gravity           -                   FAIL",
    ]


def test_words_are_not_broken_but_names_after_underscores():
    assert text_table([("0.123456789", "inverse_dynamics_derivatives b")], width=34) == [
        "  0.123456789  inverse_dynamics_",
        "               derivatives b",
    ]


def test_nothing_to_show():
    assert text_table([]) == []


cells = st.text(alphabet="ab cd_", max_size=30).map(lambda text: " ".join(text.split()))


@given(st.lists(st.tuples(cells, cells, cells), min_size=1, max_size=5), st.integers(20, 100))
def test_nothing_is_lost_and_lines_fit_where_words_allow(rows, width):
    lines = text_table(rows, width)
    written = Counter("".join(lines).replace(" ", ""))
    first, *others = (Counter("".join(row[k] for row in rows).replace(" ", "")) for k in range(3))
    # the first column stands in each part; a blank line parts them, or is a row that is empty in one of them
    most = lines.count("") + 1
    assert any(written == sum(others, sum([first] * parts, Counter())) for parts in range(1, min(most, 2) + 1))
    longest = [max((len(word) for row in rows for word in row[k].split()), default=0) for k in range(3)]
    natural = [max(len(row[k]) for row in rows) for k in range(3)]
    least = [min(n, max(w, 8)) for n, w in zip(natural, longest, strict=True)]
    assert max(map(len, lines)) <= max(width, least[0] + 4 + max(least[1:]))


LINKS = [
    ("link", "mass", "x", "Ixx", "Iyy"),
    ("1", "3.5 kg", "-0.1099 m (-109.9 mm)", "0.04316", "0.006591"),
    ("2", "12 kg", "0 m (0 mm)", "0.00504", "1"),
]


def test_a_second_unit_is_not_torn_apart_where_there_is_room():
    assert text_table(LINKS, width=46) == [
        "  link  mass    x            Ixx      Iyy",
        "  1     3.5 kg  -0.1099 m    0.04316  0.006591",
        "                (-109.9 mm)",
        "  2     12 kg   0 m (0 mm)   0.00504  1",
    ]


def test_a_table_that_cannot_be_folded_is_printed_in_parts_of_like_width():
    assert text_table(LINKS, width=34) == [
        "  link  mass    x",
        "  1     3.5 kg  -0.1099 m",
        "                (-109.9 mm)",
        "  2     12 kg   0 m (0 mm)",
        "",
        "  link  Ixx      Iyy",
        "  1     0.04316  0.006591",
        "  2     0.00504  1",
    ]


def test_numbers_are_aligned_to_the_right():
    assert text_table([("name", "value"), ("a", "1.25"), ("b", "-10.5")], right=(1,)) == [
        "  name  value",
        "  a      1.25",
        "  b     -10.5",
    ]


def test_colours_have_no_width():
    line = "\x1b[31mFAIL\x1b[0m: the word"
    assert fold_lines(line, 14) == line
    assert fold_lines("  a b c d", 6) == "  a b\n    c\n    d"
