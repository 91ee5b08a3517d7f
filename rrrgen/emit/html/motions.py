"""Motions that the report's interactive view plays, recorded or designed, and figures of run folders."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError

SAMPLES = 2000
"""Largest number of samples of a motion on the page, which interpolates between them: about 100 kB for six joints."""

DIGITS = 5  # decimals of positions (rad, m) and times (s) on the page: 0.01 mm

PIXELS_PER_POINT = 1.45
"""Size of figures on the page: 4/3 is that of print; text of 8 points, the smallest there, has 12 pixels."""

LARGEST_DRAWING = 400_000
"""Size in bytes from which the PNG of a figure is taken instead of its SVG: clouds of points make large drawings."""


@dataclass(frozen=True)
class Motion:
    """A motion to be played: ``name``, instants ``t`` (N,) in s, and joint positions ``q`` (N, n) in rad or m."""

    name: str
    t: Array
    q: Array

    def as_data(self, n: int) -> dict[str, Any]:
        """Convert the motion to data for the page: times from 0 and joint positions, at most ``SAMPLES`` samples.

        Raises InputError if it has no two samples, another number of joints, or times that do not increase.
        """
        if self.q.ndim != 2 or self.q.shape[1] != n or len(self.q) != len(self.t):
            raise InputError(f"the motion '{self.name}' is not one of the {n} joints of this robot")
        if len(self.t) < 2 or not np.all(np.diff(self.t) > 0.0) or not np.all(np.isfinite(self.q)):
            raise InputError(f"the motion '{self.name}' needs two finite samples or more, at times that increase")
        kept = np.unique(np.linspace(0, len(self.t) - 1, min(SAMPLES, len(self.t))).round().astype(int))
        t = np.round(self.t[kept] - self.t[0], DIGITS)
        return {"name": self.name, "t": t.tolist(), "q": np.round(self.q[kept] + 0.0, DIGITS).tolist()}


@dataclass(frozen=True)
class Illustration:
    """A figure on the page: ``caption``, and the whole image as a ``data:`` address, so that nothing is fetched.

    ``width`` is the width in pixels at which its text has the size of the page's notes; None where it is not known.
    """

    caption: str
    address: str
    width: int | None = None


def illustrations(folder: Path) -> list[Illustration]:
    """The figures of the run folder ``folder`` in the order of their names; raises InputError if it has none."""
    drawings = sorted((folder / "figures").glob("*.svg"))
    if not drawings:
        raise InputError(f"{folder} holds no figures: name the folder that a command wrote with -o")
    return [_illustration(folder, drawing) for drawing in drawings]


def _illustration(folder: Path, drawing: Path) -> Illustration:
    pixels = drawing.with_suffix(".png")
    large = drawing.stat().st_size > LARGEST_DRAWING and pixels.exists()
    kind, file = ("image/png", pixels) if large else ("image/svg+xml", drawing)
    content = base64.b64encode(file.read_bytes()).decode("ascii")
    caption = f"{folder.name}: {drawing.stem.replace('_', ' ')}"
    return Illustration(caption, f"data:{kind};base64,{content}", _width(drawing))


def _width(drawing: Path) -> int | None:
    """Width in pixels at which a figure is shown, from the width in points (1/72 inch) that its SVG states."""
    with drawing.open(encoding="utf-8") as text:
        stated = re.search(r'<svg[^>]*\swidth="([\d.]+)pt"', text.read(4000))
    return round(PIXELS_PER_POINT * float(stated[1])) if stated else None
