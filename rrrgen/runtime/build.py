"""Compiles C sources into an extension module with cffi (API mode), cached by content, safe for parallel builds."""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from pathlib import Path
from typing import Any

from rrrgen.base.cache import cache_directory, digest, keep_library, prune, recall_library
from rrrgen.base.errors import BuildError, StorageError, storage_error
from rrrgen.emit.c.compilers import (
    Compiler,
    find_compiler,
    include_directory,
    no_compiler,
    processor,
    read_library,
)

_loaded: dict[str, tuple[Any, Any]] = {}
_building = threading.Lock()
"""Threads whose first calls need the same library would each build it."""


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
    identity = [sys.implementation.cache_tag, platform.machine(), _cffi_version(), *compiler.identity()]
    if "-march=native" in flags:
        identity.append(processor())
    contents = [text for name in sorted(sources) for text in (name, sources[name])]
    key = digest(*identity, *flags, cdef, *contents)
    with _building:
        if key not in _loaded:
            module = f"_rrrgen_{key[:24]}"
            stem = f"{module_key}-{key[:24]}"
            path = recall_library(stem)
            if path is None:
                path = keep_library(stem, _build(module, sources, cdef, compiler, flags))
                prune()
            _loaded[key] = _load(path, module)
        return _loaded[key]


def _build(module: str, sources: Mapping[str, str], cdef: str, compiler: Compiler, flags: Sequence[str]) -> bytes:
    """Compile and link in a temporary directory; returns the bytes of the library."""
    include = include_directory()
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
        _run([compiler.compile(unit, [*flags, *special], include) for unit, special in units.items()], directory)
        library = f"library{EXTENSION_SUFFIXES[-1]}"
        _run([compiler.link(list(units), library)], directory)
        return read_library(directory / library, compiler.command[0])


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
    try:
        running = [
            subprocess.Popen(  # Microsoft's compiler complains on stdout
                command,
                cwd=directory,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            for command in commands
        ]
    except OSError as error:
        raise no_compiler(commands[0][0], f"does not run ({error.strerror})") from error
    complaints = [process.communicate()[0] for process in running]
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
        if _forbids_programs(path.parent):
            raise BuildError(
                f"the built extension cannot be loaded: {error}. The disk of the cache {path.parent} is mounted "
                "noexec: no code is run from it. Set RRRGEN_CACHE to a directory on another disk, or work without "
                "compiling: rrrgen.compile(..., backend='numpy')"
            ) from error
        path.unlink(missing_ok=True)  # so that the next run builds it again
        raise BuildError(f"the built extension cannot be loaded: {error}; it was removed, please try again") from error
    return extension.ffi, extension.lib


def _forbids_programs(directory: Path) -> bool:
    """Whether the file system of ``directory`` is mounted so that no program or library is run from it."""
    if not hasattr(os, "statvfs"):  # Windows has no such mounts
        return False
    return bool(os.statvfs(directory).f_flag & getattr(os, "ST_NOEXEC", 0))


def _cffi_version() -> str:
    import cffi

    return cffi.__version__
