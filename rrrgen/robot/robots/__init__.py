"""The robots that come with rrrgen."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rrrgen.base.errors import InputError

_FOLDER = Path(__file__).parent


@cache
def bundled_names() -> tuple[str, ...]:
    """Names of the bundled robots, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def bundled_path(name: str) -> Path:
    """The path of the bundled robot ``name``. Raises :class:`InputError` for any other name."""
    if name not in bundled_names():
        raise InputError(f"no bundled robot '{name[:40]}'; there are {', '.join(bundled_names())}")
    return _FOLDER / f"{name}.yaml"
