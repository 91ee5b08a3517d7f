"""Run every command that the pages and the help texts print, as printed, beside the files that they presuppose.

By hand, or ``make pages``: it takes some minutes. The recordings come from the virtual robot. The commands of README
and of the tutorials are run by their own tests, those in ``ELSEWHERE`` by the tests that it names.

    python tests/pages/every_command.py [--only WORD]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rrrgen
from pages.reader import compare
from pages.test_pages import PAGES, ROOT, blocks
from robot.file import par_files
from robot.file.test_ur_calibration import FAR_AWAY
from robot.importers.test_importing import urdf_of_two_arms
from robot.importers.urdf_files import ARM
from rrrgen.cli.commands import COMMANDS, load_command
from rrrgen.cli.main import run
from rrrgen.lab.data import figure_style as figures

TESTED = ("README.md", "CONTRIBUTING.md", "docs/first-")
"""Pages whose commands their own tests run, or that are how to run the tests."""

ELSEWHERE = {
    "pip install": "tests/emit/targets/test_wheel.py installs a wheel; the dependencies of rrrgen need an index",
    "colcon build": "needs ROS 2",
    "examples/tx40": "needs measured data, which examples/README.md says where to get",
    "examples/emps": "needs measured data, which examples/README.md says where to get",
    "examples/flexible_arm": "needs measured data, which examples/README.md says where to get",
    "rrrgen experiment case-study": "tests/lab/experiment/test_case_study.py",
    "--presliding": "tests/lab/friction/test_estimation.py, on recordings of a joint with bristles",
    "rrrgen response matrix": "tests/lab/studies/test_matrix_response.py",
    "rrrgen experiment elastic-joints": "tests/lab/studies/test_estimate_elastic_joints.py",
    "rrrgen response linearise": "tests/lab/experiment/test_response_experiment.py",
    "pytest tests/": "is itself a test",
    "make playground": "tests/emit/html/test_playground.py builds the page and visits it",
    "rrrgen playground": "tests/emit/html/test_playground.py builds the page and visits it",
    "my_arm_calibrated": "docs/first-calibration.md, whose lines are run",
}
"""Words of commands that are not run here, and why."""

SHOWN = "shown: "
"""Before the output that a page shows after its commands."""

ROBOTS = ROOT / "rrrgen/robot/robots"
FEW = "--harmonics 3 --starts 1 --duration 5"
FOLLOW = "--trajectory runs/excitation/results/excitation.json --torque-noise 0.05"
BEFORE = f"""
rrrgen experiment excite my_arm.yaml {FEW} -o runs/excitation
rrrgen experiment simulate my_arm.yaml {FOLLOW} -o runs/experiment
rrrgen experiment simulate my_arm.yaml {FOLLOW} --seed 1 -o s/other
rrrgen experiment simulate my_arm.yaml {FOLLOW} --duration 32 -o s/work
rrrgen experiment simulate loaded.yaml {FOLLOW} -o s/carrying
rrrgen experiment simulate my_arm.yaml --writing --torque-noise 0.05 -o runs/writing
rrrgen identify my_arm.yaml --log runs/experiment/results/log.yaml -o runs/identified
rrrgen experiment reconstruct runs/experiment/results/log.yaml --method kalman -o runs/motion
rrrgen experiment excite rrr --friction q3 -o runs/slow
rrrgen experiment simulate rrr --trajectory runs/slow/results/friction_motion.json --torque-noise 0.02 -o runs/joint3
rrrgen experiment excite rrr --response q1 -o runs/plan
rrrgen experiment simulate rrr --response runs/plan/results/response_excitation.json --base-mode 28 -o s/q1
rrrgen response frf s/q1/results/response.yaml -o runs/response
rrrgen response model runs/response/results/frf.json -o runs/model
rrrgen experiment excite rrr -o s/motion
rrrgen experiment simulate rrr --trajectory s/motion/results/excitation.json --torque-noise 0.05 -o s/rrr
rrrgen generate rrr -o generated/rrr
"""
"""Commands that make what the pages presuppose: recordings, run folders and files of other programs."""

PAYLOAD = {
    "mass: 1.2": "mass: 2.2",
    "com: [-0.275, 0, 0.004]": "com: [-0.33/2.2, 0, 0.0548/2.2]",
    "xx: 0.00422, yy: 0.1033": "xx: 0.00672, yy: 0.1058",
}
"""The last link without and with a point mass of 1 kg at 0 0 0.05."""

LOGS = {
    "log": "s/work",
    "other": "s/other",
    "empty": "runs/experiment",
    "work": "s/work",
    "carrying": "s/carrying",
    "runs/log": "runs/experiment",
    "runs/joint3/log": "runs/joint3",
}
"""Recordings of the pages, and the run folders that they come from."""

CELL = """
<mujoco><compiler angle="radian"/><worldbody><body name="cart"><joint name="rail" type="slide" axis="1 0 0"/>
<geom size="0.1" mass="1"/><body name="arm" pos="0 0 0.5"><joint name="turn" axis="0 0 1"/><geom size="0.1" mass="1"/>
<body name="tool" pos="0.4 0 0"><joint name="swing" axis="0 1 0"/><geom size="0.1" mass="1"/></body></body></body>
</worldbody></mujoco>
"""


OTHER_FILES = {
    "cell.xml": CELL,
    "panda.urdf": ARM.replace('"tool"', '"panda_link8"'),
    "torso.urdf": urdf_of_two_arms().replace('"right_lower"', '"right_hand"'),
    "arm.par": par_files.text(par_files.SLIDING | par_files.inertia(3, 1)),
    "RX90.par": par_files.text(par_files.ELBOW | par_files.inertia(6), "rx90", "0,0,G3"),
    "my_ur5.yaml": FAR_AWAY,
}
"""Files of other programs that the pages import, by their names."""


def presupposed(names: tuple[str, str, str]) -> None:
    """Write the files that the pages presuppose into the working directory, for an arm with these joints."""
    arm = (ROBOTS / "rrr.yaml").read_text(encoding="utf-8")
    for old, new in zip(("q1", "q2", "q3"), names, strict=True):
        arm = re.sub(rf"\b{old}\b", new, arm)
    arm = arm.replace("drive: {enc", "friction: {viscous: 0.3, coulomb: 1}\n    drive: {enc")
    arm = re.sub(r"^name: rrr$", "name: my_arm", arm, flags=re.M)
    for name in ("my_arm", "my_robot", "elbow3", "robots/one"):
        Path(name).parent.mkdir(exist_ok=True)
        Path(f"{name}.yaml").write_text(arm, encoding="utf-8")
    loaded = arm
    for empty, carrying in PAYLOAD.items():
        assert empty in loaded
        loaded = loaded.replace(empty, carrying)
    Path("loaded.yaml").write_text(loaded, encoding="utf-8")
    Path("panda.yaml").write_text((ROBOTS / "panda.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    shutil.copy(ROOT / "examples/trees/hand.yaml", "hand.yaml")
    for file, text in OTHER_FILES.items():
        Path(file).write_text(text, encoding="utf-8")
    page = (ROOT / "docs/virtual-robot.md").read_text(encoding="utf-8")
    (experiment,) = (text for text in blocks(page, "yaml") if text.startswith("schema: rrrgen-experiment/1"))
    Path("experiment.yaml").write_text(experiment, encoding="utf-8")
    Path("examples").symlink_to(ROOT / "examples")
    model, rng = rrrgen.compile("ur10e"), np.random.default_rng(1)
    rows = [",".join([*(f"q{i}" for i in range(1, 7)), "x", "y", "z", "roll", "pitch", "yaw"])]
    for q in rng.uniform(-1.5, 1.5, (50, 6)):
        T = model.forward_kinematics(q)
        pitch = np.arctan2(-T[2, 0], np.hypot(T[0, 0], T[1, 0]))
        angles = np.array([np.arctan2(T[2, 1], T[2, 2]), pitch, np.arctan2(T[1, 0], T[0, 0])])
        pose = np.concatenate([T[:3, 3] + rng.normal(0, 5e-5, 3), angles + rng.normal(0, 1e-4, 3)])
        rows.append(",".join(f"{value:.9f}" for value in (*q, *pose)))
    Path("measured.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    for line in BEFORE.strip().splitlines():
        code, said = printed(line)
        if code:
            raise SystemExit(f"exit code {code}: {line}\n{said}")
    for name, source in LOGS.items():
        folder = Path(source, "results")
        text = (folder / "log.yaml").read_text(encoding="utf-8").replace("log.csv", Path(name).name + ".csv")
        Path(f"{name}.yaml").write_text(text, encoding="utf-8")
        shutil.copy(folder / "log.csv", f"{name}.csv")
    wrong = Path("s/rrr/results/log.yaml").read_text(encoding="utf-8").replace("log.csv", "wrong.csv")
    wrong = wrong.replace("  - name: q2\n", "  - name: q2\n    zero: -20 deg\n")
    wrong = wrong.replace("{column: tau_q3, unit: N*m,", "{column: tau_q3, unit: N*m, gain: 2,")
    Path("runs/experiment/results/wrong.yaml").write_text(wrong, encoding="utf-8")
    shutil.copy("s/rrr/results/log.csv", "runs/experiment/results/wrong.csv")
    for name in ("joint3", "slide"):
        shutil.copy("runs/joint3/results/log.csv", f"{name}.csv")
    shutil.copy("runs/experiment/results/log_controller.yaml", "controller.yaml")
    for file in Path("s/q1/results").iterdir():
        shutil.copy(file, "joint1.yaml" if file.name == "response.yaml" else file.name)
    t = np.arange(2048) * 1e-3
    u = rng.normal(size=2048)
    y = np.zeros(2048)
    for k in range(2, 2048):
        y[k] = 1.9 * y[k - 1] - 0.95 * y[k - 2] + 0.01 * u[k - 1] + 1e-4 * rng.normal()
    np.savetxt("arm.csv", np.column_stack([t, u, y]), delimiter=",", header="t,u,y", comments="")
    response = "schema: rrrgen-response/1\nfiles: arm.csv\ntime: {column: t}\nexcitation: {column: u}\n"
    Path("arm.yaml").write_text(response + "input: {column: u}\noutput: {column: y, unit: rad}\n", encoding="utf-8")


def two_joints() -> None:
    """The arm and the recordings of docs/from-a-csv.md, beside a template that its reader fills in."""
    text = (ROBOTS / "planar2r.yaml").read_text(encoding="utf-8").replace("name: planar2r", "name: my_arm")
    Path("my_arm.yaml").write_text(text, encoding="utf-8")
    model, t = rrrgen.compile("planar2r"), np.arange(0, 10, 0.005)
    for name, rate in (("log", 1.0), ("other", 1.2)):
        q = np.stack([np.sin(2.5 * rate * t) + 0.4 * np.sin(6.5 * t), np.sin(4.4 * rate * t)], axis=1)
        dq = np.gradient(q, t, axis=0)
        tau = model.inverse_dynamics(q, dq, np.gradient(dq, t, axis=0))
        columns = np.column_stack([t, q, tau])
        np.savetxt(f"{name}.csv", columns, delimiter=",", header="t,q_q1,q_q2,tau_q1,tau_q2", comments="")


def printed(line: str) -> tuple[int, str]:
    """Run a line: rrrgen in this process, so that libraries are loaded once, everything else by the shell."""
    out = io.StringIO()
    words = re.sub(r"\s+(#|\().*$", "", line)
    if made := re.match(r"rrrgen new (\w+)", words):  # what the pages presuppose has the names of what they make
        Path(f"{made[1]}.yaml").unlink(missing_ok=True)
    target = re.search(r" -o (\S+)", words)
    if target and target[1].startswith("runs/"):  # alternatives on a page write to the same folder
        shutil.rmtree(target[1], ignore_errors=True)
    if target and words.startswith("rrrgen import "):
        Path(target[1]).unlink(missing_ok=True)
    if words == "rrrgen export panda.yaml --to urdf":  # writes the file that is presupposed for its import
        Path("panda.urdf").unlink()
    if words.startswith("rrrgen ") and not re.search(r"[|><*~]|&&", words):
        import shlex

        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            code = run(shlex.split(words)[1:])
        return code, out.getvalue()
    functions = f'rrrgen() {{ {sys.executable} -m rrrgen "$@"; }}\npython() {{ {sys.executable} "$@"; }}'
    shell = f"{functions}\nmake-robot() {{ cat my_arm.yaml; }}\n{words}"
    environment = {**os.environ, "HOME": os.getcwd()}
    if Path(rrrgen.__file__).is_relative_to(ROOT):
        environment["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(["bash", "-ec", shell], capture_output=True, text=True, env=environment, check=False)
    return done.returncode, done.stdout + done.stderr


def lines_of(text: str) -> list[str]:
    """The commands in a block, continued lines joined."""
    joined = re.sub(r"\\\n\s*", "", text)
    return [line.strip() for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def sources() -> dict[str, list[str]]:
    """The commands of every page and of every help text, and behind ``SHOWN`` what a page shows as their output."""
    found = {}
    for page in PAGES:
        name = str(page.relative_to(ROOT))
        text = page.read_text(encoding="utf-8")
        lines = []
        for block, shown in re.findall(
            r"^```(?:sh|bash|console)\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", text, re.S | re.M
        ):
            lines += lines_of(block) + [SHOWN + shown] * bool(shown)
        if lines and not name.startswith(TESTED):
            found[name] = lines
    for name in COMMANDS:
        examples = (load_command(name).help or "").partition("\b\n")[2]
        found[f"rrrgen {name} --help"] = [line.strip() for line in examples.splitlines() if "rrrgen " in line]
    return found


def main() -> int:
    """Run them; the exit code is 1 if one fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="pages and commands with this word in their name")
    only = parser.parse_args().only
    figures.PRINT = 60
    failed = []
    with tempfile.TemporaryDirectory() as place:
        bases = {}
        for kind, names in (("page", ("shoulder", "elbow", "wrist")), ("help", ("q1", "q2", "q3"))):
            bases[kind] = Path(place, kind)
            bases[kind].mkdir()
            os.chdir(bases[kind])
            presupposed(names)
        for number, (source, lines) in enumerate(sources().items()):
            if only not in source:
                continue
            folder, said_so_far = Path(place, str(number)), ""
            for line in lines:
                if line.startswith(SHOWN):
                    try:
                        compare(line.removeprefix(SHOWN), said_so_far)
                        print(f"   same     {source}: the output that the page shows")
                    except AssertionError as difference:
                        failed.append(f"{source}: output")
                        print(f"  differs   {source}: {difference}")
                    continue
                if reason := next((why for word, why in ELSEWHERE.items() if word in line), None):
                    print(f"  left out  {source}: {line}  ({reason})")
                    continue
                # the examples of a help text are alternatives; --check reads what the one before wrote
                if not folder.exists() or (source.endswith("--help") and "--check" not in line):
                    shutil.rmtree(folder, ignore_errors=True)
                    shutil.copytree(bases["help" if source.endswith("--help") else "page"], folder, symlinks=True)
                os.chdir(folder)
                start = time.perf_counter()
                code, said = printed(line)
                said_so_far += said
                if line.startswith("rrrgen new") and source == "docs/from-a-csv.md":
                    two_joints()
                print(f"{time.perf_counter() - start:6.1f} s  {code}  {source}: {line}", flush=True)
                if code:
                    failed.append(line)
                    print(said[-1500:])
        os.chdir(ROOT)
    print(f"{len(failed)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
