"""The command ``rrrgen frf``: estimate the frequency response of a joint from closed-loop recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.extras import require
from rrrgen.cli.arguments import json_option, print_json
from rrrgen.cli.progress import working
from rrrgen.cli.terminal import say
from rrrgen.cli.workflow import output_option

if TYPE_CHECKING:
    from rrrgen.lab.response.frequency_response import FrequencyResponse

METHODS = ("local_polynomial", "instrumental", "direct", "indirect")


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="Estimator: local polynomials, averages with the excitation as instrument, output over input, or by the "
    "sensitivity and the controller (14.38).",
)
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def frf(log: Path, output: Path, method: str, fresh: bool, as_json: bool) -> int:
    """Estimate the frequency response of a joint, output over input, from recordings in closed loop.

    LOG is a response file (schema rrrgen-response/1): which columns are the excitation n, the input u and the output q.
    Writes results/frf.json, with 95 % bands, the coherence and a verdict on every line, and a Bode diagram. Distortion,
    such as friction at changes of direction or quantisation that repeats in every period, biases all lines at once: the
    verdict on the recording is then negative, and the command exits with 1.

    \b
    Example:
      rrrgen frf joint1.yaml -o runs/response
    """
    require("rrrgen frf", "scipy", "matplotlib")
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.response.estimate import estimate_responses
    from rrrgen.lab.response.figures import plot_responses
    from rrrgen.lab.response.response_file import load_response

    response = load_response(log)
    with working("estimating the frequency response"):
        found = estimate_responses(response, method)
    inputs = {"log": str(log)} | {f"file {source.name}": str(source.path) for source in response.files}
    with RunFolder(output, "frf", inputs, {"method": method}, 0, fresh) as folder:
        record: dict[str, Any] = found[0].to_json()
        if len(found) > 1:
            record["postures"] = [each.to_json() for each in found]
        folder.write_json("frf.json", record)
        folder.figure("frf", plot_responses(found))
    if as_json:
        print_json(plain(record))
    else:
        for each in found:
            _print(each)
    return 0 if all(not each.findings for each in found) else 1


def _print(response: FrequencyResponse) -> None:
    """Print the verdict on every response."""
    import numpy as np

    trusted, f = response.trusted, response.frequency
    say(
        f"{response.name}: {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz, {response.method}; 95 % band "
        f"{100 * np.median(response.band95):.2g} % (median)"
    )
    if response.findings:
        for finding in response.findings:
            say(f"  not trusted: {finding.message}")
    else:
        say(f"  trusted: {np.count_nonzero(trusted)} of {len(trusted)} lines ({100 * np.mean(trusted):.0f} %)")
