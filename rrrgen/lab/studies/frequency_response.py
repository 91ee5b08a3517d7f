"""Estimation of the frequency response of a joint: its options, the study and its result."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from rrrgen.base.errors import require
from rrrgen.lab.studies.options import StudyOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.response.frequency_response import FrequencyResponse
    from rrrgen.lab.studies.sources import ProgressCallback, ResponseSource


@dataclass(frozen=True)
class FrequencyResponseOptions(StudyOptions):
    """Options of the estimation of a frequency response."""

    method: Literal["local_polynomial", "instrumental", "direct", "indirect"] = option(
        "local_polynomial",
        "Estimator: local polynomials, averages with the excitation as instrument, output over input, or by the "
        "sensitivity and the controller (14.38).",
        shown=True,
    )


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponseResult(StudyResult):
    """The result of :func:`rrrgen.frequency_response`: a sequence of responses, one for every posture.

    ``responses`` are :class:`~rrrgen.lab.response.frequency_response.FrequencyResponse`: lines with 95 % bands,
    coherence and a verdict.
    """

    responses: tuple[FrequencyResponse, ...]

    def __len__(self) -> int:
        return len(self.responses)

    def __getitem__(self, number: int) -> FrequencyResponse:
        return self.responses[number]

    def __iter__(self) -> Iterator[FrequencyResponse]:
        return iter(self.responses)

    @property
    def trusted(self) -> bool:
        """Whether nothing speaks against any of the recordings as a whole."""
        return not any(response.findings for response in self.responses)

    def lines(self, width: int | None = None) -> list[str]:
        """The report: the verdict on every response."""
        return [line for response in self.responses for line in response.lines()]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the responses: lines, range of frequencies in Hz, median of the 95 % band, verdict."""
        import numpy as np

        header = ("response", "lines", "trusted lines", "lowest [Hz]", "highest [Hz]", "band95", "verdict")
        rows = [
            (
                response.name,
                len(response.frequency),
                int(np.count_nonzero(response.trusted)),
                *(float(end) for end in response.frequency[[0, -1]]),
                float(np.median(response.band95)),
                "; ".join(finding.kind for finding in response.findings) or "trusted",
            )
            for response in self.responses
        ]
        return header, rows

    def to_json(self) -> dict[str, Any]:
        """The content of ``frf.json``: the first response, and all of them if there are several."""
        from rrrgen.lab.data.run_folder import plain_record

        record = self.responses[0].to_json()
        if len(self.responses) > 1:
            record["postures"] = [response.to_json() for response in self.responses]
        return plain_record(record)

    def figures(self) -> dict[str, FigureMaker]:
        """The figure ``frf``: a Bode diagram with bands and coherence."""
        from rrrgen.lab.response.figures import plot_responses

        return {"frf": lambda: plot_responses(self.responses)}

    def write(self, folder: RunFolder) -> None:
        """Write ``frf.json`` and the Bode diagram into an open run folder."""
        folder.write_json("frf.json", self.to_json())
        folder.figure("frf", self.plot())


def frequency_response(
    data: ResponseSource,
    options: FrequencyResponseOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    **changes: Any,
) -> FrequencyResponseResult:
    """Estimate the frequency response of a joint, output over input, from recordings in closed loop.

    Every line has a 95 % band, the coherence and a verdict. Distortion, such as friction at changes of direction or
    quantisation that repeats in every period, biases all lines at once: the verdict on the recording is then negative.

    Args:
        data: a response file (schema rrrgen-response/1), or arrays by name: ``t`` (N,) in s at a constant rate, the
            excitation ``n`` (N,), the input ``u`` (N,) and the output ``q`` (N,); without ``n`` the input is the
            excitation. A list of these are realisations of the excitation, which are averaged.
        options: a :class:`FrequencyResponseOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        changes: single options by name, such as ``method="indirect"``.

    Raises:
        InputError: data or options cannot be used; an OptionError for the options.
        DerivationError: the recording is too short, or the excitation does not show in it.
    """
    chosen = with_changes(FrequencyResponseOptions, options, changes)
    require("rrrgen response frf", "scipy", "matplotlib")
    from rrrgen.lab.response.estimation import estimate_responses
    from rrrgen.lab.studies.sources import ignore, response_input

    given = response_input(data)
    (progress or ignore)(0, 0, "estimating the frequency response")
    run = Run("frf", given.files, chosen.settings() | given.settings)
    result = FrequencyResponseResult(tuple(estimate_responses(given.response, chosen.method)), run=run)
    return run.result(lambda _: result, folder, fresh)
