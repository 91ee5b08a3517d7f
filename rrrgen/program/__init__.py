"""The one intermediate representation: straight-line, single-assignment programs over scalars."""

from rrrgen.program.builder import Builder, Scalar, Value
from rrrgen.program.counts import OperationCount, count_operations
from rrrgen.program.evaluation import evaluate
from rrrgen.program.ir import Program, nominal_name, specialization
from rrrgen.program.nodes import Node, Op
from rrrgen.program.ports import REFUSED, Domain, Failure, Port, Role, Status

__all__ = [
    "REFUSED",
    "Builder",
    "Domain",
    "Failure",
    "Node",
    "Op",
    "OperationCount",
    "Port",
    "Program",
    "Role",
    "Scalar",
    "Status",
    "Value",
    "count_operations",
    "evaluate",
    "nominal_name",
    "specialization",
]
