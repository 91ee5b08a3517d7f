"""The command line: thin, lazy, and the only place that prints or exits."""

from __future__ import annotations

from rrrgen.cli.main import main

__all__ = ["main"]
