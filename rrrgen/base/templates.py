"""Loading and rendering the text templates of emitted files."""

from __future__ import annotations

import contextlib
import sys
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from rrrgen.base.cache import digest, keep, recall
from rrrgen.base.errors import InternalError, StorageError
from rrrgen.base.version import VERSION

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

    from jinja2 import BytecodeCache, Environment


def template_text(name: str) -> str:
    """The raw text of the template ``name``, e.g. ``"c/header.h.j2"``."""
    return (_templates() / name).read_text(encoding="utf-8")


def _templates() -> Traversable:
    """The folder of the templates: inside the package where it is installed, beside it in a checkout."""
    package = resources.files("rrrgen")
    installed = package / "templates"
    if installed.is_dir():
        return installed
    with resources.as_file(package) as place:
        beside = place.parent / "templates"
    if not beside.is_dir():
        raise InternalError(f"the templates are neither in {place} nor beside it: this installation is incomplete")
    return beside


def templates_digest() -> str:
    """SHA-256 over the names and the bytes of all templates."""
    parts: list[str] = []

    def visit(folder: Traversable, prefix: str) -> None:
        for entry in sorted(folder.iterdir(), key=lambda item: item.name):
            if entry.is_dir():
                visit(entry, f"{prefix}{entry.name}/")
            else:
                parts.extend((f"{prefix}{entry.name}", entry.read_bytes().hex()))

    visit(_templates(), "")
    return digest(*parts)


@cache
def environment() -> Environment:
    """The Jinja environment of all backends: an undefined name is an error, a final line feed is kept."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(
        loader=FunctionLoader(template_text),
        bytecode_cache=_bytecode_cache(),
        undefined=StrictUndefined,
        autoescape=False,  # the output is source code, not HTML
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _bytecode_cache() -> BytecodeCache:
    """A cache of compiled templates, which saves a tenth of the time in which a small robot is derived and emitted."""
    import jinja2

    version = digest(jinja2.__version__, VERSION, sys.version)[:16]

    class Translated(jinja2.BytecodeCache):
        def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
            data = recall(f"{bucket.key}-{version}.template")
            if data is not None:
                bucket.bytecode_from_string(data)

        def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
            # optional: the cache may have been deleted, made read-only, or its disk be full
            with contextlib.suppress(OSError, StorageError):
                keep(f"{bucket.key}-{version}.template", bucket.bytecode_to_string())

    return Translated()


def render(template: str, /, **values: object) -> str:
    """Render the template named ``template`` with the variables ``values``; returns the text."""
    return environment().get_template(template).render(**values)
