"""The command line: commands that call the package, imported when they run. Only this room prints text or exits."""

from __future__ import annotations

from rrrgen.cli.main import main

__all__ = ["main"]
