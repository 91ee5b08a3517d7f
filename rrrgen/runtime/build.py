"""Compiling C sources into an extension module with cffi (API mode), cached by content, safe for parallel builds."""

from __future__ import annotations

import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Mapping, Sequence
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from typing import Any

from rrrgen.cache import cache_directory, digest, keep_library, prune, recall_library
from rrrgen.errors import BuildError, StorageError, storage_error
from rrrgen.extras import installed

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-fast-math")
"""Flags of every build. No contraction to fused multiply-adds: results then do not depend on the processor."""

SHARED: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "linux": (("-fPIC",), ("-lm",)),
    "darwin": (("-fPIC",), ("-undefined", "dynamic_lookup")),
    "win32": ((), (f"-L{Path(sys.base_prefix) / 'libs'}", f"-lpython{sys.version_info[0]}{sys.version_info[1]}")),
}
"""Flags to compile and to link a Python extension on each system; other systems are treated like Linux. Windows with
gcc, clang or zig: untested."""

ZIG = ("-m", "ziglang", "cc", "-fno-sanitize=undefined")
"""The C compiler of the Python package ``ziglang``, run by this Python. Without the flag it adds checks of its own to
the unoptimized part, whose library is not linked."""

CONTRACT = ("-ffp-contract=fast",)
"""Flag for vectorized loops over states: a fifth faster with fused multiply-adds, equal to single states to
round-off."""

NATIVE = ("-march=native", "-Wno-psabi")
"""Flags for this processor, so that vectorized loops use its widest registers. The cache key contains its features."""

_loaded: dict[str, tuple[Any, Any]] = {}


def build_extension(
    sources: Mapping[str, str],
    cdef: str,
    module_key: str,
    flags: Sequence[str] = (),
) -> tuple[Any, Any]:
    """Compile C ``sources`` (file name -> text) and load them; returns cffi's ``(ffi, lib)``.

    ``cdef`` declares the functions of ``lib``; every header among the sources is included. ``module_key`` makes the
    names in the cache readable. The result is cached in this process and on disk, by the hash of sources, flags,
    compiler and Python. Raises BuildError if the compiler is missing or rejects the code.
    """
    compiler = find_compiler()
    identity = [sys.implementation.cache_tag, platform.machine(), _cffi_version(), *compiler, _stamp(compiler[0])]
    if "-march=native" in flags:
        identity.append(processor())
    contents = [text for name in sorted(sources) for text in (name, sources[name])]
    key = digest(*identity, *FLAGS, *flags, cdef, *contents)
    if key not in _loaded:
        module = f"_rrrgen_{key[:24]}"
        stem = f"{module_key}-{key[:24]}"
        path = recall_library(stem)
        if path is None:
            path = keep_library(stem, _build(module, sources, cdef, [*compiler, *FLAGS, *flags]))
            prune()
        _loaded[key] = _load(path, module)
    return _loaded[key]


def find_compiler() -> list[str]:
    """The command of the C compiler: ``$CC``, else the first of cc, gcc, clang, else that of the package ziglang.

    Raises BuildError if there is none.
    """
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in [chosen] if chosen else [["cc"], ["gcc"], ["clang"]]:
        program = shutil.which(command[0])
        if program:
            return [program, *command[1:]]
    if not chosen and installed("ziglang"):
        return [sys.executable, *ZIG]
    missing = f"the C compiler '{chosen[0]}' named by CC" if chosen else "a C compiler (cc, gcc or clang)"
    raise BuildError(
        f"{missing} was not found. Install one (Debian, Ubuntu: apt install gcc; Fedora: dnf install gcc; macOS: "
        "xcode-select --install; anywhere: pip install ziglang, a compiler as a Python package of 400 MB), or work "
        "without: rrrgen.compile(..., backend='numpy')"
    )


