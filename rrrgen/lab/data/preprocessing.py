"""Preprocessing of a recording before estimation: reconstruction of the motion, decimation, exclusion of slow samples.

The settings come from the section ``processing`` of a mapping file and from command-line options.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext import signal_units as log_units
from rrrgen.base.yamltext.document import FaultList, Node
from rrrgen.base.yamltext.fields import Entry, Reader, words
from rrrgen.lab.data.kalman import KalmanSmoother
from rrrgen.lab.data.reconstruction import Butterworth, CentralDifferences, Reconstructor

# ------------------------------------------------------------------------------------------------------------------
# Parallel decimation: torques and regressor pass the same low-pass filter and are then downsampled.
# ------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.floating[Any]]

HALF_LENGTH = 10  # half the length of the filter, in decimated samples
KAISER_BETA = 5.0  # shape parameter of the Kaiser window
CUTOFF_RATIO = 0.8  # -6 dB frequency over the Nyquist frequency of the decimated signal
BLOCK = 16  # outputs computed by one matrix product


@dataclass(frozen=True)
class Decimator:
    """Parallel decimation: the same low-pass on the torque and on every regressor column, then every ``factor``-th row.

    Both sides of ``tau = W x`` pass the same linear filter F, so ``F tau = F W x`` holds exactly, at the ends too. F
    is a symmetric (zero-phase) FIR filter with a Kaiser window, ``20*factor + 1`` taps, -6 dB at 0.8 of the new Nyquist
    frequency. A recording may be filtered in chunks that overlap by :attr:`memory` samples: the result is exactly
    that of the whole. Raises :class:`InputError` for a factor below 1.
    """

    factor: int

    def __post_init__(self) -> None:
        if self.factor < 1:
            raise InputError(f"the decimation factor is {self.factor}; it must be 1 or more")

    @property
    def memory(self) -> int:
        """Number of recorded samples on either side that a decimated sample depends on."""
        return 0 if self.factor == 1 else HALF_LENGTH * self.factor

    def __call__(self, x: Array, first: int = 0) -> Array:
        """Filter ``x`` (N, ...) along axis 0 and keep the samples whose index in the recording is a multiple of factor.

        ``first`` is the index in the recording of ``x[0]``; samples outside ``x`` count as zero.
        """
        if self.factor == 1:
            return x
        h, width = self.memory, int(np.prod(x.shape[1:]))
        skip = -first % self.factor
        count = max(0, -(-(len(x) - skip) // self.factor))
        padded = np.zeros((len(x) + 2 * h + BLOCK * self.factor, width))
        padded[h : h + len(x)] = x.reshape(len(x), width)
        band, out = _band(self.factor), np.empty((count, width))
        for start in range(0, count, BLOCK):
            at = skip + start * self.factor
            rows = min(BLOCK, count - start)
            out[start : start + rows] = (band @ padded[at : at + band.shape[1]])[:rows]
        return out.reshape(count, *x.shape[1:])

    def dense(self, x: Array, first: int = 0) -> tuple[NDArray[np.int64], Array]:
        """Filter ``x`` (N, ...) in the same way and keep four times as many samples or more, as far as there are.

        Returns their indices in x (M,), and the samples (M, ...). A curve through them keeps the power of noise between
        the times of decimation. One through the decimated samples alone, which reach to 0.8 of their Nyquist frequency,
        loses 8 % of it in the middle between two, and a delay that is searched by the errors is drawn there.
        """
        from scipy.signal import oaconvolve

        step = max(d for d in range(1, max(1, self.factor // 4) + 1) if self.factor % d == 0)
        at = np.arange(-first % step, len(x), step)
        if self.factor == 1:
            return at, x
        taps = self.taps().reshape(-1, *[1] * (x.ndim - 1))
        h = self.memory
        return at, oaconvolve(x, taps, axes=0)[h : h + len(x)][at]

    def taps(self) -> Array:
        """Impulse response of the filter, ``2*memory + 1`` samples, symmetric about the middle one."""
        return _taps(self.factor).copy()

    def times(self, t: Array, first: int = 0) -> Array:
        """The times (s) of ``t`` (N,) that decimation keeps; ``first`` is the index of ``t[0]`` in the recording."""
        return t[-first % self.factor :: self.factor]


@lru_cache(maxsize=4)
def _taps(factor: int) -> Array:
    from scipy.signal import firwin

    length = 2 * HALF_LENGTH * factor + 1
    return np.asarray(firwin(length, CUTOFF_RATIO / factor, window=("kaiser", KAISER_BETA)))


@lru_cache(maxsize=4)
def _band(factor: int) -> Array:
    """Banded matrix that maps an input window to BLOCK consecutive filter outputs, for decimation by ``factor``.

    Filtering becomes one matrix product. The matrix is cached, because computing it takes longer than filtering one of
    the many chunks of a long recording.
    """
    taps = _taps(factor)
    band = np.zeros((BLOCK, len(taps) + (BLOCK - 1) * factor))
    for k in range(BLOCK):
        band[k, k * factor : k * factor + len(taps)] = taps
    return band


# ------------------------------------------------------------------------------------------------------------------
# Preprocessing of a recording before estimation
# ------------------------------------------------------------------------------------------------------------------

Method = Literal["butterworth", "kalman", "kalman_filter", "differences", "logged"]
KALMAN: tuple[Method, ...] = ("kalman", "kalman_filter")
DEFAULT_ORDER = 4  # number of poles of the Butterworth filter
METHODS: tuple[Method, ...] = ("butterworth", "kalman", "kalman_filter", "differences", "logged")

ENERGY_SHARE = 0.99  # share of the energy of an impulse response that defines its width
JUMP_SHARE = (
    0.999  # the same of the error that a jump leaves: a share of 0.99 would leave a tenth of it beside the width
)

METHODS_OF_SETTING: dict[str, tuple[Method, ...]] = {
    "cutoff": ("butterworth",),
    "order": ("butterworth",),
    "var_eta": KALMAN,
    "var_xi": KALMAN,
}
"""The methods of reconstruction to which a setting belongs; settings that are not listed apply to all."""

SETTING_OF_KEY = {"position_resolution": "var_eta", "jerk": "var_xi"}
"""Settings whose key in a mapping file has another name, because it takes another quantity."""


@dataclass(frozen=True)
class Processing:
    """Preprocessing settings: method of reconstruction with its tuning, decimation factor, lowest speeds.

    - ``method``: how speeds and accelerations are obtained; ``logged`` takes the recorded ones.
    - ``cutoff`` (Hz), ``order``: Butterworth filter.
    - ``var_eta`` (rad^2 or m^2), ``var_xi`` ((rad/s^3)^2 or (m/s^3)^2), one per joint: Kalman filter.
    - ``decimate``: decimation factor.
    - ``low_speed`` (n,), rad/s (m/s): the rows of a joint below this speed are left out; empty for none.

    Settings that are None are chosen from the bandwidth of the motion (:mod:`rrrgen.lab.identify.bandwidth`).
    Raises :class:`InputError` for a setting that the method does not have.
    """

    method: Method = "kalman"
    cutoff: float | None = None
    order: int | None = None
    var_eta: tuple[float, ...] | None = None
    var_xi: tuple[float, ...] | None = None
    decimate: int | None = None
    low_speed: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, methods in METHODS_OF_SETTING.items():
            if getattr(self, name) is not None and self.method not in methods:
                raise InputError(f"{name} belongs to the method {' or '.join(methods)}, not to {self.method}")

    def settings(self) -> dict[str, Any]:
        """All settings as name -> value, to be recorded with the results of a run."""
        return asdict(self)

    def reconstructor(self) -> Reconstructor:
        """The filter that reconstructs the motion by the configured ``method``.

        Raises :class:`InputError` if the cut-off of a Butterworth filter or a variance of a Kalman filter is None.
        """
        if self.method == "butterworth":
            if self.cutoff is None:
                raise InputError("the Butterworth filter needs a cutoff (Hz), above the bandwidth of the motion")
            return Butterworth(self.cutoff, self.order or DEFAULT_ORDER)
        if self.method in KALMAN:
            if self.var_eta is None or self.var_xi is None:
                raise InputError("the Kalman filter needs its two variances; tune_by_innovations finds them")
            return KalmanSmoother(self.var_eta, self.var_xi, smooth=self.method == "kalman")
        return CentralDifferences()


@lru_cache(maxsize=16)
def reconstruction_reach(processing: Processing, period: float) -> int:
    """Samples on either side of a jump of the acceleration that hold 99.9 % of the energy of the error it leaves.

    Friction makes a joint's acceleration jump where its motion reverses. The end of a recording is another jump: the
    filters continue positions by point reflection, with the opposite acceleration. ``period`` is that of the sampling,
    s.
    """
    if processing.method == "logged":
        return 0
    method = processing.reconstructor()
    half = method.memory(period)
    t = np.arange(-2 * half, 2 * half + 1) * period
    jump = np.repeat((0.5 * t * np.abs(t))[:, None], len(processing.var_eta or (0.0,)), axis=1)
    inner = slice(half, len(t) - half)
    return energy_radius(method(t, jump).ddq[inner] - np.sign(t[inner, None]), JUMP_SHARE)


def energy_radius(response: Array, share: float = ENERGY_SHARE) -> int:
    """Samples beside the middle of ``response`` (2 h + 1, k) that hold a ``share`` of the energy of each column."""
    half = len(response) // 2
    energy = np.square(response)
    both = np.concatenate([energy[half : half + 1], energy[half + 1 :] + energy[:half][::-1]])
    total = np.cumsum(both, axis=0)
    return int(np.max(np.argmax(total >= share * total[-1], axis=0)))


KEYS = {
    "method": Entry(words(METHODS)),
    "cutoff": Entry("of the Butterworth filter", "Hz"),
    "order": Entry(f"of the Butterworth filter, number of poles; {DEFAULT_ORDER} if missing"),
    "position_resolution": Entry("of the Kalman filter: step of the encoder, per joint", "rad, m"),
    "jerk": Entry("of the Kalman filter: size of the jerk, per joint", "rad/s^3"),
    "decimate": Entry("keep every k-th sample, after a low-pass filter"),
    "low_speed": Entry("samples of a joint slower than this are left out, per joint", "rad/s, m/s"),
}
"""The keys of the section ``processing``."""


def read_processing(node: Node | None, joints: int, faults: FaultList) -> dict[str, Any]:
    """Read the section ``processing`` of a mapping file for a robot with ``joints`` joints.

    Returns the given settings as keyword arguments of :class:`Processing`; faults are added to ``faults``.
    """
    if node is None:
        return {}
    reader = Reader(faults)

    def per_joint(value: Node, what: str, table: dict[str, float], bare: str, zero: bool = False) -> tuple[float, ...]:
        values = reader.per_joint(value, what, joints, table, bare)
        numbers = tuple(number for number in values if number is not None)
        if any(number < 0.0 or (number == 0.0 and not zero) for number in numbers):
            faults.error(value, f"{what} must be {'0 or more' if zero else 'positive'}")
        return numbers

    settings: dict[str, Any] = {}
    values = reader.values(node, "processing", KEYS) or {}
    for name, value in values.items():
        what = f"processing.{name}"
        if name == "method":
            word = reader.choice(value, what, METHODS)
            if word in METHODS:
                settings[name] = word
        elif name in ("order", "decimate"):
            whole = reader.whole(value, what, None)
            if whole == 0:
                faults.error(value, f"{what} is 0, not a whole number above 0")
            elif whole:
                settings[name] = whole
        elif name == "cutoff":
            settings[name] = reader.quantity(value, what, log_units.RATE, "Hz", positive=True)
        elif name == "low_speed":
            settings[name] = per_joint(value, what, log_units.VELOCITY, "rad/s", zero=True)
        elif name == "position_resolution":
            settings["var_eta"] = tuple(s**2 / 12.0 for s in per_joint(value, what, log_units.POSITION, "rad"))
        else:
            settings["var_xi"] = tuple(j**2 for j in per_joint(value, what, {"rad/s^3": 1.0}, "rad/s^3"))
    _settle_method(values, settings, faults)
    return settings


def _settle_method(entries: dict[str, Node], settings: dict[str, Any], faults: FaultList) -> None:
    """Complete the ``settings`` by the method of reconstruction, inferred from them if the file does not name it.

    A setting that belongs to another method is added to ``faults``, located by ``entries``.
    """
    methods_of = {
        name: METHODS_OF_SETTING[field]
        for name in entries
        if (field := SETTING_OF_KEY.get(name, name)) in METHODS_OF_SETTING
    }
    if "method" not in entries and methods_of:
        settings["method"] = next(iter(methods_of.values()))[0]
    method = settings.get("method")
    for name, methods in methods_of.items():
        if method is not None and method not in methods:
            chosen = f"method {method}" if "method" in entries else next(iter(methods_of))
            hint = f"it belongs to the method {' or '.join(methods)}"
            faults.error(entries[name], f"processing.{name} has no meaning beside {chosen}", hint)
