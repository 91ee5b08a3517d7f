"""C files of controllers that are written from templates, beside the functions printed from programs; self-tests."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rrrgen.base.templates import render
from rrrgen.emit import Real
from rrrgen.emit.c.ik.files import tool_solver_check, tool_solver_files
from rrrgen.emit.c.language import Trig, sincos_strategy
from rrrgen.emit.interface import SelfTestCheck

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec


def files_beside(spec: RobotSpec, real: Real, groups: Iterable[str], trig: Trig = "inline") -> dict[str, str]:
    """Headers and sources, name -> text, that belong to the emitted ``groups`` "control", "points" and "trajectory"."""
    wanted, files = set(groups), dict[str, str]()
    if "control" in wanted:
        from rrrgen.emit.controller.differential_ik import differential_ik_files

        files |= differential_ik_files(spec.name, spec.n, real)
    if "trajectory" in wanted:
        from rrrgen.emit.controller.fourier_series import fourier_series_files

        files |= fourier_series_files(spec.name, spec.n, real, sincos_strategy(trig))
    if "points" in wanted:
        files |= tool_solver_files(spec, real)
    return files


def checks_beside(spec: RobotSpec, groups: Iterable[str]) -> tuple[SelfTestCheck, ...]:
    """Self-tests of the C functions of :func:`files_beside`, for the emitted ``groups``."""
    brought = {"control": "differential_ik", "trajectory": "fourier"}
    wanted, robot = set(groups), spec.name
    checks = [
        SelfTestCheck(
            name, f"{robot}_{name}.h", render(f"c/{name}_selftest.c.j2", p=robot, M=robot.upper()), digested=True
        )
        for group, name in brought.items()
        if group in wanted
    ]
    tool = tool_solver_check(spec) if "points" in wanted else None
    return (*checks, *([] if tool is None else [tool]))
