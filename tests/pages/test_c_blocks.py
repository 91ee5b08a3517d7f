"""The C on the pages compiles against what the commands around it write, for a pendulum in place of the arms there.

README and the first tutorial have whole programs, which their own tests run; C++, Rust and MATLAB are compiled with the
tests of these languages.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from pages.test_pages import ROOT, blocks
from rrrgen.cli.main import run

WHOLE = ("quick-start", "first-model")
"""Pages whose C is a program."""

WHAT_THE_PAGES_PRESUPPOSE = """\
#include <string.h>
#define N PENDULUM_N
static pendulum_real q[N], dq[N], ddq[N], tau[N], tau_f[N], q_d[N], dq_d[N], ddq_d[N], q_r[N], dq_r[N], ddq_r[N];
static pendulum_real kp[N], kd[N], ki[N], z[N], z_next[N], width[N], tau_max[N], q_min[N], q_max[N], dq_max[N];
static pendulum_real tau_last[N], ddq_max[N], dq_last[N], dq_ref[N], r[N], innovation[N], encoder[N], error[N];
static pendulum_real beta[PENDULUM_B], loaded[PENDULUM_B], com[3], inertia[9], J[6 * N], V[6], weight[6];
static pendulum_real x[3 * N], x_next[3 * N], friction[7 * N], t, now;
static const pendulum_real *s, *q_s, *q_ss;
static pendulum_rls_state estimator;
static vibration_shaper_real reference, u;
static int status;
void read_arm(double *, double *), next_reference(double *, double *, double *), write_arm(const double *, int);
void report(const char *);
"""


def fragments() -> Iterator[tuple[str, str]]:
    """Page and text of every block of C that is not a program, about the arm called pendulum."""
    for page in sorted(ROOT.glob("docs/*.md")):
        if page.stem not in WHOLE:
            for text in blocks(page.read_text(encoding="utf-8"), "c"):
                text = re.sub(r"\b(?:arm|rrr|panda)(?=_|\.h)", "pendulum", text)
                yield page.stem.replace("-", "_"), re.sub(r"\b(?:RRR|PANDA)_", "PENDULUM_", text)


def written(folder: Path) -> None:
    """What the commands on these pages write, for a pendulum; thresholds of contact come from an experiment."""
    (folder / "tuning.json").write_text(json.dumps({"var_eta": [1e-10], "var_xi": [400.0]}), encoding="utf-8")
    groups = ("--with", "control,controller,observer,points,trajectory,timing", "--no-casadi-files")
    estimation = ("--estimator", "rls", "--torque-noise", "0.1", "--tuning", str(folder / "tuning.json"))
    of_friction = ("--rate", "1000", "--friction", "neural")
    assert run(["generate", "pendulum", "-o", str(folder), *groups, *estimation, *of_friction]) == 0
    modes = ("--mode", "28:0.1", "--mode", "96:0.02", "--rate", "1000")
    assert run(["response", "vibration", *modes, "-o", str(folder / "vibration")]) == 0
    lists = [f"#define PENDULUM_CONTACT_{name} {{1.0}}\n" for name in ("THRESHOLDS", "CHANGE_THRESHOLDS")]
    text = "".join([*lists, "#define PENDULUM_CONTACT_GAIN 50.0\n"])
    (folder / "pendulum_contact.h").write_text(text, encoding="utf-8")


def test_the_c_on_the_pages_compiles(tmp_path: Path) -> None:
    written(tmp_path)
    functions, headers = [], {f'#include "{each.name}"' for each in tmp_path.glob("*.h")}
    for number, (page, text) in enumerate(fragments()):
        headers |= set(re.findall(r"^#include .*", text, re.M))
        body = re.sub(r"^#include .*\n", "", text, flags=re.M)
        functions.append(f"void {page}_{number}(void);\nvoid {page}_{number}(void)\n{{\n{body}}}\n")
    assert len(functions) > 8
    source = "\n".join([*sorted(headers), WHAT_THE_PAGES_PRESUPPOSE, *functions])
    (tmp_path / "pages.c").write_text(source, encoding="utf-8")
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unused")
    places = ("-I", str(tmp_path), "-I", str(tmp_path / "vibration/results"))
    command = ["gcc", "-fsyntax-only", *flags, *places, "pages.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
