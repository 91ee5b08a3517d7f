"""How a recording is made ready for estimation: reconstruction, decimation, samples left out. Defaults of a mapping
file.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from rrrgen.errors import InputError
from rrrgen.signals.reconstruction import Butterworth, CentralDifferences, Reconstructor
from rrrgen.signals.smoother import KalmanSmoother
from rrrgen.yamltext import signal_units as log_units
from rrrgen.yamltext.document import FaultList, Node
from rrrgen.yamltext.reader import Reader

Method = Literal["butterworth", "kalman", "kalman_filter", "differences", "logged"]
KALMAN: tuple[Method, ...] = ("kalman", "kalman_filter")
DEFAULT_ORDER = 4  # of the Butterworth filter
METHODS: tuple[Method, ...] = ("butterworth", "kalman", "kalman_filter", "differences", "logged")

OWNERS: dict[str, tuple[Method, ...]] = {
    "cutoff": ("butterworth",),
    "order": ("butterworth",),
    "var_eta": KALMAN,
    "var_xi": KALMAN,
}
"""Settings that only some methods have."""

FIELDS = {"position_resolution": "var_eta", "jerk": "var_xi"}
"""Keys of a mapping file that are called otherwise than the setting they give."""


@dataclass(frozen=True)
class Processing:
    """Reconstruction ``method`` with its tuning, decimation, and speeds below which a joint's rows are left out.

    ``cutoff`` (Hz) and ``order`` belong to the Butterworth filter; ``var_eta`` and ``var_xi`` to the Kalman filter.
    What is None is chosen by the rule of :mod:`rrrgen.identify.scoring.bandwidth`. ``low_speed`` (n,) is in rad/s
    (m/s), empty for none. ``logged`` takes the speeds and accelerations of the recording as they are. Raises
    :class:`InputError` for a setting that the method does not have.
    """

    method: Method = "kalman"
    cutoff: float | None = None
    order: int | None = None
    var_eta: tuple[float, ...] | None = None
    var_xi: tuple[float, ...] | None = None
    decimate: int | None = None
    low_speed: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, methods in OWNERS.items():
            if getattr(self, name) is not None and self.method not in methods:
                raise InputError(f"{name} belongs to the method {' or '.join(methods)}, not to {self.method}")

    def settings(self) -> dict[str, Any]:
        """Plain values, for records."""
        return asdict(self)

    def reconstructor(self) -> Reconstructor:
        """The method with its tuning; the variances of a Kalman filter must be known."""
        if self.method == "butterworth":
            if self.cutoff is None:
                raise InputError("the Butterworth filter needs a cutoff (Hz), above the bandwidth of the motion")
            return Butterworth(self.cutoff, self.order or DEFAULT_ORDER)
        if self.method in KALMAN:
            if self.var_eta is None or self.var_xi is None:
                raise InputError("the Kalman filter needs its two variances; tune_by_innovations finds them")
            return KalmanSmoother(self.var_eta, self.var_xi, smooth=self.method == "kalman")
        return CentralDifferences()


_KEYS = ("method", "cutoff", "order", "position_resolution", "jerk", "decimate", "low_speed")


def read_processing(node: Node | None, joints: int, faults: FaultList) -> dict[str, Any]:
    """The keys of ``processing`` that are given, as arguments of :class:`Processing`; faults are recorded."""
    if node is None:
        return {}
    reader = Reader(faults)

    def per_joint(value: Node, what: str, table: dict[str, float], bare: str) -> tuple[float, ...]:
        values = reader.per_joint(value, what, joints, table, bare)
        return tuple(number for number in values if number is not None)

    found: dict[str, Any] = {}
    values = reader.values(node, "processing", _KEYS) or {}
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
    """The method is the one that the settings belong to, where it is not named; settings of others are faults."""
    owners = {name: OWNERS[field] for name in entries if (field := FIELDS.get(name, name)) in OWNERS}
    if "method" not in entries and owners:
        found["method"] = next(iter(owners.values()))[0]
    method = found.get("method")
    for name, methods in owners.items():
        if method is not None and method not in methods:
            chosen = f"method {method}" if "method" in entries else next(iter(owners))
            hint = f"it belongs to the method {' or '.join(methods)}"
            faults.error(entries[name], f"processing.{name} has no meaning beside {chosen}", hint)
