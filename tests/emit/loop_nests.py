"""Small loop nests for the tests of the passes over them, and what they print."""

from __future__ import annotations

from rrrgen.emit.c.ik.costs import SolverOperations
from rrrgen.emit.c.ik.kernels import KernelDialect
from rrrgen.emit.c.ik.loop_nest import ARC, ArcTangent, Leaf, LoopNest, RootLoop, Statement
from rrrgen.emit.c.ik.statements import print_nest
from rrrgen.emit.c.language import CTarget, LibmSinCos
from rrrgen.ik.recording.scalar import Pool, SolverScalar

TWO, FOUR = RootLoop("i", "n", 2, 0), RootLoop("j", "m", 4, 1)


def text(nest: LoopNest) -> list[str]:
    """The lines of the nest, without the indentation of the function's body."""
    return [line[4:] for line in _printed(nest)[0].splitlines()]


def counted(nest: LoopNest) -> SolverOperations:
    return _printed(nest)[1]


def _printed(nest: LoopNest) -> tuple[str, SolverOperations]:
    return print_nest(nest, CTarget(KernelDialect("robot", "double"), LibmSinCos()), ())


def opened(pool: Pool, depth: int, index: int, name: str) -> Statement:
    """The statement that reads how many roots the loop number ``index`` has."""
    return Statement(depth, (f"if ({{0}} == 0) {{ failed({index}); {{stop}}}}",), (pool.var(name),), opens=index)


def arc(pool: Pool, depth: int, name: str, cosine: SolverScalar, sine: SolverScalar) -> Statement:
    angle = pool.var(name)
    return Statement(depth, (ARC,), (cosine, sine), (angle,), calls=("arc",), arc=ArcTangent(angle, "{0}", "{1}"))


def leaf(depth: int, error: SolverScalar, *joints: tuple[int, SolverScalar]) -> Leaf:
    return Leaf(depth, joints, "0u", "0u", error)
