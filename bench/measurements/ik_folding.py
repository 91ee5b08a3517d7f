"""Recorded scalars of the inverse kinematics, folded as they are now and by ``program.Builder``.

    python -m bench.measurements.ik_folding [ROBOT ...]

prints, folded by the builder and as it is: instructions a call, solutions that differ, and the time of printing. The
page of the architecture quotes it as the reason why the scalars keep a folding of their own.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from unittest.mock import patch

import click

from bench.measurements.ik_change import compared, write
from rrrgen.ik.recording.scalar import Pool, SolverScalar
from rrrgen.program import Builder, Op, Port, Value
from rrrgen.program.builder import Scalar as Recorded
from rrrgen.robot.file import bundled_names


class BuilderPool(Pool):
    """Scalars whose arithmetic is recorded by a builder, with exact constants, and read back as scalars."""

    def __init__(self) -> None:
        super().__init__()
        self._builder = Builder()
        self._values: dict[int, Value] = {}
        self._made: dict[int, SolverScalar] = {}

    def of(self, x: SolverScalar | float) -> SolverScalar:
        """``x`` as a node."""
        node = super().of(x)
        if node.is_const:
            self._values.setdefault(id(node), Fraction(node.value))
        return node

    def var(self, text: str, level: int = 0) -> SolverScalar:
        """A variable, which is an input of the builder."""
        node = super().var(text, level)
        if id(node) not in self._values:
            (value,) = self._builder.input(Port(text, ()))
            self._values[id(node)], self._made[value.index] = value, node
        return node

    def add(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The sum."""
        return self._read(self._builder.add(self._values[id(x)], self._values[id(y)]))

    def sub(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The difference."""
        return self._read(self._builder.sub(self._values[id(x)], self._values[id(y)]))

    def mul(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The product."""
        return self._read(self._builder.mul(self._values[id(x)], self._values[id(y)]))

    def div(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The quotient."""
        return self._read(self._builder.div(self._values[id(x)], self._values[id(y)]))

    def neg(self, x: SolverScalar) -> SolverScalar:
        """The negative."""
        return self._read(self._builder.neg(self._values[id(x)]))

    def _node(
        self, op: Op, args: tuple[SolverScalar, ...], *, value: float = 0.0, text: str = "", level: int = 0
    ) -> SolverScalar:
        """A root, absolute value or selection, recorded by the builder too."""
        if not args:
            return super()._node(op, args, value=value, text=text, level=level)
        return self._read(getattr(self._builder, op.value)(*(self._values[id(arg)] for arg in args)))

    def _read(self, value: Value) -> SolverScalar:
        """The scalar of what the builder recorded."""
        if not isinstance(value, Recorded):
            return self._constant(Fraction(value))
        if value.index not in self._made:
            node = self._builder.nodes[value.index]
            if node.op is Op.CONST:
                return self._constant(Fraction(node.number))
            made = SolverScalar(self, node.op, tuple(self._read(Recorded(self._builder, arg)) for arg in node.args))
            self._made[value.index], self._values[id(made)] = made, value
        return self._made[value.index]

    def _constant(self, value: Fraction) -> SolverScalar:
        node = super()._node(
            Op.CONST, (), value=float(value), text="" if Fraction(float(value)) == value else str(value)
        )
        self._values[id(node)] = value
        return node


def main(robots: Sequence[str]) -> None:
    """Compare both foldings over ``robots``, by default all bundled ones."""
    for robot in robots or bundled_names():
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            builder, now = (Path(place) / name for name in ("builder", "now"))
            write(robot, now)  # imports, so that they are not timed
            with (
                patch("rrrgen.ik.recording.recorder.Pool", BuilderPool),
                patch("rrrgen.emit.c.ik.common_code.Pool", BuilderPool),
            ):
                before = _seconds(robot, builder)
            after = _seconds(robot, now)
            line = compared(robot, builder, now, Path(place))
            click.echo(f"{line}; planned and printed in {1e3 * before:.0f} -> {1e3 * after:.0f} ms")


def _seconds(robot: str, folder: Path) -> float:
    """Processor time to plan and print, the least of three."""
    times = []
    for _ in range(3):
        start = time.process_time()
        write(robot, folder)
        times.append(time.process_time() - start)
    return min(times)


if __name__ == "__main__":
    main(sys.argv[1:])
