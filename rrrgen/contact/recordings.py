"""Contact thresholds from recorded positions and torques, with the expected delay of detecting a contact."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.contact.residuals import observer_residuals, step_responses
from rrrgen.contact.thresholds import ContactThresholds, Detection, contact_thresholds, expected_detection
from rrrgen.errors import InputError
from rrrgen.recordings.logs import Log
from rrrgen.signals.smoother import KalmanSmoother, tune_stretches

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

POSES = 1000
"""Number of poses, evenly spread over the recordings, at which the detection delay is computed."""

LONGEST_DELAY = 0.5
"""A contact that is not detected within this time counts as missed, s."""


def thresholds_of_recordings(
    model: Model,
    recordings: Sequence[Log],
    tuning: Sequence[tuple[float, float]] | None,
    gain: float,
    width: float,
    seconds_per_alarm: float,
    block: float,
    force: float,
) -> tuple[ContactThresholds, Detection, float]:
    """Compute contact thresholds from contact-free recordings, and how fast they detect a contact force.

    ``model`` is the compiled robot. ``tuning`` holds, for each joint, the variances of position noise and of jerk for
    the Kalman filter that computes the speeds; None estimates them. ``gain`` is the pole of the momentum observer
    (1/s), ``width`` the speed below which friction is smoothed (rad/s or m/s), ``seconds_per_alarm`` the wanted mean
    time between false alarms (s), ``block`` the length of the blocks whose maxima are taken (s), ``force`` the contact
    force at the tip (N). Samples with unusable torques split a recording.

    Returns the thresholds, the expected detection of ``force``, and the sampling period of the recordings (s). Raises
    InputError for recordings that have no torques, have different periods or are too short.
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
    found = contact_thresholds(residuals, period, seconds_per_alarm, block)
    q = np.concatenate([q for q, _ in stretches])
    responses = step_responses(kalman.matrices(period, model.n), gain, LONGEST_DELAY)
    poses = model.jacobian(q[:: max(1, len(q) // POSES)])
    return found, expected_detection(found.levels, poses, responses, period, force), period


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
