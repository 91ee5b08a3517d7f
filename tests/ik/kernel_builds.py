"""Kernels of the inverse kinematics compiled alone, with the settings of a robot, and called from Python."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np

from rrrgen.emit.c.ik.kernels import NEEDS, reopening, settings
from rrrgen.emit.c.ik.mechanisms import mechanism_settings
from rrrgen.emit.c.language import Dialect
from rrrgen.ik.classify import plan
from rrrgen.ik.result_layout import STATUS_TEXTS, most_rows, opens, parts_of, reasons_of

FOLDER = Path(__file__).resolve().parents[2] / "templates" / "c" / "ik"
KERNELS = sorted(path.name for path in FOLDER.glob("*.c"))
ELIMINATION = {"general6r.c", "candidates6r.c", "aspect.c", "trig_roots.c"}


COUPLED = {"coupling.c", "coupled.c"}
OF_MECHANISMS = {*COUPLED, "order.c", "refine.c", "finish.c", "descend.c", "solve.c", "batch.c", "closest.c", "texts.c"}


def settings_header(spec, real: str = "double") -> str:
    """The text of settings.h for one robot: options as 0 or 1, words as macros; of a mechanism, those of its q."""
    planned, dialect = plan(spec), Dialect("robot", real)
    found = replace(planned, coupling=None)
    parts = parts_of(found)
    may_open = [opens(part) for part in parts]
    chosen = settings(
        found,
        dialect,
        needs=frozenset(NEEDS),
        opens=may_open,
        rows=most_rows(found),
        reasons=reasons_of(found),
        texts=STATUS_TEXTS,
    )
    chosen = reopening(chosen, "robot_ik", "branches", may_open[0] or [(0, 1)])
    if planned.coupling is not None:
        chosen = mechanism_settings(chosen, planned, planned.coupling, dialect)
    lines = ["#ifdef __cplusplus", "#define ROBOT_RESTRICT", "#else", "#define ROBOT_RESTRICT restrict", "#endif"]
    lines += [f"typedef {real} robot_real;", *(f"#define {name} {int(on)}" for name, on in chosen.options.items())]
    for name, text in chosen.words.items():
        if name not in ("LOCAL", "LOCAL_INLINE"):
            text = text.replace("robot_ik_chain_", "chain_").replace("robot_ik_", "ik_")
            lines.append(f"#define {name} {text}".replace("\n", " "))
    return "\n".join(lines) + "\n"


def prepare(folder: Path, spec, real: str = "double") -> list[str]:
    """Copy the kernels beside their settings; the files that this robot uses, without the chain of a mechanism."""
    for path in FOLDER.glob("*.[ch]"):
        shutil.copy(path, folder)
    (folder / "settings.h").write_text(settings_header(spec, real))
    found = plan(spec)
    if found.coupling is not None:
        return [name for name in KERNELS if name in OF_MECHANISMS]
    used = [name for name in KERNELS if name not in COUPLED and (found.general or name not in ELIMINATION)]
    used = [name for name in used if found.nominal_first or name != "nominal.c"]
    return [name for name in used if name not in ("open.c", "reopen.c") or any(map(opens, parts_of(found)))]


def build(folder: Path, names: list[str], extra: str = "") -> ctypes.CDLL:
    """The kernels ``names`` and the C text ``extra`` as a library."""
    (folder / "extra.c").write_text('#include "kernel.h"\n' + extra)
    files = [*names, "extra.c"]
    command = ["cc", "-std=c99", "-O0", "-shared", "-fPIC", "-o", "kernels.so", *files, "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return ctypes.CDLL(str(folder / "kernels.so"))


def pointer(array: np.ndarray):
    """An array as an argument."""
    return ctypes.c_void_p(array.ctypes.data)


def table_of(name: str, kernel: str) -> np.ndarray:
    """The numbers of a constant table of a kernel."""
    text = (FOLDER / kernel).read_text(encoding="utf-8")
    body = re.search(rf"\b{name}(?:\[\d+\])+ = (\{{.*?\}});", text, re.DOTALL)[1]
    return np.array([float(x) for x in re.findall(r"-?\d[\d.e+-]*", body)])
