"""Choice of a friction law for every joint and motor by held-out error, within the fitted part of the data.

The fitted part is split into two halves of alternating stretches. Each law is tuned on one half and scored on the
other, and vice versa; the data that the caller holds out are not used. Joints of one arm are built alike, and half a
recording says little about one joint. So all share one law, the simplest whose error is within one percent of the
smallest, except joints at which another law is significantly better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.tables import text_table
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.identify.friction_columns import FrictionSurface, stated_surfaces, surfaces_with, without_laws
from rrrgen.lab.identify.friction_shapes import Fitted, Problem, tune_shapes
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import KnownTorque, Recording, RowMaker
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor, RigidModel
from rrrgen.robot.friction.laws import LAWS

# ------------------------------------------------------------------------------------------------------------------
# Friction that depends on the load torque: estimates load and friction parameters by fixed-point iteration.
#
# The load is the torque of rigid body and drive inertia. For a known load, the ratio of Coulomb friction to load
# torque is one more linear parameter. So each iteration computes the load with the parameters of the iteration
# before. Friction depends only weakly on the load, so that a few iterations converge.
# ------------------------------------------------------------------------------------------------------------------

ROUNDS = 8
SETTLED = 1e-4  # relative change of the load at which the iteration ends


def tune_under_load(
    problem: Problem, regressor: FullRegressor, surfaces: Sequence[FrictionSurface], use: NDArray[np.bool_]
) -> tuple[Fitted, tuple[float, ...]]:
    """Fit the friction shapes of ``surfaces`` to the rows with ``use`` (r, n) True, and find the load torques.

    ``regressor`` has the columns of ``problem`` that do not depend on shapes. Returns the fit and the parameters of
    these columns, with zeros for friction, from which the load is computed; these are empty if no law depends on it.
    """
    fitted = tune_shapes(problem, surfaces, use)
    if not any(surface.definition.has_load for surface in surfaces):
        return fitted, ()
    carried = np.array([column.kind in ("rigid", "inertia") for column in regressor.columns])
    theta: Array = np.zeros(len(carried))
    for _ in range(ROUNDS):
        theta = np.where(carried, fitted.theta[: len(carried)], 0.0)
        before, problem = problem.load, problem.under_load(regressor, theta)
        fitted = tune_shapes(problem, fitted.surfaces, use)
        if np.linalg.norm(problem.load - before) <= SETTLED * np.linalg.norm(problem.load):
            break
    return fitted, tuple(float(value) for value in theta)


# ------------------------------------------------------------------------------------------------------------------
# Choice of a friction law for every joint and motor by held-out error, within the fitted part of the data
# ------------------------------------------------------------------------------------------------------------------

LINEAR = "coulomb_viscous"
AUTO = "auto"
CANDIDATES = (
    LINEAR,
    "asymmetric",
    "load_dependent",
    "exponential",
    "stribeck",
    "dahl",
    "asymmetric_exponential",
    "dahl_exponential",
    "dahl_load_dependent",
    "lugre",
)
"""The laws compared by ``auto``, the simpler ones first: those with fewer shapes."""
PARTS = 6  # stretches into which the fitted part is cut, alternating between the two halves
TOLERANCE = 0.01  # share by which the error of a simpler law may be larger
BLOCKS = 24  # number of blocks of rows over which errors are compared
SIGNIFICANT = 2.0  # standard errors by which the law of one surface must be better there than the common one

Tell = Callable[[str], None]


@dataclass(frozen=True)
class LawErrors:
    """Relative torque errors of the model with one friction ``law`` at all joints.

    ``in_sample`` is the error on the fitted rows, ``held_out`` that on the others, and ``joints`` (n,) the held-out
    error of each joint. ``squares`` (blocks, n) are the sums of squared held-out errors over consecutive blocks of
    rows.
    """

    law: str
    in_sample: float
    held_out: float
    joints: tuple[float, ...]
    squares: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """The friction laws of an identification, with their fitted shape parameters, and how they were chosen.

    ``surfaces`` are the joints and motors with a law, ``names`` their names; ``std`` holds for each the standard
    deviations of the logarithms of its shape parameters. ``joints`` are the joint names; ``table`` the laws compared,
    empty if the user named the laws; ``load`` the parameters from which load torques are computed, empty if no law
    depends on the load.
    """

    surfaces: tuple[FrictionSurface, ...]
    std: tuple[tuple[float, ...], ...]
    names: tuple[str, ...]
    joints: tuple[str, ...]
    table: tuple[LawErrors, ...] = ()
    load: tuple[float, ...] = ()

    def lines(self, width: int | None = None) -> list[str]:
        """The candidates with their errors, then the law and the shapes of every surface, as text.

        The table is folded to lines of ``width`` characters; None: lines of any length.
        """
        lines = []
        if self.table:
            rows = [("law", "in sample", "held out", *self.joints)]
            for candidate in self.table:
                values = (candidate.in_sample, candidate.held_out, *candidate.joints)
                rows.append((candidate.law, *(f"{100 * value:.3g} %" for value in values)))
            lines.append("friction laws at all joints: relative torque error, cross-validated within the fitted data")
            lines += text_table(rows, width, indent="", right=range(1, len(rows[0])))
        for name, surface, std in zip(self.names, self.surfaces, self.std, strict=True):
            estimates = zip(surface.definition.shapes, surface.shapes, std, strict=True)
            shapes = ", ".join(
                f"{shape} {value:.3g} (factor {np.exp(spread):.2g})" for shape, value, spread in estimates
            )
            lines.append(f"friction of {name}: {surface.law}{': ' + shapes if shapes else ''}")
        return lines

    def to_json(self) -> dict[str, Any]:
        """Laws, shapes and candidates as plain data for JSON."""
        return {
            "surfaces": [
                {
                    "name": name,
                    "law": surface.law,
                    "shapes": dict(zip(surface.definition.shapes, surface.shapes, strict=True)),
                    "std_of_log": dict(zip(surface.definition.shapes, std, strict=True)),
                }
                for name, surface, std in zip(self.names, self.surfaces, self.std, strict=True)
            ],
            "candidates": [vars(candidate) for candidate in self.table],
        }


@dataclass(frozen=True)
class LawChoice:
    """The friction laws that the user asks for: ``common`` at every joint and motor with friction, ``named`` at some.

    ``named`` holds pairs (joint or motor, law). A law is a name of :data:`LAWS`, or :data:`AUTO` to choose one
    by held-out error; ``common`` None keeps the laws of the robot file.
    """

    common: str | None = None
    named: tuple[tuple[str, str], ...] = ()

    @classmethod
    def parse(cls, texts: Sequence[str], spec: Any) -> LawChoice:
        """Read ``LAW``, ``auto`` or ``JOINT=LAW``.

        Raises InputError for laws, joints and motors that do not exist, and for two laws at one place.
        """
        owners = _owner_names(spec)
        laws: dict[str, str] = {}  # by joint or motor, '' for all
        for text in texts:
            where, _, law = text.rpartition("=")
            if law not in (*LAWS, AUTO):
                known = (*LAWS, AUTO)
                hint = " ".join(filter(None, (did_you_mean(law, known), f"there are {', '.join(known)}")))
                raise InputError(f"no friction law '{law}'; {hint}")
            if where and where not in owners:
                raise InputError(
                    f"no joint or motor '{where}' states friction; there are {', '.join(owners) or 'none'}"
                )
            if laws.setdefault(where, law) != law:
                place = f"at {where}" if where else "at all joints"
                raise InputError(f"two friction laws {place}, {laws[where]} and {law}: leave one away")
        common = laws.pop("", None)
        if common is not None and not owners:
            raise InputError("no joint or motor of the robot file states friction: write friction: {viscous: 0, ...}")
        return cls(common, tuple(laws.items()))

    def law_of(self, name: str, stated: str) -> str:
        """Law to fit at the joint or motor ``name``; ``stated`` is its law in the robot file."""
        return dict(self.named).get(name, self.common or stated)


def _owner_names(spec: Any) -> dict[str, str]:
    """Joints and motors for which the robot file states friction: suffix of their parameter names -> name."""
    if spec is None:  # a model of equations alone
        return {}
    endings = {f"{i + 1}": joint.name for i, joint in enumerate(spec.joints)}
    if spec.drives is not None:
        endings |= {f"_{motor.name}": motor.name for motor in spec.drives.motors}
    return {endings[surface.owner]: surface.owner for surface in surfaces_with(spec, LINEAR)}


def fit_friction(
    model: RigidModel,
    recordings: Sequence[Recording],
    processing: Processing,
    terms: DriveTerms,
    choice: LawChoice,
    split: Split,
    known: KnownTorque | None = None,
    tell: Tell | None = None,
) -> FrictionFit | None:
    """Choose the friction laws and fit their shape parameters to the fitted part of ``recordings``.

    Returns None if all friction is linear in its parameters.
    ``terms`` are the drive terms to estimate, ``choice`` the laws asked for. Raises InputError for recordings without
    rows.
    """
    tell = tell or (lambda message: None)
    owners = {owner: name for name, owner in _owner_names(model.spec).items()}
    stated = {surface.owner: surface for surface in stated_surfaces(model.spec)}
    wanted = {
        owner: choice.law_of(name, stated[owner].law if owner in stated else LINEAR) for owner, name in owners.items()
    }
    if all(law == LINEAR for law in wanted.values()):
        return None
    problems = _Problems(model, recordings, processing, terms, known)
    table: tuple[LawErrors, ...] = ()
    if AUTO in wanted.values():
        table = tuple(_compare_laws(problems, model.spec, wanted, split, tell))
        wanted |= _choose_laws(table, surfaces_with(model.spec, LINEAR), wanted)
    surfaces = _surfaces(model.spec, wanted, stated)
    tell("shapes of the friction laws")
    problem, regressor = problems.of(surfaces)
    fitted, load = tune_under_load(problem, regressor, surfaces, problem.fitted_rows(split))
    named = tuple(owners[surface.owner] for surface in fitted.surfaces)
    return FrictionFit(fitted.surfaces, fitted.std, named, tuple(recordings[0].joints), table, load)


@dataclass(frozen=True, eq=False)
class _Problems:
    """Builds the rows of ``recordings`` for any choice of friction laws; all other columns stay the same.

    ``processing`` holds the filters, ``terms`` are the drive terms to estimate, ``known`` is a torque that is
    subtracted from the measured one, None for none.
    """

    model: RigidModel
    recordings: Sequence[Recording]
    processing: Processing
    terms: DriveTerms
    known: KnownTorque | None

    def of(self, surfaces: Sequence[FrictionSurface]) -> tuple[Problem, FullRegressor]:
        regressor = FullRegressor(self.model, without_laws(self.terms, surfaces))
        maker = RowMaker(regressor, self.processing, len(regressor.columns), self.known)
        return Problem.of(self.recordings, maker), regressor


def _surfaces(
    spec: Any, wanted: Mapping[str, str], stated: Mapping[str, FrictionSurface]
) -> tuple[FrictionSurface, ...]:
    """Joints and motors with a law other than the linear one, by ``wanted`` (suffix of parameter names -> law).

    Those that the robot file states with the same law, in ``stated``, bring their shape parameters as initial values.
    """
    surfaces = []
    for surface in surfaces_with(spec, LINEAR):
        law = wanted[surface.owner]
        stated_surface = stated.get(surface.owner)
        if law != LINEAR:
            surfaces.append(
                replace(
                    surface,
                    law=law,
                    shapes=stated_surface.shapes if stated_surface is not None and stated_surface.law == law else (),
                )
            )
    return tuple(surfaces)


def _compare_laws(
    problems: _Problems, spec: Any, wanted: Mapping[str, str], split: Split, tell: Tell
) -> list[LawErrors]:
    """Errors of every candidate law at the joints and motors whose law is to be chosen.

    Each is tuned on one half of the fitted data and scored on the other, and vice versa.
    """
    table = []
    for law in CANDIDATES:
        tell(f"friction law {law}, cross-validated")
        surfaces = _surfaces(
            spec, {owner: law if wanted_law == AUTO else wanted_law for owner, wanted_law in wanted.items()}, {}
        )
        problem, regressor = problems.of(surfaces)
        use = problem.fitted_rows(split)
        halves = _halves(problem, use)
        size, inside, inside_size = (np.zeros(use.shape[1]) for _ in range(3))
        squares = np.zeros((BLOCKS, use.shape[1]))
        for half in halves:
            fitted, _ = tune_under_load(problem, regressor, surfaces, use & half[:, None])
            other = use & ~half[:, None]
            squares += _block_sums(fitted.residual, other, use)
            size += _sums(problem.tau, other)
            inside += _sums(fitted.residual, use & half[:, None])
            inside_size += _sums(problem.tau, use & half[:, None])
        table.append(
            LawErrors(
                law,
                float(np.sqrt(np.sum(inside) / np.sum(inside_size))),
                float(np.sqrt(np.sum(squares) / np.sum(size))),
                tuple(float(v) for v in np.sqrt(np.sum(squares, axis=0) / np.maximum(size, np.finfo(float).tiny))),
                tuple(tuple(row) for row in squares.tolist()),
            )
        )
    return table


def _halves(problem: Problem, use: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Split the fitted rows into two halves: two masks (r,) that alternate between stretches with equally many rows."""
    part = _parts(use, PARTS)
    return part % 2 == 0, part % 2 == 1


