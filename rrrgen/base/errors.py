"""The exceptions of rrrgen.

Every error raised on purpose derives from :class:`RrrgenError` and carries the exit code of the command line. A fault
in the user's input is an :class:`InputError`, which lists *all* faults found, each with its place in the file.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from importlib.util import find_spec


class RrrgenError(Exception):
    """Base class of all errors raised on purpose. ``exit_code`` is the exit status of the command line."""

    exit_code = 70


@dataclass(frozen=True, order=True)
class Fault:
    """One fault in a text file or an argument: where it is, what is wrong (``message``), what is allowed (``hint``).

    ``line`` and ``column`` count from 1; line 0 stands for the file as a whole. ``file`` is empty for the argument of a
    function, which has no place in a file. ``source_line`` is the text of the line, ``severity`` "error" or "warning".
    """

    file: str
    line: int
    column: int
    message: str
    source_line: str = ""
    hint: str = ""
    severity: str = "error"

    def __str__(self) -> str:
        place = self.file if self.line == 0 else f"{self.file}:{self.line}:{self.column}"
        lines = [f"{place}: {self.severity}: {self.message}" if self.file else self.message]
        if self.source_line:
            shown, offset = _window(self.source_line, self.column)
            lines += [f"    {shown}", "    " + " " * offset + "^"]
        if self.hint:
            lines.append(f"    {self.hint}")
        return "\n".join(lines)


def _window(source_line: str, column: int, width: int = 120) -> tuple[str, int]:
    """The part of a long source line around ``column``, with ... where it is cut, and the caret's offset in it."""
    text = source_line.rstrip("\r\n").replace("\t", " ")
    if len(text) <= width:
        return text, max(0, column - 1)
    start = min(max(0, column - 1 - width // 2), len(text) - width)
    before, after = "..." if start > 0 else "", "..." if start + width < len(text) else ""
    shown = before + text[start + len(before) : start + width - len(after)] + after
    return shown, max(0, column - 1 - start)


class InputError(RrrgenError, ValueError):
    """The user's file or arguments are wrong; ``faults`` holds every fault found.

    Also a ValueError, the exception that callers of Python functions expect for a wrong argument.
    """

    exit_code = 3

    def __init__(self, faults: list[Fault] | tuple[Fault, ...] | str) -> None:
        if isinstance(faults, str):
            faults = [Fault(file="", line=0, column=0, message=faults)]
        self.faults: tuple[Fault, ...] = tuple(sorted(faults))
        super().__init__("\n".join(str(fault) for fault in self.faults))


class RobotFileWarning(UserWarning):
    """A robot file is valid but doubtful, such as an inertia that no body has; one warning lists all of a file.

    ``faults`` are the single ones with their places, as :class:`Fault`. ``rrrgen check`` prints the same.
    """

    def __init__(self, faults: list[Fault] | tuple[Fault, ...]) -> None:
        self.faults: tuple[Fault, ...] = tuple(sorted(faults))
        super().__init__("\n".join(str(fault) for fault in self.faults))


class DerivationError(RrrgenError):
    """The robot file is valid, but the requested result does not exist (no closed form, not identifiable)."""

    exit_code = 4


class UnstableLoopError(DerivationError):
    """The motion of the virtual robot diverges: its control loop is unstable."""

    exit_code = 1


class BackendError(RrrgenError):
    """The requested backend cannot express a program."""

    exit_code = 4


class BuildError(RrrgenError):
    """The toolchain is missing or refused the emitted code; the message says what to install."""

    exit_code = 5


class MissingExtraError(BuildError):
    """An optional package is not installed: ``purpose``, e.g. "ROS recordings", needs ``package`` from ``extra``."""

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        self.purpose, self.package, self.extra = purpose, package, extra
        are = "are" if "," in package else "is"
        super().__init__(
            f"{purpose} needs {package}, which {are} not installed; with rrrgen's extra: pip install 'rrrgen[{extra}]'"
        )

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str]]:
        return MissingExtraError, (self.purpose, self.package, self.extra)


class StorageError(RrrgenError):
    """A disk is full or broken, or a directory is not safe to use; the message names the place and a remedy."""

    exit_code = 5


class OutputError(RrrgenError):
    """Output cannot be written to the place that the user named; the message gives the reason."""

    exit_code = 5


