"""The page of every key is that of the tables the reader uses."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from rrrgen.cli.main import cli
from rrrgen.robot.file.fields import SECTIONS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "robot-file.md"


def test_the_page_is_current():
    printed = CliRunner().invoke(cli, ["schema", "--markdown"]).output
    assert PAGE.read_text(encoding="utf-8") == printed, "rrrgen schema --markdown > docs/robot-file.md"


def test_every_key_and_every_link_of_the_page():
    page = PAGE.read_text(encoding="utf-8")
    for table in SECTIONS.values():
        assert all(f"`{key.name}`" in page for key in table)
    headings = {line[3:].lower() for line in page.splitlines() if line.startswith("## ")}
    anchors = {"".join(x for x in h if x.isalnum() or x in " _-").replace(" ", "-") for h in headings}
    assert {part.split(")")[0] for part in page.split("](#")[1:]} <= anchors
