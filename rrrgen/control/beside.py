"""C files of controllers that are written from templates, beside the functions printed from programs; self-tests."""

from __future__ import annotations

from collections.abc import Iterable

from rrrgen.backends import Real
from rrrgen.backends.c.trigonometry import Trig, sincos_strategy
from rrrgen.backends.interface import Check
from rrrgen.control.differential_ik import differential_ik_files
from rrrgen.control.fourier_series import fourier_series_files
from rrrgen.resources import render


def files_beside(robot: str, n: int, real: Real, groups: Iterable[str], trig: Trig = "inline") -> dict[str, str]:
    """Headers and sources, name -> text, that belong to the emitted ``groups`` "control" and "trajectory"."""
    wanted, files = set(groups), dict[str, str]()
    if "control" in wanted:
        files |= differential_ik_files(robot, n, real)
    if "trajectory" in wanted:
        files |= fourier_series_files(robot, n, real, sincos_strategy(trig))
    return files


def checks_beside(robot: str, groups: Iterable[str]) -> tuple[Check, ...]:
    """Self-tests of the C functions of :func:`files_beside`, for the emitted ``groups``."""
    brought = {"control": "differential_ik", "trajectory": "fourier"}
    names = [name for group, name in brought.items() if group in set(groups)]
    return tuple(
        Check(name, f"{robot}_{name}.h", render(f"c/{name}_selftest.c.j2", p=robot, M=robot.upper()), digested=True)
        for name in names
    )
