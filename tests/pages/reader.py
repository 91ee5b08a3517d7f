"""A reader of the pages: follows their steps in the current folder, in this process, so that libraries load once.

Commands run through the entry point of the command line, Python as a script of its own, everything else in the shell.
"""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Iterable


def follow(steps: Iterable[tuple[str, str]]) -> None:
    """Follow ``steps``, pairs of a language ("sh" or "python") and its text; an exit code other than 0 is an error."""
    from rrrgen.cli.main import run

    for language, text in steps:
        print("[step]", text, flush=True)
        if language == "python":
            exec(compile(text, "page", "exec"), {"__name__": "__main__"})  # our own page
            continue
        for line in text.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            command = ["bash", "-e", "-c", line]
            code = run(words[1:]) if words[:1] == ["rrrgen"] else subprocess.run(command).returncode
            assert code == 0, f"exit code {code}: {line}"
