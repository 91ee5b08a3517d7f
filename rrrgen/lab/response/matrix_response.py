"""Frequency responses of a whole arm, from the torques of all n joints to all n positions, from n experiments or more.

In every posture the arm is recorded in n experiments at least, each under a periodic excitation of its own that is
added in the control loop: one joint after the other, or all joints with phases that differ. At a line of the spectrum
the torques and positions of the experiments are the columns of U and Y (n, E), and ``Y = G U``: the response is ``G = Y
U^-1``, with more experiments by least squares. The loop between Y and U does not bias it, since both are averaged over
periods of an excitation that does not depend on the noise. The noise of an experiment is found between the harmonics of
its period.

The torques are those that act. A drive holds its torque from one sample to the next; what is recorded, the mean over a
sample about its time, is related to that torque by a known factor, and the response of a model in z^-1 by another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.response.local_polynomial import LineEstimates, between_harmonics, radius
from rrrgen.lab.response.modal_fit import common_modes
from rrrgen.lab.response.nonlinear_distortion import (
    LARGEST_RATIO,
    MATERIAL,
    Caution,
    check_repetition,
    scatter_ratio,
    times,
)
from rrrgen.lab.response.response_model import Complex, Resonance

SCHEMA = "rrrgen-frf-matrix/1"
HIGHEST = 0.4  # of the sampling rate: highest line, above which the mean over a sample leaves little of a held torque
EXCITED = 1e-3  # share of the largest harmonic of a torque above which a harmonic is examined
SURELY = 10.0  # standard deviations of the noise by which the weakest combination of torques must stand out
SAME_POSTURE = 0.05  # rad (m) by which the mean positions of the experiments of a posture may differ
FEWEST_PERIODS, SETTLED = 2, 3  # of periods, and from how many on the first is left out
SYMMETRIC = 3.0  # deviations by which a response and that with torque and position exchanged may differ in the median


@dataclass(frozen=True, eq=False)
class MatrixResponse:
    """The response ``G`` (L, n, n) of an arm from the torques of its n joints to their positions, at L lines.

    ``frequency`` (L,) is in Hz, G in rad/(N m) (m/N).
    ``G[l, i, j]`` is position i over torque j; ``variance`` (L, n, n) is that of the complex elements, ``band95`` the
    radius of their 95 % circles relative to their magnitude, ``dof`` (L, n, n) the complex degrees of freedom of the
    variance. ``posture`` (n,) is the mean of the positions, ``period`` the sampling period in s, ``experiments`` their
    number. ``resonances`` are the modes that all elements share, ``table`` the numbers of modes that were compared.
    ``asymmetry`` is the median difference of an element and that with torque and position exchanged, in deviations: a
    linear arm has none. ``findings`` are reasons not to trust the recordings.
    """

    name: str
    joints: tuple[str, ...]
    posture: Array
    frequency: Array
    G: Complex
    variance: Array
    dof: Array
    period: float
    experiments: int
    asymmetry: float
    resonances: tuple[Resonance, ...] = ()
    findings: tuple[Caution, ...] = ()
    table: tuple[dict[str, Any], ...] = ()

    @property
    def band95(self) -> Array:
        """Radius (L, n, n) of the 95 % circle of every element, relative to its magnitude."""
        return np.asarray(radius(self.variance, self.dof) / np.abs(self.G))

    def lines(self) -> list[str]:
        """The verdict and the resonances as text."""
        f, diagonal = self.frequency, np.median(np.diagonal(self.band95, axis1=1, axis2=2), axis=0)
        where = ", ".join(f"{name} {at:.4g}" for name, at in zip(self.joints, self.posture, strict=True))
        lines = [
            f"{self.name} ({where}): {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz, {self.experiments} experiments; "
            f"95 % band of the diagonal {', '.join(f'{100 * band:.2g}' for band in diagonal)} % (median)"
        ]
        lines += [f"  not trusted: {finding.message}" for finding in self.findings]
        return [*lines, *(f"  resonance {mode}" for mode in self.resonances)]

    def to_json(self) -> dict[str, Any]:
        """The response as plain data."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "joints": list(self.joints),
            "posture": self.posture,
            "experiments": self.experiments,
            "sampling_period": self.period,
            "frequency": self.frequency,
            "re": self.G.real,
            "im": self.G.imag,
            "variance": self.variance,
            "band95": self.band95,
            "asymmetry": self.asymmetry,
            "verdict": {"trusted": not self.findings, "findings": [vars(finding) for finding in self.findings]},
            "resonances": [mode.to_json() for mode in self.resonances],
            "table": list(self.table),
        }


