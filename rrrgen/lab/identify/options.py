"""Options of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from rrrgen.base.arrays import Array
from rrrgen.derive.parameters.physical_links import DEFAULT_STRENGTH, Prior
from rrrgen.lab.identify.choice import LawChoice
from rrrgen.lab.identify.definiteness import POSES
from rrrgen.lab.identify.estimated_terms import DriveTerms
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import KnownTorque

Method = Literal["ordinary", "weighted", "robust"]
METHODS: tuple[Method, ...] = ("ordinary", "weighted", "robust")


@dataclass(frozen=True)
class Options:
    """Options of an identification: what to estimate, from which part of the data, and how.

    - ``method``: ordinary, weighted or robust least squares.
    - ``terms``: drive terms to estimate; those of the robot file if None.
    - ``friction``: friction laws to fit instead of those that the robot file states.
    - ``fixed``: known values of columns, ``{"fv1": 3.2}``; ``fixed_standard``: of standard parameters, ``{"my2": 0}``.
    - ``known``: a torque that is subtracted from the measured one, as a function of the motion.
    - ``split``: which part of the data is fitted; ``guard`` (s): guard band on both sides of its borders, the reach of
      the filters if None.
    - ``consistent``: also compute the physically consistent estimate, with ``prior`` (from the robot if None) of weight
      ``prior_strength``.
    - ``essential``: also reduce the model to its essential parameters.
    - ``correlated``: allow for correlated residuals in the standard deviations.
    - ``limits`` (2, n), ``poses``: range and number of the random poses at which M(q) is tested.
    - ``seed``: of all random numbers; ``jobs``, ``cluster``: processes, or a Dask scheduler, that share the work.
    """

    method: Method = "weighted"
    terms: DriveTerms | None = None
    friction: LawChoice = field(default_factory=LawChoice)
    fixed: Mapping[str, float] = field(default_factory=dict)
    fixed_standard: Mapping[str, float] = field(default_factory=dict)
    known: KnownTorque | None = None
    split: Split = field(default_factory=Split)
    guard: float | None = None
    consistent: bool = True
    prior: Prior | None = None
    prior_strength: float = DEFAULT_STRENGTH
    essential: bool = False
    correlated: bool = True
    limits: Array | None = None
    poses: int = POSES
    seed: int = 0
    jobs: int = 1
    cluster: str | None = None
