"""Tables of text as recordings: separators, headers, decimals, and faults at their place."""

import numpy as np
import pytest

from lab.data.three_joints import PERIOD, PLAIN, TAU, TEXT, N, Q, mapped, read, write_csv
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
