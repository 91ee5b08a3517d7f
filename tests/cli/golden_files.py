"""Commands run in this process, and texts that are kept."""

from __future__ import annotations

import os
from pathlib import Path

GOLDEN = Path(__file__).parent / "golden"
UPDATE = "RRRGEN_UPDATE_GOLDEN"  # set to 1 to write what is printed today, then look at the diff


def golden(name: str, text: str) -> None:
    file = GOLDEN / name
    if os.environ.get(UPDATE):
        file.write_text(text, encoding="utf-8", newline="\n")
    assert text == file.read_text(encoding="utf-8"), f"if this is right: {UPDATE}=1 pytest {Path(__file__).name}"
