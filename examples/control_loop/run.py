"""A control loop at 1 kHz on the RRR arm: four laws on the writing task, in C against the emitted arm and in MuJoCo.

    python examples/control_loop/run.py -o runs/control_loop [--realtime]

Generates the code, builds loop.c, runs every law, prints the tracking errors, and draws control_loop.svg and .png.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import subprocess
import sys
from pathlib import Path

import numpy as np

import rrrgen
from rrrgen.cli.main import run as rrrgen_command
from rrrgen.lab.data.figure_style import new_figure, save_figure, style_axes
from rrrgen.lab.experiment.experiment_file import Experiment
from rrrgen.lab.experiment.setup import writing_path

HERE = Path(__file__).resolve().parent
LAWS = {
    "pd": "PD",
    "pd_gravity": "PD, gravity, friction",
    "feedforward": "feed-forward",
    "computed_torque": "computed torque",
}
PERIOD, ENCODER = 1e-3, 1e-5
BANDWIDTH = 40.0
FRICTION = np.array([[1.1, 3.0, 0.0], [0.3, 1.5, 0.0], [0.2, 0.8, 0.0]])  # of the case study: viscous, Coulomb, offset
WIDTH = np.full(3, 0.01)


def reference(model: rrrgen.Model) -> np.ndarray:
    """The writing task, (N, 9): q_d, dq_d, ddq_d in every period."""
    path = writing_path(Experiment(), model)
    return np.hstack(path.evaluate(np.arange(0.0, path.task.duration, PERIOD)))


def command(*words: str | Path) -> None:
    """Run a command of rrrgen; what it says does not go to the screen."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as errors:
        code = rrrgen_command([str(word) for word in words])
    if code:
        print(errors.getvalue(), file=sys.stderr)
        raise SystemExit(code)


def build(folder: Path) -> Path:
    """Generate the code of the arm and compile the loop with it; returns the program."""
    model = folder / "model"
    command("generate", "rrr", "-o", model, "--with", "control", "--no-casadi-files")
    program = folder / "loop"
    sources = [str(file) for file in (HERE / "loop.c", model / "rrr.c", model / "rrr_nominal.c")]
    subprocess.run(["cc", "-std=c99", "-O2", f"-I{model}", *sources, "-lm", "-o", str(program)], check=True)
    return program


def run(program: Path, law: str, motion: np.ndarray, realtime: bool = False) -> np.ndarray:
    """What the loop wrote, (N, 8): q, tau, lateness and cost in ns."""
    given, written = program.parent / "reference.txt", program.parent / f"{law}.txt"
    np.savetxt(given, motion, fmt="%.17g")
    clock = ["realtime"] if realtime else []
    subprocess.run([program, law, str(BANDWIDTH), given, written, *clock], check=True)
    return np.loadtxt(written)


def in_mujoco(model: rrrgen.Model, law: str, motion: np.ndarray, folder: Path) -> np.ndarray | None:
    """The positions of the same loop with MuJoCo as the arm, (N, 3); None where it is not installed.

    Its friction holds a joint at rest, that of loop.c creeps; the law is the emitted C, called from Python.
    """
    try:
        import mujoco
    except ImportError:
        return None
    file = folder / "rrr.xml"
    command("export", "rrr", "--to", "mjcf", "--force", "-o", file)
    arm = mujoco.MjModel.from_xml_path(str(file))
    arm.opt.timestep, arm.opt.integrator = PERIOD / 10, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    arm.dof_damping[:], arm.dof_frictionloss[:] = FRICTION[:, 0], FRICTION[:, 1]
    state = mujoco.MjData(arm)
    state.qpos[:] = last = motion[0, :3]
    beta, none = 1.02 * model.beta, np.zeros(3)
    D = np.diag(model.mass_matrix(motion[0, :3], beta)) if law in ("pd_gravity", "feedforward") else np.ones(3)
    known = {"beta": beta, "friction": 1.05 * FRICTION.ravel(), "width": WIDTH, "tau_max": model.limits.torque}
    apply, z = model.gravity(motion[0, :3], beta), none
    seen = np.empty((len(motion), 3))
    for k, row in enumerate(motion):
        seen[k] = state.qpos
        q = ENCODER * np.round(state.qpos / ENCODER)
        speed, last = (q - last if k else none) / PERIOD, q
        gains = (BANDWIDTH**2 * D, 2 * BANDWIDTH * D, BANDWIDTH**3 / 5 * D, z)
        tau, z = getattr(model, law)(q, speed, row[:3], row[3:6], row[6:], *gains, Ts=PERIOD, **known)
        state.ctrl[:] = apply
        mujoco.mj_step(arm, state, nstep=10)
        apply = tau
    return seen


