"""A collision in MuJoCo, reported by the momentum observer: thresholds from free motion, then a wall in the way.

    python examples/collision/run.py -o runs/collision

The RRR arm moves under computed torque and is recorded without contact; `rrrgen experiment contact-thresholds`
finds thresholds from the recording. Then a wall stands in the way; when the observer reports the contact, the arm stops
where it is. Prints contact force and delay, and draws collision.svg and .png.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import rrrgen
from rrrgen.cli.main import run as command
from rrrgen.lab.data.figure_style import new_figure, save_figure, style_axes
from rrrgen.lab.data.kalman import kalman_matrices, kalman_step
from rrrgen.robot.file.writer import dumps
from rrrgen.robot.spec import FrictionSpec

PERIOD, ENCODER, BANDWIDTH, GAIN = 1e-3, 1e-5, 20.0, 50.0
FRICTION = np.array([[0.2, 2.0, 0.0], [0.1, 1.0, 0.0], [0.05, 0.4, 0.0]])  # viscous, Coulomb, offset
WIDTH = 0.05  # rad/s over which the sign in the friction of the controller turns round
WALL = 4.0  # s after which the wall stands there
LIGHTER, SMOOTHER = 0.98, 0.95  # masses and friction of the real arm, over those that the controller knows


class Run(NamedTuple):
    """Time, readings, torques, ratios of residuals to thresholds, and the contact force in MuJoCo, a row per tick."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    ratio: np.ndarray
    force: np.ndarray


class Thresholds(NamedTuple):
    """Thresholds (3,) of the residuals and of their changes, N m."""

    residual: np.ndarray
    change: np.ndarray


def call(*words: str | Path) -> None:
    """Run a command of rrrgen; its tables and notes do not go to the screen."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        code = command([str(word) for word in words])
    if code:
        print(errors.getvalue(), file=sys.stderr)
        raise SystemExit(code)


def desired(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A smooth motion of all joints: q_d, dq_d, ddq_d."""
    a, w, phase = np.array([0.5, 0.4, 0.5]), np.array([1.3, 1.7, 2.1]), np.array([0.0, 1.0, 2.0])
    angle = w * t + phase
    return np.array([0.0, 0.5, 0.8]) + a * np.sin(angle), a * w * np.cos(angle), -a * w * w * np.sin(angle)


def arm_and_wall(model: rrrgen.Model, folder: Path):
    """The arm in MuJoCo with a ball at its tip, and a wall where the tip will be half a second after WALL."""
    import mujoco

    call("export", folder / "arm.yaml", "--to", "mjcf", "--force", "-o", folder / "rrr.xml")
    tip, ahead = (model.forward_kinematics(desired(t)[0])[:3, 3] for t in (WALL + 0.5, WALL + 0.51))
    along = (ahead - tip) / np.linalg.norm(ahead - tip)
    at = tip + 0.07 * along  # the face of the wall is 0.02 m of the ball and 0.05 m of the wall before its middle
    turn = np.array([1.0 + along[0], 0.0, -along[2], along[1]])  # a rotation that takes x to the direction of motion
    place, rotation = (" ".join(map(str, values)) for values in (at, turn))
    wall = f'<geom name="wall" type="box" size=".05 .4 .4" pos="{place}" quat="{rotation}"/>'
    text = (folder / "rrr.xml").read_text(encoding="utf-8")
    ball = '<geom name="ball" type="sphere" size="0.02" pos="0.415 0 0" mass="0"/>'
    text = text.replace('<site name="tip"', f'{ball}<site name="tip"').replace("<worldbody>", f"<worldbody>{wall}")
    arm = mujoco.MjModel.from_xml_string(text)
    arm.opt.timestep, arm.opt.integrator = PERIOD / 4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    arm.dof_damping[:], arm.dof_frictionloss[:] = SMOOTHER * FRICTION.T[:2]
    arm.body_mass[:] *= LIGHTER
    arm.body_inertia[:] *= LIGHTER
    return mujoco, arm


