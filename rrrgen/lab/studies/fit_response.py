"""Fit of linear models with resonances to frequency responses or recordings: options, study and result."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from rrrgen.base.errors import InputError, require, with_names
from rrrgen.lab.studies.frequency_response import FrequencyResponseResult
from rrrgen.lab.studies.options import OptionError, StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.plant.elastic_modes import ElasticMode
    from rrrgen.lab.response.fitting import FittedModels
    from rrrgen.lab.response.frequency_response import FrequencyResponse
    from rrrgen.lab.response.response_model import ResponseModel
    from rrrgen.lab.studies.sources import FindingsCallback, ProgressCallback, ResponseSource, RobotSource
    from rrrgen.program import Program


@dataclass(frozen=True)
class FitResponseOptions(StudyOptions):
    """Options of the fit of a linear model."""

    fit_rows: str | None = option(None, "Rows to fit, counted from 1; the others test it.", metavar="A:B")
    method: Literal["auto", "modes", "arx", "armax", "output_error", "subspace", "indirect"] = option(
        "auto", "Kind of model.", shown=True
    )
    real: Literal["double", "float"] = option("double", "Floating-point type of the C code.", shown=True)

    @property
    def rows(self) -> tuple[int, int] | None:
        """First and last row to fit; raises :class:`OptionError` for a text that is no range of rows."""
        if self.fit_rows is None:
            return None
        match = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", self.fit_rows)
        if match is None or not 1 <= int(match[1]) < int(match[2]):
            raise OptionError(f"'{self.fit_rows}' is no range of rows, e.g. 1:512; rows count from 1", "fit_rows")
        return int(match[1]), int(match[2])

    def settings(self) -> dict[str, Any]:
        """The options by name, the rows to fit as numbers."""
        return super().settings() | {"fit_rows": self.rows}


@dataclass(frozen=True, eq=False, repr=False)
class FitResponseResult(StudyResult):
    """The result of :func:`rrrgen.fit_response`: a sequence of models, one for every posture.

    ``fitted`` holds the models, the measured responses beside them, and why postures have none. ``elastic`` pairs
    measured resonances with those that the robot leads to, None if no robot was given; ``real`` is the type of the C
    code.
    """

    fitted: FittedModels
    elastic: list[dict[str, Any]] | None
    real: Literal["double", "float"]

    def __len__(self) -> int:
        return len(self.fitted.models)

    def __getitem__(self, number: int) -> ResponseModel:
        return self.fitted.models[number]

    @property
    def refused(self) -> dict[str, str]:
        """Why no model was fitted, by the name of the posture."""
        return self.fitted.refused

    def lines(self, width: int | None = None) -> list[str]:
        """The report: orders, scores and resonances of the models, and of the robot."""
        record = self.to_json()
        lines = [line for model in self.fitted.models for line in model.lines(width)]
        for mode in self.fitted.overlooked:
            which = f"not in the model: {mode}, which the frequency response shows; "
            lines.append(which + with_names("{method} modes fits it"))
        lines += [f"no model of {name}: {reason}" for name, reason in self.refused.items()]
        for mode in record.get("resonances_over_postures", ()):
            (low, high), (least, most) = mode["frequency"], mode["damping"]
            where = f"over {len(mode['postures'])} postures"
            lines.append(f"{where}: {low:.4g} to {high:.4g} Hz, damping {least:.3g} to {most:.3g}")
        return [*lines, *self._alias_lines(), *(elastic_line(row) for row in self.elastic or ())]

    def _alias_lines(self) -> list[str]:
        """Sentences on the frequencies above half the sampling rate that the resonances may stand for."""
        from rrrgen.lab.response.fitting import alias_lines

        rates = {round(1.0 / model.period, 9): model for model in self.fitted.models}
        return [line for rate, model in rates.items() for line in alias_lines(model.resonances, rate)]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the resonances of all models, with their standard deviations."""
        header = ("model", "frequency [Hz]", "std [Hz]", "damping", "std")
        rows = [
            (model.name, *(value if value is not None else "" for value in numbers))
            for model in self.fitted.models
            for mode in model.resonances
            for numbers in [(mode.frequency, mode.frequency_std, mode.damping, mode.damping_std)]
        ]
        return header, rows

    def to_json(self) -> dict[str, Any]:
        """The content of ``response_model.json``: the first posture, and all of them if there are several."""
        from rrrgen.lab.data.run_folder import plain_record

        record = self.fitted.to_json() | ({} if self.elastic is None else {"elastic_model": self.elastic})
        return plain_record(record)

    def figures(self) -> dict[str, FigureMaker]:
        """The figures: response_model if a response was measured, resonances if there are several postures."""
        from rrrgen.lab.response.figures import plot_models, plot_resonances

        measured, models = self.fitted.measured, self.fitted.models
        makers: dict[str, FigureMaker] = {}
        if measured:
            makers["response_model"] = lambda: plot_models(measured, models)
        if len(models) > 1:
            makers["resonances"] = lambda: plot_resonances(models)
        return makers

    def write(self, folder: RunFolder) -> None:
        """Write ``response_model.json``, C of one step of every model, and the figures into an open run folder."""
        from rrrgen.emit.c.function_files import function_files

        folder.write_json("response_model.json", self.to_json())
        programs = _steps(self.fitted.models)
        for name, text in function_files("response_model", "a linear model", programs, self.real).items():
            folder.write_text(name, text)
        for name in self.figures():
            folder.figure(name, self.plot(name))


