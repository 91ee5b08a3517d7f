"""Fitting of models to recordings or frequency responses, one for every posture, with reasons where none is fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.response.difference_models import fit_difference_model
from rrrgen.lab.response.estimation import estimate_one, estimate_responses
from rrrgen.lab.response.frequency_response import FrequencyResponse
from rrrgen.lab.response.modal_fit import fit_modes
from rrrgen.lab.response.resonances import modes_over_postures
from rrrgen.lab.response.response_file import ResponseFile, ResponseRecording, read_recordings
from rrrgen.lab.response.response_model import Resonance, ResponseModel

APART = 0.02  # relative distance of the frequencies of two resonances


@dataclass(frozen=True)
class FittedModels:
    """Models fitted to postures, the ``measured`` responses to draw with them, and postures without a model.

    ``refused`` maps the name of each posture without a model to the reason. ``overlooked`` are resonances of the
    frequency response that a difference equation does not have.
    """

    models: list[ResponseModel]
    measured: list[FrequencyResponse]
    refused: dict[str, str]
    overlooked: tuple[Resonance, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The contents of ``results/response_model.json``: the first posture, and all of them if there are several."""
        record = self.models[0].to_json()
        record["overlooked"] = [mode.to_json() for mode in self.overlooked]
        if len(self.models) + len(self.refused) > 1:
            record["postures"] = [model.to_json() for model in self.models]
            record["resonances_over_postures"] = [mode.to_json() for mode in modes_over_postures(self.models)]
            record["refused"] = self.refused
        return record


def fit_responses(measured: Sequence[FrequencyResponse]) -> FittedModels:
    """Fit modes to every response that can be trusted; raises :class:`DerivationError` if none can."""
    models, refused = [], {}
    for response in measured:
        try:
            models.append(fit_modes(response))
        except DerivationError as error:
            refused[response.name] = str(error)
    if not models:
        raise DerivationError("; ".join(refused.values()))
    return FittedModels(models, list(measured), refused)


def fit_recordings(response: ResponseFile, rows: tuple[int, int] | None, method: str) -> FittedModels:
    """Fit models to the recordings of a response file.

    ``method`` is "modes", "arx", "armax", "output_error", "subspace", "indirect" or "auto". The last fits modes to the
    frequency response where the recording has an excitation besides the input (a closed loop) or there are several
    recordings, and a difference equation otherwise. ``rows`` (first, last, counted from 1) are fitted, the others test
    the model.
    """
    records = read_recordings(response)
    if len(records) > 1:
        if rows is not None or method not in ("auto", "modes"):
            raise InputError(
                "several recordings are fitted by their frequency responses: rows or another method need one"
            )
        return fit_responses(estimate_responses(response))
    record = records[0]
    closed = response.excitation is not None and bool((record.n != record.u).any())
    if method == "modes" or (method == "auto" and closed):
        return _modes_of(record, response.period, rows)
    model = fit_difference_model(record, rows, method, response.controller)
    try:
        measured = estimate_one(record, response.period)
    except DerivationError:  # too short for a frequency response to show beside the model
        return FittedModels([model], [], {})
    return FittedModels([model], [measured], {}, _overlooked_resonances(model, measured))


def _overlooked_resonances(model: ResponseModel, measured: FrequencyResponse) -> tuple[Resonance, ...]:
    """The resonances of which the frequency response is certain and that the model does not have."""
    try:
        modes = fit_modes(measured).resonances
    except DerivationError:
        return ()
    return tuple(
        mode
        for mode in modes
        if not mode.uncertain
        and all(abs(resonance.frequency / mode.frequency - 1.0) > APART for resonance in model.resonances)
    )


