"""The option ``--html``, and the reading of motions and figures for the HTML report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.cli.arguments import USUAL, F
from rrrgen.cli.terminal import progress_bar

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.html.scene import Illustration, PlayedMotion
    from rrrgen.emit.html.tables import Verification
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.verify.report import Report

FRAMES_PER_SECOND = 50
"""Rate at which a designed trajectory is sampled for the view."""


def html_option(function: F) -> F:
    """Add the option ``--html FILE``, for an HTML report."""
    kind = click.Path(dir_okay=False, path_type=Path)
    return click.option("--html", type=kind, help="Also write a self-contained HTML report of the robot.")(function)


def write_html(
    file: Path,
    model: DerivedModel,
    report: Report | None = None,
    motions: Sequence[PlayedMotion] = (),
    figures: Sequence[Illustration] = (),
) -> None:
    """Write the HTML report of ``model`` to ``file``, with the closed forms of the usual functions."""
    from rrrgen.base.files import write_file
    from rrrgen.derive import prepare
    from rrrgen.derive.closed_forms import closed_form
    from rrrgen.emit.html import html_report
    from rrrgen.robot.identity import identify
    from rrrgen.robot.model.mechanism import refuse_loops

    refuse_loops(model.spec, "the report with the drawing")
    identity = identify(model.spec)
    derivation = prepare(model.spec)
    notice = f"Written by rrrgen {identity.tool_version} from model {identity.model_hash}."
    forms = {}
    with progress_bar() as tell:
        for k, name in enumerate(USUAL):
            tell(k, len(USUAL) + 1, f"closed form of {name}")
            forms[name] = closed_form(derivation, name).readable()
        tell(len(USUAL), len(USUAL) + 1, "writing the page")
        write_file(
            file, html_report(model, forms, None if report is None else verification(report), notice, motions, figures)
        )
    click.echo(f"{file} written", err=True)


def verification(report: Report) -> Verification:
    """What the HTML page of a robot says of the verification ``report``."""
    from rrrgen.emit.html.tables import HtmlTable, Verification

    rows, failed = [], []
    for k, row in enumerate(report.rows):
        difference, tolerance = f"{row.difference:.1e}", f"{row.tolerance:.0e}" if row.tolerance else "0"
        verdict = row.verdict if not row.note else f"{row.verdict}: {row.note}"
        rows.append((row.function, row.reference, row.parameters, str(row.samples), difference, tolerance, verdict))
        if not row.ok:
            failed.append(k)
    headings = ("function", "reference", "parameters", "states", "max. relative difference", "tolerance", "verdict")
    table = HtmlTable(headings, tuple(rows), frozenset({3, 4, 5}), frozenset(failed))
    return Verification(table, report.ok, report.samples, report.seed, report.skipped)


def read_motions(files: Iterable[Path], spec: RobotSpec) -> list[PlayedMotion]:
    """The motions of trajectories (.json of `rrrgen experiment excite`) and of recordings or their mapping files.

    Raises InputError for a file that is neither, or that belongs to another robot.
    """
    return [_trajectory(file) if file.suffix == ".json" else _recording(file, spec) for file in files]


def _trajectory(file: Path) -> PlayedMotion:
    import numpy as np

    from rrrgen.emit.html.scene import PlayedMotion
    from rrrgen.lab.design.fourier_series import read_trajectory
    from rrrgen.lab.design.friction_motion import read_friction_motion

    series = read_friction_motion(file) or read_trajectory(file)
    t = np.linspace(0.0, series.period, max(2, round(FRAMES_PER_SECOND * series.period) + 1))
    return PlayedMotion(f"Trajectory {_short(file)}", t, series.evaluate(t)[0])


def _recording(file: Path, spec: RobotSpec) -> PlayedMotion:
    from rrrgen.emit.html.scene import PlayedMotion
    from rrrgen.lab.data.recordings import check_robot, load_stream, open_log
    from rrrgen.lab.data.uniform_stream import LogStream

    mapping = open_log(file)
    check_robot(mapping, spec)
    log = load_stream(LogStream(mapping), [joint.name for joint in spec.joints])
    return PlayedMotion(f"Recording {_short(file)}", log.t, log.q)


def _short(file: Path) -> str:
    """The name of ``file`` on a page that others will see: without the folders above its run folder."""
    return "/".join(file.absolute().parts[-3:]) if file.parent.name == "results" else file.name
