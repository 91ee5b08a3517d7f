"""A reader of the pages: follows their steps in the current folder, in this process, so that libraries load once.

Commands run through the entry point of the command line, Python as a script of its own, everything else in the shell.
What a page shows as printed must have been printed.
"""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Callable, Iterable


def follow(steps: Iterable[tuple[str, str]], printed: Callable[[], str] = str) -> None:
    """Follow ``steps``, pairs of a language ("sh", "python" or "text") and its text.

    An exit code other than 0 is an error, and so is a line of "text" that no step before it has printed. ``printed``
    gives what was printed since its last call.
    """
    from rrrgen.cli.main import run

    said = ""
    for language, text in steps:
        if language == "text":
            said += printed()
            compare(text, said)
            continue
        print("[step]", text, flush=True)
        if language == "python":
            exec(compile(text, "page", "exec"), {"__name__": "__main__"})  # our own page
            continue
        for line in text.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            command = ["bash", "-e", "-c", line]
            code = run(words[1:]) if words[:1] == ["rrrgen"] else subprocess.run(command).returncode
            assert code == 0, f"exit code {code}: {line}"


def compare(text: str, said: str) -> None:
    """Raise AssertionError unless every line of ``text`` stands in ``said``; how lines are indented does not count."""
    lines = {line.strip() for line in said.splitlines()}
    missing = [line for line in text.splitlines() if line.strip() and line.strip() not in lines]
    assert not missing, f"the page shows what nothing printed: {missing}"
