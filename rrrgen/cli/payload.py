"""The command ``rrrgen payload``: estimate mass, centre of mass and inertia of a payload."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.base.extras import require
from rrrgen.cli.arguments import json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.progress import working
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import (
    chosen_processing,
    input_files,
    log_option,
    output_option,
    print_repairs,
    processing_options,
    truncated_option,
)


@click.command()
@robot_argument
@log_option
@truncated_option
@output_option
@processing_options
@click.option(
    "--keep-friction", is_flag=True, help="Take friction as the robot file states it instead of correcting it too."
)
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def payload(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Estimate mass, centre of mass and inertia of a payload at the last link of a known arm.

    Writes payload.json, and robot.yaml with the payload as a part of the last link, to DIR. Half a minute of a motion
    in which the last joints move through many directions of gravity is enough. Samples near rest are left out. Exits
    with 4 if the motion does not determine the mass; other values that it does not determine are marked.

    \b
    Example:
      rrrgen payload runs/identified/results/robot.yaml --log carrying.yaml -o runs/payload
    """
    require("rrrgen payload", "scipy", "cvxpy", "clarabel")
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import check_robot, open_log
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.identify.payload import identify_payload
    from rrrgen.robot.file import dumps
    from rrrgen.runtime import load

    spec = read_with_warnings(robot)
    skip = options["skip_truncated_line"]
    mappings = [open_log(path, skip_truncated=skip) for path in logs]
    for mapping in mappings:
        check_robot(mapping, spec)
    processing = chosen_processing(mappings, options["reconstruction"], options["cutoff"], options["decimate"])
    settings = {**processing.settings(), "keep_friction": options["keep_friction"], "skip_truncated_line": skip}
    inputs = input_files(robot, logs, mappings)
    with (
        RunFolder(output, "payload", inputs, settings, 0, options["fresh"]) as folder,
        working("estimating the payload"),
    ):
        recordings = [LogStream(mapping) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        found = identify_payload(load.compile(spec), recordings, processing, not options["keep_friction"])
        folder.write_json("payload.json", found.to_json())
        folder.write_text("robot.yaml", dumps(found.carried_by(spec)))
    if as_json:
        print_json(plain(found.to_json()))
    else:
        say(*found.lines(), *found.tuning.sentences())
        say(f"results in {output}")
    return 0
