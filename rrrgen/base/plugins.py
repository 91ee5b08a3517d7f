"""What other installed packages add: robots and importers, targets, commands, each found by an entry point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ROBOTS, TARGETS, COMMANDS = "rrrgen.robots", "rrrgen.targets", "rrrgen.commands"
"""Groups of entry points: an Importer or the path of a robot file; an Exporter; a click command."""


@dataclass(frozen=True)
class Plugin:
    """An entry point of another package: its ``name``, and ``where`` it comes from, for messages."""

    name: str
    where: str
    entry: EntryPoint

    def load(self) -> Any:
        """Import what the entry point names; InputError with its package if that fails in any way."""
        try:
            return self.entry.load()
        except Exception as error:  # whatever a foreign module raises when it is imported
            raise InputError(f"{self.where} cannot be loaded: {error}") from error


def plugins(group: str) -> Iterator[Plugin]:
    """The entry points of a group, by name."""
    from importlib.metadata import entry_points

    kind = group.rpartition(".")[2].removesuffix("s")
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        package = entry.dist.name if entry.dist else "an unknown package"
        yield Plugin(entry.name, f"{package}: {kind} '{entry.name}' ({entry.value})", entry)
