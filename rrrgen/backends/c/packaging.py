"""Files that let build systems use the emitted C: CMake and pkg-config."""

from __future__ import annotations

from collections.abc import Iterable

from rrrgen.backends import Identity
from rrrgen.backends.c.dialect import Dialect
from rrrgen.resources import render


def build_files(files: Iterable[str], identity: Identity, dialect: Dialect) -> dict[str, str]:
    """``CMakeLists.txt`` and ``<name>.pc`` for the C files named in ``files`` (paths relative to the output)."""
    names = sorted(files)
    prefix = dialect.prefix
    selftests = [name for name in names if name.endswith("_selftest.c")]
    values = {
        "prefix": prefix,
        "macro": dialect.macro,
        "identity": identity,
        "version": identity.tool_version,
        "headers": [name for name in names if name.endswith(".h") and "/" not in name],
        "sources": [name for name in names if name.endswith(".c") and "/" not in name and name not in selftests],
        "casadi": [name for name in names if name.startswith("casadi/") and name.endswith(".c")],
        "selftests": selftests,
    }
    return {
        "CMakeLists.txt": render("c/CMakeLists.txt.j2", **values),
        f"{prefix}.pc": render("c/pkgconfig.pc.j2", **values),
    }
