"""Discrete-time description of the joint controllers that were active during a recording.

Each joint has a list of signals, computed in order at every controller sample. A signal is a weighted sum, filter,
limit, sign or integral of earlier signals. The inputs are the measured position, the reference position and velocity,
the feed-forward torque and the constant 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

INPUTS = ("position", "reference", "reference_velocity", "feedforward", "constant")
"""Input signals of every joint controller."""
Kind = Literal["sum", "filter", "limit", "sign", "integral"]
KINDS: tuple[Kind, ...] = ("sum", "filter", "limit", "sign", "integral")
Record = Literal["applied", "command", "centred"]
RECORDS: tuple[Record, ...] = ("applied", "command", "centred")
SETTLED = 1e-4
"""Fraction of its initial transient below which a filter counts as settled."""


@dataclass(frozen=True)
class Operation:
    """Operation that computes one controller signal: its ``kind``, source signals ``of`` and coefficients ``values``.

    The meaning of ``values`` depends on the kind:

    - sum: one weight for each source signal.
    - filter: numerator, then denominator coefficients in ascending powers of 1/z; both have the same length and the
      first denominator coefficient is 1.
    - limit: lower and upper limit.
    - sign: half-width of the dead zone around zero in which the result is 0.
    - integral: gain times sampling period, then lower and upper limit of the integral.
    """

    kind: Kind
    of: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class JointController:
    """Controller of one joint: maps signal names to operations, in the order in which they are computed.

    ``torque`` names the signal that is recorded as torque, ``acts`` the signal that drives the joint.
    """

    name: str
    signals: Mapping[str, Operation]
    torque: str
    acts: str


@dataclass(frozen=True)
class LoopController:
    """Controllers of all joints, with their common sampling ``period`` (s).

    ``delay`` is the time from reading the encoders until the torque acts, in sampling periods; it adds to delays
    inside the signals. ``records`` says which torque is stored with each sample: "applied" is the torque applied from
    that instant on, "command" the command computed at that instant, "centred" the mean over one period centred there.
    ``source`` is the file it was read from.
    """

    joints: tuple[JointController, ...]
    period: float
    delay: float = 0.0
    records: Record = "applied"
    source: str = field(default="", compare=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    def uses(self, signal: str) -> bool:
        """Whether the controller of any joint reads the input ``signal``, one of :data:`INPUTS`."""
        return any(signal in each.of for joint in self.joints for each in joint.signals.values()) or any(
            signal in (joint.torque, joint.acts) for joint in self.joints
        )

    @property
    def records_what_acts(self) -> bool:
        """Whether, for every joint, the signal that is recorded as torque is also the one that drives the joint."""
        return all(joint.acts == joint.torque for joint in self.joints)

    @property
    def settling(self) -> int:
        """Number of samples until the transients of all filters have settled; poles on the unit circle are ignored."""
        longest = 1
        for joint in self.joints:
            total = 0
            for each in joint.signals.values():
                if each.kind == "filter":
                    total += _settling(each.values)
            longest = max(longest, total)
        return longest + int(np.ceil(self.delay)) + 1

    def tables(self) -> Tables:
        """Encode the operations of all joints as the arrays that the compiled simulation reads."""
        return Tables.of(self)


@dataclass(frozen=True, eq=False)
class Tables:
    """Controller operations of n joints, encoded as flat arrays for the compiled simulation.

    ``operations`` holds kind, signal index and source indices of each operation in turn, ``coefficients`` all their
    values. ``outputs`` (2n,) are the indices of the recorded and the acting torque signal of each joint. ``signals``
    and ``memory`` are the numbers of signals and of stored filter and integrator states.
    """

    operations: NDArray[np.int32]
    coefficients: Array
    outputs: NDArray[np.int32]
    signals: int
    memory: int

    @classmethod
    def of(cls, controller: LoopController) -> Tables:
        """Encode ``controller``; every signal must refer to earlier signals only, as the reader has checked."""
        operations: list[int] = []
        coefficients: list[float] = []
        outputs: list[int] = []
        signals, memory = len(INPUTS) * len(controller.joints), 0
        for j, joint in enumerate(controller.joints):
            place = {name: len(INPUTS) * j + k for k, name in enumerate(INPUTS)}
            for name, each in joint.signals.items():
                of = [place[source] for source in each.of]
                kind = KINDS.index(each.kind)
                match each.kind:
                    case "sum":
                        operations += [kind, signals, len(of), *of]
                    case "filter":
                        order = len(each.values) // 2 - 1
                        operations += [kind, signals, of[0], order, memory]
                        memory += order
                    case "integral":
                        operations += [kind, signals, of[0], memory]
                        memory += 1
                    case _:
                        operations += [kind, signals, of[0]]
                coefficients += each.values
                place[name] = signals
                signals += 1
            outputs += [place[joint.torque], place[joint.acts]]
        return cls(
            np.array(operations, np.int32),
            np.array([*coefficients, 0.0]),
            np.array(outputs, np.int32),
            signals,
            memory,
        )


def filtered(of: str, numerator: tuple[float, ...], denominator: tuple[float, ...] = (1.0,)) -> Operation:
    """Filter of the signal ``of`` with coefficients in ascending powers of 1/z, normalized to a leading 1.

    Raises InputError for an empty numerator or denominator, or a first denominator coefficient of 0.
    """
    if not numerator or not denominator or denominator[0] == 0.0:
        raise InputError("a filter needs a numerator, and a denominator whose first coefficient is not 0")
    size = max(len(numerator), len(denominator))
    rows = [tuple(c / denominator[0] for c in part) + (0.0,) * (size - len(part)) for part in (numerator, denominator)]
    return Operation("filter", (of,), rows[0] + rows[1])


def _settling(values: tuple[float, ...]) -> int:
    """Number of samples until the transient of a filter with coefficients ``values`` has decayed to SETTLED."""
    size = len(values) // 2
    radii = np.abs(np.roots(values[size:]))
    slow = radii[radii < 1.0 - 1e-9]
    slowest = float(slow.max()) if len(slow) else 0.0
    return size - 1 + (int(np.ceil(np.log(SETTLED) / np.log(slowest))) if slowest > 1e-6 else 0)
