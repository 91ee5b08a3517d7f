"""Finds a C compiler and builds its command lines: gcc, clang and zig, and Microsoft's cl.

Tried on Linux with gcc, clang and zig. The command lines for Windows and macOS are untested there.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PureWindowsPath

from rrrgen.base.errors import BuildError, is_installed

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-fast-math")
"""Flags of every build. No contraction to fused multiply-adds: results then do not depend on the processor."""

ZIG = ("-m", "ziglang", "cc", "-fno-sanitize=undefined")
"""The C compiler of the Python package ``ziglang``, run by this Python. Without the flag it adds checks of its own to
the unoptimized part, whose library is not linked."""

CONTRACT = ("-ffp-contract=fast",)
"""Flag for vectorized loops over states: a fifth faster with fused multiply-adds, equal to single states to
round-off."""

NATIVE = ("-march=native", "-Wno-psabi")
"""Flags for this processor, so that vectorized loops use its widest registers. The cache key contains its features."""

MICROSOFT = {
    "-std=c99": "/std:c11",  # it has no C99; C11 contains what is emitted
    "-O2": "/O2",
    "-O0": "/Od",
    "-ffp-contract=off": "/fp:precise",
}
"""What a flag is called by Microsoft's compiler; flags that are not listed have no counterpart and are left out."""

WANTED = {"win32": (["cl"], ["clang"], ["gcc"], ["cc"])}
COMPILERS = (["cc"], ["gcc"], ["clang"])
"""Compilers in the order in which they are looked for, on Windows and elsewhere."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler, called by the words of its ``command``, such as ("zig", "cc")."""

    command: tuple[str, ...]

    @property
    def microsoft(self) -> bool:
        """Whether the compiler takes the options of Microsoft's ``cl``; such a compiler has no vector types."""
        return PureWindowsPath(self.command[0]).stem.lower() in ("cl", "clang-cl")

    def compile(self, unit: str, flags: Sequence[str], include: str) -> list[str]:
        """The command that compiles the file ``unit`` to ``object_file(unit)``, for a shared library."""
        if self.microsoft:
            usual, special = ([MICROSOFT[flag] for flag in given if flag in MICROSOFT] for given in (FLAGS, flags))
            translated = [*usual, *further_flags(), *special]
            macros = [flag for flag in flags if flag.startswith("-D")]
            return [
                *self.command,
                "/nologo",
                *translated,
                *macros,
                f"/I{include}",
                "/c",
                unit,
                f"/Fo{self.object(unit)}",
            ]
        position = () if sys.platform == "win32" else ("-fPIC",)  # all code is, on Windows
        return [
            *self.command,
            *FLAGS,
            *further_flags(),
            *map(_flag, flags),
            *position,
            f"-I{include}",
            "-c",
            unit,
            "-o",
            self.object(unit),
        ]

    def object(self, unit: str) -> str:
        """The name of the object file of ``unit``."""
        return f"{unit}.obj" if self.microsoft else f"{unit}.o"

    def link(self, units: Sequence[str], library: str) -> list[str]:
        """The command that links the objects of ``units`` to ``library``, an extension module of this Python."""
        objects = [self.object(unit) for unit in units]
        if self.microsoft:
            return [*self.command, "/nologo", "/LD", *objects, f"/Fe{library}", "/link", f"/LIBPATH:{_libraries()}"]
        return [*self.command, "-shared", *objects, *_link_options(), "-o", library]

    def version_command(self) -> list[str]:
        """Command that prints the version of the compiler; Microsoft's prints it if called without arguments."""
        return [*self.command] if self.microsoft else [*self.command, "--version"]

    def identity(self) -> list[str]:
        """Text that identifies the compiler and its version, for the keys of the cache of builds."""
        status = Path(self.command[0]).resolve().stat()
        zig = [_zig_version()] if "ziglang" in self.command else []
        return [*self.command, *FLAGS, *further_flags(), f"{status.st_size} {status.st_mtime_ns}", *zig]