@dataclass(frozen=True, eq=False)
class _Experiment:
    """Harmonics ``Z`` (K, 2 n) of an experiment, torques and then positions.

    ``noise`` (K, 2 n, 2 n) is their covariance, ``dof`` its complex degrees of freedom.
    """

    Z: Complex
    noise: Complex
    dof: int


def matrix_responses(recordings: Sequence[Log], period: float, held: bool = True) -> list[MatrixResponse]:
    """Estimate the response in every posture of ``recordings``; each posture has as many of them as joints, or more.

    ``period`` is that of the excitation, s. Of three or more recorded periods the first is left out, in which the
    motion settles. ``held`` says that the drives hold their torques from one sample to the next; otherwise the record
    is one of torques that change smoothly.

    Raises InputError for recordings that do not belong together, DerivationError where they determine no response.
    """
    groups = _postures(recordings)
    names = ["arm"] if len(groups) == 1 else [f"posture{number}" for number in range(1, len(groups) + 1)]
    return [_matrix(group, period, held, name) for group, name in zip(groups, names, strict=True)]


def _postures(recordings: Sequence[Log]) -> list[list[Log]]:
    """The recordings by posture, in the order of their first; raises InputError where one has too few."""
    first = recordings[0]
    for recording in recordings:
        if recording.joints != first.joints or abs(recording.period / first.period - 1.0) > 1e-6:
            raise InputError("the recordings have different joints or sampling rates")
        if recording.tau is None:
            raise InputError("a recording has no torques: there is no response to them")
    groups: list[list[Log]] = []
    for recording in recordings:
        mean = recording.q.mean(axis=0)
        near = [group for group in groups if np.max(np.abs(group[0].q.mean(axis=0) - mean)) < SAME_POSTURE]
        if near:
            near[0].append(recording)
        else:
            groups.append([recording])
    counts = [f"{len(g)} at {np.round(g[0].q.mean(axis=0), 2).tolist()}" for g in groups if len(g) < first.n]
    if counts:
        raise InputError(
            f"a posture needs as many experiments as the arm has joints, {first.n}, each with its own excitation; "
            f"there are {'; '.join(counts)}"
        )
    return groups


def _matrix(recordings: Sequence[Log], period: float, held: bool, name: str) -> MatrixResponse:
    """The response of the arm in one posture."""
    n, dt = recordings[0].n, recordings[0].period
    samples = round(period / dt)
    if samples < 2 or abs(samples * dt - period) > 1e-3 * dt * max(1.0, 1e-3 * samples):
        raise InputError(f"the period of {period:.9g} s is not a whole number of samples of {dt:.9g} s")
    spectra = [_spectrum(recording, samples) for recording in recordings]
    k = _excited_harmonics(spectra, samples, n)
    x = np.pi * k / samples
    factor = np.tan(x) / x if held else np.ones(len(x))
    experiments = [_experiment(spectrum, k, factor, n) for spectrum in spectra]
    k, experiments = _select_clear_harmonics(k, experiments, n)
    frequency, x = k / (samples * dt), np.pi * k / samples
    G, variance, dof, findings = _estimate_response(experiments, n)
    of_steps = np.sinc(x / np.pi) * np.exp(-1j * x)  # response of a held torque to its samples
    responses, spread = (array.reshape(len(k), -1).T for array in (G, variance))
    resonances, table = common_modes(frequency, responses * of_steps, spread * np.abs(of_steps) ** 2, dt)
    variance, scattered = _widen_by_scatter(k, frequency, resonances, G, variance, dof, recordings[0].joints)
    findings += scattered
    asymmetry, relative = _asymmetry(G, variance)
    if asymmetry > SYMMETRIC and relative > MATERIAL:
        message = (
            f"the responses of joint i to joint j and of j to i differ by {100.0 * relative:.2g} % of the diagonal "
            f"({asymmetry:.3g} deviations) in the median, and are equal for a linear arm: is the torque constant of a "
            "joint wrong, a column exchanged, or a torque late?"
        )
        findings.append(Caution("asymmetry", asymmetry, SYMMETRIC, message))
    return MatrixResponse(
        name=name,
        joints=recordings[0].joints,
        posture=np.mean([spectrum.posture for spectrum in spectra], axis=0),
        frequency=frequency,
        G=G,
        variance=variance,
        dof=dof,
        period=dt,
        experiments=len(recordings),
        asymmetry=asymmetry,
        resonances=resonances,
        findings=tuple(findings),
        table=table,
    )


