"""Calls of functions that take the positions of passive joints, of loops that Newton's method solves.

These positions are the last input of such a function that its caller must give, ``loop_q``. In Python they may be left
out: they are then followed from the start of the robot file along a straight line in q, which takes far longer than the
call itself. Loops that follow a motion give them: ``model.at_loops(loop_q)``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.derive.recursions.loop_positions import LoopClosure, Numbers, parts_of
from rrrgen.program import Program, Role
from rrrgen.robot.model import build_model
from rrrgen.runtime.arguments import check_positions
from rrrgen.runtime.engines import Array, Engine, EngineName

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rrrgen.robot.spec import RobotSpec

REMEMBERED = 64
"""Number of arrays of positions q whose passive joints are kept, since several functions are called for the same."""


def _plain(x: Any) -> Array:
    return np.asarray(x, dtype=np.float64)  # exact constants are whole numbers and fractions


ARRAYS = Numbers(np.cos, np.sin, lambda x: np.sqrt(_plain(x)), lambda x, y: np.maximum(_plain(x), _plain(y)))
"""Functions of arrays, with an entry for each state."""


class FollowedLoops:
    """The passive joints of the robot ``spec``, followed from the start of its file."""

    def __init__(self, spec: RobotSpec) -> None:
        self._positions = LoopClosure(build_model(spec), ARRAYS)
        self._known: dict[tuple[bytes, tuple[int, ...]], Array] = {}

    @property
    def start(self) -> Array:
        """The positions (p,) where the drives are at zero, or at the limit next to it; rad or m."""
        return np.array(self._positions.start)

    def at(self, q: Any) -> Array:
        """The positions (..., p) of the passive joints at ``q`` (..., n), as assembled at the start.

        Where the loops cannot be assembled at ``q``, or on a straight line to it, the result is finite and the status
        of ``closed_loops`` there is not 0.
        """
        wanted = np.array(q, dtype=np.float64)
        key = wanted.tobytes(), wanted.shape
        if key not in self._known:
            if len(self._known) >= REMEMBERED:
                self._known.clear()
            drives = np.array(self._positions.drives)
            parts = parts_of(float(np.max(np.abs(wanted - drives), initial=0.0))) if np.all(np.isfinite(wanted)) else 1
            with np.errstate(all="ignore"):
                moved = self._positions.follow(list(np.moveaxis(wanted, -1, 0)), list(self.start), list(drives), parts)
            self._known[key] = np.stack(np.broadcast_arrays(*moved), axis=-1)
        return self._known[key].copy()


class LoopEngine:
    """An ``engine`` whose programs may be called without the positions of passive joints.

    Args:
        engine: evaluates a program by its name.
        programs: the programs, by name.
        followed: gives the positions for q.
        loop_q: positions (..., p) to be taken instead, rad or m.
    """

    def __init__(
        self,
        engine: Engine,
        programs: Mapping[str, Program],
        followed: Callable[[], FollowedLoops],
        loop_q: Any = None,
    ) -> None:
        self._engine, self._programs, self.followed, self.loop_q = engine, programs, followed, loop_q

    @property
    def name(self) -> EngineName:
        """The kind of engine, "c" or "numpy"."""
        return self._engine.name

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of all numbers."""
        return self._engine.dtype

    @property
    def threads(self) -> int:
        """Number of threads that share one batch."""
        return self._engine.threads

    @threads.setter
    def threads(self, count: int) -> None:
        self._engine.threads = count

    def at(self, loop_q: Any) -> LoopEngine:
        """The same engine with the positions ``loop_q`` (..., p) of the passive joints."""
        return LoopEngine(self._engine, self._programs, self.followed, loop_q)

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` and evaluate the program ``name``, with the positions of passive joints if it takes them."""
        inputs = self._programs[name].inputs
        roles = [port.role for port in inputs]
        if Role.LOOPS in roles and len(values) == len(inputs) - 1:
            place = roles.index(Role.LOOPS)
            loop_q = self.loop_q
            if loop_q is None:
                position = roles.index(Role.POSITION)
                (n,) = inputs[position].shape
                loop_q = self.followed().at(check_positions(self._programs[name].function, values[position], n))
            values = (*values[:place], np.asarray(loop_q, dtype=self.dtype), *values[place:])
        return self._engine.call(name, values)

    def prepare(self) -> None:
        """Build at once everything that first calls would build one by one."""
        self._engine.prepare()

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """A function without arguments that computes the program ``name`` from ``inputs`` into ``outputs``.

        Nothing is followed here: ``inputs`` hold the positions of the passive joints, ``loop_q``, too.
        """
        return self._engine.bind(name, inputs, outputs)