def _modes_of(record: ResponseRecording, period: float | None, rows: tuple[int, int] | None) -> FittedModels:
    """Fit modes to the response of the chosen rows; if there are enough rows after them, score the model on these."""
    if rows is None:
        return fit_responses([estimate_one(record, period)])
    first, last = rows
    if last > len(record.q):
        raise InputError(f"rows {first}:{last} of a recording with rows 1:{len(record.q)}")
    fitted_models = fit_responses([estimate_one(_part(record, first - 1, last), period)])
    fit = fitted_models.models[0].fit
    fit["fitted_rows"] = [first, last]
    try:
        other = estimate_one(_part(record, last, len(record.q)), period)
    except DerivationError:  # too short
        return fitted_models
    use = other.trusted
    if not use.any():
        return fitted_models
    relative = np.abs(fitted_models.models[0].response(other.frequency[use]) / other.P[use] - 1.0)
    fit |= {
        "value": 100.0 * (1.0 - float(rms(relative))),
        "protocol": "frequency response of the scored rows at its trusted lines, which includes their own noise",
        "scored_rows": [last + 1, len(record.q)],
        "held_out": True,
        "lines": int(np.count_nonzero(use)),
        "largest_relative_error_95": float(np.quantile(relative, 0.95)),
    }
    return fitted_models


def _part(record: ResponseRecording, start: int, stop: int) -> ResponseRecording:
    return replace(record, **{name: getattr(record, name)[start:stop] for name in ("n", "u", "q")})


# ------------------------------------------------------------------------------------------------------------------
# The true frequencies that a resonance of a sampled recording may stand for, and how a second rate tells them apart.
#
# Sampling at the rate fs folds the pole of a mode: with its frequency f and damping zeta, ``zeta f`` and ``f sqrt(1 -
# zeta^2)`` up to multiples of fs and sign are all that the samples hold. Every ``|k fs +- f_d|`` below the bandwidth of
# what is measured is a candidate, each with the decay of the measured mode. Behind a sampled hold all have the same
# poles, so that nothing in one recording decides.
# ------------------------------------------------------------------------------------------------------------------

ANALOGUE_BANDWIDTH = 5.0  # of drives and sensors, over the sampling rate, where nothing else is known


def aliases(mode: Resonance, rate: float, bandwidth: float | None = None) -> list[Resonance]:
    """All modes below the analogue ``bandwidth`` (Hz) with the samples of ``mode`` at ``rate`` (Hz); ``mode`` leads.

    The default bandwidth is five times the rate. The standard deviations of the frequencies are that of the mode;
    those of the dampings keep their share of the value.
    """
    highest = ANALOGUE_BANDWIDTH * rate if bandwidth is None else bandwidth
    decay = mode.damping * mode.frequency
    damped = mode.frequency * math.sqrt(max(0.0, 1.0 - mode.damping**2))
    modes = [mode]
    for k in range(1, int(highest / rate) + 2):
        for image in (k * rate - damped, k * rate + damped):
            frequency = math.hypot(image, decay)
            if frequency <= highest:
                damping = decay / frequency
                share = None if mode.damping_std is None or not mode.damping else mode.damping_std / mode.damping
                std = None if share is None else abs(share * damping)
                modes.append(replace(mode, frequency=frequency, damping=damping, damping_std=std))
    return modes


def rates_decide(rate: float, other: float, bandwidth: float) -> bool:
    """Whether no two frequencies below ``bandwidth`` (Hz) have the same images at both rates (Hz)."""
    low, high = sorted((rate, other))
    multiples = (k * high for k in range(1, int(2.0 * bandwidth / high) + 1))
    return not any(abs(multiple / low - round(multiple / low)) < 1e-6 for multiple in multiples)


def second_rate(rate: float) -> float:
    """A second sampling rate (Hz) that tells the candidates apart: a tenth faster, no simple ratio of the first."""
    return 1.1 * rate if rates_decide(rate, 1.1 * rate, ANALOGUE_BANDWIDTH * rate) else 1.13 * rate


def alias_lines(modes: Sequence[Resonance], rate: float) -> list[str]:
    """A sentence for each of ``modes`` on the true frequencies that it may stand for, sampled at ``rate`` (Hz)."""
    lines = []
    for mode in modes:
        others = aliases(mode, rate)[1:]
        shown = ", ".join(f"{alias.frequency:.4g} Hz (damping {alias.damping:.3g})" for alias in others[:3])
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        lines.append(f"{mode.frequency:.4g} Hz may stand for {shown}{more}")
    if lines:
        lines.append(
            f"no recording at {rate:g} Hz tells these frequencies apart: low-pass filters before the sampling exclude "
            f"those above {0.5 * rate:g} Hz, or record again at {second_rate(rate):g} Hz and compare"
        )
    return lines
