"""From an unknown arm to a carried payload: excite, identify, control; pick something up, identify and compensate it.

    python examples/pick_up/run.py -o runs/pick_up

The arm is the virtual RRR arm. No code is generated anew for the payload: its mass, centre and inertia go into the base
parameters that the control law takes as an argument. Prints the tracking errors and draws pick_up.svg and .png.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import rrrgen
from rrrgen.base.files import write_file
from rrrgen.cli.main import run as command
from rrrgen.lab.data.figure_style import new_figure, save_figure, style_axes
from rrrgen.lab.experiment.experiment_file import Experiment
from rrrgen.lab.experiment.setup import writing_path
from rrrgen.robot.file.writer import dumps
from rrrgen.robot.spec import LinkSpec

PERIOD, BANDWIDTH = 1e-3, 40.0
MASS, COM, INERTIA = 1.5, np.array([0.02, 0.0, 0.05]), np.diag([2e-3, 2e-3, 1e-3])  # of the payload, in the tip's frame
PICKED_UP, COMPENSATED = 3.0, 6.0  # s


def call(*words: str | Path) -> None:
    """Run a command of rrrgen; its progress goes to the screen, its tables do not."""
    with contextlib.redirect_stdout(io.StringIO()):
        code = command([str(word) for word in words])
    if code:
        raise SystemExit(code)


def carrying(file: Path) -> Path:
    """The robot file of the arm with the payload as a part of its last link: what stands in the laboratory."""
    spec = rrrgen.load_spec("rrr")
    assert spec.links is not None
    own = spec.links[-1]
    mass = float(own.mass) + MASS
    com = (float(own.mass) * np.array(own.com, float) + MASS * COM) / mass
    moved = INERTIA + MASS * (COM @ COM * np.eye(3) - np.outer(COM, COM))  # about the origin of the frame
    added = np.array([moved[i] for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    inertia = np.array(own.inertia_about_origin(), float) + added
    exact = [tuple(sp.Rational(str(round(float(v), 12))) for v in values) for values in (com, inertia)]
    link = LinkSpec(sp.Rational(str(mass)), exact[0], exact[1], "origin")
    write_file(file, dumps(replace(spec, links=(*spec.links[:-1], link), basis=None)).encode())
    return file


def identified(folder: Path) -> tuple[Path, dict[str, Any]]:
    """The robot file identified from an exciting motion, and the payload from the writing task with it."""
    motion = folder / "excitation/results/excitation.json"
    noisy = ("--torque-noise", "0.05", "--fresh", "-o")
    call("experiment", "excite", "rrr", "--harmonics", "4", "--starts", "1", "--fresh", "-o", folder / "excitation")
    call("experiment", "simulate", "rrr", "--trajectory", motion, *noisy, folder / "empty")
    call("identify", "rrr", "--log", folder / "empty/results/log.yaml", "--fresh", "-o", folder / "identified")
    arm = folder / "identified/results/robot.yaml"
    call("experiment", "simulate", carrying(folder / "carrying.yaml"), "--writing", *noisy, folder / "carrying")
    call(
        "experiment", "payload", arm, "--log", folder / "carrying/results/log.yaml", "--fresh", "-o", folder / "payload"
    )
    return arm, json.loads((folder / "payload/results/payload.json").read_text(encoding="utf-8"))


def write(arms: tuple[rrrgen.Model, rrrgen.Model], model: rrrgen.Model, loaded: np.ndarray) -> np.ndarray:
    """Errors of the joints, (N, 3), on the writing task: the payload is picked up, and later told to the control law.

    ``arms`` are the real arm without and with the payload, ``model`` is the identified one, and ``loaded`` are its base
    parameters with the identified payload.
    """
    path = writing_path(Experiment(), arms[0])
    t = np.arange(0.0, path.task.duration, PERIOD)
    q_d, dq_d, ddq_d = path.evaluate(t)
    plants = [arm.bind("forward_dynamics") for arm in arms]
    gains = (np.full(3, BANDWIDTH**2), np.full(3, 2 * BANDWIDTH), np.zeros(3), np.zeros(3))
    known = {"friction": np.zeros(9), "width": np.ones(3), "tau_max": model.limits.torque, "Ts": PERIOD}
    q, dq, error = q_d[0].copy(), dq_d[0].copy(), np.empty_like(q_d)
    tau = model.gravity(q)
    for k, instant in enumerate(t):
        error[k] = q_d[k] - q
        beta = loaded if instant >= COMPENSATED else model.beta
        plant, applied = plants[int(instant >= PICKED_UP)], tau
        tau = model.computed_torque(q, dq, q_d[k], dq_d[k], ddq_d[k], *gains, beta=beta, **known)[0]
        plant.inputs["q"][:], plant.inputs["dq"][:], plant.inputs["tau"][:] = q, dq, applied
        ddq = plant()
        q += PERIOD * dq + PERIOD**2 / 2 * ddq
        dq += PERIOD * ddq
    return error


def main() -> int:
    """Run the example; the exit status is 1 if the identified payload does not restore most of the accuracy."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/pick_up"))
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    file, payload = identified(folder)
    found = payload["values"]
    print(f"payload: {found['mass']:.3f} kg, true {MASS} kg; std {payload['std']['mass']:.3f}")
    model = rrrgen.compile(file)
    com = [found[f"com_{axis}"] for axis in "xyz"]
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = (found[f"I{axes}"] for axes in ("xx", "yy", "zz", "xy", "xz", "yz"))
    inertia = [[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]]
    loaded = model.add_payload(mass=found["mass"], com=com, inertia=inertia)
    error = write((rrrgen.compile("rrr"), rrrgen.compile(folder / "carrying.yaml")), model, loaded)
    parts = {"empty": (0.5, PICKED_UP), "carrying": (PICKED_UP + 0.5, COMPENSATED), "told": (COMPENSATED + 0.5, 10.0)}
    rms = {name: part_rms(error, *ends) for name, ends in parts.items()}
    for name, value in rms.items():
        print(f"{name:10}{value:8.3f} mrad")
    draw(error, folder)
    return 0 if rms["told"] < 0.1 * rms["carrying"] else 1


def part_rms(error: np.ndarray, begin: float, end: float) -> float:
    """Root of the mean square of the joint errors between two instants, mrad."""
    return float(1e3 * np.sqrt(np.mean(error[round(begin / PERIOD) : round(end / PERIOD)] ** 2)))


def draw(error: np.ndarray, folder: Path) -> None:
    """The errors of the joints over time, with the instants at which the payload came and was told."""
    figure, (axis,) = new_figure(1, 1, 3.4)
    t = PERIOD * np.arange(len(error))
    for joint in range(3):
        axis.plot(t, 1e3 * error[:, joint], linewidth=0.8, label=f"q{joint + 1}")
    for instant, text in ((PICKED_UP, "picked up"), (COMPENSATED, "told to the law")):
        axis.axvline(instant, color="0.3", linewidth=0.8, linestyle="--")
        axis.annotate(
            text, (instant, 1.0), (3, -3), xycoords=("data", "axes fraction"), textcoords="offset points", va="top"
        )
    style_axes(axis, "t in s", "joint error in mrad")
    axis.legend(loc="lower right", ncols=3, fontsize="small")
    save_figure(figure, folder / "pick_up")


if __name__ == "__main__":
    sys.exit(main())
