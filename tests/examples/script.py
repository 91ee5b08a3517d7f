"""The scripts of the examples, run in the process of the tests: each import is then paid once."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def script(name: str) -> ModuleType:
    """The module of ``examples/<name>/run.py``."""
    found = importlib.util.spec_from_file_location(f"{name}_example", EXAMPLES / name / "run.py")
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def exit_code(name: str, *arguments: object) -> int:
    """The exit status of the script with these arguments."""
    with patch.object(sys, "argv", ["run.py", *map(str, arguments)]):
        return int(script(name).main())
