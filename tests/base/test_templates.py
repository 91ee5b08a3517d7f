"""Templates: found in every installation, explained where they are missing, no undefined names."""

from __future__ import annotations

import pytest

from emit.test_packaging import templates
from rrrgen.base.errors import InternalError
from rrrgen.base.templates import environment, render, template_text


def test_every_template_is_found_in_this_installation():
    for name in templates():
        environment().get_template(name)  # compiles it


def test_an_undefined_name_in_a_template_is_an_error():
    with pytest.raises(Exception, match="undefined"):
        render("c/pkgconfig.pc.j2", prefix="x")


def test_missing_templates_are_explained(tmp_path, monkeypatch):
    package = tmp_path / "rrrgen"
    package.mkdir()
    monkeypatch.setattr("rrrgen.base.templates.resources.files", lambda _: package)
    with pytest.raises(InternalError, match="installation is incomplete"):
        template_text("c/header.h.j2")
