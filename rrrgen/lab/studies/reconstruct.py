"""Reconstruction of the motion of a recording: its options, the study and its result."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import require
from rrrgen.lab.studies.options import MotionOptions, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.base.arrays import Array
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.recordings import Log
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.identify.bandwidth import Tuning
    from rrrgen.lab.studies.sources import FindingsCallback, ProgressCallback, RecordingInputs, RecordingSource


@dataclass(frozen=True, eq=False, repr=False)
class ReconstructionResult(StudyResult):
    """The result of :func:`rrrgen.reconstruct`: the motion at N points in time, and the filter that gave it.

    ``t`` (N,) s; ``q``, ``dq``, ``ddq`` (N, n) rad (m) and per s and s^2. ``tuning`` holds the filter and how it was
    chosen, ``recording`` the recording after its repair.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tuning: Tuning
    recording: Log

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints."""
        return self.recording.joints

    @property
    def processing(self) -> Processing:
        """The settings of the filter, complete with those that were chosen automatically."""
        return self.tuning.processing

    def lines(self, width: int | None = None) -> list[str]:
        """The report: how the filter was chosen, and the number of samples."""
        return [self.tuning.sentences()[0], f"{len(self.t)} samples by {self.processing.method}"]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the largest speed and acceleration of every joint, SI."""
        import numpy as np

        rows = zip(
            self.joints, *(np.max(np.abs(values), axis=0).tolist() for values in (self.dq, self.ddq)), strict=True
        )
        return ("joint", "largest speed", "largest acceleration"), list(rows)

    def to_json(self) -> dict[str, Any]:
        """Number of samples and settings of the filter as plain data."""
        from rrrgen.lab.data.run_folder import plain_record

        return plain_record({"samples": len(self.t), "processing": self.processing.settings()})

    def figures(self) -> dict[str, FigureMaker]:
        """The figure ``bode`` of a Kalman filter; none for other methods."""
        from rrrgen.lab.data.kalman import KalmanSmoother
        from rrrgen.lab.identify.figures import plot_bode

        method = None if self.processing.method == "logged" else self.processing.reconstructor()
        if not isinstance(method, KalmanSmoother):
            return {}
        matrices = method.matrices(self.recording.period, len(self.joints))
        return {"bode": lambda: plot_bode(matrices, self.joints)}

    def write(self, folder: RunFolder) -> None:
        """Write ``motion.csv``, the tuning, the repairs and the Bode plot into an open run folder."""
        import numpy as np

        header = ["t", *(f"{kind}_{joint}" for kind in ("q", "dq", "ddq") for joint in self.joints)]
        folder.write_csv("motion.csv", header, np.column_stack([self.t, self.q, self.dq, self.ddq]).tolist())
        folder.write_json("tuning.json", self.processing.settings())
        folder.write_json("repairs.json", {"repairs": [self.recording.repairs.to_json()]})
        for name in self.figures():
            folder.figure(name, self.plot(name))


def reconstruct(
    recording: RecordingSource,
    options: MotionOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    skip_truncated_line: bool = False,
    **changes: Any,
) -> ReconstructionResult:
    """Reconstruct joint positions, speeds and accelerations from a recording.

    Unless an option or the mapping file sets them, the noise variances of the Kalman smoother are tuned by its
    innovations, and the cut-off of a Butterworth filter is 5 times the bandwidth of the motion.

    Args:
        recording: a recording or mapping file, a ``Log``, or arrays by name: ``t`` (N,) in s, ``q`` (N, n), and others
            as for :func:`rrrgen.identify`. The joints of arrays are called q1, q2, ...
        options: a :class:`MotionOptions`; the default options if None.
        folder: run folder to write to; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with the repairs of the recording.
        skip_truncated_line: leave out the last line of a text file if it is incomplete.
        changes: single options by name, such as ``method="butterworth"``.

    Raises:
        InputError: recording or options cannot be used; an OptionError for the options.
    """
    chosen = with_changes(MotionOptions, options, changes)
    require("rrrgen experiment reconstruct", "scipy", "matplotlib")
    from rrrgen.lab.studies.sources import chosen_processing, ignore, single_recording

    log = single_recording(recording, skip_truncated_line=skip_truncated_line)
    processing = chosen_processing(log.mappings, chosen)
    settings = {**processing.settings(), "skip_truncated_line": skip_truncated_line, **log.settings}
    run = Run("reconstruct", log.files, settings)
    compute = partial(_reconstruct, run, log, processing, progress or ignore, findings or ignore)
    return run.result(compute, folder, fresh)


def _reconstruct(
    run: Run,
    log: RecordingInputs,
    processing: Processing,
    progress: ProgressCallback,
    findings: FindingsCallback,
    folder: RunFolder | None,
) -> ReconstructionResult:
    """Tune the filter to the recording and apply it stretch by stretch."""
    import numpy as np

    from rrrgen.lab.identify.bandwidth import tune
    from rrrgen.lab.identify.observations import reconstruct as reconstruct_part

    progress(0, 0, "reading")
    (recording,) = log.load(findings)
    progress(0, 0, "bandwidth and noise of the positions")
    tuning = tune(replace(processing, decimate=1), [recording])  # no decimation: every sample is reconstructed
    motions, done = [], 0
    for part in recording.parts():
        progress(done, len(recording), "reconstructing")
        motions.append(reconstruct_part(part, tuning.processing))
        done += len(part)
    t, q, dq, ddq = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("t", "q", "dq", "ddq"))
    if folder is not None:
        progress(len(t), len(t), "writing the motion")
    return ReconstructionResult(t, q, dq, ddq, tuning, recording, run=run)
