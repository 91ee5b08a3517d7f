"""The version is stated alike everywhere."""

from __future__ import annotations

from emit.test_packaging import ROOT
from rrrgen.base.version import VERSION


def test_the_version_is_stated_alike():
    assert f'version = "{VERSION}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f"## {VERSION} (" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\nversion: {VERSION}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
