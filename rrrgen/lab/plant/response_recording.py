"""Writes recordings of a response experiment, with the response files by which `rrrgen frf` reads them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.run_folder import write_atomically
from rrrgen.lab.design.plan import ResponseDesign, ResponseRun
from rrrgen.lab.response.controller import Controller

COLUMNS = ("t", "n", "u", "q", "q_r")


@dataclass(frozen=True, eq=False)
class LoopSignals:
    """Signals of one joint in one recorded ``run``, (N,) each, of the loop ``u = n - C (q - q_r)``.

    ``t`` is time, ``n`` the excitation, ``u`` the input, ``q`` the measured position and ``q_r`` its reference.
    ``clipped`` counts the torques of all joints that a limit has clipped.
    """

    run: ResponseRun
    t: Array
    n: Array
    u: Array
    q: Array
    q_r: Array
    clipped: int = 0

    def settled(self) -> Array:
        """The signals as rows [t, n, u, q, q_r], without the settling periods at the start."""
        rows = np.column_stack([self.t, self.n, self.u, self.q, self.q_r])
        return np.asarray(rows[self.run.settle :])


def write_responses(
    folder: Path,
    design: ResponseDesign,
    signals: Sequence[LoopSignals],
    controller: Controller | None,
    prismatic: bool = False,
) -> list[Path]:
    """Write one CSV file per run and the response files; returns the paths of the latter.

    Several postures of one realisation are one file with ``recordings: postures``; with several realisations or strokes
    each posture has a file of its own. ``controller`` is C of ``u = n - C (q - q_r)``, None where it is not known.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for each in signals:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(each.settled().tolist())
        write_atomically(folder / f"{each.run.name}.csv", text.getvalue())
    by_posture: dict[int, list[str]] = {}
    for each in signals:
        by_posture.setdefault(each.run.posture, []).append(each.run.name)
    paths = []
    if len(by_posture) > 1 and all(len(names) == 1 for names in by_posture.values()):
        names = [name for each in by_posture.values() for name in each]
        paths.append(_write_response(folder / "response.yaml", design, names, controller, prismatic, "postures"))
    else:
        for number, names in by_posture.items():
            stem = "response" if len(by_posture) == 1 else f"response_posture{number}"
            paths.append(_write_response(folder / f"{stem}.yaml", design, names, controller, prismatic, "realisations"))
    return paths


def _write_response(
    path: Path,
    design: ResponseDesign,
    names: Sequence[str],
    controller: Controller | None,
    prismatic: bool,
    several: str,
) -> Path:
    others = {f"{(kp**0.5) / (2.0 * math.pi):.3g}" for k, kp in enumerate(design.kp) if k != design.joint}
    loops = f", with the loops of the other joints closed at {', '.join(sorted(others))} Hz" if others else ""
    lines = [
        f"# from the input u of joint {design.joint_name} to its position{loops}",
        "schema: rrrgen-response/1",
        f"name: {design.robot}_{design.joint_name}",
        f"files: [{', '.join(f'{name}.csv' for name in names)}]",
        f"recordings: {several}",
        f"time: {{period: {design.period!r} s}}",
        "excitation: {column: n}",
        "input: {column: u}",
        f"output: {{column: q, unit: {'m' if prismatic else 'rad'}}}",
    ]
    if design.signal_period is not None:
        lines.append(f"period: {design.signal_period * design.period!r} s")
    if controller is not None:
        powers = (controller.numerator, controller.denominator)
        numerator, denominator = (", ".join(repr(float(v)) for v in values) for values in powers)
        lines.append(f"controller: {{numerator: [{numerator}], denominator: [{denominator}]}}")
    write_atomically(path, "\n".join(lines) + "\n")
    return path
