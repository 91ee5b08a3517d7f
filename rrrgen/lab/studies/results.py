"""The base of the results of studies: printed, shown in a notebook, drawn, and written to a run folder."""

from __future__ import annotations

import html
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.suggestions import did_you_mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.base.arrays import Array
    from rrrgen.lab.data.run_folder import RunFolder

ResultType = TypeVar("ResultType", bound="StudyResult")

FigureMaker = Callable[[], "Figure | None"]
"""Draws a figure; None if the data do not allow one."""


@dataclass(frozen=True)
class Run:
    """What a run folder records of a study: ``command``, ``inputs`` (files by role), ``settings`` and ``seed``."""

    command: str
    inputs: Mapping[str, Path]
    settings: Mapping[str, Any]
    seed: int = 0

    def open(self, folder: str | os.PathLike[str], fresh: bool = False) -> RunFolder:
        """The run folder at ``folder``; raises InputError if it holds another run and is not to start ``fresh``."""
        from rrrgen.lab.data.run_folder import RunFolder

        return RunFolder(folder, self.command, self.inputs, self.settings, self.seed, fresh)

    def result(
        self,
        compute: Callable[[RunFolder | None], ResultType],
        folder: str | os.PathLike[str] | None = None,
        fresh: bool = False,
    ) -> ResultType:
        """The result of ``compute(opened)``, which is written into the run folder at ``folder`` unless that is None."""
        if folder is None:
            return compute(None)
        with self.open(folder, fresh) as opened:
            result = compute(opened)
            result.write(opened)
        return result


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult(ABC):
    """Base of the results of studies. ``run`` holds the inputs and settings that the result comes from."""

    run: Run = field(kw_only=True)

    @abstractmethod
    def lines(self, width: int | None = None) -> list[str]:
        """The report as text, its tables folded to ``width`` characters (None: lines of any length)."""

    @abstractmethod
    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the table that a notebook shows."""

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """The result as plain data for JSON."""

    def figures(self) -> dict[str, FigureMaker]:
        """The figures of the result: name -> function that draws it."""
        return {}

    @abstractmethod
    def write(self, folder: RunFolder) -> None:
        """Write the result into an open run folder."""

    def save(self, folder: str | os.PathLike[str], fresh: bool = False) -> Path:
        """Write what the command writes into its run folder, and return the folder.

        With ``fresh`` a run that the folder already holds is discarded; without, :class:`InputError` is raised for a
        run of other inputs or settings.
        """
        with self.run.open(folder, fresh) as opened:
            self.write(opened)
        return Path(folder)

    def plot(self, kind: str | None = None) -> Figure:
        """One figure of the result, the first without a name; raises InputError if there is none called ``kind``."""
        makers = self.figures()
        if not makers:
            raise InputError("this result has no figures")
        name = next(iter(makers)) if kind is None else kind
        if name not in makers:
            hint = " ".join(filter(None, (did_you_mean(name, makers), f"there are {', '.join(makers)}")))
            raise InputError(f"this result has no figure '{name}'; {hint}")
        figure = makers[name]()
        if figure is None:
            raise InputError(f"the data do not allow the figure '{name}'")
        return figure

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        header, rows = self.table()
        head = "".join(f"<th>{html.escape(name)}</th>" for name in header)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(_cell(value))}</td>" for value in row) + "</tr>" for row in rows
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _cell(value: Any) -> str:
    return value if isinstance(value, str) else f"{value:.6g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True)
class ParameterValue:
    """One estimated parameter: ``value`` and standard deviation ``std`` in ``unit``."""

    name: str
    value: float
    std: float
    unit: str

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        return f"{self.name} = {self.value:.6g} +- {self.std:.2g} {self.unit}".rstrip()


class EstimateResult(StudyResult):
    """Base of the results that hold estimated parameters: ``names``, ``values``, ``std``, ``units`` and ``notes``."""

    names: tuple[str, ...]
    values: Array
    std: Array
    units: tuple[str, ...]
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> ParameterValue:
        if name not in self.names:
            hint = " ".join(filter(None, (did_you_mean(str(name), self.names), f"there are {', '.join(self.names)}")))
            raise KeyError(f"no parameter {name!r}; {hint}")
        i = self.names.index(name)
        return ParameterValue(name, float(self.values[i]), float(self.std[i]), self.units[i])

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the parameters: name, unit, value and standard deviation."""
        parameters = [self[name] for name in self.names]
        return ("parameter", "unit", "value", "std"), [
            (parameter.name, parameter.unit, parameter.value, parameter.std) for parameter in parameters
        ]


@dataclass(frozen=True, eq=False, repr=False)
class FittedResult(EstimateResult):
    """Base of the results whose estimate is final when they are made; ``values`` and ``std`` are (p,)."""

    names: tuple[str, ...]
    values: Array
    std: Array
    units: tuple[str, ...]
    notes: tuple[str, ...]
