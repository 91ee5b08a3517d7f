"""Derived programs, kept between runs: derivation is the slow part of loading a robot that was compiled before."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from rrrgen.backends import Identity
from rrrgen.cache import cache_directory, digest, store, touch

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robotfile.robot_spec import RobotSpec

_KEPT = frozenset(
    {
        "programs",
        "base_parameters",
        "base_projection",
        "regrouping",
        "beta_nominal",
        "drive_inertia_nominal",
        "passes",
    }
)
"""What backends and the runtime read of a derived model, beside the description, which the caller has."""


def recall(spec: RobotSpec, identity: Identity, derive: Callable[[RobotSpec], DerivedModel]) -> DerivedModel:
    """``derive(spec)``, or what an earlier run of the same compiler made of the same robot.

    The records of the derivation itself are not kept; closed forms derive anew. The cache lies in a directory private
    to the user, as the extensions that are loaded from it do.
    """
    path = cache_directory() / f"{spec.name}-{digest(identity.model_hash, _compiler_hash())[:24]}.derived"
    kept = _load(path)
    if kept is None:
        derived = derive(spec)
        records = {field.name: None for field in fields(derived) if field.name not in _KEPT}
        kept = replace(derived, **records)  # type: ignore[arg-type]
        store(path, pickle.dumps(kept))
    else:
        touch(path)
    return replace(kept, spec=spec)


def _load(path: Path) -> DerivedModel | None:
    try:
        return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]
    except Exception:  # a damaged file raises whatever its bytes happen to mean; deriving anew replaces it
        return None


@cache
def _compiler_hash() -> str:
    """Changes with every source file of this package, with SymPy and with Python."""
    import sympy

    root = Path(__file__).resolve().parents[1]
    parts = [sys.version, sympy.__version__]
    for path in sorted(root.rglob("*.py")):
        parts += [path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")]
    return digest(*parts)
