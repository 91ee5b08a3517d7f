"""The command ``rrrgen reconstruct``: reconstruct positions, speeds and accelerations from a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from rrrgen.cli.arguments import json_option, print_json
from rrrgen.cli.identification.workflow import (
    chosen_processing,
    output_option,
    print_repairs,
    reconstruction_options,
    truncated_option,
)
from rrrgen.cli.progress import progress_bar
from rrrgen.cli.terminal import say
from rrrgen.extras import require


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@reconstruction_options
@truncated_option
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def reconstruct(log: Path, output: Path, as_json: bool, fresh: bool, **options: Any) -> int:
    """Reconstruct joint positions, speeds and accelerations from the recording LOG (or its mapping file).

    Unless an option or the mapping file sets them, the noise variances of the Kalman smoother are tuned by its
    innovations, and the cut-off of a Butterworth filter is 5 times the bandwidth of the motion; the choice is printed.
    Writes motion.csv, the tuning, and for a Kalman filter its Bode plot to DIR.

    \b
    Example:
      rrrgen reconstruct runs/experiment/results/log.yaml --method kalman -o runs/motion
    """
    require("rrrgen reconstruct", "scipy", "matplotlib")
    from rrrgen.identify.estimation.observations import reconstruct as reconstructed
    from rrrgen.identify.estimation_plots import plot_bode
    from rrrgen.identify.scoring.bandwidth import tune
    from rrrgen.recordings.log_stream import LogStream
    from rrrgen.recordings.logs import load_stream, open_log
    from rrrgen.runs.run_folder import RunFolder, plain
    from rrrgen.signals.smoother import KalmanSmoother

    mapping = open_log(log, skip_truncated=options["skip_truncated_line"])
    processing = chosen_processing([mapping], options["reconstruction"], options["cutoff"])
    inputs = {"log": log, **{source.name: Path(source.path) for source in mapping.files}}
    settings = {**processing.settings(), "skip_truncated_line": options["skip_truncated_line"]}
    with RunFolder(output, "reconstruct", inputs, settings, 0, fresh) as folder, progress_bar() as tell:
        tell(0, 0, "reading")
        recording = load_stream(LogStream(mapping))
        print_repairs([recording.repairs], as_json)
        tell(0, 0, "bandwidth and noise of the positions")
        tuning = tune(replace(processing, decimate=1), [recording])  # no decimation: every sample is reconstructed
        processing = tuning.processing
        rows: list[list[float]] = []
        for part in recording.parts():
            tell(len(rows), len(recording), "reconstructing")
            motion = reconstructed(part, processing)
            columns = [motion.t[:, None], motion.q, motion.dq, motion.ddq]
            rows += [[float(v) for block in row for v in block] for row in zip(*columns, strict=True)]
        header = ["t", *(f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in recording.joints)]
        tell(len(recording), len(recording), "writing the motion")
        folder.write_csv("motion.csv", header, rows)
        folder.write_json("tuning.json", processing.settings())
        folder.write_json("repairs.json", {"repairs": [recording.repairs.to_json()]})
        method = None if processing.method == "logged" else processing.reconstructor()
        if isinstance(method, KalmanSmoother):
            matrices = method.matrices(recording.period, len(recording.joints))
            folder.figure("bode", plot_bode(matrices, recording.joints))
    if as_json:
        print_json(plain({"samples": len(rows), "processing": processing.settings()}))
    else:
        say(tuning.sentences()[0])
        say(f"{len(rows)} samples by {processing.method}; motion in {output / 'results' / 'motion.csv'}")
    return 0
