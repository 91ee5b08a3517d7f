"""The cache of derived models: derivation is the slow part of loading a robot that was compiled before."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.base.cache import digest, keep
from rrrgen.base.cache import recall as recall_bytes
from rrrgen.base.errors import StorageError
from rrrgen.derive.derived_format import dumps, loads
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.robot.robot_spec import RobotSpec


def recall(
    spec: RobotSpec, identity: Identity, derive: Callable[[RobotSpec], DerivedModel], groups: Sequence[str] = ("model",)
) -> DerivedModel:
    """Return the derived model of a robot from the cache, or derive it by ``derive(spec)`` and store it there.

    A cached model is used if ``identity`` (the content of the robot file), ``groups`` (of functions), and the version
    of rrrgen agree. The cache holds all fields except ``spec``, which is taken from the caller.
    """
    name = f"{spec.name}-{digest(identity.model_hash, *groups, _compiler_hash())[:24]}.derived"
    found = _load(name)
    if found is None:
        derived = derive(spec)
        found = {field.name: getattr(derived, field.name) for field in fields(derived) if field.name != "spec"}
        # optional: the cache may be full or read-only
        with contextlib.suppress(OSError, StorageError):
            keep(name, dumps(found))
    return DerivedModel(spec=spec, **found)


def _load(name: str) -> dict[str, Any] | None:
    data = recall_bytes(name)
    try:
        return None if data is None else loads(data)
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        return None  # not the format of this version; the model is derived again and replaces it


@cache
def _compiler_hash() -> str:
    """The hash of all source files of this package and of the versions of SymPy and Python."""
    import sympy

    root = Path(__file__).resolve().parents[1]
    parts = [sys.version, sympy.__version__]
    for path in sorted(root.rglob("*.py")):
        parts += [path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")]
    return digest(*parts)
