"""Robot file -> files of another program."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import replace

from rrrgen.errors import InputError
from rrrgen.export import targets
from rrrgen.export.interface import Exported, Exporter
from rrrgen.robotfile.robot_spec import RobotSpec
from rrrgen.yamltext.suggest import did_you_mean


def exporters() -> dict[str, Exporter]:
    """Every target by its name: the modules of the folder ``targets``."""
    names = sorted(module.name for module in pkgutil.iter_modules(targets.__path__))
    found = [importlib.import_module(f"{targets.__name__}.{name}").EXPORTER for name in names]
    return {exporter.name: exporter for exporter in found}


def export_robot(spec: RobotSpec, target: str, beta: Mapping[str, float] | None = None) -> Exported:
    """The files of ``spec`` for ``target``.

    ``beta`` gives values of base parameters by name; links that have them are used in place of those of ``spec``.
    Raises :class:`InputError` for an unknown target or base parameter, :class:`rrrgen.errors.DerivationError` where the
    robot has no counterpart in the format.
    """
    known = exporters()
    if target not in known:
        hint = did_you_mean(target, known) or f"targets are {', '.join(known)}"
        raise InputError(f"there is no target '{target}'; {hint}")
    exporter = known[target]
    notes: tuple[str, ...] = ()
    if beta is not None or exporter.needs_bodies:
        from rrrgen.export.physical_links import with_physical_links

        spec, notes = with_physical_links(spec, beta)
    found = exporter.write(spec)
    return replace(found, notes=(*notes, *found.notes))
