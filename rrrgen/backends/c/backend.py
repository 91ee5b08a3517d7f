"""The C backend: everything below the output directory that is C, except what other backends print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rrrgen.backends import Identity, Real
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.selftest import selftest
from rrrgen.backends.c.sources import header_and_sources
from rrrgen.backends.c.trigonometry import Trig, sincos_strategy

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


@dataclass(frozen=True)
class CBackend:
    """Prints header, sources and self-test; ``trig`` says where sines and cosines come from."""

    trig: Trig = "inline"
    name: ClassVar[str] = "c"

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """``<name>.h``, ``<name>.c`` with the sources beside it, and ``<name>_selftest.c``."""
        dialect = Dialect(model.spec.name, real)
        return {
            **header_and_sources(model, identity, dialect, sincos_strategy(self.trig)),
            **selftest(model, identity, dialect),
        }