def largest_eigenvalue(model: rrrgen.Model, motion: np.ndarray) -> float:
    """The largest eigenvalue of M^-1 D along the motion, with D the diagonal of M at its start."""
    D = np.diag(np.diag(model.mass_matrix(motion[0, :3])))
    return float(
        max(np.abs(np.linalg.eigvals(np.linalg.solve(M, D))).max() for M in model.mass_matrix(motion[::50, :3]))
    )


def draw(motion: np.ndarray, found: dict[str, np.ndarray], rest: dict[str, np.ndarray], folder: Path) -> None:
    """Tracking errors over time on a logarithmic scale, and the third joint at rest."""
    figure, (upper, lower) = new_figure(2, 1, 6.0)
    t = PERIOD * np.arange(len(motion))
    for law, name in LAWS.items():
        upper.semilogy(t, 1e3 * np.linalg.norm(found[law][:, :3] - motion[:, :3], axis=1), linewidth=0.8, label=name)
    style_axes(upper, "t in s", "norm of the joint errors in mrad")
    upper.set_ylim(1e-2, 1e3)
    upper.legend(ncols=4, fontsize="small", loc="upper center")
    for law, name in (("resting_measured", "measured speed"), ("resting_desired", "desired speed")):
        at_rest = rest[law][:1500, 2]
        lower.plot(
            PERIOD * np.arange(len(at_rest)), 1e3 * (at_rest - motion[0, 2]), linewidth=0.8, label=f"sgn of the {name}"
        )
    style_axes(lower, "t in s", "third joint at rest in mrad")
    lower.legend(fontsize="small")
    save_figure(figure, folder / "control_loop")


def rms(positions: np.ndarray, motion: np.ndarray) -> float:
    """Root of the mean square of all joint errors, mrad."""
    return float(1e3 * np.sqrt(np.mean((positions[:, :3] - motion[:, :3]) ** 2)))


def main() -> int:
    """Run the example; the exit status is 1 if computed torque is not five times as accurate as PD with gravity."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/control_loop"))
    parser.add_argument("--realtime", action="store_true", help="wait for the clock in every period")
    options = parser.parse_args()
    folder = options.output
    folder.mkdir(parents=True, exist_ok=True)
    model = rrrgen.compile("rrr")
    motion, program = reference(model), build(folder)
    share = BANDWIDTH * PERIOD * largest_eigenvalue(model, motion)
    print(f"gains: w T lambda_max = {share:.3f}, stable below 0.32, safe below 0.16")
    found = {law: run(program, law, motion, options.realtime) for law in LAWS}
    still = np.hstack([np.tile(motion[0, :3], (3000, 1)), np.zeros((3000, 6))])
    rest = {law: run(program, law, still) for law in ("resting_measured", "resting_desired")}
    print(f"{'rms error in mrad':24}{'emitted arm':>12}{'MuJoCo':>12}{'ns per tick':>14}")
    for law, name in LAWS.items():
        other = None if law == "pd" else in_mujoco(model, law, motion, folder)
        seen = "" if other is None else f"{rms(other, motion):.2f}"
        print(f"{name:24}{rms(found[law], motion):12.2f}{seen:>12}{np.median(found[law][:, 7]):14.0f}")
    for law, log in rest.items():
        print(f"at rest, {law[8:]} speed: third joint {1e3 * np.ptp(log[1000:, 2]):.2f} mrad peak to peak")
    if options.realtime:
        late = np.concatenate([log[:, 6] for log in found.values()]) / 1e3
        print(
            f"lateness: median {np.median(late):.0f}, 99 % {np.quantile(late, 0.99):.0f}, largest {late.max():.0f} us"
        )
    draw(motion, found, rest, folder)
    gain = rms(found["pd_gravity"], motion) / rms(found["computed_torque"], motion)
    print(f"computed torque: {gain:.1f} times less error than PD with gravity and friction; figure in {folder}")
    return 0 if gain >= 5.0 else 1


if __name__ == "__main__":
    sys.exit(main())
