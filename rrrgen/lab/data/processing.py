"""Preprocessing of a recording before estimation: reconstruction of the motion, decimation, exclusion of slow samples.

The settings come from the section ``processing`` of a mapping file and from command-line options.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext import signal_units as log_units
from rrrgen.base.yamltext.document import FaultList, Node
from rrrgen.base.yamltext.keys import Entry, words
from rrrgen.base.yamltext.reader import Reader
from rrrgen.lab.data.reconstruction import Butterworth, CentralDifferences, Reconstructor
from rrrgen.lab.data.smoother import KalmanSmoother

Method = Literal["butterworth", "kalman", "kalman_filter", "differences", "logged"]
KALMAN: tuple[Method, ...] = ("kalman", "kalman_filter")
DEFAULT_ORDER = 4  # number of poles of the Butterworth filter
METHODS: tuple[Method, ...] = ("butterworth", "kalman", "kalman_filter", "differences", "logged")

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

    def per_joint(value: Node, what: str, table: dict[str, float], bare: str) -> tuple[float, ...]:
        values = reader.per_joint(value, what, joints, table, bare)
        return tuple(number for number in values if number is not None)

    found: dict[str, Any] = {}
    values = reader.values(node, "processing", KEYS) or {}
    for name, value in values.items():
        what = f"processing.{name}"
        if name == "method":
            word = reader.choice(value, what, METHODS)
            if word in METHODS:
                found[name] = word
        elif name in ("order", "decimate"):
            whole = reader.whole(value, what, None)
            if whole == 0:
                faults.error(value, f"{what} is 0, not a whole number above 0")
            elif whole:
                found[name] = whole
        elif name == "cutoff":
            found[name] = reader.quantity(value, what, log_units.RATE, "Hz")
        elif name == "low_speed":
            found[name] = per_joint(value, what, log_units.VELOCITY, "rad/s")
        elif name == "position_resolution":
            found["var_eta"] = tuple(s**2 / 12.0 for s in per_joint(value, what, log_units.POSITION, "rad"))
        else:
            found["var_xi"] = tuple(j**2 for j in per_joint(value, what, {"rad/s^3": 1.0}, "rad/s^3"))
    _settle_method(values, found, faults)
    return found


def _settle_method(entries: dict[str, Node], found: dict[str, Any], faults: FaultList) -> None:
    """Complete the settings ``found`` by the method of reconstruction, inferred from them if the file does not name it.

    A setting that belongs to another method is added to ``faults``, located by ``entries``.
    """
    methods_of = {
        name: METHODS_OF_SETTING[field]
        for name in entries
        if (field := SETTING_OF_KEY.get(name, name)) in METHODS_OF_SETTING
    }
    if "method" not in entries and methods_of:
        found["method"] = next(iter(methods_of.values()))[0]
    method = found.get("method")
    for name, methods in methods_of.items():
        if method is not None and method not in methods:
            chosen = f"method {method}" if "method" in entries else next(iter(methods_of))
            hint = f"it belongs to the method {' or '.join(methods)}"
            faults.error(entries[name], f"processing.{name} has no meaning beside {chosen}", hint)
