"""All C that the pages print compiles without a warning, by gcc, the clang at hand and the newest one at hand."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from pages.test_pages import PAGES, ROOT, blocks
from rrrgen.cli.main import cli
from rrrgen.lab.contact import contact_header

WARNINGS = ["-Wall", "-Wextra", "-Werror"]
C, CXX = ["-std=c99", *WARNINGS], ["-x", "c++", "-std=c++17", *WARNINGS]

RRR = "rrr_real q[3], dq[3], ddq[3], q_d[3], dq_d[3], ddq_d[3], tau[3];\n"
AROUND = {
    ("docs/first-model.md", "#include <math.h>"): ("arm", "", ""),
    ("docs/index.md", "#include"): ("arm", "double q[3], dq[3], ddq[3], tau[3];", ""),
    ("docs/quick-start.md", "#include"): ("elbow3", "", ""),
    ("README.md", "#include"): ("ur5", "", "(void)g;"),
    ("docs/control.md", "rrr_nominal"): ("rrr", f"{RRR} rrr_real beta[15], com[3], inertia[9], loaded[15];", ""),
    ("docs/control.md", "rrr_computed"): (
        "rrr",
        f"{RRR} rrr_real kp[3], kd[3], ki[3], z[3], beta[15], friction[9], width[3], tau_max[3], z_next[3];",
        "",
    ),
    ("docs/control.md", "if (rrr_computed"): (
        "rrr",
        f"{RRR} rrr_real kp[3], kd[3], ki[3], z[3], beta[15], friction[9], width[3], tau_max[3], z_next[3];"
        "rrr_real tau_last[3];",
        "",
    ),
    ("docs/control.md", "rrr_jacobian"): (
        "rrr",
        f"{RRR} rrr_real dq_last[3], J[18], V[6], weight[6], dq_ref[3], q_min[3], q_max[3], dq_max[3], ddq_max[3];",
        "",
    ),
    ("docs/contact.md", "#include"): ("rrr", "rrr_real r[3];", ""),
    ("docs/control.md", "static rrr_fourier"): ("rrr", f"{RRR} double t;", ""),
    ("docs/control.md", "rrr_tool"): ("rrr", RRR, ""),
    ("docs/control.md", "static const rrr_real tau_max"): ("rrr", "", "(void)tau_max; (void)names;"),
    ("docs/controller.md", "rrr_controller_params"): (
        "rrr",
        "void read_arm(double *, double *), next_reference(double *, double *, double *);"
        "void write_arm(const double *, int), report(const char *);",
        "",
    ),
    ("docs/generated-code.md", "const auto"): (
        "rrr",
        "std::array<double, 3> q, dq, tau; std::array<double, 15> beta;",
        "(void)T; (void)J;",
    ),
    ("docs/online-estimation.md", "rrr_kalman"): (
        "rrr",
        f"{RRR} rrr_real x[9], encoder[3], q_r[3], dq_r[3], ddq_r[3], x_next[9], innovation[3];"
        "rrr_real friction[99], tau_f[3], error[3]; rrr_rls_state estimator;",
        "",
    ),
    ("docs/path-timing.md", "static panda"): (
        "panda",
        "panda_real s[1000], q[7000], q_s[7000], q_ss[7000], friction[21], beta[64], now, q_d[7], dq_d[7], ddq_d[7];"
        "int status;",
        "(void)shares;",
    ),
    ("docs/vibration.md", "#include"): ("vibration", "double reference, u;", ""),
}
"""By page and beginning of a block: the robot whose code it calls, the variables of its reader, and what ends it."""


def printed() -> list[tuple[str, str, str]]:
    """Every block of C and C++ on the pages: (page, language, text)."""
    found = []
    for page in PAGES:
        for match in re.finditer(r"^```(c|cpp|c\+\+|C)\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M):
            found.append((str(page.relative_to(ROOT)), match[1], match[2]))
    return found


def compilers(language: str) -> list[list[str]]:
    names = ["g++", "clang++"] if language == "cpp" else ["gcc", "clang"]
    found = [[name] for name in names if shutil.which(name)]
    if find_spec("ziglang") is not None:
        found.append([sys.executable, "-m", "ziglang", "c++" if language == "cpp" else "cc"])
    return found


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """The emitted code of every robot whose functions the blocks call."""
    root = tmp_path_factory.mktemp("printed")
    (root / "tuning.json").write_text(json.dumps({"var_eta": [1e-10] * 3, "var_xi": [400.0] * 3}), encoding="utf-8")
    extra = ["--tuning", root / "tuning.json", "--rate", 1000, "--friction", "neural", "--estimator", "rls"]
    robots = {
        "arm": ["generate", robot_of("docs/first-model.md", root)],
        "elbow3": ["generate", robot_of("docs/quick-start.md", root)],
        "ur5": ["generate", "ur5"],
        "rrr": ["generate", "rrr", "--with", "control,controller,cpp,observer,points,trajectory", *extra],
        "panda": ["generate", "panda", "--with", "timing"],
    }
    for name, words in robots.items():
        call(*words, "--no-casadi-files", "-o", root / name)
    call("response", "vibration", "--mode", "28:0.1", "--mode", "96:0.02", "--rate", 1000, "-o", root / "run")
    (root / "vibration").mkdir()
    for path in (root / "run").rglob("vibration_*.[hc]"):
        shutil.copy(path, root / "vibration")
    levels = SimpleNamespace(levels=[1.0] * 3, change_levels=[0.1] * 3)
    found = SimpleNamespace(thresholds=levels, covariance=SimpleNamespace(matrix=np.eye(3)), gain=50.0, period=1e-3)
    (root / "rrr" / "rrr_contact.h").write_text(contact_header("rrr", found), encoding="utf-8")
    return root


def call(*words: object) -> None:
    done = CliRunner().invoke(cli, [str(word) for word in words])
    assert done.exit_code == 0, (words, done.output, done.exception)


def robot_of(page: str, folder: Path) -> Path:
    """The robot file that a page prints."""
    (block,) = blocks((ROOT / page).read_text(encoding="utf-8"), "yaml")
    (folder / f"{Path(page).stem}.yaml").write_text(block, encoding="utf-8")
    return folder / f"{Path(page).stem}.yaml"


@pytest.mark.parametrize(("page", "language", "block"), printed(), ids=[f"{p}:{b[:24]}" for p, _, b in printed()])
def test_it_compiles_without_a_warning(page, language, block, folders):
    keys = [key for key in AROUND if key[0] == page and block.startswith(key[1])]
    assert len(keys) == 1, "a new block needs its surroundings"
    robot, variables, end = AROUND[keys[0]]
    folder = folders / robot
    included = re.findall(r"^#include.*\n", block, re.M)
    if "int main" not in block:
        headers = sorted(path.name for path in folder.glob("*.hpp" if language == "cpp" else "*.h"))
        headers = [name for name in headers if "any_gravity" not in name]
        text = "".join(f'#include "{name}"\n' for name in headers)
        text = text if language == "cpp" else f"#include <string.h>\n{text}"
        body = re.sub(r"^(#include|Eigen::).*\n", "", block, flags=re.M)  # Eigen is an option of the header
        text = f"{text}{variables}\nvoid fragment(void);\nvoid fragment(void)\n{{\n{body}{end}\n}}\n"
        for line in included:
            assert line.split('"')[1] in headers, line
    else:
        text = block
    check(text, language, folder)


@pytest.mark.parametrize("name", ["control_loop/loop.c"])
def test_the_c_of_the_examples_compiles_without_a_warning(name, folders):
    check((ROOT / "examples" / name).read_text(encoding="utf-8"), "c", folders / "rrr")


def check(text: str, language: str, folder: Path) -> None:
    """Compile a text in the folder of emitted code by every compiler at hand; a warning fails the test."""
    source = folder / ("block.cpp" if language == "cpp" else "block.c")
    source.write_text(text, encoding="utf-8")
    for compiler in compilers(language):
        flags = CXX if language == "cpp" else C
        done = subprocess.run(
            [*compiler, *flags, "-O1", "-I.", "-c", source.name, "-o", "block.o"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{' '.join(compiler)}\n{done.stderr}"
