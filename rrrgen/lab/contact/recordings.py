"""What recordings without contact tell: thresholds, covariance of the residuals, and the delay of detection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.lab.contact.covariance import ResidualCovariance, residual_covariance
from rrrgen.lab.contact.residuals import observer_residuals, step_responses
from rrrgen.lab.contact.thresholds import ContactThresholds, Detection, contact_thresholds, expected_detection
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.data.smoother import KalmanSmoother, tune_stretches

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

SAMPLES = 20_000
"""Number of samples, evenly spread over the recordings, from which the covariance is found."""

POSES = 1000
"""Number of poses, evenly spread over the recordings, at which the detection delay is computed."""

LONGEST_DELAY = 0.5
"""A contact that is not detected within this time counts as missed, s."""


@dataclass(frozen=True)
class ContactFindings:
    """What recordings with the sampling ``period`` (s), made without contact, tell about contacts.

    ``detection`` tells how fast a force at the tip exceeds the ``thresholds``; ``covariance`` is that of the residuals.
    """

    thresholds: ContactThresholds
    covariance: ResidualCovariance
    detection: Detection
    gain: float
    period: float

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the form written to contact.json."""
        return self.thresholds.to_json() | {
            "covariance": self.covariance.matrix,
            "covariance_enlarged": self.covariance.enlarged,
            "gain": self.gain,
            "period": self.period,
            "detection": self.detection.__dict__,
        }


def findings_of_recordings(
    model: Model,
    recordings: Sequence[Log],
    tuning: Sequence[tuple[float, float]] | None,
    gain: float,
    width: float,
    seconds_per_alarm: float,
    block: float,
    force: float,
) -> ContactFindings:
    """Compute contact thresholds from contact-free recordings, and how fast they detect a contact force.

    ``model`` is the compiled robot. ``tuning`` holds, for each joint, the variances of position noise and of jerk for
    the Kalman filter that computes the speeds; None estimates them. ``gain`` is the pole of the momentum observer
    (1/s), ``width`` the speed below which friction is smoothed (rad/s or m/s), ``seconds_per_alarm`` the wanted mean
    time between false alarms (s), ``block`` the length of the blocks whose maxima are taken (s), ``force`` the contact
    force at the tip (N). Samples with unusable torques split a recording.

    Raises InputError for recordings that have no torques, have different periods or are too short.
    """
    periods = {round(recording.period, 12) for recording in recordings}
    if len(periods) > 1:
        raise InputError("the recordings have different sampling periods: thresholds hold for one")
    period = recordings[0].period
    stretches = [piece for recording in recordings for piece in _usable(recording)]
    if not stretches:
        raise InputError("no stretch of the recordings has usable torques of all joints")
    if tuning is None:
        tuned = tune_stretches([q for q, _ in stretches], period)
        kalman = KalmanSmoother(tuned.var_eta, tuned.var_xi, smooth=False)
    else:
        kalman = KalmanSmoother(tuple(eta for eta, _ in tuning), tuple(xi for _, xi in tuning), smooth=False)
    residuals = [observer_residuals(model, q, tau, period, kalman, gain, width) for q, tau in stretches]
    found = contact_thresholds(residuals, period, gain, seconds_per_alarm, block)
    r = np.concatenate(residuals)
    q = np.concatenate([q[len(q) - len(r) :] for (q, _), r in zip(stretches, residuals, strict=True)])
    every = max(1, len(q) // SAMPLES)
    J = model.jacobian(q[::every])
    responses = step_responses(kalman.matrices(period, model.n), gain, LONGEST_DELAY)
    detection = expected_detection(found, J[:: max(1, len(J) // POSES)], responses, period, gain, force)
    return ContactFindings(found, residual_covariance(r[::every], J), detection, gain, period)


def _usable(recording: Log) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions and torques, (m, n) each, of the uninterrupted stretches where the torques of all joints are valid."""
    pieces = []
    for part in recording.parts():
        if part.tau is None:
            raise InputError("contact detection needs recorded torques")
        good = np.concatenate([[False], np.all(part.valid, axis=1), [False]])
        edges = np.flatnonzero(np.diff(good.astype(int)))
        pieces += [(part.q[a:b], part.tau[a:b]) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 2]
    return pieces
