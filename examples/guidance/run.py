"""A person pushes a moving arm and then guides it by hand: the controller as a unit with MuJoCo as the arm.

    python examples/guidance/run.py [--c]

Computed torque follows a motion; a push is reported as a contact, and the arm stops. After a reset gravity
compensation lets a hand move it, and computed torque goes on from there. ``--c`` also runs loop.c, the same in C, and
compares. Exit status 1 if the arm did not stop in time, was not moved by the hand, or C and Python differ.
"""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

import rrrgen
from rrrgen.cli.main import run as command

HERE = Path(__file__).resolve().parent


def guided(arm: mujoco.MjModel, data: mujoco.MjData, c: rrrgen.Controller) -> np.ndarray:
    """The scene of four seconds, a row for each tick: phase, mode, positions (3), torques (3)."""
    start, rows = data.qpos.copy(), []
    c.start(q=data.qpos, dq=data.qvel)
    for k in range(4000):
        t = 0.001 * k if k < 3000 else 0.001 * k - 3.0
        push = 40.0 if k // 100 == 10 else {7: 2.0, 8: -2.0}.get(k // 300, 0.0)  # a hit, then a hand that guides
        data.qfrc_applied[1] = push
        if k == 2000:  # the person comes to the arm: it yields
            c.reset(q=data.qpos, dq=data.qvel)
            c.set(contact_action=0)
            c.mode = "gravity"
        if k == 3000:  # the person leaves: the motion goes on where the arm stands
            c.set(contact_action=2)
            c.mode, start = "computed_torque", data.qpos.copy()
        q_d, dq_d, ddq_d = start + 0.3 * (1 - np.cos(t)), np.full(3, 0.3 * np.sin(t)), np.full(3, 0.3 * np.cos(t))
        out = c.step(q=data.qpos, dq=data.qvel, q_d=q_d, dq_d=dq_d, ddq_d=ddq_d)
        data.ctrl[:] = out.tau
        rows.append((out.phase, out.mode, *data.qpos, *out.tau))
        mujoco.mj_step(arm, data)
    return np.array(rows)


def judged(rows: np.ndarray) -> bool:
    """Print what happened; whether it is what should happen."""
    phase, q, tau = rows[:, 0], rows[:, 2:5], rows[:, 5:]
    stopped = int(np.argmax(phase == 2))
    moved, by_hand = np.abs(q[1900] - q[stopped]).max(), np.abs(q[3000] - q[2000]).max()
    bumps = [np.abs(tau[k] - tau[k - 1]).max() for k in (2000, 3000)]
    print(f"push at 1000 ms, stopped at {stopped} ms, after that {1e3 * moved:.0f} mrad until rest")
    print(f"guided by {1e3 * by_hand:.0f} mrad; torque steps when the mode changes {max(bumps):.2g} N m")
    print(f"error of the motion at the end {1e3 * np.abs(q[-1] - q[3000] - 0.3 * (1 - np.cos(0.999))).max():.2f} mrad")
    return 1000 <= stopped < 1030 and set(phase[3000:]) == {0.0} and by_hand > 0.05 and max(bumps) < 0.5


def in_c(folder: Path, robot: str) -> np.ndarray:
    """The rows of loop.c, built against the library of the Python package of MuJoCo."""
    with contextlib.redirect_stdout(io.StringIO()):
        words = ["--with", "controller", "--modes", "computed_torque", "--no-casadi-files"]
        assert command(["generate", robot, "-o", str(folder / "model"), *words]) == 0
    place = Path(mujoco.__file__).parent
    library = next(place.glob("libmujoco.so*"))
    sources = [
        HERE / "loop.c",
        *(folder / "model" / f"rrr{part}.c" for part in ("", "_controller", "_controller_laws")),
    ]
    options = ["-std=c99", "-O2", f"-I{folder / 'model'}", f"-I{place / 'include'}", f"-Wl,-rpath,{place}"]
    subprocess.run(["cc", *options, *map(str, sources), str(library), "-lm", "-o", str(folder / "loop")], check=True)
    done = subprocess.run([folder / "loop", folder / "rrr.xml"], capture_output=True, text=True, check=True)
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


def main() -> int:
    """Run the scene."""
    with tempfile.TemporaryDirectory(prefix="rrrgen-guidance-") as name:
        folder = Path(name)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            assert command(["export", "rrr", "--to", "mjcf", "-o", str(folder / "rrr.xml")]) == 0
        arm = mujoco.MjModel.from_xml_path(str(folder / "rrr.xml"))
        arm.opt.timestep = 0.001
        controller = rrrgen.compile("rrr").controller(modes=["computed_torque"], threshold=10.0, contact_action=2)
        rows = guided(arm, mujoco.MjData(arm), controller)
        sound = judged(rows)
        if "--c" in sys.argv:
            difference = np.abs(in_c(folder, "rrr") - rows).max()
            print(f"largest difference between C and Python {difference:.1e}")
            sound = sound and difference < 1e-9
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(main())
