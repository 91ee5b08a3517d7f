"""Files of simulated recordings: logs with mapping files, controller files, and those of response experiments."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.files import write_file
from rrrgen.lab.design.plan import ResponseDesign, ResponseRun
from rrrgen.lab.plant.controllers import PD, DeviationFilter
from rrrgen.lab.plant.experiment import Instruments, SimulatedRecording
from rrrgen.lab.response.response_model import ControllerTransferFunction

# ------------------------------------------------------------------------------------------------------------------
# Writer of the controller of a simulated experiment, as a file that ``rrrgen identify --controller`` reads.
# ------------------------------------------------------------------------------------------------------------------

RECORDS = {"centred": "centred", "command": "applied"}
"""The word of the controller file for the torque that a recording holds, by ``Instruments.torque_record``."""


def controller_text(recording: SimulatedRecording, joints: Sequence[str], instruments: Instruments) -> str | None:
    """Write the controller of ``recording`` as the text of a controller file; None where the format cannot express it.

    It can express PD control with a Kalman observer, with drives whose torques are neither rounded nor limited at
    coupled motors.
    """
    controller, observer = recording.loop or (None, None)
    plain = instruments.motors is None and instruments.torque_resolution is None
    if not isinstance(controller, PD) or not isinstance(observer, DeviationFilter) or not plain:
        return None
    lines = [
        *("schema: rrrgen-controller/1", "description: PD control (14.33) with a Kalman observer of the deviation"),
        *(f"period: {recording.period!r} s", f"delay: {instruments.delay}"),
        *(f"records: {RECORDS[instruments.torque_record]}", "joints:"),
    ]
    n = len(joints)
    fed = "" if recording.feedforward is None else ", feedforward: 1"
    E, k = np.broadcast_to(observer.E, (n, 3, 3)), np.broadcast_to(observer.k, (n, 3))
    for i, name in enumerate(joints):
        position, speed, denominator = _filters(E[i], k[i])
        lines += [
            f"  - name: {name}",
            "    signals:",
            "      deviation: {sum: {position: 1, reference: -1}}",
            f"      e: {{filter: deviation, numerator: {position}, denominator: {denominator}}}",
            f"      de: {{filter: deviation, numerator: {speed}, denominator: {denominator}}}",
            f"      command: {{sum: {{e: {-controller.kp[i]!r}, de: {-controller.kd[i]!r}{fed}}}}}",
        ]
        if instruments.torque_limit is not None:
            lines.append(f"      limited: {{limit: command, to: {float(instruments.torque_limit[i])!r}}}")
        lines.append(f"    torque: {'command' if instruments.torque_limit is None else 'limited'}")
    return "\n".join(lines) + "\n"


def _filters(E: Array, k: Array) -> tuple[list[float], list[float], list[float]]:
    """The transfer functions of the filter: numerators to the filtered deviation and its rate, and the denominator.

    All are coefficients in powers of 1/z. The filter with transition matrix ``E`` and gain ``k`` predicts the state
    x_hat of the deviation e: ``x_bar = (I - k c) x_hat + k e``, ``x_hat(k+1) = E x_bar``, c = [1, 0, 0].
    """
    from scipy.signal import ss2tf

    kept = np.eye(3) - np.outer(k, [1.0, 0.0, 0.0])
    numerators, denominator = ss2tf(E @ kept, (E @ k)[:, None], kept[:2], k[:2, None])
    return numerators[0].tolist(), numerators[1].tolist(), denominator.tolist()


# ------------------------------------------------------------------------------------------------------------------
# Writes a simulated recording as CSV and mapping file, in the format in which recordings of a real robot are read.
# ------------------------------------------------------------------------------------------------------------------


def write_recording(
    folder: Path,
    stem: str,
    recording: SimulatedRecording,
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
    if instruments is not None and (delay := torque_delay(recording, instruments)):
        text_of_mapping += f"torque_delay: {delay!r} s\n"
    _write(mapping, text_of_mapping)
    control = controller_text(recording, joints, instruments or Instruments())
    if control is not None:
        _write(folder / f"{stem}_controller.yaml", control)
    return log, mapping


def torque_delay(recording: SimulatedRecording, instruments: Instruments) -> float:
    """How much later (s) than its row a recorded torque acts, in the mean: a command is held until the next one."""
    return 0.5 * recording.period if instruments.torque_record == "command" else 0.0


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


# ------------------------------------------------------------------------------------------------------------------
# Writes recordings of a response experiment, with the response files by which `rrrgen response frf` reads them.
# ------------------------------------------------------------------------------------------------------------------

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

    def settled_rows(self) -> Array:
        """The signals as rows [t, n, u, q, q_r], without the settling periods at the start."""
        rows = np.column_stack([self.t, self.n, self.u, self.q, self.q_r])
        return np.asarray(rows[self.run.settle :])


def write_responses(
    folder: Path,
    design: ResponseDesign,
    signals: Sequence[LoopSignals],
    controller: ControllerTransferFunction | None,
    prismatic: bool = False,
) -> list[Path]:
    """Write one CSV file per run and the response files; returns the paths of the latter.

    Several postures of one realisation are one file with ``recordings: postures``; with several realisations or strokes
    each posture has a file of its own. ``controller`` is C of ``u = n - C (q - q_r)``, None where it is not known.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for run_signals in signals:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(run_signals.settled_rows().tolist())
        write_file(folder / f"{run_signals.run.name}.csv", text.getvalue())
    by_posture: dict[int, list[str]] = {}
    for run_signals in signals:
        by_posture.setdefault(run_signals.run.posture, []).append(run_signals.run.name)
    paths = []
    if len(by_posture) > 1 and all(len(names) == 1 for names in by_posture.values()):
        names = [name for runs in by_posture.values() for name in runs]
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
    controller: ControllerTransferFunction | None,
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
    write_file(path, "\n".join(lines) + "\n")
    return path