def _include_directory() -> str:
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").is_file():
        raise BuildError(
            f"Python's C headers are missing (no Python.h in {include}). Install them (Debian, Ubuntu: apt install "
            "python3-dev; Fedora: dnf install python3-devel), or work without: rrrgen.compile(..., backend='numpy')"
        )
    return include


def _build(module: str, sources: Mapping[str, str], cdef: str, compile_command: list[str]) -> bytes:
    """Compile and link in a temporary directory; returns the bytes of the library."""
    include = _include_directory()
    compile_flags, link_flags = SHARED.get(sys.platform, SHARED["linux"])
    compile_command = [*compile_command, *compile_flags]
    with tempfile.TemporaryDirectory(dir=cache_directory(), prefix=".build-") as name:
        directory = Path(name)
        try:
            for file, text in sources.items():
                (directory / file).write_text(text, encoding="utf-8", newline="\n")
            _write_wrapper(directory / f"{module}.c", module, sources, cdef)
        except OSError as error:
            raise storage_error(directory, error) or error from error
        # the wrapper only forwards pointers: optimizing it would take a third of the build time and gain 1 %
        units = {f"{module}.c": ["-O0"], **{file: [] for file in sources if file.endswith(".c")}}
        _run(
            [
                [*compile_command, *special, f"-I{include}", "-c", unit, "-o", f"{unit}.o"]
                for unit, special in units.items()
            ],
            directory,
        )
        objects = [f"{unit}.o" for unit in units]
        _run([[*compile_command, "-shared", *objects, *link_flags, "-o", "library.so"]], directory)
        return (directory / "library.so").read_bytes()


def _write_wrapper(file: Path, module: str, sources: Mapping[str, str], cdef: str) -> None:
    """Write the C file of cffi that makes the functions of ``cdef`` callable from Python."""
    from cffi import FFI, recompiler

    ffi = FFI()
    ffi.cdef(cdef)
    includes = "\n".join(f'#include "{name}"' for name in sorted(sources) if name.endswith(".h"))
    recompiler.make_c_source(ffi, module, includes, str(file))


def _run(commands: list[list[str]], directory: Path) -> None:
    """Run compiler commands in parallel. Raises BuildError with the compiler's message for the first that fails."""
    environment = {**os.environ, "LC_ALL": "C"}
    running = [
        subprocess.Popen(command, cwd=directory, env=environment, stderr=subprocess.PIPE, text=True, errors="replace")
        for command in commands
    ]
    complaints = [process.communicate()[1] for process in running]
    for process, complaint, command in zip(running, complaints, commands, strict=True):
        if process.returncode:
            if "No space left on device" in complaint:
                places = f"{directory}, or temporary files in {tempfile.gettempdir()}"
                raise StorageError(f"cannot write {places}: the disk is full. Free some space there")
            words = "\n".join(complaint.splitlines()[:20])
            raise BuildError(f"{command[0]} refused emitted code (exit {process.returncode}):\n{words}")


def _load(path: Path, module: str) -> tuple[Any, Any]:
    loader = ExtensionFileLoader(module, str(path))  # named, because Windows expects another suffix than .so
    spec = importlib.util.spec_from_file_location(module, path, loader=loader)
    if spec is None or spec.loader is None:
        raise BuildError(f"the built extension cannot be loaded: {path}")
    try:
        extension = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(extension)
    except ImportError as error:
        path.unlink(missing_ok=True)  # so that the next run builds it again
        raise BuildError(f"the built extension cannot be loaded: {error}; it was removed, please try again") from error
    return extension.ffi, extension.lib


def processor() -> str:
    """The instruction-set features of this processor, as far as the system reports them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    return next((line for line in lines if line.startswith(("flags", "Features"))), "")


def _cffi_version() -> str:
    import cffi

    return cffi.__version__


def _stamp(program: str) -> str:
    """Size and modification time of the compiler, which change when another version is installed."""
    status = Path(program).resolve().stat()
    return f"{status.st_size} {status.st_mtime_ns}"
