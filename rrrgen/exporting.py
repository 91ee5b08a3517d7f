"""Export of a robot: selects the target and returns its files."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace

from rrrgen.base import plugins as plugin_groups
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.base.plugins import plugins
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.controller.table import GROUPS as UNIT_GROUPS
from rrrgen.emit import targets
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions
from rrrgen.robot.spec import RobotSpec

TARGETS = ("cuda", "embedded", "fmu", "jax", "matlab", "mjcf", "open_symoro", "ros2", "urdf", "wheel")
"""Modules of :mod:`rrrgen.emit.targets` that hold an ``EXPORTER``."""


def exporters() -> dict[str, Exporter]:
    """All export targets by name: those of the modules of :data:`TARGETS`, then those of other installed packages."""
    return _with_unusable()[0]


def unusable() -> dict[str, str]:
    """What is wrong with the entry points that add no target, a message by the name of each."""
    return _with_unusable()[1]


def exporter_of(target: str) -> Exporter:
    """The exporter named ``target``; raises InputError if there is none, or its entry point is unusable."""
    known, faulty = _with_unusable()
    if target in known:
        return known[target]
    if target in faulty:
        raise InputError(faulty[target])
    hint = did_you_mean(target, known) or f"targets are {', '.join(known)}"
    raise InputError(f"there is no target '{target}'; {hint}")


def _with_unusable() -> tuple[dict[str, Exporter], dict[str, str]]:
    """The targets by name, and messages by name of the entry points that cannot be used.

    Those cannot be loaded, are no :class:`Exporter`, or take the name of another target.
    """
    built_in_exporters = [importlib.import_module(f"{targets.__name__}.{name}").EXPORTER for name in TARGETS]
    known = {exporter.name: exporter for exporter in built_in_exporters}
    faulty: dict[str, str] = {}
    for plugin in plugins(plugin_groups.TARGETS):
        try:
            exporter = plugin.load()
        except InputError as error:
            faulty[plugin.name] = str(error)
            continue
        if not isinstance(exporter, Exporter):
            faulty[plugin.name] = f"{plugin.where} is no {Exporter.__module__}.Exporter, but {type(exporter).__name__}"
        elif exporter.name in known:
            faulty[plugin.name] = f"{plugin.where}: there is a target '{exporter.name}' already"
        else:
            known[exporter.name] = exporter
    return known, faulty


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
    exporter, options = exporter_of(target), options or ExportOptions()
    _refuse_words(exporter, options.further)
    _refuse_mechanism(exporter, spec)
    _refuse_unused(exporter, options)
    wanted = {*spec.emit, *options.further}
    held = exporter.further
    if options.chosen and "controller" not in wanted & {*held}:
        raise InputError("--modes and --parts belong to --with controller")
    if "controller" in wanted and "controller" in held:
        wanted |= set(UNIT_GROUPS)
        held = tuple(dict.fromkeys((*held, *UNIT_GROUPS)))
    options = replace(options, further=tuple(word for word in held if word in wanted))
    notes = tuple(_unheld(exporter, spec))
    if beta is not None or exporter.needs_bodies:
        from rrrgen.derive.parameters.physical_links import with_physical_links

        spec, changed = with_physical_links(spec, beta)
        notes += changed
    if "controller" in options.further:
        from rrrgen.controller.files import unit_code

        options = replace(options, unit=unit_code(spec, options.real, options.further, options.chosen))
    export = exporter.write(spec, options)
    return replace(export, notes=(*notes, *export.notes))


def _refuse_mechanism(exporter: Exporter, spec: RobotSpec) -> None:
    """Raise DerivationError if the rows of the robot form no chain of joints and ``exporter`` takes nothing else."""
    able = {name: candidate.loops if spec.loops else candidate.mechanisms for name, candidate in exporters().items()}
    if spec.mechanism is not None and not (exporter.loops if spec.loops else exporter.mechanisms):
        what = "closed loops" if spec.loops else "joints that follow others and branches"
        others = ", ".join(name for name in able if able[name])
        raise DerivationError(f"{spec.name}: {what} are not exported to {exporter.name}, but to {others}")


def _refuse_unused(exporter: Exporter, options: ExportOptions) -> None:
    """Raise InputError if the user gives an option that ``exporter`` does not use."""
    usual = ExportOptions(further=options.further, chosen=options.chosen)
    for field in fields(options):
        if field.name not in exporter.options and getattr(options, field.name) != getattr(usual, field.name):
            takers = [taker.name for taker in exporters().values() if field.name in taker.options]
            option = "--platform" if field.name == "platforms" else f"--{field.name}"
            raise InputError(f"{exporter.name} has no use for {option}; targets that have: {', '.join(takers)}")


def _refuse_words(exporter: Exporter, further: tuple[str, ...]) -> None:
    """Raise InputError for a word of ``--with`` that ``exporter`` cannot hold."""
    for word in further:
        if word not in exporter.further:
            takers = [taker.name for taker in exporters().values() if word in taker.further]
            able = f"targets that can: {', '.join(takers)}" if takers else "'rrrgen generate --with' writes it"
            hint = f"; it takes {', '.join(exporter.further)}" if exporter.further else ""
            raise InputError(f"{exporter.name} cannot hold '{word}'{hint}; {able}")


def _unheld(exporter: Exporter, spec: RobotSpec) -> Iterator[str]:
    """Yield a note that names the extra code that the robot file asks for but ``exporter`` does not write."""
    left = [word for word in spec.emit if word not in exporter.further]
    if left and exporter.further:
        words = ", ".join(left)
        yield f"the robot file also asks for {words}: not in this package, but in what 'rrrgen generate' writes"
