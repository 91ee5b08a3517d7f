"""The robots that come with rrrgen, and those that other packages add by entry points."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rrrgen.base.errors import InputError
from rrrgen.base.plugins import ROBOTS, plugins

_FOLDER = Path(__file__).parent


@cache
def bundled_names() -> tuple[str, ...]:
    """Names of the bundled robots, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def installed_path(name: str) -> Path | None:
    """The path of the robot file that another installed package adds under this name; None if none does.

    Its entry point names a path or text. Raises InputError if it cannot be loaded.
    """
    for plugin in plugins(ROBOTS):
        if plugin.name == name:
            place = plugin.load()
            if isinstance(place, str | Path):
                return Path(place)
    return None


def bundled_path(name: str) -> Path:
    """The path of the bundled robot ``name``. Raises :class:`InputError` for any other name."""
    if name not in bundled_names():
        raise InputError(f"no bundled robot '{name[:40]}'; there are {', '.join(bundled_names())}")
    return _FOLDER / f"{name}.yaml"
