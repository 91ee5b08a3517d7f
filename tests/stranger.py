"""The stranger: takes robots that nobody has tried the way of a user, in an environment with a wheel of this checkout.

Each seed draws a robot with a legal name (capitals, digits, words that other languages have taken) and a random
structure, from `rrrgen new`, a bundled robot, a robot file, a URDF or an MJCF, and takes it through check, show,
generate, a build without warnings, self-tests, verify, ik, two targets of export and back, excite, simulate and
identify. The loop must follow, and the parameters that made the recording lie within their deviations. What one seed
leaves out of `--with` and the targets, others have. A seed that fails keeps its folder.

    make stranger SEEDS=300                  fresh seeds, then the pages
    python tests/stranger.py --seed 4711     that seed again

Half of the time of a small robot would go into importing numerical libraries and another part into drawing figures: the
process of each seed is forked from one that has imported them, and one seed in four draws.

The short form in continuous integration, `--seed` with five seeds, takes arms of two or three joints, from three
kinds of sources, through generation, verification, export and identification. It installs no packages, runs no pages,
and leaves out arms of six and seven joints, most words of `--with` and most targets.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import itertools
import json
import math
import multiprocessing
import multiprocessing.connection
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess

    from rrrgen.robot.spec import RobotSpec
    from rrrgen.verify.references.newton_euler import NewtonEuler

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 1200.0
"""A seed that takes longer has failed; the longest, of seven joints, take some minutes."""

GCC = ["-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
WITH = ["control", "cpp", "elastic", "gravity", "javascript", "observer", "points", "rust", "timing", "trajectory"]
TARGETS = ["embedded", "fmu", "matlab", "mjcf", "par", "ros2", "urdf", "wheel"]
BUNDLED = ["gantry", "iiwa14", "panda", "pendulum", "planar2r", "puma560", "rrr", "scara", "stanford", "ur10e", "ur5"]

LIBRARIES = """
rrrgen.cli.main rrrgen.derive rrrgen.runtime.load rrrgen.verify.checks rrrgen.lab.studies.excite
rrrgen.lab.studies.simulate rrrgen.lab.studies.identify numpy scipy.linalg scipy.optimize scipy.signal
matplotlib.backends.backend_agg matplotlib.backends.backend_svg matplotlib.figure cvxpy casadi cffi sympy
roboticstoolbox pinocchio mujoco
"""
"""What the process that seeds are forked from imports."""

TAKEN = """
auto register restrict inline class template namespace operator this nullptr co_await and xor requires
fn impl let match mod move mut pub ref self Self super trait type unsafe use where loop crate dyn async await box
yield abstract become final macro unsized virtual try gen
end function classdef elseif otherwise parfor persistent global spmd properties methods events
None True False def lambda pass del nonlocal in is not raise with from import print self len int list
NAN INFINITY NULL EOF I E N T M pi tau beta con nul test main std double real_t bool true linux unix windows
"""
"""Words of languages, libraries and systems; as they stand some are refused as names, others not."""


# -- the robots ----------------------------------------------------------------------------------------------------


def draw_name(rng: random.Random) -> str:
    """A name with capitals, digits and words that are keywords somewhere; not every one is legal for a robot."""
    word = rng.choice(TAKEN.split())
    return rng.choice(
        [
            word,
            word.capitalize(),
            word.upper(),
            f"{word}_{rng.randint(0, 99)}",
            f"{word.capitalize()}{rng.randint(1, 9)}",
            f"{rng.choice('ABQRXZ')}{rng.randint(1, 99)}{rng.choice('DLR')}",
            f"{rng.choice(['UF', 'AL', 'My', 'my'])}_{rng.choice(['ROBOT', 'Arm', 'arm_2', 'x'])}{rng.randint(0, 9)}",
            "z" + "".join(rng.choice("aBcD3") for _ in range(39)),
        ]
    )


def draw_joints(rng: random.Random, most: int = 7) -> str:
    """The kinds of joints, R and P, of a chain: mostly two to four."""
    n = min(most, rng.choice([1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 5, 6, 6, 7]))
    return "".join("P" if rng.random() < 0.2 else "R" for _ in range(n))


def draw_body(rng: random.Random) -> tuple[float, list[float], list[float]]:
    """Mass, centre of mass and the six entries xx, yy, zz, xy, xz, yz of a tensor about it: a box turned at random."""
    mass = round(rng.uniform(0.5, 8), 2)
    a, b, c = (rng.uniform(0.05, 0.3) for _ in range(3))
    moments = [mass / 12 * (b * b + c * c), mass / 12 * (a * a + c * c), mass / 12 * (a * a + b * b)]
    R = rotation(*(rng.uniform(-3, 3) for _ in range(3)))
    tensor = [[sum(R[i][k] * moments[k] * R[j][k] for k in range(3)) for j in range(3)] for i in range(3)]
    entries = [tensor[i][j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return mass, [round(rng.uniform(-0.2, 0.2), 3) for _ in range(3)], [round(entry, 5) for entry in entries]


def rotation(roll: float, pitch: float, yaw: float) -> list[list[float]]:
    """The rotation matrix of fixed-axis angles."""
    cr, sr, cp, sp, cy, sy = (f(x) for x in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def inertia_text(entries: list[float]) -> str:
    """The entries of a tensor as a mapping of YAML."""
    return ", ".join(
        f"{key}: {entry:g}" for key, entry in zip(["xx", "yy", "zz", "xy", "xz", "yz"], entries, strict=True)
    )


def friction_text(rng: random.Random, scale: float) -> str:
    """Friction of a joint whose torques are of the size of ``scale``."""
    return f"{{viscous: {scale * rng.uniform(0.01, 0.1):.3g}, coulomb: {scale * rng.uniform(0.01, 0.05):.3g}}}"


def write_rows(rng: random.Random, name: str, joints: str) -> str:
    """A robot file with random rows: either convention, both signs, named lengths, friction and drives."""
    n = len(joints)
    degrees = rng.random() < 0.5
    rounded = rng.random() < 0.2  # as people type 1.5708 for a right angle

    def turn(angle: float) -> str:
        if degrees:
            return f"{math.degrees(angle):.10g}"
        quarters = angle / (math.pi / 2)
        return f"{quarters:.0f}*pi/2" if quarters == int(quarters) and not rounded else f"{angle:.5g}"

    lines = ["schema: rrrgen/1", f"name: {name}", f"convention: {rng.choice(['standard', 'modified'])}"]
    lines += [f"units: {{angle: {'deg' if degrees else 'rad'}, length: m}}"]
    lines += [f"gravity: {rng.choice(['[0, 0, -9.81]', '[0, 0, -9.81]', '[0, -9.81, 0]', '[3.1, -2.7, -8.9]'])}"]
    named = rng.random() < 0.4
    if named:
        lines.append(f"parameters: {{L1: {rng.uniform(0.1, 0.5):.3f}}}")
    if rng.random() < 0.4:
        lines.append(f"base: {{translation: [0.1, -0.2, 0.35], rpy: [0, {turn(math.pi / 2)}, {turn(0.3)}]}}")
    if rng.random() < 0.5:
        lines.append(f"tool: {{translation: [0, 0.05, 0.12], rpy: [{turn(0.7)}, 0, {turn(math.pi / 2)}]}}")
    lines.append("joints:")
    bodies = [draw_body(rng) for _ in range(n)]
    rubs, driven = rng.random() < 0.7, rng.random() < 0.4
    for k, kind in enumerate(joints):
        alpha = rng.choice([0, math.pi / 2, -math.pi / 2, math.pi / 2, -math.pi / 2, math.pi, 0.7])
        a, d = (rng.choice(["0", "0", f"{rng.uniform(0.1, 0.5):.3f}", "L1" if named else "0.25"]) for _ in range(2))
        theta = rng.choice([0, 0, 0, math.pi / 2, -0.4])
        row = f"name: {rng.choice(['Axis_', 'shaft', 'end_'])}{k + 1}"
        row += f", type: {'prismatic' if kind == 'P' else 'revolute'}"
        row += f", alpha: {turn(alpha)}, a: {a}, d: {d}, theta: {turn(theta)}"
        if rng.random() < 0.2:
            row += ", sign: -1"
        low, high, speed = ("0", "0.6", "1") if kind == "P" else (turn(-2.8), turn(2.8), turn(2.5))
        row += f", limits: {{lower: {low}, upper: {high}, velocity: {speed}}}"
        carried = sum(body[0] for body in bodies[k:])
        if rubs:
            row += f", friction: {friction_text(rng, carried * (9.81 if kind == 'P' else 2))}"
        if driven:
            row += f", drive: {{inertia: {carried * (0.3 if kind == 'P' else 0.02):.3g}}}"
        lines.append(f"  - {{{row}}}")
    lines.append("links:")
    for mass, com, entries in bodies:
        lines.append(f"  - {{mass: {mass}, com: {com}, inertia: {{about: com, {inertia_text(entries)}}}}}")
    return "\n".join(lines) + "\n"


def write_urdf(rng: random.Random, name: str, joints: str) -> str:
    """A URDF of a chain, with what real ones have besides: visuals, short numbers, a fixed flange, mixed names."""
    parts = [f'<robot name="{name}">', '<link name="Base Link"/>']
    parent = "Base Link"
    for k, kind in enumerate(joints, start=1):
        mass, com, e = draw_body(rng)
        link = rng.choice([f"Link-{k}", f"link_{k}", f"L{k}"])
        tensor = " ".join(f'i{key}="{e[i]}"' for i, key in enumerate(["xx", "yy", "zz", "xy", "xz", "yz"]))
        parts.append(
            f'<link name="{link}"><inertial><origin xyz="{com[0]} {com[1]} {com[2]}" rpy="0 0 .0"/>'
            f'<mass value="{mass}"/><inertia {tensor}/></inertial>'
            '<visual><geometry><box size=".1 .1 .1"/></geometry></visual></link>'
        )
        xyz = " ".join(rng.choice(["0", "0.", ".1", "-.25", f"{rng.uniform(-0.4, 0.4):.3f}"]) for _ in range(3))
        rpy = " ".join(rng.choice(["0", "1.5707963267948966", "-1.5707963267948966", "0.3"]) for _ in range(3))
        axis = rng.choice(["0 0 1", "0 1 0", "1 0 0", "0 0 -1", "0 -1 0"])
        low, high, speed = ("0", ".6", "1") if kind == "P" else ("-2.8", "2.8", "2.5")
        parts.append(
            f'<joint name="{rng.choice(["joint", "Joint", "A", "class", "end"])}{k}" '
            f'type="{"prismatic" if kind == "P" else "revolute"}"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="{speed}" effort="{rng.choice(["0", "500", "1000."])}"/>'
            f'<dynamics damping=".{rng.randint(1, 9)}" friction=".{rng.randint(1, 9)}"/></joint>'
        )
        parent = link
    if rng.random() < 0.5:
        parts.append('<link name="flange"/><joint name="to flange" type="fixed">')
        parts.append('<origin xyz="0 0 .1" rpy="0 1.5708 0"/>')
        parts.append(f'<parent link="{parent}"/><child link="flange"/></joint>')
    return "\n".join([*parts, "</robot>"])


def write_mjcf(rng: random.Random, name: str, joints: str) -> str:
    """An MJCF of a chain of bodies with inertials."""
    text = ""
    for k, kind in reversed(list(enumerate(joints, start=1))):
        mass, com, e = draw_body(rng)
        pos = " ".join(rng.choice(["0", ".1", "-.25", f"{rng.uniform(-0.4, 0.4):.3f}"]) for _ in range(3))
        turned = rng.choice(['euler="0 0 0"', 'euler="90 0 0"', 'quat=".5 .5 .5 .5"', 'euler="0 90 30"'])
        span = 'range="0 .6"' if kind == "P" else 'range="-160 160"'
        joint = f'name="Joint {k}" type="{"slide" if kind == "P" else "hinge"}" {span}'
        joint += f' axis="{rng.choice(["0 0 1", "0 1 0", "1 0 0", "0 -1 0"])}"'
        joint += f' damping="{rng.uniform(0.1, 1):.2f}" frictionloss="{rng.uniform(0.1, 1):.2f}"'
        inertial = f'mass="{mass}" pos="{com[0]} {com[1]} {com[2]}" fullinertia="{" ".join(map(str, e))}"'
        text = f'<body name="b{k}" pos="{pos}" {turned}><joint {joint}/><inertial {inertial}/>{text}</body>'
    return f'<mujoco model="{name}"><compiler angle="degree"/><worldbody>{text}</worldbody></mujoco>'


# -- one seed ----------------------------------------------------------------------------------------------------


class Fault(Exception):  # noqa: N818
    """Something that a user would report, with all that was printed."""


def reference_of(spec: RobotSpec) -> NewtonEuler:
    """Kinematics and dynamics of a robot file by the reference of verification; zero parameters without links."""
    import numpy as np

    from rrrgen.verify.references.newton_euler import NewtonEuler
    from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

    chain, phi = chain_of(spec), nominal_parameters(spec)
    return NewtonEuler(chain, np.zeros((chain.links, 10)) if phi is None else phi)


def value_of(name: str, values: dict[str, float]) -> float:
    """The value of a parameter, also of a combination such as ``Jyy2R + 0.5*Ia2``; Fault for an unknown name."""
    names = re.compile(
        "|".join(rf"(?<![\w.]){re.escape(known)}(?!\w)" for known in sorted(values, key=len, reverse=True))
    )
    numbers = names.sub(lambda match: f"({values[match.group()]!r})", name)
    if re.search(r"[^\d\s.e()*+-]", numbers):
        raise Fault(f"a parameter without a truth: {name}; there are {sorted(values)}")
    return float(eval(numbers, {"__builtins__": {}}))  # digits and signs only


class Stranger:
    """A user with one robot in a folder of their own; runs commands, and notes what was tried.

    Args:
        seed: of everything that is drawn.
        folder: where it works.
    """

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = random.Random(seed)
        self.folder = folder
        self.tried: list[str] = []

    def rrrgen(self, *words: str, allowed: tuple[int, ...] = (0,)) -> tuple[int, str]:
        """Run a command of rrrgen in this process; Fault for an exit code that is not ``allowed``."""
        from rrrgen.cli.main import run

        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            code = run(list(words))
        if code not in allowed or "Traceback" in out.getvalue():
            raise Fault(f"exit code {code}: rrrgen {' '.join(words)}\n{out.getvalue()}")
        return code, out.getvalue()

    def program(self, *words: str | Path, cwd: Path | None = None, **environment: str) -> str:
        """Run another program; Fault if it fails."""
        done = subprocess.run(
            list(map(str, words)),
            cwd=cwd,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode:
            raise Fault(f"exit code {done.returncode}: {' '.join(map(str, words))}\n{done.stdout[-6000:]}")
        return done.stdout

    def summary(self) -> str:
        """One line: the time of a processor that it took, and what was tried."""
        user, system, of_children, system_of_children, _ = os.times()
        return f"{user + system + of_children + system_of_children:.0f} s  {' '.join(self.tried)}"

    def make_robot(self) -> str:
        """Get a robot file; its path. Names are drawn until one is legal: an illegal one must be refused, not break."""
        source = self.rng.choice(["new", "new", "bundled", "written", "written", "written", "urdf", "mjcf"])
        joints = draw_joints(self.rng)
        while True:
            name = draw_name(self.rng)
            code, _ = self.rrrgen("new", name, "--force", allowed=(0, 2, 3))
            if code == 0:
                break
        file = f"{name}.yaml"
        if source == "new":
            convention = self.rng.choice(["standard", "modified"])
            self.rrrgen("new", name, "--joints", joints, "--convention", convention, "--force")
            if self.rng.random() < 0.5:
                text = Path(file).read_text(encoding="utf-8")
                Path(file).write_text(re.sub(r"\bq([1-7])\b", r"Turn_\1", text), encoding="utf-8")
        elif source == "bundled":
            source = self.rng.choice(BUNDLED)
            self.rrrgen("new", name, "--from", source, "--force")
        elif source == "written":
            Path(file).write_text(write_rows(self.rng, name, joints), encoding="utf-8")
        else:
            write, suffix = {"urdf": (write_urdf, ".urdf"), "mjcf": (write_mjcf, ".xml")}[source]
            Path(f"source{suffix}").write_text(write(self.rng, name, joints), encoding="utf-8")
            convention = self.rng.choice(["standard", "modified"])
            self.rrrgen("import", f"source{suffix}", "-o", file, "--force", "--convention", convention)
        import rrrgen

        self.n = rrrgen.load_spec(file).n
        self.tried.append(f"{name} ({source}, {self.n} joints)")
        return file

    def generate(self, file: str) -> None:
        """Emit code, build it with every warning an error, run its self-tests."""
        words = [word for word in WITH if self.rng.random() < 0.25]
        real = self.rng.choice(["double", "double", "float"])
        options = ["--with", ",".join(words)] if words else []
        self.tried.append(f"generate[{','.join(words)}{',float' if real == 'float' else ''}]")
        self.rrrgen("generate", file, "-o", "code", "--real", real, "-j", "1", "--no-casadi-files", *options)
        code = Path("code")
        compiler = self.rng.choice([tool for tool in ("gcc", "clang") if shutil.which(tool)])
        self.build(code, compiler, self.rng.choice(["c99", "c11", "gnu17"]))
        for header in code.glob("*.hpp"):
            unit = Path("unit.cpp")
            unit.write_text(f'#include "{header.name}"\nint main() {{ return 0; }}\n', encoding="utf-8")
            tool = {"gcc": "g++", "clang": "clang++"}[compiler]
            self.program(tool, "-std=c++17", *GCC, "-fsyntax-only", f"-I{code}", unit)
        for crate in code.glob("**/Cargo.toml"):
            if shutil.which("cargo"):
                target = str(self.folder / "crate")
                self.program("cargo", "build", "-q", "--offline", "--manifest-path", crate, CARGO_TARGET_DIR=target,
                             RUSTFLAGS="-D warnings")  # fmt: skip
        for module in code.glob("**/*.mjs"):
            if shutil.which("node"):
                load = f"import * as model from {json.dumps(str(module.resolve()))}"
                self.program("node", "--input-type=module", "-e", load)
        if self.rng.random() < 0.3:  # it derives everything again, a third of the time of this step
            words = ["--real", real, "-j", "1", "--no-casadi-files", "--check", *options]
            self.rrrgen("generate", file, "-o", "code", *words)

    def build(self, code: Path, compiler: str, standard: str) -> None:
        """Build every self-test in a folder of C, and run it."""
        tests = sorted(code.glob("*_selftest.c"))
        if not tests:
            raise Fault(f"no self-test in {code}: {sorted(path.name for path in code.iterdir())}")
        sources = [path for path in sorted(code.glob("*.c")) if path not in tests]
        for test in tests:
            self.program(compiler, f"-std={standard}", *GCC, f"-I{code}", *sources, test, "-o", "selftest", "-lm")
            self.program(self.folder / "selftest")

    def verify(self, file: str) -> None:
        """Compare with independent dynamics, and solve for one pose."""
        import numpy as np

        import rrrgen

        backend = self.rng.choice(["c", "c", "numpy"])
        self.tried.append(f"verify[{backend}]")
        self.rrrgen("verify", file, "--samples", "20", "--backend", backend, "--seed", str(self.rng.randint(0, 999)))
        m = rrrgen.compile(file, backend="numpy")
        low, high = (np.nan_to_num(bound, neginf=-2.0, posinf=2.0) for bound in m.limits[:2])
        q = low + (high - low) * np.array([self.rng.uniform(0.1, 0.9) for _ in low])
        T = m.forward_kinematics(q)
        code, _ = self.rrrgen("ik", file, "--pose", " ".join(f"{x:.15g}" for x in T.ravel()), "--json",
                                 "--near", " ".join(f"{x:.15g}" for x in q), allowed=(0, 1, 2, 4))  # fmt: skip
        self.tried.append(f"ik[{code}]")

    def export(self, file: str) -> None:
        """Write files for other programs, read back those that can be read, build what is C, load the wheel."""
        for target in self.rng.sample(TARGETS, 2):
            suffix = {"urdf": ".urdf", "mjcf": ".xml", "par": ".par", "fmu": ".fmu"}.get(target, f"_{target}")
            place = f"out{suffix}"
            code, said = self.rrrgen("export", file, "--to", target, "-o", place, allowed=(0, 3, 4))
            self.tried.append(f"export[{target}{'' if code == 0 else ' refused'}]")
            if code:
                if not said.strip():
                    raise Fault(f"export --to {target} is refused without a word")
                continue
            if target in ("urdf", "mjcf", "par"):
                self.read_back(file, place, target)
            if target == "embedded":
                for source in Path(place).glob("**/*.c"):
                    folders = [f"-I{path}" for path in {header.parent for header in Path(place).glob("**/*.h")}]
                    self.program("gcc", "-std=c99", *GCC, "-fsyntax-only", *folders, source)
            if target == "wheel":
                (wheel,) = [*Path(place).glob("*.whl"), *([Path(place)] if Path(place).is_file() else [])]
                zipfile.ZipFile(wheel).extractall("installed")
                (package,) = [p.parent for p in Path("installed").glob("*/__init__.py")]
                self.program(sys.executable, "-c", f"import {package.name} as r; print(r.gravity(r.Q_MIN * 0))",
                             PYTHONPATH="installed")  # fmt: skip

    def read_back(self, file: str, place: str, target: str) -> None:
        """Import an exported file: the mass matrix, and the motion of the tip, must be those of the robot."""
        import numpy as np

        import rrrgen

        values = ["--angle-tolerance=0"]  # else 1.5708 comes back as a right angle
        if target == "par":
            written = re.sub(r"\(\*.*?\*\)", "", Path(place).read_text(encoding="utf-8"))  # without comments
            values = [
                f"--set={name}={float(value)}"
                for name, value in rrrgen.load_spec(file).parameters.items()
                if re.search(rf"\b{name}\b", written)  # a length that no row of the file uses has no name there
            ]
        code, said = self.rrrgen(
            "import", place, "-o", "back.yaml", "--force", "--name", "back", *values, allowed=(0, 3)
        )
        if code:
            raise Fault(f"what export wrote as {target} is not read: {said}")
        # by the reference of `verify`, for which nothing need be derived
        ours, theirs = (reference_of(rrrgen.load_spec(name)) for name in (file, "back.yaml"))
        if theirs.chain.n != ours.chain.n:
            raise Fault(f"{target}: {ours.chain.n} joints went out, {theirs.chain.n} came back\n{said}")
        q = np.array([[self.rng.uniform(-1, 1) for _ in range(ours.chain.n)] for _ in range(4)])
        if ours.phi.any() and theirs.phi.any():
            M, other = (m.mass_matrix(q) - m.chain.drive_inertia for m in (ours, theirs))  # a URDF has no rotors
            if not np.allclose(M, other, rtol=1e-6, atol=1e-6 * np.abs(M).max()):
                raise Fault(f"{target} and back: the mass matrix differs by {np.abs(M - other).max():.3g}\n{said}")
        moved = [np.linalg.inv(T[0]) @ T for T in (m.forward_kinematics(q) for m in (ours, theirs))]
        if not np.allclose(*moved, atol=1e-6) and "tool" not in said:
            raise Fault(
                f"{target} and back: the tip moves otherwise, by {np.abs(moved[0] - moved[1]).max():.3g}\n{said}"
            )

    def identify(self, file: str) -> None:
        """Excite, simulate and identify; the loop must follow, the truth lie within its deviations."""
        import numpy as np

        import rrrgen

        m = rrrgen.compile(file)
        harmonics, seconds = ("3", "6") if self.n < 4 else ("5", "12")
        bounds = []
        if not np.isfinite(m.limits.velocity).all():  # an MJCF states no speeds
            text = "schema: rrrgen-experiment/1\nexcitation: {limits: {speed: 2}}\n"
            Path("experiment.yaml").write_text(text, encoding="utf-8")
            bounds = ["--experiment", "experiment.yaml"]
        effort = ["--harmonics", harmonics, "--duration", seconds, "--starts", "1"]
        words = ["experiment", "excite", file, *bounds, *effort, "-o", "excitation"]
        code, said = self.rrrgen(*words, allowed=(0, 3))
        if code:
            if "write their angles exactly" not in said or "only to" not in said:  # 1.5708 for a right angle
                raise Fault(f"excite is refused: {said}")
            self.tried.append("excite refused")
            return
        trajectory = "excitation/results/excitation.json"
        g = np.abs(m.gravity(np.array([[self.rng.uniform(-1, 1) for _ in range(m.n)] for _ in range(20)])))
        noise = max(1e-3, 3e-3 * float(g.max()))
        following = ["experiment", "simulate", file, "--trajectory", trajectory, "-o", "experiment"]
        _, said = self.rrrgen(*following, "--torque-noise", f"{noise:.3g}", "--seed", str(self.rng.randint(0, 99)))
        self.tried.append("excite simulate")
        self.must_follow(m, Path("experiment/results/log.csv"), noise, said)
        self.rrrgen("identify", file, "--log", "experiment/results/log.yaml", "-o", "identified")
        self.tried.append("identify")
        found = json.loads(Path("identified/results/identification.json").read_text(encoding="utf-8"))
        truth = dict(zip(m.identification_parameter_names, map(float, m.identification_parameters), strict=True))
        rows = [row for row in found["identified"] if row["unconstrained_std"]]
        z = {
            row["parameter"]: (row["unconstrained"] - value_of(row["parameter"], truth)) / row["unconstrained_std"]
            for row in rows
        }
        rms = math.sqrt(sum(x * x for x in z.values()) / max(1, len(z)))
        self.tried.append(f"z {rms:.1f}/{max(map(abs, z.values()), default=0):.1f}")
        if rms > 2.0 or max(map(abs, z.values()), default=0.0) > 5.0:
            far = {name: f"{x:.1f}" for name, x in z.items() if abs(x) > 3}
            raise Fault(f"the truth lies outside: {rms:.1f} deviations (rms), far are {far}\n{said}")

    def must_follow(self, m: object, log: Path, noise: float, said: str) -> None:
        """A stable loop: the recorded torque is that of the reference motion, the error of the motion is small."""
        import numpy as np

        names = log.read_text(encoding="utf-8").partition("\n")[0].split(",")
        data = np.loadtxt(log, delimiter=",", skiprows=1)
        column = {name: data[:, k] for k, name in enumerate(names)}
        joints = m.joint_names  # type: ignore[attr-defined]
        q, tau, ref = (np.column_stack([column[f"{kind}_{name}"] for name in joints]) for kind in ("q", "tau", "ref"))
        span = np.ptp(ref, axis=0)
        error = np.abs(q - ref)[len(q) // 10 :].max(axis=0)
        # what changes from sample to sample beyond the noise is an oscillation; a motion of some Hz changes hardly
        step = np.std(np.diff(tau[len(tau) // 10 :], axis=0), axis=0)
        size = np.ptp(tau, axis=0) + noise
        self.tried.append(f"error {error.max():.3f}")
        if (error > 0.05 + 0.1 * span).any() or (step > 4 * noise + 0.05 * size).any():
            raise Fault(
                f"the loop does not follow: error {error} of {span}, steps {step} of {size}, noise {noise}\n{said}"
            )


def one(seed: int, folder: Path) -> None:
    """Take one seed through everything; ends this process. Writes what was tried, and the fault, to stranger.txt."""
    os.chdir(folder)
    output = os.open("stranger.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(output, 1)
    os.dup2(output, 2)
    code = take(seed, folder)
    sys.stdout.flush()
    os._exit(code)


def take(seed: int, folder: Path) -> int:
    """Take one seed through everything in the current folder; the exit code."""
    stranger = Stranger(seed, folder)
    from rrrgen.lab.data import figure_style

    warnings.simplefilter("ignore")  # of Python; the commands print their own
    figure_style.PRINT = 60  # figures of a low resolution take a fifth of the time
    if random.Random(f"{seed} draws").random() > 0.25:
        figure_style.save_figure = lambda figure, stem: []
    try:
        file = stranger.make_robot()
        stranger.rrrgen("check", file)
        stranger.rrrgen("show", file, *stranger.rng.choice([(), ("--html", "page.html"), ("--latex", "-f", "gravity")]))
        chance = 0.7 if stranger.n <= 4 else 0.15  # of the laboratory, which takes a minute for seven joints
        for step, share in (
            (stranger.generate, 0.5),
            (stranger.verify, 0.5),
            (stranger.export, 0.6),
            (stranger.identify, chance),
        ):
            if stranger.rng.random() < share:
                step(file)
    except BaseException as fault:
        print(stranger.summary())
        print(str(fault) if isinstance(fault, Fault) else traceback.format_exc())
        return 1
    print(stranger.summary())
    return 0


# -- all of them ----------------------------------------------------------------------------------------------------


def environment(place: Path, packages_of: Path | None) -> Path:
    """Build a wheel of this checkout, install it into a new environment in ``place``; the Python of that environment.

    The packages that it needs are installed too, or taken from the environment of the Python ``packages_of``.
    """
    builder = packages_of or Path(sys.executable)
    wheels = place / "wheels"
    build = [builder, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", wheels, ROOT]
    if subprocess.run([*map(str, build)], check=False).returncode:
        raise SystemExit("the wheel could not be built")
    (wheel,) = wheels.glob("*.whl")
    subprocess.run([sys.executable, "-m", "venv", str(place / "env")], check=True)
    (python,) = [path for path in (place / "env/bin/python", place / "env/Scripts/python.exe") if path.exists()]
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if packages_of is None:
        subprocess.run([*pip, f"{wheel}[identify]", "pytest", "hypothesis"], check=True)
    else:
        subprocess.run([*pip, "--no-deps", str(wheel)], check=True)
        ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
        ours, theirs = (subprocess.check_output([str(p), "-c", ask], text=True).strip() for p in (python, packages_of))
        nested = [line for pth in Path(theirs).glob("*.pth") for line in pth.read_text().splitlines()]
        nested = [line for line in nested if Path(line).is_dir() and Path(line) != ROOT]
        Path(ours, "packages.pth").write_text("\n".join([theirs, *nested]) + "\n", encoding="utf-8")
    ask = "import rrrgen; print(rrrgen.__file__)"
    where = subprocess.check_output([str(python), "-c", ask], text=True, cwd=place)
    if not Path(where.strip()).is_relative_to(place):
        raise SystemExit(f"not the wheel is imported but {where}")
    return python


def pages(python: Path, place: Path, variables: dict[str, str]) -> bool:
    """Run the tutorials and every command of the pages with the wheel; whether all went well."""
    tests = ROOT / "tests/pages"
    pytest = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", "pythonpath=", "-k", "not optimal"]
    commands = [[*pytest, str(tests / "test_tutorials.py")], [str(tests / "every_command.py")]]
    codes = [
        subprocess.run([str(python), *command], cwd=place, env=variables, check=False).returncode
        for command in commands
    ]
    return not any(codes)


def seeds_of(options: argparse.Namespace) -> Iterator[int]:
    """The seeds to try."""
    if options.seed:
        return iter(options.seed)
    first = options.first if options.first is not None else random.SystemRandom().randrange(10**6) * 1000
    return iter(range(first, first + options.seeds))


def main() -> int:
    """Run the strangers; the exit code is 1 if one met a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=12, help="how many")
    parser.add_argument("--first", type=int, help="the first of consecutive seeds; fresh ones if not given")
    parser.add_argument("--seed", type=int, nargs="+", help="these seeds alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--packages-of", type=Path, help="take third-party packages from this Python, install none")
    parser.add_argument("--pages", action="store_true", help="also the tutorials and every command of the pages")
    parser.add_argument("--inside", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        return strangers(seeds_of(options), options.jobs, options.inside)
    start = time.perf_counter()
    os.environ.pop("PYTHONPATH", None)  # which would name this checkout
    place = Path(tempfile.mkdtemp(prefix="stranger-"))
    packages_of = options.packages_of and options.packages_of.absolute()
    python = environment(place, packages_of)
    print(f"wheel installed in {time.perf_counter() - start:.0f} s: {place}", flush=True)
    variables = {**os.environ, "RRRGEN_CACHE": str(place / "cache"), "RRRGEN_CFLAGS": "-O1", "MPLBACKEND": "agg"}
    variables |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [str(python), "-P", str(Path(__file__).resolve()), "--inside", str(place), "--jobs", str(options.jobs)]
    command += ["--seed", *map(str, seeds_of(options))]
    well = not subprocess.run(command, cwd=place, env=variables, check=False).returncode
    well = well and (not options.pages or pages(python, place, variables))
    if well:
        shutil.rmtree(place)
    return 0 if well else 1


def strangers(seeds: Iterator[int], jobs: int, place: Path) -> int:
    """Take seeds through everything, ``jobs`` at a time, in folders of ``place``; 1 if one met a fault."""
    warnings.simplefilter("ignore")
    for name in LIBRARIES.split():
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    context = multiprocessing.get_context("fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn")
    start = time.perf_counter()
    failed: list[int] = []
    times: list[float] = []
    running: dict[int, tuple[BaseProcess, float]] = {}
    while True:
        for seed in itertools.islice(seeds, jobs - len(running)):
            folder = place / str(seed)
            folder.mkdir()
            process = context.Process(target=one, args=(seed, folder))
            process.start()
            running[seed] = (process, time.perf_counter())
        if not running:
            break
        multiprocessing.connection.wait([process.sentinel for process, _ in running.values()], timeout=5.0)
        for seed, (process, begun) in list(running.items()):
            took = time.perf_counter() - begun
            if process.exitcode is None and took > SECONDS:
                process.kill()
                process.join()
            if process.exitcode is None:
                continue
            del running[seed]
            folder = place / str(seed)
            said = (folder / "stranger.txt").read_text(encoding="utf-8", errors="replace")
            first, _, rest = said.partition("\n")
            times.append(took)
            verdict = "FAULT" if process.exitcode else "ok"
            print(f"{len(times):4d}  seed {seed}  {verdict}  {took:5.1f} s, processor {first}", flush=True)
            if process.exitcode:
                failed.append(seed)
                print(f"      {rest.strip()[-3000:]}", flush=True)
                print(f"      kept: {folder}; again: python tests/stranger.py --seed {seed}", flush=True)
            else:
                shutil.rmtree(folder)
    print(f"{len(times)} strangers, {len(failed)} with a fault{': ' if failed else ''}{', '.join(map(str, failed))}; "
          f"{sum(times) / max(1, len(times)):.0f} s each, {time.perf_counter() - start:.0f} s in all")  # fmt: skip
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
