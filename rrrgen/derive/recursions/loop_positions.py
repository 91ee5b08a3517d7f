"""Positions of the passive joints of loops that Newton's method solves, far from those that are known.

The positions are followed from the start that the robot file states, along straight lines in q and in small steps, so
that the loops stay assembled as they are there. Emitted code does the same in the steps of its caller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.derive.recursions.following_joints import Turning
from rrrgen.derive.recursions.link_frames import newton_loops
from rrrgen.derive.recursions.loops import DEAD_POINT, Arithmetic, NewtonLoops
from rrrgen.robot.model import RobotModel

STEP = 0.05
"""Largest step (rad or m) of a drive along a line: at 1 kHz that of a motion of 50 rad/s."""

STEPS = 2
"""Steps of Newton's method behind each of them."""

ROUGH_STEPS = 60
"""Largest number of steps of Newton's method from the start in the robot file, which is rough."""

LONGEST = 0.3
"""Longest of these steps, rad or m."""

CLOSED = 1e-12
"""Gap that counts as closed, over the lengths in the loops."""


@dataclass(frozen=True)
class Numbers:
    """The functions of one kind of number, floats or arrays of them."""

    cos: Callable[[Any], Any]
    sin: Callable[[Any], Any]
    root: Callable[[Any], Any]
    at_least: Callable[[Any, Any], Any]


FLOATS = Numbers(math.cos, math.sin, math.sqrt, max)


class LoopClosure:
    """The passive joints of ``model``, whose loops Newton's method solves, in ``numbers``.

    ``drives`` (n,) are those positions of the drives, next to zero within their limits, at which the loops are
    assembled near the start in the robot file; :attr:`start` (p,) are the positions of the passive joints there. Raises
    DerivationError where the loops are not assembled near it, or have no rates there.
    """

    def __init__(self, model: RobotModel, numbers: Numbers = FLOATS) -> None:
        self._model, self._numbers = model, numbers
        self._constants: dict[sp.Expr, float] = {}
        self.drives = [
            min(max(0.0, -math.inf if lower is None else lower), math.inf if upper is None else upper)
            for lower, upper in ((joint.limits.lower, joint.limits.upper) for joint in model.spec.joints)
        ]
        self._names = ", ".join(loop.name for loop in model.spec.loops)
        self.start = self._assemble()

    def _constant(self, expression: sp.Expr) -> float:
        if expression not in self._constants:
            self._constants[expression] = float(self._model.nominal(expression).doit())
        return self._constants[expression]

    def loops(self, positions: Sequence[Any], numbers: Numbers | None = None) -> NewtonLoops:
        """The loops at ``positions`` (n + p,) of drives and passive joints, which need not close them."""
        use = numbers or self._numbers

        def trig(turning: Turning, angle: sp.Expr) -> tuple[Any, Any]:
            total: Any = self._constant(angle)
            for k, factor in turning:
                total = total + self._constant(factor) * positions[k]
            return use.cos(total), use.sin(total)

        return newton_loops(self._model, trig, positions, Arithmetic(self._constant, use.root, use.at_least))

    def _assemble(self) -> list[float]:
        spec = self._model.spec
        x = [self._constant(v) for loop in spec.loops for v in loop.start or ()]
        for _ in range(ROUGH_STEPS):
            loops = self.loops([*self.drives, *x], FLOATS)
            steps = [new - old for new, old in zip(loops.step(), x, strict=True)]
            x = [v + min(max(step, -LONGEST), LONGEST) for v, step in zip(x, steps, strict=True)]
            if max(map(abs, loops.gaps)) < CLOSED * math.sqrt(loops.scale):
                break
        else:
            raise DerivationError(
                f"{spec.name}: {self._names} cannot be assembled near the start, where the drives are at "
                f"{', '.join(f'{v:g}' for v in self.drives)} (rad, m); state displacements there that nearly close them"
            )
        loops = self.loops([*self.drives, *x], FLOATS)
        if abs(loops.sine) < DEAD_POINT:
            raise DerivationError(f"{spec.name}: {self._names} are locked or at a dead point at their start")
        if all(abs(v) < CLOSED for row in loops.W for v in row):
            raise DerivationError(f"{spec.name}: no drive moves the passive joints of {self._names} at their start")
        return x

    def follow(self, q: Sequence[Any], last: Sequence[Any], q_last: Sequence[Any], parts: int) -> list[Any]:
        """Follow the passive joints from ``last`` (p,) at ``q_last`` to ``q`` (n,) in so many ``parts``; (p,)."""
        at, positions = list(q_last), list(last)
        for part in range(1, parts + 1):
            target = [x + (y - x) * (part / parts) for x, y in zip(q_last, q, strict=True)]
            rates = self.loops([*at, *positions]).rates([y - x for x, y in zip(at, target, strict=True)])
            positions = [x + dx for x, dx in zip(positions, rates[len(target) :], strict=True)]
            for _ in range(STEPS):
                positions = self.loops([*target, *positions]).step()
            at = target
        for _ in range(STEPS):  # steps as long as these leave more than round-off near dead points
            positions = self.loops([*at, *positions]).step()
        return positions

    def gap(self, q: Sequence[Any], positions: Sequence[Any]) -> float:
        """The largest gap at floats, over the lengths in the loops."""
        loops = self.loops([*q, *positions])
        return float(max(map(abs, loops.gaps)) / math.sqrt(loops.scale))


def parts_of(distance: float) -> int:
    """The number of steps along a line of which no drive moves farther than ``distance``."""
    return max(1, math.ceil(distance / STEP))
