"""Checks of a recording for Coulomb friction at a velocity that changes its sign, and for an input that is limited.

Such friction biases a response, which confidence bands do not show. The model is ``Q = P (U - f S)`` with S the
spectrum of sgn(velocity). The part of S that is uncorrelated with the excitation n acts as an independent input, from
which the coefficient f is estimated over all lines. The part correlated with n biases P by ``f G_s/G_u``.

A limit of torque or current acts alike, with the cube of u in the place of the sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.response.controller import Complex
from rrrgen.lab.response.distortion import Finding
from rrrgen.lab.response.local_polynomial import (
    LineEstimates,
    regress_window,
    remove_smooth,
    spectrum,
    whole_periods,
)
from rrrgen.lab.response.noise_lines import LEAST_ROUGHNESS, rough_power
from rrrgen.lab.response.response_file import ResponseRecording

MATERIAL_BIAS = 0.002  # bias above this share of the response counts; the scatter by friction is larger than its bias
MATERIAL_FORCE = 0.01  # friction above this share of the input's root mean square counts
SIGNIFICANT = 5.0  # standard deviations from zero at which the friction coefficient is significant
SLOW_SHARE = 0.01  # least share of the samples that must move in the other direction for a reversal to count
NOISE_SHARE = 0.001  # the same where the excitation is noise, since no scatter from harmonic to harmonic shows friction
FRICTION_WINDOW = 6  # lines at either side in a window
SMOOTHING = 11  # samples in the window of the polynomial that differentiates the output
SLOW_PART = 20  # velocities are averaged over the recording's length divided by this, to find slow reversals


@dataclass(frozen=True)
class _Force:
    """An estimate of friction.

    ``force`` is in units of the input, ``certain`` is the force in standard deviations, and ``bias`` the relative bias
    of P that 90 % of the lines do not exceed.
    """

    force: float
    certain: float
    bias: float = 0.0


def check_friction(record: ResponseRecording, samples: int | None, lines: LineEstimates, P: Complex) -> Finding | None:
    """Check whether part of the input overcomes Coulomb friction at a velocity that changes its sign.

    ``samples`` is the period of the excitation (None: noise), ``P`` (L,) the response at ``lines``. Returns a finding
    against the recording where friction biases the response or the joint reverses its motion; otherwise None.
    """
    from scipy.signal import savgol_filter

    if len(record.q) < 40 * FRICTION_WINDOW:
        return None
    velocity = savgol_filter(record.q, SMOOTHING, 2, deriv=1)
    back = _share_back(velocity)
    if back < (NOISE_SHARE if samples is None else SLOW_SHARE):
        return None
    width = samples or len(velocity) // SLOW_PART
    turns = _share_back(np.convolve(velocity, np.ones(width) / width, "valid")) >= SLOW_SHARE
    sign = np.sign(velocity)
    found = [_of_noise(record, sign) if samples is None else _of_periods(record, sign, samples)]
    if samples is not None and turns:
        found.append(_between_harmonics(record, sign, samples, lines, P))
    large = MATERIAL_FORCE * float(np.std(record.u))
    for each in found:
        if each is None or each.certain <= SIGNIFICANT:
            continue
        if each.bias <= MATERIAL_BIAS and not (turns and abs(each.force) > large):
            continue
        harm = f"friction biases the response by up to {100 * each.bias:.1f} % and scatters it"
        if each.bias <= MATERIAL_BIAS:
            harm = "the joint turns round in the recording, and friction there is no part of a linear response"
        message = (
            f"the velocity changes sign ({100 * back:.0f} % of the samples go back), and with it "
            f"a force of {abs(each.force):.3g} in units of the input ({each.certain:.0f} deviations from none): {harm}"
            "; move the joint so fast that it never turns"
        )
        return Finding("friction", each.certain, SIGNIFICANT, message)
    return None


def check_limits(record: ResponseRecording) -> Finding | None:
    """Check whether an input of noise acts less than in proportion where it is large, as behind a limit of torque.

    Such a limit lowers the response at all lines alike, within a narrow band. The cube of the input enters without its
    part in proportion to the input. Returns a finding against the recording, or None.
    """
    if len(record.u) < 40 * FRICTION_WINDOW:
        return None
    u = record.u - record.u.mean()
    power = float(np.mean(u**2))
    cube = u**3 / power - float(np.mean(u**4)) / power**2 * u
    found = _of_noise(record, cube)
    if found is None or found.certain <= SIGNIFICANT or abs(found.force) * np.std(cube) <= MATERIAL_FORCE * np.std(u):
        return None
    message = (
        f"the input acts less than in proportion where it is large ({found.certain:.0f} deviations from proportion): a "
        "limit of torque or current; record the input after the limit, or excite less"
    )
    return Finding("limit", found.certain, SIGNIFICANT, message)


def _share_back(velocity: Array) -> float:
    """Share of the samples in which the joint moves in its less frequent direction."""
    return float(min(np.mean(velocity > 0.0), np.mean(velocity < 0.0)))


def _of_noise(record: ResponseRecording, sign: Array) -> _Force | None:
    return _beside_excitation(spectrum(np.column_stack([record.n, record.u, record.q, sign])))


def _of_periods(record: ResponseRecording, sign: Array, samples: int) -> _Force | None:
    """Estimate the friction force from the mean period of the recording."""
    rows, signs, M = _with_sign(record, sign, samples)
    both = np.hstack([rows, signs]).reshape(M, samples, 4).mean(axis=0)
    return _beside_excitation(np.fft.fft(both - both.mean(axis=0), axis=0))


def _with_sign(record: ResponseRecording, sign: Array, samples: int) -> tuple[Array, Array, int]:
    rows, M = whole_periods(record, samples)
    signed = ResponseRecording(record.name, record.period, sign, record.u, record.q)
    return rows, whole_periods(signed, samples)[0][:, :1], M


def _beside_excitation(F: Complex) -> _Force | None:
    """Estimate the friction force from the spectra ``F`` (lines, 4) of n, u, q and sgn(velocity).

    Within windows of neighbouring lines the responses to n are smooth and can be removed.
    """
    power = np.abs(F[: len(F) // 2, 0])
    active = np.flatnonzero(power > 0.03 * power[1:].max())
    width = FRICTION_WINDOW
    k = np.arange(max(width, active[0]), min(len(F) // 2 - width, active[-1]), 2 * width + 1)
    if len(k) < 4:
        return None
    around = F[k[:, None] + np.arange(-width, width + 1)]
    n = around[:, :, 0]  # where it is smooth there is leakage alone, beside the band, and no response can be told
    around = around[rough_power(n) > LEAST_ROUGHNESS * np.mean(np.abs(n) ** 2, axis=1)]
    if len(around) < 4:
        return None
    G, residual, _, dof = regress_window(around[:, :, :1], around[:, :, 1:])
    P = (G[:, 1] / G[:, 0])[:, None]
    force, certain = _coefficient(residual[:, :, 1] - P * residual[:, :, 0], -P * residual[:, :, 2], dof)
    return _Force(force, certain, float(np.quantile(np.abs(force * G[:, 2] / G[:, 0]), 0.9)))


def _between_harmonics(
    record: ResponseRecording, sign: Array, samples: int, lines: LineEstimates, P: Complex
) -> _Force | None:
    """Estimate the friction force from the lines between the harmonics.

    At these lines sgn(velocity) has a part only if the joint does not reverse in every period alike.
    """
    rows, signs, M = _with_sign(record, sign, samples)
    both = np.hstack([rows[:, 1:], signs])
    residual, dof = remove_smooth(np.fft.fft(both - both.mean(axis=0), axis=0), lines.line, M)
    at = P[:, None]
    force, certain = _coefficient(residual[:, :, 1] - at * residual[:, :, 0], -at * residual[:, :, 2], dof)
    return _Force(force, certain)


def _coefficient(e: Complex, s: Complex, dof: int) -> tuple[float, float]:
    """Estimate the real factor f in ``e = f s`` over windows (L, lines), weighted by their noise.

    Returns f, and f divided by its standard deviation.
    """
    weight = dof / np.maximum(np.sum(np.abs(e) ** 2, axis=1), 1e-300)
    information = max(float(np.sum(weight * np.sum(np.abs(s) ** 2, axis=1))), 1e-300)
    force = float(np.sum(weight * np.sum(s.conj() * e, axis=1).real)) / information
    return force, abs(force) * float(np.sqrt(2.0 * information))
