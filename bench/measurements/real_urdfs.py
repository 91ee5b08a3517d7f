"""``python -m bench.measurements.real_urdfs``: URDFs of real arms, imported, verified, solved for inverse kinematics.

The files come with rtb-data, which the Robotics Toolbox installs, and with example-robot-data, 130 MB that no extra
installs (``pip install --no-deps example-robot-data``). Each arm is imported twice. With its decimals as they are,
poses and torques are compared with Pinocchio, which reads the source. As users import it, with exact angles, every
function is verified, and inverse kinematics is solved for the poses of random configurations: every solution must meet
its pose, and the configuration itself must be among them. For arms of seven joints the table names the joint whose
value is prescribed.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from rrrgen.robot.importers.importing import Imported, import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.imported_source import SourceComparison, compare_with_source
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.engines import EngineName

AGREE = 1e-9
"""Largest difference of poses (parts of the reach) and torques (parts of the largest one) from the source."""

MEETS = 1e-12
"""Largest error of a solution: entries of the rotation matrix, positions in reaches."""

SAME = 1e-4
"""Largest difference (rad, m) between the configuration of a target and the solution that counts as the same."""


@dataclass(frozen=True)
class File:
    """A URDF in the data of a package, and the chain that is taken from it: from ``base`` (the root) to ``tip``."""

    package: str
    path: str
    tip: str = ""
    base: str = ""


TOOLBOX, DATA = "rtb-data", "example-robot-data"
ARMS = {
    "irb140": File(TOOLBOX, "abb_irb140_description/urdf/irb140.urdf"),
    "kr16": File(TOOLBOX, "kuka_description/kuka_kr16/urdf/kr16_2.urdf"),
    "kr120": File(TOOLBOX, "kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf"),
    "kr210": File(TOOLBOX, "kuka_description/kuka_kr210/urdf/kr210l150.urdf", "tool0"),
    "iiwa14": File(TOOLBOX, "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf"),
    "puma560": File(TOOLBOX, "unimation_puma560_description/urdf/puma560_robot.urdf"),
    "al5d": File(TOOLBOX, "lynxmotion_al5d_description/urdf/al5d_robot.urdf"),
    "panda": File(TOOLBOX, "qut_frankie_description/robots/panda_arm.urdf.xacro"),
    "px100": File(TOOLBOX, "trossen_descriptions/urdf/px100.urdf.xacro", "px100/ee_gripper_link"),
    "wx250s": File(TOOLBOX, "trossen_descriptions/urdf/wx250s.urdf.xacro", "wx250s/ee_gripper_link"),
    "vx300s": File(TOOLBOX, "trossen_descriptions/urdf/vx300s.urdf.xacro", "vx300s/ee_gripper_link"),
    "panda+inertia": File(DATA, "panda_description/urdf/panda.urdf", "panda_link8"),
    "ur3": File(DATA, "ur_description/urdf/ur3_robot.urdf", "ee_link"),
    "ur5": File(DATA, "ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur10": File(DATA, "ur_description/urdf/ur10_robot.urdf", "tool0"),
    "j2s6s200": File(DATA, "kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "z1": File(DATA, "z1_description/urdf/z1.urdf", "link06"),
    "xarm7": File(DATA, "xarm_description/urdf/xarm7.urdf"),
    "so101": File(DATA, "so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "tiago": File(DATA, "tiago_description/robots/tiago.urdf", "hand_tool_link", "torso_lift_link"),
    "baxter": File(DATA, "baxter_description/urdf/baxter.urdf", "left_gripper"),
}


class MissingDataError(Exception):
    """The package with the file is not installed; the message says how to install it."""


def urdf_of(name: str, folder: Path) -> Path:
    """The URDF of an arm; a file with macros is expanded into ``folder``, under the name of the arm."""
    arm = ARMS[name]
    if arm.package == DATA:
        places = [Path(place) / "cmeel.prefix/share/example-robot-data/robots" / arm.path for place in sys.path]
        found = next((place for place in places if place.exists()), None)
        if found is None:
            raise MissingDataError(f"needs 130 MB of robots: pip install --no-deps {DATA}")
        return found
    package = find_spec("rtbdata")
    if package is None or not package.submodule_search_locations:
        raise MissingDataError(f"needs {TOOLBOX}, which roboticstoolbox-python installs")
    root = Path(package.submodule_search_locations[0]) / "xacro"
    return root / arm.path if arm.path.endswith(".urdf") else _expanded(root, name, folder)


def _expanded(root: Path, name: str, folder: Path) -> Path:
    try:
        import xacrodoc
    except ImportError:
        raise MissingDataError("needs xacrodoc, which roboticstoolbox-python installs") from None
    xacrodoc.packages.update_package_cache({each.name: str(each) for each in root.iterdir() if each.is_dir()})
    given = {"robot_name": name, "robot_model": name}
    document = xacrodoc.XacroDoc.from_file(str(root / ARMS[name].path), subargs=given)
    (folder / f"{name}.urdf").write_text(document.to_urdf_string(), encoding="utf-8")
    return folder / f"{name}.urdf"


def imported(name: str, folder: Path, angle_tolerance: float = ChainChoice.angle_tolerance) -> Imported:
    """The robot of an arm, with angles taken as exact within ``angle_tolerance`` (rad)."""
    chain = ChainChoice(ARMS[name].base, ARMS[name].tip, angle_tolerance=angle_tolerance)
    return import_robot(urdf_of(name, folder), name="arm", chain=chain)


def agrees(difference: SourceComparison) -> bool:
    """Whether poses, and torques where the file has inertia, are those of the source."""
    return (
        difference.pose is not None
        and difference.pose <= AGREE
        and (difference.torque is None or difference.torque <= AGREE)
    )


@dataclass(frozen=True)
class Solved:
    """Inverse kinematics for random poses: solutions per pose, configurations that were not found, largest error."""

    family: str
    prescribed: str
    rows: float
    lost: int
    error: float
    microseconds: float

    @property
    def ok(self) -> bool:
        """Whether every configuration was found and all solutions meet their poses."""
        return self.lost == 0 and self.error <= MEETS


def solved(spec: RobotSpec, poses: int, seed: int, backend: EngineName = "c") -> Solved:
    """Solve for the poses of random configurations; these poses and those of the solutions by an own recursion."""
    from rrrgen.runtime.inverse_kinematics import load_solver

    solver = load_solver(spec, backend=backend)
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (poses, spec.n))
    oracle = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)))
    T = oracle.forward_kinematics(q)
    locked = solver.plan.locked is not None
    given = np.array([solver.parameter(x) for x in q]) if locked else None
    begin = time.process_time()
    batch = solver.solve_batch(T, limits=False, redundancy=given)
    seconds = time.process_time() - begin
    valid = np.arange(batch.q.shape[1]) < batch.counts[:, None]
    apart = np.abs(np.remainder(batch.q - q[:, None] + np.pi, 2 * np.pi) - np.pi).max(axis=2)
    lost = ~(np.where(valid, apart, np.inf).min(axis=1) <= SAME)
    off = np.abs(oracle.forward_kinematics(batch.q[valid]) - np.repeat(T, batch.counts, axis=0))
    off[:, :3, 3] /= solver.plan.chain.reach
    prescribed = str(solver.plan.redundancy) if locked else ""
    return Solved(
        solver.plan.family, prescribed, float(batch.counts.mean()), int(lost.sum()), float(off.max(initial=0.0)),
        1e6 * seconds / poses,
    )  # fmt: skip


def verified(spec: RobotSpec, samples: int, seed: int) -> str:
    """``pass``, or the names of the functions that differ from independent dynamics at random states."""
    from rrrgen.runtime import load
    from rrrgen.verify import verify

    report = verify(load.compile(spec), samples, seed)
    return ", ".join(sorted({row.function for row in report.failures})) or "pass"


@click.command()
@click.option("--poses", default=2000, show_default=True, help="Number of random poses per arm.")
@click.option("--samples", default=100, show_default=True, help="Number of random states of the verification.")
@click.option("--seed", default=0, show_default=True, help="Seed of poses and states.")
@click.option("--arm", "only", multiple=True, type=click.Choice(list(ARMS)), help="Only this arm; repeat for several.")
def real_urdfs(poses: int, samples: int, seed: int, only: tuple[str, ...]) -> int:
    """Import, verify and solve real arms; exit with 1 if a figure is off. Arms whose files are missing are named."""
    click.echo(
        f"{'arm':14} joints {'poses':>8} {'torques':>8}  {'verify':7} {'family':10} {'solutions':>9} {'lost':>5} "
        f"{'error':>8} {'us/pose':>8}  prescribed"
    )
    sound = True
    with tempfile.TemporaryDirectory() as folder:
        for name in only or ARMS:
            try:
                difference = compare_with_source(imported(name, Path(folder), 0.0))
            except MissingDataError as error:
                click.echo(f"{name:14} left out: {error}")
                continue
            spec = imported(name, Path(folder)).spec
            verdict, ik = verified(spec, samples, seed), solved(spec, poses, seed)
            pose, torque = ("-" if x is None else f"{x:.1e}" for x in (difference.pose, difference.torque))
            click.echo(
                f"{name:14} {spec.n:6} {pose:>8} {torque:>8}  {verdict:7} {ik.family:10} {ik.rows:9.2f} {ik.lost:5} "
                f"{ik.error:8.1e} {ik.microseconds:8.2f}  {ik.prescribed}"
            )
            sound = sound and agrees(difference) and verdict == "pass" and ik.ok
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(real_urdfs(standalone_mode=False))
