"""The command ``rrrgen drive-gains``: estimate torque constants from recordings with and without a payload."""

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
@click.option(
    "--loaded",
    "loaded",
    required=True,
    multiple=True,
    type=click.Path(path_type=Path),
    help="Recording, or its mapping file, with the payload; --log is the one without. Repeat for several.",
)
@click.option("--mass", required=True, type=click.FloatRange(min=0, min_open=True), help="Mass of the payload, kg.")
@click.option(
    "--com",
    nargs=3,
    type=float,
    default=(0.0, 0.0, 0.0),
    help="Centre of mass in the last link frame, m; default: its origin.",
)
@click.option(
    "--inertia",
    nargs=6,
    type=float,
    default=(0.0,) * 6,
    metavar="XX YY ZZ XY XZ YZ",
    help="Inertia tensor about the centre of mass in its axes, kg m^2; default: a point mass.",
)
@truncated_option
@output_option
@processing_options
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def drive_gains(
    robot: str, logs: tuple[Path, ...], loaded: tuple[Path, ...], output: Path, as_json: bool, **options: Any
) -> int:
    """Estimate unknown drive gains (torque constants) from recordings without and with a known payload.

    The masses of ROBOT are not used: all parameters of the arm are estimated too, in the units of the payload. Writes
    drive_gains.json to DIR. Exits with 4 if the payload hardly loads a joint, whose gain is then not determined.

    \b
    Example:
      rrrgen drive-gains my_arm.yaml --log empty.yaml --loaded carrying.yaml --mass 4.6 --com 0 0 0.05 -o runs/gains
    """
    require("rrrgen drive-gains", "scipy")
    import numpy as np

    from rrrgen.base.errors import DerivationError
    from rrrgen.lab.data.log_stream import LogStream
    from rrrgen.lab.data.recordings import check_robot, open_log
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.identify.drive_gains import identify_gains
    from rrrgen.lab.identify.rows import standard_of
    from rrrgen.runtime import load

    spec = read_with_warnings(robot)
    skip = options["skip_truncated_line"]
    mappings = [open_log(path, skip_truncated=skip) for path in (*logs, *loaded)]
    for mapping in mappings:
        check_robot(mapping, spec)
    processing = chosen_processing(mappings, options["reconstruction"], options["cutoff"], options["decimate"])
    named = ("mass", "com", "inertia", "skip_truncated_line")
    settings = {**processing.settings(), **{name: options[name] for name in named}}
    inputs = input_files(robot, logs, mappings[: len(logs)])
    inputs |= input_files("", loaded, mappings[len(logs) :], "loaded")
    body = standard_of(options["mass"], np.array(options["com"]), np.array(options["inertia"]))
    with (
        RunFolder(output, "drive-gains", inputs, settings, 0, options["fresh"]) as folder,
        working("estimating drive gains"),
    ):
        recordings = [LogStream(mapping) for mapping in mappings]
        print_repairs((recording.repairs for recording in recordings), as_json)
        empty, carrying = recordings[: len(logs)], recordings[len(logs) :]
        found = identify_gains(load.compile(spec), empty, carrying, body, processing)
        folder.write_json("drive_gains.json", found.to_json())
    if as_json:
        print_json(plain(found.to_json()))
    else:
        say(*found.lines(), *found.tuning.sentences())
        say(f"results in {output}")
    return DerivationError.exit_code if found.undetermined else 0
