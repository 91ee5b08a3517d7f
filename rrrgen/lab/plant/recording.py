"""Writes a simulated recording as CSV and mapping file, in the format in which recordings of a real robot are read."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.lab.plant.controller_text import controller_text
from rrrgen.lab.plant.experiment import Instruments, Recording


def write_recording(
    folder: Path,
    stem: str,
    recording: Recording,
    *,
    joints: Sequence[str],
    prismatic: Sequence[bool] | None = None,
    instruments: Instruments | None = None,
) -> tuple[Path, Path]:
    """Write ``stem.csv`` and its mapping file ``stem.yaml``; returns both paths.

    The columns are t, and of every joint q_, tau_, ref_, with feedforward also ff_.
    ``joints`` are the joint names, ``prismatic`` states which joints are prismatic (m, N instead of rad, N m), and the
    torque limits of ``instruments`` go into the mapping file. A PD controller with a Kalman observer is written to
    ``stem_controller.yaml``. Every number reads back exactly. Raises InputError if the number of names is wrong.
    """
    n = recording.q.shape[1]
    if len(joints) != n:
        raise InputError(f"a recording of {n} joints needs {n} names, got {len(joints)}")
    folder.mkdir(parents=True, exist_ok=True)
    log, mapping = folder / f"{stem}.csv", folder / f"{stem}.yaml"
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = {"q": recording.q, "tau": recording.tau, "ref": recording.reference}
    if recording.feedforward is not None:
        columns["ff"] = recording.feedforward
    writer.writerow(["t", *(f"{signal}_{name}" for signal in columns for name in joints)])
    writer.writerows(np.column_stack([recording.t, *columns.values()]).tolist())
    _write(log, text.getvalue())
    kinds = list(prismatic) if prismatic is not None else [False] * n
    limits = None if instruments is None else instruments.torque_limit
    text_of_mapping = _mapping_text(stem, joints, kinds, limits, recording.feedforward is not None)
    if instruments is not None and instruments.torque_record == "command":  # held until the next sample
        text_of_mapping += f"torque_delay: {0.5 * recording.period!r} s\n"
    _write(mapping, text_of_mapping)
    control = controller_text(recording, joints, instruments or Instruments())
    if control is not None:
        _write(folder / f"{stem}_controller.yaml", control)
    return log, mapping


def _write(path: Path, text: str) -> None:
    """Write ``text`` so that the file is either complete or absent."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8", newline="\n")
    os.replace(part, path)


def _mapping_text(
    stem: str, joints: Sequence[str], prismatic: Sequence[bool], limits: Sequence[float] | None, fed: bool
) -> str:
    lines = [
        "schema: rrrgen-log/1",
        f"name: {stem}",
        "description: recording of the virtual robot",
        f"files: {stem}.csv",
        "time: {column: t, unit: s}",
        "joints:",
    ]
    for i, (name, slides) in enumerate(zip(joints, prismatic, strict=True)):
        length, force = ("m", "N") if slides else ("rad", "N*m")
        limit = "" if limits is None else f", limit: {limits[i]!r}"
        lines += [
            f"  - name: {name}",
            f"    position: {{column: q_{name}, unit: {length}}}",
            f"    torque: {{column: tau_{name}, unit: {force}{limit}}}",
            f"    reference: {{column: ref_{name}, unit: {length}}}",
        ]
        if fed:
            lines.append(f"    feedforward: {{column: ff_{name}, unit: {force}}}")
    return "\n".join(lines) + "\n"
