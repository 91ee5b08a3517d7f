"""A frequency response with its uncertainty and a verdict on every line."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.response.controller import Complex
from rrrgen.lab.response.distortion import Finding

WIDEST_BAND = 0.1  # relative radius of the 95 % confidence circle above which a line is not trusted
LEAST_COHERENCE = 0.1
SCHEMA = "rrrgen-frf/1"


@dataclass(frozen=True)
class FrequencyResponse:
    """The response ``P`` (L,) of the plant, output over input, at ``frequency`` (L,) in Hz.

    ``band95`` (L,) is the radius of the circle around P that contains the true response with probability 95 %, relative
    to the magnitude of P; ``variance`` (L,) that of the complex P; ``coherence`` (L,) the share of the output's power
    that is due to the excitation (14.37); ``period`` the sampling period in s. ``independent`` is the share of the
    lines that do not share data with others, one number or (L,). ``findings`` are reasons not to trust the recording as
    a whole. ``dof`` are the complex degrees of freedom of the variance, one number or (L,), ``kernel`` (lags,) the
    correlation of lines that are 0, 1, .. apart (None: independent); ``unsmoothed`` is the response before it was
    smoothed over lines, None if it was not.
    ``method`` names the estimator; ``details`` holds the kind of excitation and the figures of the checks.
    """

    name: str
    method: str
    frequency: Array
    P: Complex
    variance: Array
    band95: Array
    coherence: Array
    period: float
    independent: Array | float = 1.0
    findings: tuple[Finding, ...] = ()
    details: dict[str, Any] = field(default_factory=dict)
    dof: Array | float = np.inf
    kernel: Array | None = None
    unsmoothed: FrequencyResponse | None = None

    @property
    def reasons(self) -> list[str]:
        """For each line the reason why it is not trusted; empty text for a trusted line."""
        if self.findings:
            return [self.findings[0].kind] * len(self.frequency)
        wide, low = ~(self.band95 <= WIDEST_BAND), ~(self.coherence >= LEAST_COHERENCE)
        return [
            f"band of {100 * band:.0f} %" if is_wide else "coherence" if is_low else ""
            for band, is_wide, is_low in zip(self.band95, wide, low, strict=True)
        ]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Mask (L,) of the spectral lines whose estimate may be used."""
        return np.array([not reason for reason in self.reasons])

    def lines(self) -> list[str]:
        """The verdict on the response as text."""
        trusted, f = self.trusted, self.frequency
        lines = [
            f"{self.name}: {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz, {self.method}; 95 % band "
            f"{100 * np.median(self.band95):.2g} % (median)"
        ]
        if self.findings:
            return lines + [f"  not trusted: {finding.message}" for finding in self.findings]
        share = f"{np.count_nonzero(trusted)} of {len(trusted)} lines ({100 * np.mean(trusted):.0f} %)"
        return [*lines, f"  trusted: {share}"]

    def to_json(self) -> dict[str, Any]:
        """The response as plain data for ``results/frf.json``."""
        raw = self.unsmoothed
        return {
            "schema": SCHEMA,
            "name": self.name,
            "method": self.method,
            "sampling_period": self.period,
            "independent_share": self.independent,
            "verdict": {
                "trusted": not self.findings,
                "trusted_lines": int(np.count_nonzero(self.trusted)),
                "lines": len(self.frequency),
                "findings": [vars(finding) for finding in self.findings],
            },
            "frequency": self.frequency,
            "re": self.P.real,
            "im": self.P.imag,
            "band95": self.band95,
            "coherence": self.coherence,
            "trusted": self.trusted,
            "reason": self.reasons,
            "variance": self.variance,
            **self.details,
        } | ({} if raw is None else {"unsmoothed": {"re": raw.P.real, "im": raw.P.imag, "variance": raw.variance}})


def read_responses(path: Path) -> list[FrequencyResponse]:
    """Read the responses, one for every posture, from a ``frf.json`` of `rrrgen frf`.

    Raises :class:`InputError` for any other file.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return [_of_json(each) for each in found.get("postures", [found])]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is no frequency response of `rrrgen frf`: {error!r}") from None


def _of_json(found: dict[str, Any]) -> FrequencyResponse:
    names = ("frequency", "re", "im", "variance", "band95", "coherence")
    columns = {key: np.array(found[key], float) for key in names}
    raw = (
        {key: np.array(found["unsmoothed"][key], float) for key in ("re", "im", "variance")}
        if "unsmoothed" in found
        else {}
    )
    period = float(found["sampling_period"])
    independent = np.broadcast_to(np.array(found["independent_share"], float), columns["frequency"].shape)
    lengths = {len(column) for column in (*columns.values(), *raw.values())}
    if len(lengths) > 1 or not (period > 0.0 and np.all((independent > 0.0) & (independent <= 1.0))):
        raise ValueError("columns of different length, or no period")
    response = FrequencyResponse(
        name=str(found["name"]),
        method=str(found["method"]),
        frequency=columns["frequency"],
        P=columns["re"] + 1j * columns["im"],
        variance=columns["variance"],
        band95=columns["band95"],
        coherence=columns["coherence"],
        period=period,
        independent=independent,
        findings=tuple(Finding(**each) for each in found["verdict"]["findings"]),
    )
    if not raw:
        return response
    unsmoothed = replace(response, P=raw["re"] + 1j * raw["im"], variance=raw["variance"])
    return replace(response, unsmoothed=unsmoothed)
