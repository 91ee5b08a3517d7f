"""Where the text templates live and how they are loaded; the only place that touches package data of the backends."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from rrrgen.cache import cache_directory
from rrrgen.errors import InternalError

if TYPE_CHECKING:
    from jinja2 import Environment


def template_text(name: str) -> str:
    """The raw text of the template ``name``, e.g. ``"c/header.h.j2"``."""
    root = resources.files("rrrgen") / "templates"
    if not root.is_dir():
        raise InternalError(
            "rrrgen/templates is not a directory; it is a symbolic link to ../templates, and this checkout or "
            "archive lost it (on Windows: git config core.symlinks true, then check out again)"
        )
    return (root / name).read_text(encoding="utf-8")


@cache
def environment() -> Environment:
    """The Jinja environment of every backend: an undefined name is an error, line ends stay as written.

    Templates that were translated once are kept: translating them takes a tenth of the time of a small robot.
    """
    from jinja2 import Environment, FileSystemBytecodeCache, FunctionLoader, StrictUndefined

    translated = cache_directory() / "templates"
    translated.mkdir(mode=0o700, exist_ok=True)
    return Environment(
        loader=FunctionLoader(template_text),
        bytecode_cache=FileSystemBytecodeCache(str(translated)),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # the output is source code, not HTML
    )


def render(template: str, /, **values: object) -> str:
    """The template of that name filled with ``values``."""
    return environment().get_template(template).render(**values)
