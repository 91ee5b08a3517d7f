"""Converts shafts that move several joints of a chain into the coupled drives of a robot file."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from rrrgen.base.yamltext.document import FaultList
from rrrgen.robot.importers.trees.exact_numbers import decimal
from rrrgen.robot.importers.trees.serial_chain import SerialChain
from rrrgen.robot.importers.trees.tree import Shaft, Tree
from rrrgen.robot.names import identifier
from rrrgen.robot.robot_spec import DrivesSpec, MotorSpec


def drives_of(tree: Tree, chain: SerialChain, names: Sequence[str], faults: FaultList) -> DrivesSpec | None:
    """The drives of the joints ``names``; None and warnings where shafts and joints do not determine each other.

    A joint that no shaft moves has a motor of its own, which turns with it.
    """
    places = {joint.joint.name: k for k, joint in enumerate(chain.joints)}
    shafts = [shaft for shaft in tree.shafts if shaft.weights.keys() <= places.keys()]
    for shaft in tree.shafts:
        if shaft not in shafts:
            message = f"the tendon '{shaft.name}' is left out: it moves joints beside the chain"
            faults.warning(shaft.place, message, "coupled drives move joints of the chain")
    if not shafts:
        return None
    moved = {name for shaft in shafts for name in shaft.weights}
    free = [name for name in places if name not in moved]
    units = [[sp.Integer(int(place == places[name])) for place in range(len(names))] for name in free]
    rows = [_row(shaft, places) for shaft in shafts] + units
    matrix = sp.Matrix(rows)
    if matrix.rows != matrix.cols or matrix.det() == 0:
        message = f"{len(shafts)} tendons move {len(moved)} joints: they are left out"
        faults.warning(shafts[0].place, message, "as many independent tendons as joints that they move")
        return None
    inverse = matrix.inv(method="LU")
    motors = [_motor(shaft, k) for k, shaft in enumerate(shafts)]
    motors += [MotorSpec(name=f"{names[places[name]]}_drive") for name in free]
    n = len(names)
    return DrivesSpec(tuple(tuple(inverse[i, k] for k in range(n)) for i in range(n)), tuple(motors))


def _row(shaft: Shaft, places: dict[str, int]) -> list[sp.Expr]:
    row = [sp.S.Zero] * len(places)
    for name, weight in shaft.weights.items():
        row[places[name]] = decimal(weight)
    return row


def _motor(shaft: Shaft, k: int) -> MotorSpec:
    name = identifier(shaft.name.removeprefix("shaft_")) or f"m{k + 1}"
    return MotorSpec(name=name, inertia=shaft.inertia, friction=shaft.friction, torque_limit=shaft.torque_limit)
