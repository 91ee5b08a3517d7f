"""The documentation builds without a warning, every page is in its contents, and every public name is described."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import rrrgen
from rrrgen.cli.commands import COMMANDS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> Path:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    folder = tmp_path_factory.mktemp("html")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d", str(folder / "trees")]
    done = subprocess.run(
        [*command, "docs", str(folder / "html")], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_every_command_and_public_name_is_described(pages):
    commands = (pages / "commands.html").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert 'id="rrrgen-{}"'.format(name.replace(" ", "-")) in commands, name
    assert "rrrgen check --strict robots/*.yaml" in commands  # examples as they are typed
    python = (pages / "python.html").read_text(encoding="utf-8")
    for name in rrrgen.__all__:
        if not name.startswith("__"):
            assert re.search(rf'id="rrrgen\.(?:base\.errors\.)?{name}"', python), name


def test_every_page_is_in_the_contents(pages):
    contents = (pages / "index.html").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        if page.stem != "index":
            assert f'href="{page.stem}.html"' in contents, page.stem
