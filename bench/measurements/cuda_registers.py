"""Registers, stack and spills of the CUDA kernels of a robot, and the time that NVRTC takes; needs no GPU.

    python -m bench.measurements.cuda_registers rrr panda --architecture sm_90

NVRTC is the wheel nvidia-cuda-nvrtc-cu12.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import re
import time
from pathlib import Path
from typing import NamedTuple

import click

from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec


class Kernel(NamedTuple):
    """What the assembler reports of a kernel: registers of a thread, bytes of its stack, bytes of spills."""

    registers: int
    stack: int
    spills: int


def nvrtc() -> ctypes.CDLL:
    """NVIDIA's run-time compiler from its wheel; raises ImportError without it."""
    found = importlib.util.find_spec("nvidia.cuda_nvrtc")
    for folder in (found.submodule_search_locations or ()) if found else ():
        for library in sorted(Path(folder).glob("lib/libnvrtc.so.*")):
            return ctypes.CDLL(str(library))
    raise ImportError("nvidia-cuda-nvrtc-cu12 is not installed")


def compiled(source: str, architecture: str = "sm_90") -> dict[str, Kernel]:
    """Compile CUDA C++; returns the kernels by name, raises ValueError with the compiler's log if it fails."""
    library, program = nvrtc(), ctypes.c_void_p()
    library.nvrtcCreateProgram(ctypes.byref(program), source.encode(), b"model.cu", 0, None, None)
    options = [f"--gpu-architecture={architecture}".encode(), b"--ptxas-options=-v"]
    failed = library.nvrtcCompileProgram(program, len(options), (ctypes.c_char_p * len(options))(*options))
    size = ctypes.c_size_t()
    library.nvrtcGetProgramLogSize(program, ctypes.byref(size))
    text = ctypes.create_string_buffer(size.value)
    library.nvrtcGetProgramLog(program, text)
    library.nvrtcDestroyProgram(ctypes.byref(program))
    log = text.value.decode()
    if failed:
        raise ValueError(log)
    parts = re.split(r"Compiling entry function '(\w+)'", log)[1:]
    return {name: _kernel(report) for name, report in zip(parts[::2], parts[1::2], strict=True)}


def _kernel(report: str) -> Kernel:
    def number(pattern: str) -> int:
        match = re.search(pattern, report)
        if match is None:
            raise ValueError(report)
        return int(match.group(1))

    spills = number(r"(\d+) bytes spill stores") + number(r"(\d+) bytes spill loads")
    return Kernel(number(r"Used (\d+) registers"), number(r"(\d+) bytes stack frame"), spills)


def main() -> None:
    """Print a table for each robot and precision."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="+")
    parser.add_argument("--architecture", default="sm_90")
    arguments = parser.parse_args()
    for robot in arguments.robots:
        spec = load_spec(robot)
        for real in ("float", "double"):
            (source,) = export_robot(spec, "cuda", options=ExportOptions(real=real)).files.values()
            start = time.perf_counter()
            kernels = compiled(str(source), arguments.architecture)
            click.echo(f"{robot}, {real}: {len(kernels)} kernels in {time.perf_counter() - start:.1f} s")
            for name, kernel in sorted(kernels.items()):
                click.echo(
                    f"  {name:56} {kernel.registers:3} registers {kernel.stack:5} B stack {kernel.spills:5} B spills"
                )


if __name__ == "__main__":
    main()
