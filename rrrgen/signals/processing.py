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
METHODS: tuple[Method, ...] = ("butterworth", "kalman", "kalman_filter", "differences", "logged")


@dataclass(frozen=True)
class Processing:
    """Reconstruction ``method`` with its tuning, decimation, and speeds below which a joint's rows are left out.

    ``cutoff`` (Hz) and ``order`` belong to the Butterworth filter; ``var_eta`` and ``var_xi`` to the Kalman filter,
    found from the innovations where they are None. ``decimate`` is chosen from the motion where it is None.
    ``low_speed`` (n,) is in rad/s (m/s), empty for none. ``logged`` takes the speeds and accelerations of the
    recording as they are.
    """

    method: Method = "kalman"
    cutoff: float | None = None
    order: int = 4
    var_eta: tuple[float, ...] | None = None
    var_xi: tuple[float, ...] | None = None
    decimate: int | None = None
    low_speed: tuple[float, ...] = ()

    def settings(self) -> dict[str, Any]:
        """Plain values, for records."""
        return asdict(self)

    def reconstructor(self) -> Reconstructor:
        """The method with its tuning; the variances of a Kalman filter must be known."""
        if self.method == "butterworth":
            if self.cutoff is None:
                raise InputError(
                    "the Butterworth filter needs a cutoff (Hz): about 5 times the highest frequency of the motion"
                )
            return Butterworth(self.cutoff, self.order)
        if self.method in ("kalman", "kalman_filter"):
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
    for name, (key, value) in (read_entries(node, "processing", faults) or {}).items():
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
    return found


def _per_joint(
    node: Node, what: str, joints: int, table: dict[str, float], bare: str, faults: FaultList
) -> tuple[float, ...]:
    items = node.items if isinstance(node, Sequence) else [node] * joints
    if len(items) != joints:
        faults.error(node, f"{what} has {len(items)} entries for {joints} joints")
    values = [log_units.read_quantity(item, what, table, bare, faults) for item in items]
    return tuple(value for value in values if value is not None)
