"""The one intermediate representation: straight-line, single-assignment programs over scalars."""

from rrrgen.program.builder import Builder, Scalar, Value
from rrrgen.program.counts import OperationCount, count_operations
from rrrgen.program.evaluate import evaluate
from rrrgen.program.ir import Node, Op, Port, Program

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
