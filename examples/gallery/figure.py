"""The picture of docs/gallery.md: python examples/gallery/figure.py -o docs/figures

The bundled arms, each in a posture that shows its axes, drawn as lines along their Denavit-Hartenberg parameters.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from matplotlib import pyplot

import rrrgen

ARMS = [
    "planar2r",
    "scara",
    "gantry",
    "rrr",
    "puma560",
    "stanford",
    "ur3e",
    "ur5e",
    "ur10e",
    "ur20",
    "xarm6",
    "piper",
    "vx300s",
    "so101",
    "iiwa14",
    "panda",
    "fr3",
    "gen3",
    "xarm7",
    "openarm",
]  # simple ones first, then by number of joints
COLUMNS = 4


def posture(m: rrrgen.Model) -> np.ndarray:
    """The middle of the range of every joint, (n,), rad or m, bent so that axes in line come apart."""
    low, high = (np.nan_to_num(side, posinf=np.pi, neginf=-np.pi) for side in (m.limits.lower, m.limits.upper))
    return (low + high) / 2 + np.resize([0.15, -0.2, 0.2, 0.1], m.n) * (high - low) / 2


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/gallery"), metavar="DIR")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    rows = math.ceil(len(ARMS) / COLUMNS)
    figure = pyplot.figure(figsize=(3.2 * COLUMNS, 3.2 * rows))
    for number, name in enumerate(ARMS):
        m = rrrgen.compile(name, backend="numpy")
        ax = figure.add_subplot(rows, COLUMNS, number + 1, projection="3d")
        m.plot(posture(m), ax)
        ax.set(xlabel="", ylabel="", zlabel="", title=f"{m.spec.name}, {m.n} joints")
        ax.locator_params(nbins=4)
        ax.tick_params(labelsize=6)
    figure.tight_layout()
    figure.savefig(folder / "gallery.png", dpi=70, metadata={"Software": None})


if __name__ == "__main__":
    main()
