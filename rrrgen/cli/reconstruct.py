"""The command ``rrrgen experiment reconstruct``: reconstruct positions, speeds and accelerations from a recording."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import FindingsPrinter, fresh_option, json_option, output_option, print_json, truncated_option
from rrrgen.cli.study_options import click_options
from rrrgen.cli.terminal import progress_bar, say
from rrrgen.lab.studies.preprocessing import MotionOptions


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@click_options(MotionOptions)
@truncated_option
@fresh_option
@json_option
def reconstruct(
    log: Path, output: Path, options: MotionOptions, skip_truncated_line: bool, fresh: bool, as_json: bool
) -> int:
    """Reconstruct joint positions, speeds and accelerations from the recording LOG (or its mapping file).

    Unless an option or the mapping file sets them, the noise variances of the Kalman smoother are tuned by its
    innovations, and the cut-off of a Butterworth filter is 5 times the bandwidth of the motion; the choice is printed.
    Writes motion.csv, the tuning, and for a Kalman filter its Bode plot to DIR.

    \b
    Example:
      rrrgen experiment reconstruct runs/experiment/results/log.yaml --method kalman -o runs/motion
    """
    from rrrgen.lab.studies.reconstruct import reconstruct as study

    with progress_bar() as progress:
        result = study(
            log,
            options,
            folder=output,
            fresh=fresh,
            progress=progress,
            findings=FindingsPrinter(as_json),
            skip_truncated_line=skip_truncated_line,
        )
    if as_json:
        print_json(result.to_json())
    else:
        tuned, samples = result.lines()
        say(tuned, f"{samples}; motion in {output / 'results' / 'motion.csv'}")
    return 0
