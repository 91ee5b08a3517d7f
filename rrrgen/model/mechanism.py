"""The chain of rows from the base to the tip of a mechanism, as a robot of its own without couplings."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from rrrgen.robotfile.robot_spec import Limits, RobotSpec


def chain_to_tip(spec: RobotSpec) -> RobotSpec:
    """The kinematics of the rows between base and tip, every one with a drive of its own and without limits."""
    if spec.mechanism is None:
        return spec
    rows = tuple(
        replace(spec.rows[i], limits=Limits(), friction=None, drive=None) for i in spec.mechanism.path(spec.mechanism.tip)
    )
    return replace(spec, joints=rows, mechanism=None, links=None, drives=None, basis=None, tools={})


def coupling_to_tip(spec: RobotSpec) -> sp.Matrix:
    """The displacements of the rows of :func:`chain_to_tip` as multiples of q, (rows, n)."""
    if spec.mechanism is None:
        return sp.eye(spec.n)
    return sp.Matrix([list(spec.mechanism.matrix[i]) for i in spec.mechanism.path(spec.mechanism.tip)])