def elastic_line(row: dict[str, Any]) -> str:
    """A computed resonance and the measured one beside it as text."""
    computed, measured = row["computed"], row["measured"]
    beside = "no resonance measured"
    if measured is not None:
        deviation = f"{100 * row['deviation']:.2g} %"
        beside = f"measured {measured['frequency']:.4g} Hz, {measured['damping']:.3g} ({deviation})"
    return (
        f"{row['posture']}: M(q) and stiffness give {computed['frequency']:.4g} Hz, damping "
        f"{computed['damping']:.3g}, a peak of {computed['peak']:.2g}; {beside}"
    )


def _steps(models: Sequence[ResponseModel]) -> list[Program]:
    """Record one step of every model as a program named ``step``, or ``step_<posture>`` where there are several."""
    from rrrgen.emit.controller.filters import linear_step_program

    programs, names = [], set[str]()
    for model in models:
        name = re.sub(r"\W", "_", f"step_{model.name}") if len(models) > 1 else "step"
        while name in names:
            name += "_"
        names.add(name)
        title = f"the linear model of {model.name}" if len(models) > 1 else "a linear model"
        programs.append(linear_step_program([model.state_space()], model.period, name, title))
    return programs


def fit_response(
    response: FrequencyResponseResult | FrequencyResponse | Sequence[FrequencyResponse] | ResponseSource,
    options: FitResponseOptions | None = None,
    *,
    robot: RobotSource | None = None,
    experiment: str | os.PathLike[str] | None = None,
    joint: str | None = None,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    **changes: Any,
) -> FitResponseResult:
    """Fit a linear model with its resonances to a frequency response or to a recording.

    The method auto fits modes to the frequency response where the recording has an excitation beside the input (a
    closed loop), and otherwise a difference equation: ARX, ARMAX or output error. Orders are chosen within the rows to
    fit. Several postures get a model each.

    Args:
        response: the result of :func:`rrrgen.frequency_response`, responses of it, its frf.json, a response file, or
            arrays as for that function.
        options: a :class:`FitResponseOptions`; the default options if None.
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model, of which the resonances are
            computed, too.
        experiment: experiment file with the elastic parts and postures of ``robot``; they belong together.
        joint: the joint of the response, where the section ``response`` of the experiment file does not state it.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file.
        changes: single options by name, such as ``method="arx"`` or ``fit_rows="1:512"``.

    Raises:
        InputError: response, robot or options cannot be used; an OptionError for the options.
        DerivationError: no model can be fitted, or the response cannot be trusted.
    """
    chosen = with_changes(FitResponseOptions, options, changes)
    settings = chosen.settings()
    require("rrrgen response model", "scipy", "matplotlib")
    from rrrgen.lab.experiment.experiment_file import load_experiment
    from rrrgen.lab.experiment.response import beside, expected_modes
    from rrrgen.lab.response.fitting import fit_recordings, fit_responses
    from rrrgen.lab.studies.sources import ignore, response_input, robot_input

    files = {"log": Path(response)} if isinstance(response, (str, os.PathLike)) else {}
    if (robot is None) != (experiment is None):
        raise OptionError("{robot} and {experiment} belong together")
    if joint is not None and robot is None:
        raise OptionError("{joint} is of use with {robot} and {experiment} only")
    computed = None
    if robot is not None and experiment is not None:
        arm = robot_input(robot, findings or ignore)
        computed = expected_modes(load_experiment(experiment, arm.spec.n), arm.model, joint)
        files["experiment"] = Path(experiment)
        settings |= arm.settings | ({} if joint is None else {"joint": joint})
    measured = _frequency_responses(response)
    if measured is not None:
        if chosen.rows is not None or chosen.method not in ("auto", "modes"):
            raise OptionError("a frequency response has no rows, and takes {method} modes")
        settings |= {} if files.get("log") else {"responses": [_hash(measurement) for measurement in measured]}
        fit = partial(fit_responses, measured)
    else:
        given = response_input(cast("ResponseSource", response))
        files |= given.files
        settings |= given.settings
        fit = partial(fit_recordings, given.response, chosen.rows, chosen.method)
    (progress or ignore)(0, 0, "fitting the model")
    fitted = fit()
    elastic = None if computed is None else beside(fitted.models, _by_posture(fitted, computed))
    result = FitResponseResult(fitted, elastic, chosen.real, run=Run("response-model", files, settings))
    return result.run.result(lambda _: result, folder, fresh)


def _frequency_responses(response: Any) -> list[FrequencyResponse] | None:
    """The frequency responses among what may be fitted, None for recordings."""
    from rrrgen.lab.response.frequency_response import FrequencyResponse, read_responses

    if isinstance(response, (str, os.PathLike)):
        return read_responses(Path(response)) if Path(response).suffix.lower() == ".json" else None
    responses: list[Any] = [response] if isinstance(response, (FrequencyResponse, Mapping)) else list(response)
    return responses if responses and all(isinstance(entry, FrequencyResponse) for entry in responses) else None


def _hash(response: FrequencyResponse) -> str:
    """SHA-256 of a response that comes from no file."""
    from rrrgen.lab.studies.sources import hash_of_arrays

    P = response.P
    return hash_of_arrays({"frequency": response.frequency, "re": P.real, "im": P.imag, "variance": response.variance})


def _by_posture(fitted: FittedModels, computed: list[list[ElasticMode]]) -> dict[str, list[ElasticMode]]:
    """The computed modes by the name of the measured posture; raises InputError if there are fewer or more postures."""
    names = [posture.name for posture in fitted.measured or fitted.models]
    if len(names) != len(computed):
        raise InputError(f"{len(names)} postures are measured, the experiment file has {len(computed)} (`response`)")
    return dict(zip(names, computed, strict=True))
