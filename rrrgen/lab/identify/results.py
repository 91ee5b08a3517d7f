"""Writes the results of an identification: JSON record, CSV tables, figures, and the identified robot file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.errors import DerivationError
from rrrgen.base.tables import text_table
from rrrgen.base.version import VERSION
from rrrgen.lab.estimate.remainder import remainder_record
from rrrgen.lab.estimate.statistics import confidence_factor
from rrrgen.lab.identify.consistency import ConsistentEstimate
from rrrgen.lab.identify.scores import held_out_notes
from rrrgen.robot.friction.laws import LEAST
from rrrgen.robot.model.drives import SYMBOLS
from rrrgen.robot.spec import STANDARD, DriveSpec, FrictionSpec, LawSpec, link_of, standard_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.base.arrays import Array
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.estimate.tsqr import Rows
    from rrrgen.lab.identify.cross_validation import Convergence
    from rrrgen.lab.identify.friction_columns import FrictionSurface
    from rrrgen.lab.identify.identification import Identification
    from rrrgen.lab.identify.observations import Recording
    from rrrgen.lab.identify.regressor import RigidModel
    from rrrgen.robot.spec import FitSpec, RobotSpec


# ------------------------------------------------------------------------------------------------------------------
# The identified parameters as lines of text: values, standard deviations, units and the meaning of the names.
# ------------------------------------------------------------------------------------------------------------------

LINE = 118
"""Longest line of a file or pipe: a parameter that is a combination of many others has a long name."""


def parameter_lines(identification: Identification, width: int | None = None) -> Iterator[str]:
    """Lines of the parameter table, of its legend, and of the essential parameters if they were computed.

    The table is folded to lines of ``width`` characters, :data:`LINE` by default.
    """
    delivered, estimate = identification.delivered, identification.estimate
    beside = delivered.x is not estimate.x
    rows = [("parameter", "unit", "value", "std", *(("unconstrained", "std", "pull") if beside else ()))]
    for i, name in enumerate(estimate.names):
        std = "at bound" if delivered.at_bound[i] else f"{delivered.std[i]:.2e}"
        pull = f"{delivered.pull[i]:+.1f}{' from the prior' if abs(delivered.pull[i]) > 1.0 else ''}"
        free = (f"{estimate.x[i]:.6g}", f"{estimate.std[i]:.2e}", pull) if beside else ()
        rows.append((name, identification.units[i], f"{delivered.x[i]:.6g}", std, *free))
    yield from text_table(rows, width or LINE, indent="", right=range(2, 6))
    yield (
        f"value: {delivered.origin} estimate"
        + (", the one in robot.yaml; unconstrained: " + estimate.method if beside else "")
    )
    if beside:
        yield (
            "std of value: delta method at the constrained optimum, residuals correlated, and the difference from the "
            "unconstrained estimate; pull: that difference in deviations of the latter; drives at their bound of 0 do "
            "not move"
        )
    if identification.known:
        yield "known: " + ", ".join(f"{name} = {value:.6g}" for name, value in identification.known.items())
    yield from (f"names: {meaning}" for meaning in identification.meanings)
    yield from _essential(identification)


def _essential(identification: Identification) -> Iterator[str]:
    essential = identification.essential
    if essential is None:
        return
    estimate = essential.estimate
    yield f"essential parameters: {len(estimate.names)} of {len(identification.names)} ({essential.stopped_by})"
    for i, name in enumerate(estimate.names):
        yield f"  {name} = {estimate.x[i]:.6g} +- {estimate.std[i]:.2g} {identification.units[essential.kept[i]]}"
    yield f"essential parameters alone: relative error {100 * estimate.relative_error:.3g} % of the rows fitted"
    yield f"left out, in this order: {', '.join(essential.dropped) or 'none'}"


# ------------------------------------------------------------------------------------------------------------------
# Writes the results of an identification
# ------------------------------------------------------------------------------------------------------------------

FRICTION_SYMBOLS = {field: symbol for field, symbol in SYMBOLS.items() if field != "inertia"}
CONFIDENCE = 0.95


def as_record(identification: Identification, joints: Sequence[str]) -> dict[str, Any]:
    """The content of ``identification.json``: estimates, scores, filters, notes, repairs and diagnoses.

    ``joints`` (n,) are the names of the joints.
    """
    estimate = identification.estimate
    covered = {name: identification.band.coverage(blocks) for name, blocks in identification.parts}
    left = identification.left_in(joints)
    header, rows = parameter_table(identification)
    return {
        "method": estimate.method,
        "data": str(identification.split),
        "delivered": identification.delivered.origin,
        "identified": [dict(zip(header, row, strict=True)) for row in rows],
        "names": list(identification.meanings),
        "known": identification.known,
        "hardly_determined": list(identification.hardly_determined),
        "torque_band": {
            k: None if coverage is None else (coverage.share, coverage.parameters) for k, coverage in covered.items()
        },
        "torque_band_joints": {k: None if coverage is None else coverage.joints for k, coverage in covered.items()},
        "held_out_notes": list(held_out_notes(identification.scores, covered["held out"], joints, left)),
        "held_out_remainder": remainder_record(left),
        "friction": None if identification.friction is None else identification.friction.to_json(),
        "nuisances": None if identification.nuisances is None else identification.nuisances.to_json(),
        "diagnoses": [cause.to_json() for cause in identification.diagnoses],
        "oscillations": list(identification.swinging),
        "repairs": [repairs.to_json() for repairs in identification.repairs],
        "identifiable_parameters": identification.structure.rank,
        "columns": len(identification.columns),
        "relative_error_fit": identification.fit["relative_error"],
        "relative_error_held_out": identification.held_out["relative_error"],
        "fit": identification.fit,
        "held_out": identification.held_out,
        "scores": [{"measured_on": score.where, **vars(score)} for score in identification.scores],
        "condition": estimate.condition,
        "condition_scaled": estimate.scaled_condition,
        "rank": estimate.rank,
        "iterations": estimate.iterations,
        "joint_sigma": estimate.joint_sigma,
        "processing": identification.processing.settings(),
        "bandwidth": identification.tuning.to_json(),
        "guard_band": identification.split.guard,
        "whiteness": [
            {
                "durbin_watson": w.durbin_watson,
                "ljung_box_p": w.p_value,
                "samples_per_independent": w.inflation,
                "autocorrelation": w.autocorrelation,
            }
            for w in identification.whiteness
        ],
        "not_identifiable": list(identification.structural_notes),
        "not_excited": list(identification.motion_notes) + [direction.sentence for direction in identification.weak],
        "indefinite_mass_matrix_share": identification.indefinite,
        "physically_consistent": _consistent_record(identification),
        "essential": None
        if identification.essential is None
        else {
            "parameters": list(identification.essential.estimate.names),
            "values": identification.essential.estimate.x,
            "left_out": list(identification.essential.dropped),
            "relative_error_fit": identification.essential.estimate.relative_error,
            "condition": identification.essential.estimate.condition,
            "stopped_by": identification.essential.stopped_by,
        },
        "parameters": dict(zip((c.name for c in identification.columns), identification.theta, strict=True)),
    }


def _consistent_record(identification: Identification) -> dict[str, Any] | None:
    consistent = identification.consistent
    if consistent is None:
        return None
    names = standard_names(len(consistent.phi) // len(STANDARD))
    return {
        "relative_error_fit": None
        if identification.consistent_fit is None
        else identification.consistent_fit["relative_error"],
        "relative_error_held_out": None
        if identification.consistent_held_out is None
        else identification.consistent_held_out["relative_error"],
        "fit": identification.consistent_fit,
        "held_out": identification.consistent_held_out,
        "smallest_eigenvalues": consistent.eigenvalues,
        "rise_of_weighted_residual": consistent.loss,
        "standard_parameters": dict(zip(names, consistent.phi, strict=True)),
        "parameters": dict(zip(consistent.names, consistent.theta, strict=True)),
        **consistent.facts,
    }


def parameter_table(identification: Identification) -> tuple[tuple[str, ...], Iterator[Sequence[Any]]]:
    """Header and rows of ``parameters.csv``, one row per identifiable combination.

    A row holds value, standard deviation and 95 % confidence interval of the written model, and the unconstrained
    estimate for comparison.
    """
    estimate, delivered = identification.estimate, identification.delivered
    half = confidence_factor(CONFIDENCE, estimate.freedom)
    header = ("parameter", "unit", "value", "std", "std_percent", "lower_95", "upper_95", "at_bound")
    beside = ("unconstrained", "unconstrained_std", "unconstrained_std_if_white", "essential")
    kept = None if identification.essential is None else set(identification.essential.kept)

    def rows() -> Iterator[Sequence[Any]]:
        for i, name in enumerate(estimate.names):
            value, std = float(delivered.x[i]), float(delivered.std[i])
            percent = 100.0 * std / abs(value) if value else float("inf")
            essential = "" if kept is None else "yes" if i in kept else "no"
            bound = "yes" if delivered.at_bound[i] else "no"
            free = float(estimate.x[i]), float(estimate.std[i]), float(identification.iid_std[i])
            yield (
                name,
                identification.units[i],
                value,
                std,
                percent,
                value - half * std,
                value + half * std,
                bound,
                *free,
                essential,
                float(delivered.pull[i]),
            )

    return (*header, *beside, "pull"), rows()


def identified_spec(
    spec: RobotSpec,
    consistent: ConsistentEstimate,
    description: str = "",
    surfaces: Sequence[FrictionSurface] = (),
) -> RobotSpec:
    """Copy of ``spec`` with the links, friction and (also coupled) drives of a physically consistent estimate.

    Inertia is stated about the origin of the link frame, as estimated; friction and drive terms that ``spec`` lacks are
    added; ``surfaces`` are the joints and motors with other friction laws. ``description`` replaces that of the robot
    unless empty. Raises :class:`DerivationError` for an estimate that a robot file cannot hold: a link without mass, or
    terms of a motor that the robot does not have.
    """
    phi = consistent.phi.reshape(len(spec.rows), len(STANDARD))
    if np.any(phi[:, 0] <= 0):
        raise DerivationError("a link without mass cannot be written into a robot file")
    left = dict(consistent.drives)
    laws = {surface.owner: _law(surface, left) for surface in surfaces}
    joints = []
    for i, joint in enumerate(spec.joints):
        friction, inertia = _take_friction(f"{i + 1}", joint.friction, left, laws)
        drive = joint.drive if inertia is None else replace(joint.drive or DriveSpec(), inertia=inertia)
        joints.append(replace(joint, friction=friction, drive=drive))
    drives = spec.drives
    if drives is not None:
        motors = []
        for motor in drives.motors:
            friction, inertia = _take_friction(f"_{motor.name}", motor.friction, left, laws)
            motors.append(replace(motor, friction=friction, inertia=motor.inertia if inertia is None else inertia))
        drives = replace(drives, motors=tuple(motors))
    if left:
        raise DerivationError(f"no motor of the robot file is that of {', '.join(left)}: describe it under 'drives'")
    links = tuple(link_of(row) for row in phi)
    return replace(spec, joints=tuple(joints), drives=drives, links=links, description=description or spec.description)


def _law(surface: FrictionSurface, left: dict[str, float]) -> LawSpec:
    """Friction law of a joint or motor with its estimated parameters, for the robot file.

    ``left`` maps the names of parameters not yet used to their values; those of this law are removed from it.
    """
    coefficients = [
        (parameter, left.pop(f"{parameter.name}{surface.owner}")) for parameter in surface.definition.linear
    ]
    linear = [max(value, LEAST) if parameter.positive else value for parameter, value in coefficients]
    return LawSpec(surface.law, tuple(float(value) for value in surface.definition.join(linear, surface.shapes)))


def _take_friction(
    owner: str, friction: FrictionSpec | None, left: dict[str, float], laws: Mapping[str, LawSpec]
) -> tuple[FrictionSpec | None, float | None]:
    """Friction and inertia of the joint or motor whose parameter names end in ``owner``; removes them from ``left``."""
    given = {field: left.pop(f"{symbol}{owner}", None) for field, symbol in FRICTION_SYMBOLS.items()}
    coefficients: dict[str, Any] = {field: value for field, value in given.items() if value is not None}
    if owner in laws:
        friction = FrictionSpec(offset=coefficients.get("offset"), law=laws[owner])
    elif friction is not None and friction.law is not None:
        friction = FrictionSpec(**coefficients)  # the user asked for the linear law instead of that of the robot file
    elif coefficients:
        friction = replace(friction or FrictionSpec(), **coefficients)
    return friction, left.pop(f"Ia{owner}", None)


def fitted_data(identification: Identification, recordings: str = "") -> FitSpec:
    """The ``provenance`` entry of the robot file: fingerprint of the fitted samples; ``recordings`` are file names."""
    from rrrgen.robot.spec import FitSpec

    data = "all" if identification.split.kind == "none" else str(identification.split)
    return FitSpec(identification.fitted.hashes, identification.fitted.windows, f"rrrgen {VERSION}", recordings, data)


def write_identification(
    folder: RunFolder,
    identification: Identification,
    spec: RobotSpec,
    points: int = 200,
    recordings: str = "",
    model: RigidModel | None = None,
    recording: Recording | None = None,
) -> None:
    """Write the result of an identification into a run folder.

    Writes ``identification.json``, ``parameters.csv``, ``robot.yaml`` (of the physically consistent estimate),
    ``convergence.csv``, and the figures of :func:`identification_figures`. ``recordings`` names the data files in the
    provenance of the robot file; ``points`` is the approximate number of points of the convergence curves. Long
    recordings are read again for the figures.
    """
    from rrrgen.robot.file import dumps

    joints = [joint.name for joint in _with_rows(identification, spec).joints]
    folder.write_json("identification.json", as_record(identification, joints))
    folder.write_csv("parameters.csv", *parameter_table(identification))
    if identification.consistent is not None:
        folder.write_text("robot.yaml", dumps(spec_with_provenance(identification, spec, recordings)))
    settling = _convergence(identification, spec, points)
    rows = zip(settling.samples, settling.condition, *settling.x.T, strict=True)
    folder.write_csv("convergence.csv", ("samples", "condition", *settling.names), rows)
    for name, draw in identification_figures(identification, spec, points, model, recording, settling).items():
        figure = draw()
        if figure is not None:
            folder.figure(name, figure)


def spec_with_provenance(identification: Identification, spec: RobotSpec, recordings: str = "") -> RobotSpec:
    """The robot ``spec`` with the physically consistent estimate, which it must have, and the data that it is from.

    Gravity is that against the base, if its tilt was estimated.

    ``recordings`` names the data files. Raises :class:`DerivationError` for an estimate that no robot file can hold.
    """
    import sympy as sp

    assert identification.consistent is not None
    fits = {fit.hashes: fit for fit in (*spec.provenance, fitted_data(identification, recordings))}
    surfaces = () if identification.friction is None else identification.friction.surfaces
    gravity = None if identification.nuisances is None else identification.nuisances.corrections.gravity()
    if gravity is not None:
        x, y, z = (sp.Rational(repr(value)) for value in gravity)
        spec = replace(spec, gravity=(x, y, z), basis=None)  # a tilted arm has other base parameters
    return replace(identified_spec(spec, identification.consistent, surfaces=surfaces), provenance=tuple(fits.values()))


def _with_rows(identification: Identification, spec: RobotSpec) -> RobotSpec:
    """``spec`` with a joint for every row of the estimation: also for those of the wrench on a floating base."""
    from rrrgen.lab.identify.floating_base import with_base_joints

    return spec if len(identification.band.sigma) == spec.n else with_base_joints(spec)


def _convergence(identification: Identification, spec: RobotSpec, points: int) -> Convergence:
    """The estimate as a function of the number of samples, at about ``points`` numbers."""
    from rrrgen.lab.identify.cross_validation import convergence

    every = max(1, identification.fit["rows"] // _with_rows(identification, spec).n // points)
    return convergence(
        identification.blocks, identification.names, identification.estimate.weights, identification.transform, every
    )


def identification_figures(
    identification: Identification,
    spec: RobotSpec,
    points: int = 200,
    model: RigidModel | None = None,
    recording: Recording | None = None,
    settling: Convergence | None = None,
) -> dict[str, Callable[[], Figure | None]]:
    """The figures of an identification: name -> function that draws it, None if the data do not allow it.

    ``torques``, ``torques_held_out``, ``convergence``, ``whiteness``, ``bandwidth``, and ``friction`` if ``model`` and
    ``recording`` are given. ``points`` is the approximate number of points of the convergence curves ``settling``,
    which are computed if None.
    """
    from rrrgen.lab.identify.figures import (
        force_units,
        plot_convergence,
        plot_spectra,
        plot_torque_curves,
        plot_whiteness,
        torque_curves,
    )

    theta = identification.theta if identification.consistent is None else identification.consistent.theta
    spec = _with_rows(identification, spec)
    joints = [joint.name for joint in spec.joints]

    def torques(blocks: Iterable[Rows]) -> Figure | None:
        curves = torque_curves(blocks, theta, band=identification.band)
        return None if curves is None else plot_torque_curves(curves, joints, force_units(spec))

    return {
        "torques": lambda: torques(identification.blocks),
        "torques_held_out": lambda: torques(identification.held_out_blocks),
        "convergence": lambda: plot_convergence(
            _convergence(identification, spec, points) if settling is None else settling,
            identification.estimate.std,
            identification.units,
        ),
        "whiteness": lambda: plot_whiteness(identification.whiteness, joints) if identification.whiteness else None,
        "bandwidth": lambda: (
            plot_spectra(identification.tuning.spectra, joints) if any(identification.tuning.spectra) else None
        ),
        "friction": lambda: (
            None if model is None or recording is None else _friction_figure(identification, model, recording, theta)
        ),
    }


def _friction_figure(
    identification: Identification, model: RigidModel, recording: Recording, theta: Array
) -> Figure | None:
    """The estimated friction against the speed of every joint; None if the model has none."""
    from rrrgen.lab.identify.diagnosis.trial_fits import MOST_ROWS, sample_of
    from rrrgen.lab.identify.figures import plot_friction
    from rrrgen.lab.identify.friction_columns import law_columns
    from rrrgen.runtime.regressor_columns import drive_columns

    sample = sample_of(recording, identification.processing)
    kinds = {column.kind for column in identification.columns}
    if sample is None or not kinds & {"viscous", "coulomb", "law"}:
        return None
    sample = sample.thin(MOST_ROWS // sample.n)
    surfaces, load = (
        ((), ())
        if identification.friction is None
        else (identification.friction.surfaces, identification.friction.load)
    )
    drives = [column for column in identification.columns if column.kind not in ("rigid", "law")]
    rigid = np.asarray(model.regressor(sample.q, sample.dq, sample.ddq))
    fixed = np.concatenate([rigid, drive_columns(drives, sample.dq, sample.ddq)], axis=-1)
    W = np.concatenate([fixed, law_columns(surfaces, sample.dq, None, fixed @ load if load else None)], axis=-1)
    revolute = [joint.is_revolute for joint in model.spec.joints]
    return plot_friction(sample, W, identification.columns, theta, recording.joints, revolute, surfaces)
