"""Tables of text as recordings: separators, headers, decimals, and faults at their place."""

import numpy as np
import pytest

from lab.data.three_joints import PERIOD, PLAIN, TAU, TEXT, N, Q, mapped, read, table, write_csv
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import loads_mapping


@pytest.mark.parametrize(
    ("separator", "decimal", "header", "before"),
    [
        (",", ".", "t,q1,q2,tau1,tau2", ""),
        (";", ",", "t,q1,q2,tau1,tau2", ""),
        ("\t", ",", "t,q1,q2,tau1,tau2", "# a comment of the logger"),
        (" ", ".", "t,q1,q2,tau1,tau2", ""),
        ("|", ".", "t,q1,q2,tau1,tau2\ns,rad,rad,Nm,Nm", ""),
        (";", ".", "\ufefft,q1,q2,tau1,tau2", ""),
    ],
)
def test_text_tables_are_read_whatever_their_separators(tmp_path, separator, decimal, header, before):
    write_csv(tmp_path / "log.csv", separator, decimal, header, before)
    log = read(mapped(tmp_path, "log.csv"))
    np.testing.assert_allclose(log.q, Q, atol=TEXT)
    np.testing.assert_allclose(log.tau, TAU, atol=TEXT)
    assert log.findings == ()
    assert log.period == pytest.approx(PERIOD, rel=1e-6)


def test_a_table_without_header_is_addressed_by_numbers(tmp_path):
    write_csv(tmp_path / "log.csv", ";", ",", header="")
    mapping = loads_mapping(
        PLAIN.format(file="log.csv", q1=2, q2=3, tau1=4, tau2=5).replace("column: t,", "column: 1,"),
        str(tmp_path / "log.yaml"),
    )
    np.testing.assert_allclose(read(mapping).q, Q, atol=TEXT)


def test_decimal_comma_with_comma_separator_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text("t,q1\n0,0,1,5\n0,1,1,6\n")
    with pytest.raises(InputError):
        read(mapped(tmp_path, "log.csv"))


def rewrite(path, change, first=1):
    """Apply ``change(number, line)`` to the lines of a text file, counted from 1, from line ``first`` on."""
    lines = path.read_text().splitlines()
    changed = [change(k, line) if k >= first else line for k, line in enumerate(lines, 1)]
    path.write_text("\n".join(changed) + "\n")


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("quote", ['"', ""])
def test_row_names_in_front_are_refused_as_the_names_would_be_shifted(tmp_path, separator, quote):
    write_csv(tmp_path / "log.csv", separator)
    rewrite(tmp_path / "log.csv", lambda k, line: f"{quote}{k - 1}{quote}{separator}{line}", first=2)
    with pytest.raises(InputError, match="6 entries, where the header has 5 names") as caught:
        read(mapped(tmp_path, "log.csv"))
    (fault,) = caught.value.faults
    assert (fault.file, fault.line, fault.column) == (str(tmp_path / "log.csv"), 2, 1)
    assert "row names" in fault.hint
    assert ("decimal commas" in fault.hint) == (separator == ",")


@pytest.mark.parametrize("standstill", [0, 150])  # rows of whole numbers, which have no decimal comma
def test_decimal_commas_between_commas_are_refused_where_they_begin(tmp_path, standstill):
    rows = table()
    rows[:standstill] = np.round(rows[:standstill])
    rows[:standstill, 0] = np.arange(standstill) - 10 * standstill
    write_csv(tmp_path / "log.csv", rows=rows)
    text = (tmp_path / "log.csv").read_text().replace(".0000000000", "").replace(".", ",")
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(InputError, match="entries, where the header has 5 names") as caught:
        read(mapped(tmp_path, "log.csv"), chunk=100)
    (fault,) = caught.value.faults
    wider = next(k for k, line in enumerate(text.splitlines(), 1) if line.count(",") > 4)
    assert fault.line == wider > standstill
    assert "decimal commas" in fault.hint


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
def test_a_separator_at_the_end_of_rows_makes_no_column(tmp_path, separator):
    write_csv(tmp_path / "log.csv", separator)
    rewrite(tmp_path / "log.csv", lambda _, line: line + separator, first=2)
    np.testing.assert_allclose(read(mapped(tmp_path, "log.csv")).tau, TAU, atol=TEXT)


@pytest.mark.parametrize("in_front", [True, False])
def test_separators_in_quotes_separate_nothing(tmp_path, in_front):
    names = "t,q1,q2,tau1,tau2"
    write_csv(tmp_path / "log.csv", header=f"state,{names}" if in_front else f"{names},state")

    def with_state(number, line):
        state = '"ready"' if number % 9 == 0 else '"ready,enabled"'
        return f"{state},{line}" if in_front else f"{line},{state}"

    rewrite(tmp_path / "log.csv", with_state, first=2)
    log = read(mapped(tmp_path, "{path: log.csv, header: 1}"), chunk=100)
    np.testing.assert_allclose(log.q, Q, atol=TEXT)
    np.testing.assert_allclose(log.tau, TAU, atol=TEXT)


def test_a_word_among_the_numbers_is_located(tmp_path):
    write_csv(tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[200] = lines[200].replace(lines[200].split(",")[3], "overrun")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(InputError) as caught:
        read(mapped(tmp_path, "log.csv"))
    (fault,) = caught.value.faults
    assert (fault.line, fault.column) == (201, lines[200].index("overrun") + 1)


def test_a_line_that_breaks_off_is_located(tmp_path):
    write_csv(tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text().rstrip()
    (tmp_path / "log.csv").write_text(text[:-20])
    with pytest.raises(InputError) as caught:
        read(mapped(tmp_path, "log.csv"))
    assert caught.value.faults[0].line == N + 1
