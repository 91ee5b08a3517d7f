"""The way from robot file to text where NumPy and cffi cannot be imported, as in a browser: the same files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from rrrgen.emit.c.ik.files import emit
from rrrgen.ik.classify import plan
from rrrgen.robot.file.reader import load_spec

HIDING = '''
import sys
from pathlib import Path
from click.testing import CliRunner

class Hiding:
    """Makes the modules impossible to import."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numpy", "scipy", "cffi", "casadi"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hiding())
from rrrgen.cli.main import cli

folder = Path(sys.argv[1])
for arguments in (
    ["check", "ur5"],
    ["show", "planar2r"],
    ["show", "rrr", "--latex", "-f", "gravity", "-f", "inverse_kinematics"],
    ["show", "ur5", "-f", "inverse_kinematics", "--program"],
    ["generate", "rrr", "-o", str(folder / "rrr"), "-j", "1"],
    ["generate", "pendulum", "-o", str(folder / "pendulum"), "-j", "1",
     "--with", "control,controller,javascript,timing", "--parts", "observer,estimator,kalman"],
):
    result = CliRunner().invoke(cli, arguments)
    print(" ".join(arguments[:2]), result.exit_code, len(result.stdout))
    if result.exception is not None:
        raise result.exception

from rrrgen.emit.c.ik.files import emit
from rrrgen.ik.classify import plan
from rrrgen.ik.interpreter.solve import OK, solve
from rrrgen.robot.file.reader import load_spec

skew = load_spec(folder / "skew.yaml")
for name, text in emit(skew, plan(skew)).files.items():
    (folder / name).write_text(text, encoding="utf-8")

puma = plan(load_spec("puma560"))
T = puma.chain.tip_pose((0.3, -0.4, 0.5, 0.2, 0.7, 0.4))
answer = solve(puma, [x for row in (*T, (0.0, 0.0, 0.0, 1.0)) for x in row])
assert (answer.status, len(answer.rows)) == (OK, 8), answer
assert not {"numpy", "cffi"} & sys.modules.keys()
'''

SKEW = """
schema: rrrgen/1
name: skew
convention: standard
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
""" + "".join(
    f"  - {{type: revolute, alpha: {alpha}, a: {a}, d: {d}, theta: 0}}\n"
    for alpha, a, d in zip((70, 50, 80, 65, 55, 20), (11, 42, 31, 7, 5, 3), (13, 9, 4, 35, 8, 6), strict=True)
)


def test_the_compiler_needs_neither_numpy_nor_cffi(tmp_path):
    (tmp_path / "skew.yaml").write_text(SKEW)
    command = [sys.executable, "-c", HIDING, str(tmp_path)]
    environment = os.environ | {"RRRGEN_CACHE": str(tmp_path / "cache")}  # nothing that was computed with NumPy
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2], env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    committed = Path(__file__).parents[2] / "generated" / "rrr"
    for file in sorted(path for path in (tmp_path / "rrr").rglob("*") if path.is_file()):
        assert file.read_bytes() == (committed / file.relative_to(tmp_path / "rrr")).read_bytes(), file.name
    # a general arm too, whose elimination of variables is chosen numerically
    skew = load_spec(tmp_path / "skew.yaml")
    for name, text in emit(skew, plan(skew)).files.items():
        assert (tmp_path / name).read_text(encoding="utf-8") == text, name
