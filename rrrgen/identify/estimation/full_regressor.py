"""The regressor of the estimation: base columns of the compiled model and columns of the drives, (14.10), (14.11)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from rrrgen.arrays import Array
from rrrgen.model.drive_columns import drive_columns
from rrrgen.model.estimated_terms import Column, DriveTerms


class RigidModel(Protocol):
    """Interface of the compiled robot that identification needs; :class:`rrrgen.runtime.Model` implements it."""

    @property
    def n(self) -> int: ...  # noqa: D102
    @property
    def spec(self) -> Any: ...  # noqa: D102
    @property
    def base_parameter_names(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def base_projection(self) -> Array: ...  # noqa: D102

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array: ...  # noqa: D102
    def standard_regressor(self, q: Array, dq: Array, ddq: Array) -> Array: ...  # noqa: D102


@dataclass(frozen=True)
class FullRegressor:
    """Regressor ``W(q, dq, ddq)`` (N, n, p): base columns of ``model``, then the columns of the drive ``terms``.

    ``tau = W theta`` with the base parameters and the drive parameters in theta. Source: (14.10), (14.11).
    """

    model: RigidModel
    terms: DriveTerms

    @property
    def columns(self) -> tuple[Column, ...]:
        """The p columns in order."""
        rigid = tuple(Column(name, "rigid") for name in self.model.base_parameter_names)
        return rigid + self.terms.columns(self.model.n)

    @property
    def names(self) -> tuple[str, ...]:
        """The name of the parameter of every column."""
        return tuple(column.name for column in self.columns)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the robot file instead of the compiled model, which holds machine code; the receiver compiles it."""
        from rrrgen.runtime.model import Model

        if isinstance(self.model, Model):
            return _compiled_regressor, (self.model.spec, self.terms)
        return FullRegressor, (self.model, self.terms)

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """W (N, n, p) at N instants; ``q``, ``dq``, ``ddq`` are (N, n), in rad (m) and seconds."""
        drives = drive_columns(self.terms.columns(self.model.n), np.asarray(dq, float), np.asarray(ddq, float))
        return np.concatenate([np.asarray(self.model.regressor(q, dq, ddq)), drives], axis=-1)


_COMPILED: dict[bytes, RigidModel] = {}


def _compiled_regressor(spec: Any, terms: DriveTerms) -> FullRegressor:
    """The regressor of ``spec``; each robot is compiled once per process."""
    import pickle

    from rrrgen.pipeline import compile

    key = pickle.dumps(spec)
    if key not in _COMPILED:
        _COMPILED[key] = compile(spec)
    return FullRegressor(_COMPILED[key], terms)
