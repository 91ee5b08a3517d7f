"""The C backend: everything below the output directory that is C, except what other backends print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rrrgen.backends import Identity, Real
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.sources import header_and_sources
from rrrgen.backends.c.trigonometry import Trig, sincos_strategy

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


@dataclass(frozen=True)
class CBackend:
    """Prints header, sources and self-test; ``trig`` says where sines and cosines come from."""

    trig: Trig = "inline"

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """``<name>.h``, ``<name>.c`` with the sources beside it, and ``<name>_selftest.c``."""
        return self.sources(model, identity, real) | self.selftest(model, identity, real)

    def sources(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """``<name>.h`` and the sources."""
        return header_and_sources(model, identity, Dialect(model.spec.name, real), sincos_strategy(self.trig))

    def selftest(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """``<name>_selftest.c``, whose golden vectors NumPy computes."""
        from rrrgen.backends.c.selftest import selftest

        return selftest(model, identity, Dialect(model.spec.name, real))