class _Spectrum(NamedTuple):
    """Spectrum ``F`` (M samples, 2 n) of torques and positions over M whole ``periods``, and their mean ``posture``."""

    F: Complex
    periods: int
    posture: Array


def _spectrum(recording: Log, samples: int) -> _Spectrum:
    """The spectrum over the last whole periods of a recording.

    The first sample is left out, at which there may be no torque where torques act later than they are recorded.
    """
    parts = [part.align_torques() for part in recording.parts()]
    M = (len(recording) - 1) // samples
    if len(parts) > 1 or M < FEWEST_PERIODS:
        what = "has a gap" if len(parts) > 1 else f"holds {len(recording) / samples:.3g} periods of the excitation"
        raise DerivationError(f"a recording {what}: record {SETTLED} whole periods at least, better ten, without gaps")
    M -= M >= SETTLED
    count = M * samples
    if not np.all(parts[0].valid[-count:-1]):
        raise DerivationError("torques are missing in a recording, or at their limit")
    rows = np.concatenate([np.asarray(parts[0].tau), parts[0].q], axis=1)[-count:]
    slope = (rows[samples:] - rows[:-samples]).mean(axis=0) / samples  # of a motion at constant speed
    rows = rows - np.multiply.outer(np.arange(count), slope)
    return _Spectrum(np.fft.fft(rows - rows.mean(axis=0), axis=0) / count, M, parts[0].q[-count:].mean(axis=0))