def cannot_write(path: str | os.PathLike[str], error: OSError) -> RrrgenError:
    """Make the exception that says why ``path`` cannot be written, from the system's ``error``.

    It is a StorageError for a full or broken disk, otherwise an OutputError.
    """
    reason = error.strerror or str(error)
    return storage_error(path, error) or OutputError(f"cannot write {os.fspath(path)}: {reason}")


def storage_error(path: str | os.PathLike[str], error: OSError) -> StorageError | None:
    """Make a StorageError if ``error`` means that the disk of ``path`` is full or broken; None for other errors."""
    reason = {
        errno.ENOSPC: "the disk is full",
        errno.EDQUOT: "your share of the disk (quota) is used up",
        errno.EFBIG: "files may not become that large here (see ulimit -f)",
        errno.EIO: "the disk reports an error",
    }.get(error.errno or 0)
    if reason is None:
        return None
    return StorageError(f"cannot write {os.fspath(path)}: {reason}. Free some space there, or name another place")


class InternalError(RrrgenError):
    """A fault of rrrgen itself: ``message`` says which assumption does not hold."""

    exit_code = 70

    def __init__(self, message: str) -> None:
        super().__init__(f"internal fault of rrrgen, please report it: {message}")


# ------------------------------------------------------------------------------------------------------------------
# Optional packages: the extra of rrrgen that installs each, and the error that names it when one is missing.
# ------------------------------------------------------------------------------------------------------------------

EXTRAS = {
    "casadi": "identify",
    "scipy": "identify",
    "matplotlib": "plot",
    "cvxpy": "identify",
    "clarabel": "identify",
    "h5py": "logs",
    "pyarrow": "logs",
    "rosbags": "logs",
    "dask": "cluster",
    "distributed": "cluster",
    "control": "response",
    "nfoursid": "response",
    "pandas": "response",
    "ziglang": "cross",
}
"""The extra of pyproject.toml that installs each optional top-level module."""


USES = {
    "plot": "Model.plot and Model.animate",
    "identify": "excite, identify, validate, reconstruct, friction and case-study, with figures; CasADi functions",
    "logs": "recordings in HDF5, Parquet and ROS bags",
    "cluster": "excite on the machines of a Dask cluster",
    "cross": "export: wheels and FMUs for other platforms",
    "response": "response-model: export to python-control, subspace identification",
}
"""What each extra lets a user do, in a few words."""


def require(purpose: str, *modules: str) -> None:
    """Raise MissingExtraError unless all ``modules`` are installed; none of them is imported.

    Call it before any work is done. ``purpose`` says in the message what needs them.
    """
    missing = [module for module in modules if not is_installed(module)]
    if missing:
        raise MissingExtraError(purpose, ", ".join(missing), EXTRAS[missing[0]])


def is_installed(module: str) -> bool:
    """Whether the top-level ``module`` is installed, as far as can be determined without importing it."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing_extra(error: BaseException | None) -> MissingExtraError | None:
    """The MissingExtraError for a failed import ``error``, or one caused by it; None if no extra would help."""
    while error is not None:
        if isinstance(error, ImportError):
            package = (error.name or "").partition(".")[0]
            if package in EXTRAS:
                return MissingExtraError("this", package, EXTRAS[package])
        error = error.__cause__
    return None


# ------------------------------------------------------------------------------------------------------------------
# Names of options in messages: as Python callers write them, or as flags while a command runs.
# ------------------------------------------------------------------------------------------------------------------

_WRITTEN: ContextVar[Callable[[str], str]] = ContextVar("written", default=str)


def option_name(name: str) -> str:
    """The option ``name`` as the caller writes it: ``fit_rows`` in Python, ``--fit-rows`` inside a command."""
    return _WRITTEN.get()(name)


def with_names(template: str, written: Callable[[str], str] = option_name) -> str:
    """The text of a ``template`` with every ``{option}`` in it as ``written(option)``."""
    return re.sub(r"\{(\w+)\}", lambda match: written(match.group(1)), template)


@contextmanager
def options_written(written: Callable[[str], str]) -> Iterator[None]:
    """Let messages write options as ``written(name)`` gives them."""
    before = _WRITTEN.set(written)
    try:
        yield
    finally:
        _WRITTEN.reset(before)
