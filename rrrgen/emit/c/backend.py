"""The C backend: header, sources and self-test of a robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rrrgen.emit import Real
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.path_timing.files import timing_files
from rrrgen.emit.c.sources import header_and_sources
from rrrgen.emit.c.trigonometry import Trig, sincos_strategy
from rrrgen.emit.interface import Check
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

Files = dict[str, str]


def _nothing() -> tuple[Files, Sequence[Check]]:
    return {}, ()


@dataclass(frozen=True)
class CBackend:
    """Prints header, sources and self-test; ``trig`` is the source of sines and cosines.

    ``beside`` is a function that returns further C files of the robot, and checks of these for the self-test. It is
    called in the process that prints the self-test, since both need NumPy.
    """

    trig: Trig = "inline"
    beside: Callable[[], tuple[Files, Sequence[Check]]] = _nothing

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        """Print all files: ``<name>.h``, ``<name>.c`` with further sources, and ``<name>_selftest.c``."""
        return self.assemble(model, identity, [task() for task in self.tasks(model, identity, real)])

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> list[Callable[[], Files]]:
        """List the two independent tasks: one prints header and sources, the other the self-test."""
        return [partial(self.sources, model, identity, real), partial(self._selftest, model, identity, real)]

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[Files]) -> Files:
        """The union of the files of all tasks."""
        return {name: text for files in results for name, text in files.items()}

    def sources(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        """Header and sources without the self-test."""
        dialect = Dialect(model.spec.name, real)
        files = header_and_sources(model, identity, dialect, sincos_strategy(self.trig))
        if "path_dynamics" in model.programs:
            files |= timing_files(model.programs["path_dynamics"], dialect)
        return files

    def _selftest(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        from rrrgen.emit.c.self_test import selftest  # its golden vectors need NumPy

        files, checks = self.beside()
        return selftest(model, identity, Dialect(model.spec.name, real), checks) | files
