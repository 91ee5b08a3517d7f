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
from rrrgen.yamltext.document import FaultList, Node, Scalar, Sequence
from rrrgen.yamltext.sections import describe, read_entries
from rrrgen.yamltext.suggest import did_you_mean

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
    found: dict[str, Any] = {}
    entries = read_entries(node, "processing", faults) or {}
    for name, (key, value) in entries.items():
        what = f"processing.{name}"
        if name not in _KEYS:
            hint = f"{did_you_mean(name, _KEYS)} allowed are {', '.join(_KEYS)}".strip()
            faults.error(key, f"unknown key '{name}' in processing", hint)
        elif name == "method":
            if not isinstance(value, Scalar) or value.text not in METHODS:
                faults.error(value, f"{what} is {describe(value)}", f"allowed are {', '.join(METHODS)}")
            else:
                found[name] = value.text
        elif name in ("order", "decimate"):
            if isinstance(value, Scalar) and value.text.isdecimal() and int(value.text) > 0:
                found[name] = int(value.text)
            else:
                faults.error(value, f"{what} is {describe(value)}, not a whole number above 0")
        elif name == "cutoff":
            found[name] = log_units.read_quantity(value, what, log_units.RATE, "Hz", faults)
        elif name == "low_speed":
            found[name] = _per_joint(value, what, joints, log_units.VELOCITY, "rad/s", faults)
        elif name == "position_resolution":
            steps = _per_joint(value, what, joints, log_units.POSITION, "rad", faults)
            found["var_eta"] = tuple(step**2 / 12.0 for step in steps)
        else:
            found["var_xi"] = tuple(j**2 for j in _per_joint(value, what, joints, {"rad/s^3": 1.0}, "rad/s^3", faults))
    _settle_method(entries, found, faults)
    return found


def _settle_method(entries: dict[str, tuple[Scalar, Node]], found: dict[str, Any], faults: FaultList) -> None:
    """The method is the one that the settings belong to, where it is not named; settings of others are faults."""
    owners = {name: OWNERS[field] for name in entries if (field := FIELDS.get(name, name)) in OWNERS}
    if "method" not in entries and owners:
        found["method"] = next(iter(owners.values()))[0]
    method = found.get("method")
    for name, methods in owners.items():
        if method is not None and method not in methods:
            chosen = f"method {method}" if "method" in entries else next(iter(owners))
            hint = f"it belongs to the method {' or '.join(methods)}"
            faults.error(entries[name][0], f"processing.{name} has no meaning beside {chosen}", hint)


def _per_joint(
    node: Node, what: str, joints: int, table: dict[str, float], bare: str, faults: FaultList
) -> tuple[float, ...]:
    items = node.items if isinstance(node, Sequence) else [node] * joints
    if len(items) != joints:
        faults.error(node, f"{what} has {len(items)} entries for {joints} joints")
    values = [log_units.read_quantity(item, what, table, bare, faults) for item in items]
    return tuple(value for value in values if value is not None)
