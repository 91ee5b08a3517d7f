"""Builds emitted C as shared libraries for this machine and, with the compiler of the package ziglang, for others."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rrrgen.base.errors import BuildError, InputError, require
from rrrgen.base.files import Contents, as_bytes
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.emit.c.compilers import FLAGS, ZIG, environment_words, find_compiler, further_flags, read_library

# ------------------------------------------------------------------------------------------------------------------
# Reproducible ZIP archives: the bytes depend only on the contents, not on the time of writing.
# ------------------------------------------------------------------------------------------------------------------

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a ZIP file can state


def zip_archive(files: Mapping[str, Contents]) -> bytes:
    """Make a ZIP file of ``files`` (path -> contents), in the order given and without the time of writing."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, contents in files.items():
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, as_bytes(contents))
    return stream.getvalue()


# ------------------------------------------------------------------------------------------------------------------
# Builds emitted C as shared libraries for this machine and, with the compiler of the package ziglang, for others
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Platform:
    """Platform to build for: user's ``name``, ``zig`` target, wheel ``tag`` and library ``suffix``.

    ``fmi`` is the folder of its binaries in an FMU, "" if FMI 2.0 has none for it.
    """

    name: str
    zig: str
    tag: str
    fmi: str
    suffix: str


PLATFORMS = {
    platform.name: platform
    for platform in (
        Platform("linux-x86_64", "x86_64-linux-gnu.2.17", "manylinux2014_x86_64", "linux64", ".so"),
        Platform("linux-aarch64", "aarch64-linux-gnu.2.17", "manylinux2014_aarch64", "", ".so"),
        Platform("macos-arm64", "aarch64-macos.11.0", "macosx_11_0_arm64", "", ".dylib"),
        Platform("macos-x86_64", "x86_64-macos.11.0", "macosx_11_0_x86_64", "darwin64", ".dylib"),
        Platform("windows-x86_64", "x86_64-windows-gnu", "win_amd64", "win64", ".dll"),
    )
}
"""Systems that zig can build for, by name."""


def this_machine() -> Platform:
    """Platform that rrrgen runs on, for which the installed C compiler builds."""
    tag = re.sub(r"[-.]", "_", sysconfig.get_platform())
    system, suffix = {"win32": ("windows", ".dll"), "darwin": ("macos", ".dylib")}.get(sys.platform, ("linux", ".so"))
    machine = "x86_64" if tag.endswith(("x86_64", "amd64")) else ""
    known = PLATFORMS.get(f"{system}-{machine}")
    return Platform("", "", tag, known.fmi if known else "", suffix)


def platforms(names: Sequence[str]) -> tuple[Platform, ...]:
    """Look up platforms by ``names``; without names, this machine. Raises InputError for an unknown name."""
    for name in names:
        if name not in PLATFORMS:
            hint = did_you_mean(name, PLATFORMS) or f"platforms are {', '.join(PLATFORMS)}"
            raise InputError(f"there is no platform '{name}'; {hint}")
    if names:
        require("building for other platforms", "ziglang")
    return tuple(PLATFORMS[name] for name in dict.fromkeys(names)) or (this_machine(),)


def shared_library(files: Mapping[str, str], platform: Platform) -> bytes:
    """Compile the C ``files`` (name -> text) to a shared library for ``platform`` that depends only on the C library.

    Raises BuildError if there is no compiler or it fails.
    """
    sources = sorted(name for name in files if name.endswith(".c"))
    with tempfile.TemporaryDirectory(prefix="rrrgen-library-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        command = _command(platform)
        done = subprocess.run(
            [*command, *sources, "-o", "library", *_libraries(platform)],
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            env={**os.environ, "LC_ALL": "C"},
            check=False,
        )
        if done.returncode:
            words = "\n".join(done.stderr.splitlines()[:20])
            raise BuildError(f"the C compiler refused emitted code (exit {done.returncode}):\n{words}")
        return read_library(folder / "library", command[0])


def _command(platform: Platform) -> list[str]:
    """Compiler command with flags: strict floating point, and no paths of the building machine in the binary."""
    position = [] if platform.suffix == ".dll" else ["-fPIC"]
    flags = [*FLAGS, *further_flags(), "-shared", "-DRRRGEN_SHARED", "-g0", "-s", *position]
    if platform.zig:
        return [sys.executable, *ZIG, "-target", platform.zig, *flags]
    compiler = find_compiler()
    if compiler.microsoft:
        raise BuildError(
            "libraries for other programs are built by gcc, clang or zig, not by cl: name one in CC, or name the "
            "platform with --platform, for which the package ziglang builds (pip install 'rrrgen[cross]')"
        )
    return [*compiler.command, *flags]


def _libraries(platform: Platform) -> list[str]:
    """Linker arguments: libraries to link with, and the user's own linker options."""
    libraries = [] if platform.suffix == ".dll" else ["-lm"]
    return libraries + environment_words("LDFLAGS") * (not platform.zig)
