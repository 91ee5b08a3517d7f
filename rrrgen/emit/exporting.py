"""Export of a robot: selects the target and returns its files."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from importlib.metadata import entry_points

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.base.yamltext.suggest import did_you_mean
from rrrgen.emit import targets
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions
from rrrgen.robot.robot_spec import RobotSpec

TARGETS = ("cuda", "embedded", "fmu", "jax", "matlab", "mjcf", "open_symoro", "ros2", "urdf", "wheel")
"""Modules of :mod:`rrrgen.emit.targets` that hold an ``EXPORTER``."""


GROUP = "rrrgen.targets"
"""Group of the entry points by which other packages add targets; each names an :class:`Exporter`."""


def exporters() -> dict[str, Exporter]:
    """All export targets by name: those of the modules of :data:`TARGETS`, then those of other installed packages.

    Raises InputError for an entry point that cannot be loaded, is no :class:`Exporter`, or takes the name of another.
    """
    own = [importlib.import_module(f"{targets.__name__}.{name}").EXPORTER for name in TARGETS]
    known = {exporter.name: exporter for exporter in own}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        package = entry.dist.name if entry.dist else "an unknown package"
        where = f"{package}: target '{entry.name}' ({entry.value})"
        try:
            exporter = entry.load()
        except Exception as error:  # whatever a foreign module raises when it is imported
            raise InputError(f"{where} cannot be loaded: {error}") from error
        if not isinstance(exporter, Exporter):
            raise InputError(f"{where} is no rrrgen.emit.targets.interface.Exporter, but {type(exporter).__name__}")
        if exporter.name in known:
            raise InputError(f"{where}: there is a target '{exporter.name}' already")
        known[exporter.name] = exporter
    return known


def export_robot(
    spec: RobotSpec,
    target: str,
    beta: Mapping[str, float] | None = None,
    options: ExportOptions | None = None,
) -> Exported:
    """Export the robot ``spec`` to the format ``target``, such as "urdf"; nothing is written to disk.

    ``beta`` maps names of base parameters to values in SI units; the link inertias of ``spec`` are then replaced by
    ones with these base parameters. Raises :class:`InputError` for an unknown target, platform or base parameter, or an
    option that the target does not use, :class:`rrrgen.base.errors.DerivationError` if the format cannot represent the
    robot.
    """
    known = exporters()
    if target not in known:
        hint = did_you_mean(target, known) or f"targets are {', '.join(known)}"
        raise InputError(f"there is no target '{target}'; {hint}")
    exporter, options = known[target], options or ExportOptions()
    _refuse_words(exporter, options.further)
    if spec.mechanism is not None and not exporter.mechanisms:
        targets_of = ", ".join(name for name, each in known.items() if each.mechanisms)
        raise DerivationError(
            f"{spec.name}: joints that follow others and branches are not exported to {target}, but to {targets_of}"
        )
    _refuse_unused(exporter, options)
    wanted = {*spec.emit, *options.further}
    options = replace(options, further=tuple(word for word in exporter.further if word in wanted))
    notes = tuple(_unheld(exporter, spec))
    if beta is not None or exporter.needs_bodies:
        from rrrgen.derive.parameters.physical_links import with_physical_links

        spec, changed = with_physical_links(spec, beta)
        notes += changed
    found = exporter.write(spec, options)
    return replace(found, notes=(*notes, *found.notes))


def _refuse_unused(exporter: Exporter, options: ExportOptions) -> None:
    """Raise InputError if the user gives an option that ``exporter`` does not use."""
    usual = ExportOptions(further=options.further)
    for field in fields(options):
        if field.name not in exporter.options and getattr(options, field.name) != getattr(usual, field.name):
            takers = [each.name for each in exporters().values() if field.name in each.options]
            option = "--platform" if field.name == "platforms" else f"--{field.name}"
            raise InputError(f"{exporter.name} has no use for {option}; targets that have: {', '.join(takers)}")


def _refuse_words(exporter: Exporter, further: tuple[str, ...]) -> None:
    """Raise InputError for a word of ``--with`` that ``exporter`` cannot hold."""
    for word in further:
        if word not in exporter.further:
            takers = [each.name for each in exporters().values() if word in each.further]
            able = f"targets that can: {', '.join(takers)}" if takers else "'rrrgen generate --with' writes it"
            own = f"; it takes {', '.join(exporter.further)}" if exporter.further else ""
            raise InputError(f"{exporter.name} cannot hold '{word}'{own}; {able}")


def _unheld(exporter: Exporter, spec: RobotSpec) -> Iterator[str]:
    """Yield a note that names the extra code that the robot file asks for but ``exporter`` does not write."""
    left = [word for word in spec.emit if word not in exporter.further]
    if left and exporter.further:
        words = ", ".join(left)
        yield f"the robot file also asks for {words}: not in this package, but in what 'rrrgen generate' writes"
