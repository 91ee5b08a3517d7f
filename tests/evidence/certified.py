"""A certified folder and the command that checks it."""

from __future__ import annotations

import json

from click.testing import CliRunner

from rrrgen.cli.certify import certify
from rrrgen.evidence.certificate import CERTIFICATE


def run(*arguments):
    done = CliRunner().invoke(certify, [str(argument) for argument in arguments], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


def content_of(folder):
    return json.loads((folder / CERTIFICATE).read_text(encoding="utf-8"))
