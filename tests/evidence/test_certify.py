"""The command certify: options that contradict, folders without a certificate."""

from __future__ import annotations

import click
import pytest

from evidence.certified import run
from rrrgen.base.errors import InputError
from rrrgen.evidence.certificate import CERTIFICATE


@pytest.mark.parametrize(
    "arguments", [(), ("pendulum",), ("--again",), ("pendulum", "-o", "x", "--check", ".")], ids=str
)
def test_contradictory_options_are_refused(arguments):
    with pytest.raises(click.UsageError):
        run(*arguments)


def test_a_folder_without_certificate_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=CERTIFICATE):
        run("--check", tmp_path)