def _excited_harmonics(spectra: Sequence[_Spectrum], samples: int, n: int) -> NDArray[np.int64]:
    """Numbers of the harmonics that are strong in the torque of some joint, in any of the experiments."""
    parts = [spectrum.F[: spectrum.periods * (samples // 2) : spectrum.periods, :n] for spectrum in spectra]
    size = np.sqrt(np.sum(np.abs(parts) ** 2, axis=0))
    size[0] = 0.0
    strong = np.any(size > EXCITED * size.max(axis=0).clip(np.finfo(float).tiny), axis=1)
    k = np.flatnonzero(strong)
    return np.asarray(k[(k > 0) & (k < HIGHEST * samples)])


def _experiment(spectrum: _Spectrum, k: NDArray[np.int64], factor: Array, n: int) -> _Experiment:
    """The harmonics of an experiment without the transient; ``factor`` (K,) makes recorded torques those that act."""
    F, M, _ = spectrum
    transient, V, leverage, dof = between_harmonics(F, k, M)
    scale = np.ones((len(k), 2 * n))
    scale[:, :n] = factor[:, None]
    noise = (1.0 + leverage) * V * scale[:, :, None] * scale[:, None, :]
    return _Experiment((F[k * M] - transient) * scale, noise, dof)


def _select_clear_harmonics(
    k: NDArray[np.int64], experiments: Sequence[_Experiment], n: int
) -> tuple[NDArray[np.int64], list[_Experiment]]:
    """The harmonics at which every combination of the torques was excited far above the noise."""
    U = np.stack([experiment.Z[:, :n] for experiment in experiments], axis=2)
    noise = np.mean([experiment.noise[:, :n, :n] for experiment in experiments], axis=0)
    least = 1e-20 * np.sum(np.abs(U) ** 2, axis=(1, 2)) + np.finfo(float).tiny
    white = np.linalg.solve(np.linalg.cholesky(noise + least[:, None, None] * np.eye(n)), U)
    clear = np.linalg.svd(white, compute_uv=False)[:, -1] > SURELY
    if not clear.any():
        raise DerivationError(
            f"at none of {len(k)} lines all torques stand out from the noise in different combinations: is the period "
            "that of the excitation, and does it differ from experiment to experiment?"
        )
    return k[clear], [
        _Experiment(experiment.Z[clear], experiment.noise[clear], experiment.dof) for experiment in experiments
    ]


def _estimate_response(experiments: Sequence[_Experiment], n: int) -> tuple[Complex, Array, Array, list[Caution]]:
    """The response (K, n, n), variances and degrees of freedom of its elements, reasons not to trust it.

    Errors of the experiments e add to ``sum_e (dy_e - G du_e) (U^+)_e``. What more experiments than joints leave of
    ``Y - G U`` beyond their noise is distortion, and widens the variance.
    """
    Z = np.stack([experiment.Z for experiment in experiments], axis=2)
    U, Y = Z[:, :n], Z[:, n:]
    inverse = np.linalg.pinv(U)
    G = Y @ inverse
    a = np.concatenate([-G, np.broadcast_to(np.eye(n), G.shape)], axis=2)
    noise = np.stack(
        [np.einsum("kia,kab,kib->ki", a, experiment.noise, a.conj()).real for experiment in experiments]
    )  # (E, K, n)
    shares = noise[..., None] * np.abs(inverse.transpose(1, 0, 2))[:, :, None, :] ** 2
    variance = np.maximum(shares.sum(axis=0), np.finfo(float).tiny)
    freedom = np.array([experiment.dof for experiment in experiments], float)
    dof = variance**2 / np.maximum(np.einsum("ekij,e->kij", shares**2, 1.0 / freedom), np.finfo(float).tiny)
    spare = len(experiments) - n
    if not spare:
        return G, variance, dof, []
    from scipy.stats import chi2

    left = np.sum(np.abs(Y - G @ U) ** 2, axis=2)
    kept = 1.0 - np.einsum("kej,kje->ke", inverse, U).real
    expected = np.einsum("eki,ke->ki", noise, kept)
    typical = float(chi2.ppf(0.5, 2 * spare)) / (2 * spare)
    ratio = float(np.median(left / np.maximum(expected, np.finfo(float).tiny))) / typical
    size = float(np.median(np.sqrt(left / np.sum(np.abs(Y) ** 2, axis=2))))
    if not (ratio > LARGEST_RATIO and size > MATERIAL):
        return G, variance, dof, []
    message = (
        f"the experiments differ {times(ratio)} as much as their noise from one linear response (limit "
        f"{LARGEST_RATIO}): friction at changes of direction, a posture that moves, or a limit of torque"
    )
    return G, ratio * variance, dof, [Caution("distortion", ratio, LARGEST_RATIO, message)]


def _widen_by_scatter(
    k: NDArray[np.int64],
    frequency: Array,
    resonances: Sequence[Resonance],
    G: Complex,
    variance: Array,
    dof: Array,
    joints: Sequence[str],
) -> tuple[Array, list[Caution]]:
    """The variances (K, n, n), widened by the scatter from harmonic to harmonic; a finding if it is too large.

    The scatter is that of the response without the poles of its ``resonances``, which is smooth from line to line.
    """
    smooth = np.ones(len(k), complex)
    for mode in resonances:
        ratio = frequency / mode.frequency
        smooth *= 1.0 - ratio**2 + 2j * mode.damping * ratio
    wider, findings = variance.copy(), list[Caution]()
    for i, j in np.ndindex(G.shape[1:]):
        P, spread = G[:, i, j] * smooth, variance[:, i, j] * np.abs(smooth) ** 2
        lines = LineEstimates(
            frequency=frequency,
            line=k,
            G=np.stack([np.ones_like(P), P], axis=1),
            covariance=spread[:, None, None] * np.diag([0.0, 1.0]),
            dof=dof[:, i, j],
            signal=np.abs(P) ** 2,
            noise=spread,
        )
        wider[:, i, j] *= scatter_ratio(lines, P, spread)
        caution = check_repetition(lines, P, spread)[0] if i == j and not findings else None
        if caution is not None:
            findings.append(replace(caution, message=f"{joints[i]}: {caution.message}"))
    return wider, findings


def _asymmetry(G: Complex, variance: Array) -> tuple[float, float]:
    """Median difference of exchanged elements, in deviations and relative to the diagonal elements; 0 for one joint."""
    i, j = np.triu_indices(G.shape[1], 1)
    if not len(i):
        return 0.0, 0.0
    off = np.abs(G[:, i, j] - G[:, j, i])
    deviations = np.sqrt(np.median(off**2 / (variance[:, i, j] + variance[:, j, i])) / np.log(2.0))
    return float(deviations), float(np.median(off / np.sqrt(np.abs(G[:, i, i] * G[:, j, j]))))
