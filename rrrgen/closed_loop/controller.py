"""The controller of a recording, exactly as implemented in discrete time: per joint, signals computed in order.

Every signal is a weighted sum, a filter, a limit, a sign or an integral of signals before it. The first ones are the
measured position, the reference and its velocity, the feed-forward torque and the constant 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import InputError

INPUTS = ("position", "reference", "reference_velocity", "feedforward", "constant")
"""Signals that every joint has from the start."""
Kind = Literal["sum", "filter", "limit", "sign", "integral"]
KINDS: tuple[Kind, ...] = ("sum", "filter", "limit", "sign", "integral")
Record = Literal["applied", "command", "centred"]
RECORDS: tuple[Record, ...] = ("applied", "command", "centred")
SETTLED = 1e-4
"""Share of a transient at which a filter counts as settled."""


@dataclass(frozen=True)
class Operation:
    """One signal: its ``kind``, the signals it is computed ``of``, and its coefficients.

    - sum: ``values`` are the weights.
    - filter: ``values`` are the coefficients of the numerator, then those of the denominator, in powers of 1/z from 0
      on, equally many of each, the first of the denominator 1.
    - limit: lowest and highest value; sign: the dead zone.
    - integral: the gain times the period, lowest and highest value.
    """

    kind: Kind
    of: tuple[str, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class JointController:
    """The controller of one joint: its ``signals`` in the order in which they are computed.

    ``torque`` names the signal that is recorded as torque, ``acts`` the one that acts on the joint.
    """

    name: str
    signals: Mapping[str, Operation]
    torque: str
    acts: str


@dataclass(frozen=True)
class LoopController:
    """The controllers of all joints, with the ``period`` of their samples (s).

    ``delay`` is the time from reading the encoders to the torque, in periods, on top of ``signals`` that are late by
    themselves. ``records`` says which torque a recording holds: the one applied from that instant on, the command
    computed at that instant, or the mean over a period around it.
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
        """Whether any joint uses the input ``signal``."""
        return any(signal in each.of for joint in self.joints for each in joint.signals.values()) or any(
            signal in (joint.torque, joint.acts) for joint in self.joints
        )

    @property
    def settling(self) -> int:
        """Samples after which all filters have forgotten their start; poles on the unit circle never do."""
        longest = 1
        for joint in self.joints:
            total = 0
            for each in joint.signals.values():
                if each.kind == "filter":
                    total += _settling(each.values)
            longest = max(longest, total)
        return longest + int(np.ceil(self.delay)) + 1

    def tables(self) -> Tables:
        """The operations of all joints as arrays, in the form that the simulation reads."""
        return Tables.of(self)


@dataclass(frozen=True, eq=False)
class Tables:
    """Operations and coefficients of all joints in one list each; ``outputs`` (2n,) are the signals of the torques."""

    operations: NDArray[np.int32]
    coefficients: Array
    outputs: NDArray[np.int32]
    signals: int
    memory: int

    @classmethod
    def of(cls, controller: LoopController) -> Tables:
        """The tables of ``controller``; its signals are known to exist."""
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
    """A filter of the signal ``of`` with coefficients in powers of 1/z from 0 on. Raises InputError."""
    if not numerator or not denominator or denominator[0] == 0.0:
        raise InputError("a filter needs a numerator, and a denominator whose first coefficient is not 0")
    size = max(len(numerator), len(denominator))
    rows = [tuple(c / denominator[0] for c in part) + (0.0,) * (size - len(part)) for part in (numerator, denominator)]
    return Operation("filter", (of,), rows[0] + rows[1])


def _settling(values: tuple[float, ...]) -> int:
    """Samples after which a filter has forgotten its start."""
    size = len(values) // 2
    radii = np.abs(np.roots(values[size:]))
    slow = radii[radii < 1.0 - 1e-9]
    slowest = float(slow.max()) if len(slow) else 0.0
    return size - 1 + (int(np.ceil(np.log(SETTLED) / np.log(slowest))) if slowest > 1e-6 else 0)
