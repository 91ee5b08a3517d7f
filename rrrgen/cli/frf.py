"""The command ``rrrgen response frf``: estimate the frequency response of a joint from closed-loop recordings."""

from __future__ import annotations

from pathlib import Path

import click

from rrrgen.cli.arguments import fresh_option, json_option, output_option, run_study
from rrrgen.cli.study_options import click_options
from rrrgen.lab.studies.frequency_response import FrequencyResponseOptions


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@click_options(FrequencyResponseOptions)
@fresh_option
@json_option
def frf(log: Path, output: Path, options: FrequencyResponseOptions, fresh: bool, as_json: bool) -> int:
    """Estimate the frequency response of a joint, output over input, from recordings in closed loop.

    LOG is a response file (schema rrrgen-response/1): which columns are the excitation n, the input u and the output q.
    Writes results/frf.json, with 95 % bands, the coherence and a verdict on every line, and a Bode diagram. Distortion,
    such as friction at changes of direction or quantisation that repeats in every period, biases all lines at once: the
    verdict on the recording is then negative, and the command exits with 1.

    \b
    Example:
      rrrgen response frf joint1.yaml -o runs/response
    """
    from rrrgen.lab.studies.frequency_response import frequency_response

    result = run_study(frequency_response, log, options, folder=output, fresh=fresh, as_json=as_json)
    return 0 if result.trusted else 1
