"""Options of the preprocessing of recordings, which several studies share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rrrgen.lab.studies.options import StudyOptions, option


@dataclass(frozen=True)
class MotionOptions(StudyOptions):
    """How the motion is reconstructed from recorded positions; None: as the mapping file says."""

    method: Literal["butterworth", "kalman", "kalman_filter", "differences", "logged"] | None = option(
        None, "How speeds and accelerations are obtained from the positions; default kalman, a smoother."
    )
    cutoff: float | None = option(
        None,
        "Cut-off frequency of the Butterworth filter; implies {method} butterworth if no method is named.",
        unit="Hz",
        above=0,
    )


@dataclass(frozen=True)
class PreprocessingOptions(MotionOptions):
    """How recordings are processed before parameters are estimated; None: as the mapping file says."""

    decimate: int | None = option(
        None,
        "Decimation factor k: low-pass filter, then keep every k-th row; default: from the bandwidth of the motion.",
        least=1,
        metavar="K",
    )
    low_speed: tuple[float, ...] | None = option(
        None, "Rows of a joint below this speed are left out, rad/s (m/s), one number a joint.", command=False
    )
