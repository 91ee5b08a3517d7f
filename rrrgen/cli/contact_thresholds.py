"""The command ``rrrgen contact-thresholds``: find thresholds of contact detection from recordings without contact."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.extras import require
from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import working
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import (
    input_files,
    log_option,
    output_option,
    print_repairs,
    truncated_option,
)

if TYPE_CHECKING:
    from rrrgen.lab.contact.recordings import ContactFindings

POSITIVE = click.FloatRange(min=0.0, min_open=True)


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@click.option(
    "--tuning",
    type=click.Path(path_type=Path, exists=True),
    help="tuning.json of `rrrgen reconstruct`, for the Kalman filter of the speeds; default: tuned by the recordings.",
)
@click.option("--gain", type=POSITIVE, default=50.0, show_default=True, help="Pole of the momentum observer, 1/s.")
@click.option("--width", type=POSITIVE, default=0.05, show_default=True, help="Width of smooth friction, rad/s or m/s.")
@click.option(
    "--seconds-per-alarm",
    type=POSITIVE,
    default=3600.0,
    show_default=True,
    help="Mean time between false alarms of all joints together, s.",
)
@click.option("--block", type=POSITIVE, default=1.0, show_default=True, help="Length of a block of residuals, s.")
@click.option("--force", type=POSITIVE, default=10.0, show_default=True, help="Force at the tip to report on, N.")
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def contact_thresholds(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Find thresholds of contact detection from recordings without contact.

    The momentum observer runs along the recordings as it does in the controller, and an extreme-value distribution is
    fitted to the largest residual in every second, and to its fastest change. From them follow the thresholds for a
    given mean time between false alarms, and the delay with which a force at the tip will be detected. Writes
    contact.json, and <name>_contact.h with the thresholds for the C function `contact` and the covariance for
    `external_force` and `external_wrench`, to DIR. Record motions like those of normal work, with the torques that were
    applied.

    \b
    Example:
      rrrgen contact-thresholds runs/identified/results/robot.yaml --log work.yaml -o runs/contact
    """
    require("rrrgen contact-thresholds", "scipy")
    from rrrgen.lab.contact.header import contact_header
    from rrrgen.lab.contact.recordings import findings_of_recordings
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import check_robot, load_stream, open_log
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.runtime import load

    spec = read_with_warnings(robot)
    mappings = [open_log(path, skip_truncated=options["skip_truncated_line"]) for path in logs]
    for mapping in mappings:
        check_robot(mapping, spec)
    names = ("gain", "width", "seconds_per_alarm", "block", "force")
    settings = {name: options[name] for name in (*names, "skip_truncated_line")}
    inputs = input_files(robot, logs, mappings) | ({"tuning": options["tuning"]} if options["tuning"] else {})
    with (
        RunFolder(output, "contact-thresholds", inputs, settings, 0, options["fresh"]) as folder,
        working("finding thresholds"),
    ):
        recordings = [load_stream(LogStream(mapping)) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        tuning = _tuning(options["tuning"], spec.n)
        found = findings_of_recordings(
            load.compile(spec), recordings, tuning, **{name: options[name] for name in names}
        )
        record = plain(found.to_json())
        folder.write_json("contact.json", record)
        folder.write_text(f"{spec.name}_contact.h", contact_header(spec.name, found))
    if as_json:
        print_json(record)
    else:
        _print(found, [joint.name for joint in spec.joints], output)
    return 0


def _tuning(path: Path | None, joints: int) -> Any:
    """The variances (eta, xi) of the joints in a tuning.json; None without a file."""
    from rrrgen.cli.controller_code import read_tuning

    return None if path is None else read_tuning(path, joints)


def _print(found: ContactFindings, joints: list[str], output: Path) -> None:
    limits = found.thresholds
    columns = ("residual", "change", "rms")
    say("thresholds of residuals and of their changes, and the residuals' root mean square, N m or N:")
    say(" ".join([" " * 10, *(f"{column:>10}" for column in columns)]))
    for name, *values in zip(joints, limits.levels, limits.change_levels, found.covariance.deviations, strict=True):
        say(" ".join([f"  {name:8}", *(f"{value:10.4g}" for value in values)]))
    say(f"from {limits.blocks} blocks of {limits.block:g} s, for one false alarm in {limits.seconds_per_alarm:g} s")
    say(found.detection.sentence())
    say(f"results in {output}")
