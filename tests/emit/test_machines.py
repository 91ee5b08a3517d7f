"""The emitted self-test on other processors: it passes, and in double the bits of the results are the same on all."""

from __future__ import annotations

import pytest

from bench.cortex_m import measured
from bench.machines import MACHINES, digest, executed
from emit.targets.rrr_library import STRICT, run
from pipeline.optimized import bundled
from rrrgen.emit.package import emit

CROSS = ("aarch64", "armhf", "s390x", "cortex-m4f")
"""Under QEMU, by compilers of Debian; ``make machines`` runs the Cortex-M7 and WebAssembly too, with all robots."""


@pytest.fixture(scope="module")
def emitted(tmp_path_factory):
    """Real type -> folder and C files of a small robot, and the digest of its results on this machine."""
    found = {}
    for real in ("double", "float"):
        folder = tmp_path_factory.mktemp(real)
        files = {name: text for name, text in emit(bundled("planar2r"), real).items() if "/" not in name}
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = sorted(name for name in files if name.endswith(".c"))
        run("gcc", "-std=c99", "-O0", *sources, "-lm", "-o", "here", cwd=folder)
        found[real] = folder, sources, digest(run(folder / "here"))
    return found


@pytest.mark.parametrize("name", CROSS)
def test_the_self_test_passes_with_the_same_bits(name, emitted):
    """Single precision where there is no other unit: there -fshort-enums and warnings as errors."""
    machine = MACHINES[name]
    if machine.missing:
        pytest.skip(f"needs {', '.join(machine.missing)}")
    folder, sources, bits = emitted["float" if name == "cortex-m4f" else "double"]
    assert len(bits) == 16
    assert executed(machine, folder, sources, STRICT) == (True, bits)


def test_the_control_loop_on_a_microcontroller(tmp_path):
    """It follows its reference, the observer sees nothing where nothing touches the arm, and the counts repeat."""
    missing = MACHINES["cortex-m4f"].missing
    if missing:
        pytest.skip(f"needs {', '.join(missing)}")
    loop = measured("planar2r", tmp_path)
    assert loop.passed
    assert loop.error < 2e-4  # rad; of semi-implicit Euler with the period of the loop
    assert loop.external < 0.02  # N m
    assert 1300 < loop.instructions < 1900
    assert 150 < loop.stack < 600