def further_flags() -> list[str]:
    """The flags in ``$RRRGEN_CFLAGS``, which follow :data:`FLAGS`: ``-O1`` builds faster what runs a little slower."""
    return environment_words("RRRGEN_CFLAGS")


def environment_words(variable: str) -> list[str]:
    """The words of an environment ``variable``, as a shell splits it. Raises BuildError for an open quotation."""
    text = os.environ.get(variable, "")
    try:
        return shlex.split(text, posix=sys.platform != "win32")
    except ValueError as error:
        raise BuildError(f"{variable} ({text}) cannot be split into words: {str(error).lower()}") from None


def _flag(flag: str) -> str:
    """Replace the flag ``-march=native`` on Apple's processors, where compilers may know ``-mcpu=native`` only."""
    apple = sys.platform == "darwin" and platform.machine() == "arm64"
    return "-mcpu=native" if flag == "-march=native" and apple else flag


def _link_options() -> list[str]:
    """Linker options of an extension module on this system; systems other than Windows and macOS count as Linux."""
    if sys.platform == "win32":
        return [f"-L{_libraries()}", f"-lpython{sys.version_info[0]}{sys.version_info[1]}"]
    if sys.platform == "darwin":
        return ["-undefined", "dynamic_lookup"]
    return ["-lm"]


def _libraries() -> str:
    """Folder of Python's import library, which extension modules are linked with on Windows."""
    return str(Path(sys.base_prefix) / "libs")


def _zig_version() -> str:
    try:
        return version("ziglang")
    except PackageNotFoundError:
        return ""


def find_compiler() -> Compiler:
    """Find the C compiler of this machine: ``$CC``, else the first one on the path, else that of the package ziglang.

    The names tried are cc, gcc and clang, on Windows cl, clang, gcc and cc. Raises BuildError if there is none.
    """
    chosen = _split_cc()
    for command in [chosen] if chosen else WANTED.get(sys.platform, COMPILERS):
        program = shutil.which(command[0])
        if program:
            return Compiler((program, *command[1:]))
    if not chosen and is_installed("ziglang"):
        return Compiler((sys.executable, *ZIG))
    kinds = "cl, clang or gcc" if sys.platform == "win32" else "cc, gcc or clang"
    missing = f"the C compiler '{chosen[0]}' named by CC" if chosen else f"a C compiler ({kinds})"
    raise BuildError(
        f"{missing} was not found. Install one (Debian, Ubuntu: apt install gcc; Fedora: dnf install gcc; macOS: "
        "xcode-select --install; Windows: the build tools of Visual Studio, in whose developer prompt cl is found; "
        "anywhere: pip install ziglang, a compiler as a Python package of 400 MB), or work without: "
        "rrrgen.compile(..., backend='numpy')"
    )


def _split_cc() -> list[str]:
    """Split ``$CC`` into words; if the whole is the path of a file, even with blanks or backslashes, it is one word."""
    text = os.environ.get("CC", "").strip()
    return [text] if text and Path(text).is_file() else environment_words("CC")


def no_compiler(program: str, reason: str) -> BuildError:
    """The error for a ``program`` that was taken for a C compiler, but is none; the ``reason`` is a predicate."""
    return BuildError(f"{program} {reason}: it is no C compiler. The environment variable CC names the one to use")


def read_library(library: Path, program: str) -> bytes:
    """The bytes of a ``library`` that the compiler ``program`` has just written. Raises BuildError if there is none."""
    try:
        return library.read_bytes()
    except FileNotFoundError:
        raise no_compiler(program, "reported success, but wrote no library") from None


def include_directory() -> str:
    """The folder of Python's C headers. Raises BuildError if they are missing."""
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").is_file():
        raise BuildError(
            f"Python's C headers are missing (no Python.h in {include}). Install them (Debian, Ubuntu: apt install "
            "python3-dev; Fedora: dnf install python3-devel), or work without: rrrgen.compile(..., backend='numpy')"
        )
    return include


def processor() -> str:
    """The instruction-set features of this processor, as far as the system reports them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")