def _parts(use: NDArray[np.bool_], count: int) -> NDArray[np.int64]:
    """For each row the index (r,) of its part: ``count`` consecutive parts have equally many rows in use."""
    number = np.cumsum(use.any(axis=1))
    return np.asarray(np.clip((number - 1) * count // max(1, int(number[-1])), 0, count - 1))


def _sums(values: Array, use: NDArray[np.bool_]) -> Array:
    return np.asarray(np.sum(np.where(use, values, 0.0) ** 2, axis=0))


def _block_sums(values: Array, chosen: NDArray[np.bool_], use: NDArray[np.bool_]) -> Array:
    """Sums (blocks, n) of squares of ``values`` (r, n) in the rows ``chosen`` of every block of the rows ``use``."""
    sums = np.zeros((BLOCKS, values.shape[1]))
    np.add.at(sums, _parts(use, BLOCKS), np.where(chosen, values, 0.0) ** 2)
    return sums


def _choose_laws(
    table: Sequence[LawErrors], surfaces: Sequence[FrictionSurface], wanted: Mapping[str, str]
) -> dict[str, str]:
    """Choose the law of every joint and motor ("surface") whose law is open; in general all get a common law.

    The error of a surface is that of the joints on which it acts, each relative to its own smallest error. The common
    law is the simplest whose mean error is within the tolerance of the smallest. A surface keeps the linear law if no
    other is better there, and gets another than the common law if this lowers its errors, over blocks of rows, by more
    than :data:`SIGNIFICANT` standard errors.
    """
    squares = np.array([candidate.squares for candidate in table])  # (laws, blocks, n)
    least = np.maximum(np.min(np.sum(squares, axis=1), axis=0), np.finfo(float).tiny)
    chosen = [surface for surface in surfaces if wanted[surface.owner] == AUTO]
    blocks = np.array([np.mean((squares / least)[..., list(surface.joints)], axis=-1) for surface in chosen])
    errors = np.sum(blocks, axis=-1)  # (surfaces, laws)
    common = _simplest(np.mean(errors, axis=0))
    laws = {}
    for surface, law_errors, parts in zip(chosen, errors, blocks, strict=True):
        gain = parts[common] - parts
        spread = np.maximum(np.std(gain, axis=-1, ddof=1) / np.sqrt(BLOCKS), np.finfo(float).tiny)
        better = np.mean(gain, axis=-1) > SIGNIFICANT * spread
        law = common
        if _simplest(law_errors) == 0:
            law = 0
        elif better.any():
            law = _simplest(np.where(better, law_errors, np.inf))
        laws[surface.owner] = table[law].law
    return laws


def _simplest(squares: Array) -> int:
    """Index of the first law whose error is within the tolerance of the smallest; ``squares`` (laws,) are squared."""
    return int(np.flatnonzero(squares <= np.min(squares) * (1.0 + TOLERANCE) ** 2)[0])
