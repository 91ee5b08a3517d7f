"""The one intermediate representation: straight-line, single-assignment programs over scalars."""

from rrrgen.program.builder import Builder, Scalar, Value
from rrrgen.program.evaluation import evaluate, evaluate_floats
from rrrgen.program.program import (
    REFUSED,
    Domain,
    Failure,
    Node,
    Op,
    OperationCount,
    Port,
    Program,
    Role,
    Status,
    count_operations,
    nominal_name,
    specialization,
)

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
    "evaluate_floats",
    "nominal_name",
    "specialization",
]