def run(model: rrrgen.Model, folder: Path, seconds: float, thresholds: Thresholds | None) -> Run:
    """Control the arm for ``seconds``; without ``thresholds`` there is no wall and nothing is reported."""
    limits = thresholds or Thresholds(*np.full((2, 3), np.inf))
    mujoco, arm = arm_and_wall(model, folder)
    state = mujoco.MjData(arm)
    wall = arm.geom("wall").id
    arm.geom_contype[wall] = arm.geom_conaffinity[wall] = 0
    state.qpos[:], state.qvel[:] = desired(0.0)[0], desired(0.0)[1]
    filter = kalman_matrices(PERIOD, ENCODER**2 / 12, 300.0**2)
    width, limit = np.full(3, WIDTH), model.limits.torque
    gains = (np.full(3, BANDWIDTH**2), np.full(3, 2 * BANDWIDTH), np.zeros(3), np.zeros(3))
    estimate, applied, p_u, r, held, rows = np.zeros((3, 3)), model.gravity(state.qpos), None, np.zeros(3), None, []
    acted, change = applied, np.zeros(3)  # torques until this tick; those from this tick on are `applied`
    for k in range(round(seconds / PERIOD)):
        t = k * PERIOD
        if thresholds is not None and t >= WALL:
            arm.geom_contype[wall] = arm.geom_conaffinity[wall] = 1
        wanted = desired(t) if held is None else (held, np.zeros(3), np.zeros(3))
        reading = ENCODER * np.round(state.qpos / ENCODER)
        estimate, seen = kalman_step(filter.E, filter.k, estimate, reading, np.stack(wanted, -1))
        q, dq = seen[:, 0], seen[:, 1]
        if p_u is None:
            p_u = model.momentum_observer_start(q, dq, width=width)
        found = model.momentum_observer(
            q, dq, acted, p_last=p_u[0], u_last=p_u[1], r_last=r, gain=GAIN, Ts=PERIOD, width=width
        )
        ratio, touches, change = model.contact(found.r, r, change, GAIN, PERIOD, *limits)
        p_u, r = (found.p, found.u), found.r
        if held is None and t >= 1.0 and touches:
            held = q.copy()  # stop where the arm is; the filter estimates deviations from what is desired
            estimate += np.stack(desired(t + PERIOD), -1) - np.stack((held, 0 * held, 0 * held), -1)
        tau = model.computed_torque(q, dq, *wanted, *gains, Ts=PERIOD, tau_max=limit, width=width)[0]
        state.ctrl[:] = applied
        mujoco.mj_step(arm, state, nstep=4)
        force = np.zeros(6)
        if state.ncon:
            mujoco.mj_contactForce(arm, state, 0, force)
        rows.append((t, reading, applied, ratio, abs(force[0])))
        acted, applied = applied, tau
    return Run(*map(np.array, zip(*rows, strict=True)))


def known_arm(folder: Path) -> rrrgen.Model:
    """The model that the controller has: the RRR arm with friction, written to arm.yaml."""
    spec = rrrgen.load_spec("rrr")
    stated = [FrictionSpec(*map(float, row)) for row in FRICTION]
    joints = tuple(replace(joint, friction=own) for joint, own in zip(spec.joints, stated, strict=True))
    (folder / "arm.yaml").write_text(dumps(replace(spec, name="arm", joints=joints)), encoding="utf-8")
    return rrrgen.compile(folder / "arm.yaml")


def learn(model: rrrgen.Model, folder: Path, seconds: float, block: float) -> Thresholds:
    """Thresholds from a recording of free motion, by the command that a user would take."""
    free = run(model, folder, seconds, None)
    names = [f"{kind}_{joint}" for kind in ("q", "tau") for joint in model.joint_names]
    table = np.column_stack([free.t, free.q, free.tau])
    np.savetxt(folder / "free.csv", table, fmt="%.9g", delimiter=",", header=",".join(["t", *names]), comments="")
    settings = ("--block", str(block), "--fresh", "-o", folder / "contact")
    call("experiment", "contact-thresholds", folder / "arm.yaml", "--log", folder / "free.csv", *settings)
    found = json.loads((folder / "contact/results/contact.json").read_text(encoding="utf-8"))
    return Thresholds(np.array(found["levels"]), np.array(found["change_levels"]))


def draw(seen: Run, reported: float, folder: Path) -> None:
    """Contact force and residuals around the collision."""
    figure, (upper, lower) = new_figure(2, 1, 5.0, sharex=True)
    shown = (seen.t > reported - 0.05) & (seen.t < reported + 0.1)
    t = seen.t[shown]
    upper.plot(t, seen.force[shown], color="tab:red", linewidth=1.0)
    style_axes(upper, "", "contact force in N")
    for joint in range(3):
        lower.plot(t, seen.ratio[shown, joint], linewidth=1.0, label=f"q{joint + 1}")
    lower.axhline(1.0, color="0.3", linewidth=0.8, linestyle="--")
    style_axes(lower, "t in s", "residual or change\nover threshold")
    lower.legend(ncols=3, fontsize="small")
    for axis in (upper, lower):
        axis.axvline(reported, color="0.3", linewidth=0.8)
    upper.text(reported + 0.002, 0.95, "reported", transform=upper.get_xaxis_transform(), va="top")
    save_figure(figure, folder / "collision")


def main() -> int:
    """Run the example; the exit status is 1 for a false alarm, or if the contact is reported later than after 15 ms."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/collision"))
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the recording without contact")
    parser.add_argument(
        "--block", type=float, default=1.0, help="length of the blocks whose largest residuals count, s"
    )
    options = parser.parse_args()
    folder = options.output
    folder.mkdir(parents=True, exist_ok=True)
    model = known_arm(folder)
    thresholds = learn(model, folder, options.seconds, options.block)
    print("thresholds in N m", thresholds.residual.round(3), "of changes", thresholds.change.round(3))
    seen = run(model, folder, WALL + 1.5, thresholds)
    touched = seen.t[np.argmax(seen.force > 0.0)]
    alarms = seen.t[(seen.t >= 1.0) & (seen.ratio.max(axis=1) > 1.0)]
    if not len(alarms) or not seen.force.any():
        print("no contact was reported")
        return 1
    delay = alarms[0] - touched
    then, most = seen.force[np.argmax(seen.t >= alarms[0])], seen.force.max()
    print(
        f"contact at {touched:.3f} s, reported after {1e3 * delay:.0f} ms; force then {then:.0f}, at most {most:.0f} N"
    )
    draw(seen, alarms[0], folder)
    return 0 if 0.0 <= delay <= 0.015 else 1


if __name__ == "__main__":
    sys.exit(main())
