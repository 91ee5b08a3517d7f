"""The C backend: everything below the output directory that is C, except what other backends print."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rrrgen.backends import Identity, Real
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.selftest import selftest
from rrrgen.backends.c.sources import header_and_source

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


class CBackend:
    """Prints header, source and self-test."""

    name = "c"

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """``<name>.h``, ``<name>.c`` and ``<name>_selftest.c``."""
        dialect = Dialect(model.spec.name, real)
        return {**header_and_source(model, identity, dialect), **selftest(model, identity, dialect)}
