"""The one intermediate representation: straight-line, single-assignment programs over scalars."""

from rrrgen.program.counts import OperationCount, count_operations
from rrrgen.program.evaluate import evaluate
from rrrgen.program.ir import Builder, Node, Op, Port, Program, Scalar, Value

__all__ = [
    "Builder",
    "Node",
    "Op",
    "OperationCount",
    "Port",
    "Program",
    "Scalar",
    "Value",
    "count_operations",
    "evaluate",
]
