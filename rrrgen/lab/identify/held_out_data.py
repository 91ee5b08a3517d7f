"""Split of a recording into a fitted and a held-out part, with a guard band between them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError


@dataclass(frozen=True)
class Split:
    """Rule that decides which points in time of a recording are fitted; the others are held out and scored.

    ``kind`` "none" fits all; "first" fits the first share ``value`` of the duration; "blocks" fits every other block of
    ``value`` seconds, beginning with the first; "fold" fits all but part ``value`` (from 1) of ``parts`` equal parts.
    Points in time closer than ``guard`` (s) to a border belong to neither part,
    because the filters mix samples from both sides of it.
    """

    kind: Literal["none", "first", "blocks", "fold"] = "none"
    value: float = 0.0
    guard: float = 0.0
    parts: int = 0

    @classmethod
    def parse(cls, text: str) -> Split:
        """Parse ``none``, ``first:0.6``, ``blocks:0.5`` or ``fold:2/5``; raises :class:`InputError` for other texts."""
        fold = re.fullmatch(r"\s*fold\s*:\s*(\d{1,4})\s*/\s*(\d{1,4})\s*", text)
        if fold:
            part, parts = int(fold.group(1)), int(fold.group(2))
            if not (parts >= 2 and 1 <= part <= parts):
                raise InputError(f"part {part} of {parts}: write fold:2/5 to hold out the second of five parts")
            return cls("fold", float(part), parts=parts)
        match = re.fullmatch(r"\s*(none|first|blocks)\s*(?::\s*([0-9.eE+-]+)\s*)?", text)
        try:
            value = float(match.group(2) or 0.0) if match else 0.0
        except ValueError:
            match = None
        if match is None or (match.group(1) == "none") != (match.group(2) is None):
            raise InputError(f"'{text}' is not a way to split the data; write none, first:0.6, blocks:0.5 or fold:2/5")
        kind: Any = match.group(1)
        if kind == "first" and not 0.0 < value < 1.0:
            raise InputError(f"the first {value:g} of the data; the share must lie between 0 and 1")
        if kind == "blocks" and not value > 0.0:
            raise InputError(f"blocks of {value:g} s; their length must be positive")
        return cls(kind, value)

    def with_guard(self, guard: float) -> Split:
        """A copy with a guard band of ``guard`` seconds on both sides of every border.

        Raises :class:`InputError` if nothing would be left between two guard bands.
        """
        if self.kind == "none":
            return self
        if self.kind == "blocks" and self.value <= 2.0 * guard:
            raise InputError(
                f"blocks of {self.value:g} s leave nothing between guard bands of {guard:.3g} s at either end, "
                "which the filters need; make the blocks longer, or filter less"
            )
        return replace(self, guard=guard)

    def is_fitted(self, t: Array, start: float, duration: float) -> NDArray[np.bool_]:
        """Mask (N,) of the fitted points in time among ``t`` (N,), s.

        The recording begins at ``start`` (s) and lasts ``duration`` (s).
        """
        return self._first(t - start, duration) & ~self.between(t, start, duration)

    def is_scored(self, t: Array, start: float, duration: float) -> NDArray[np.bool_]:
        """Mask (N,) of the held-out points in time among ``t`` (N,), s.

        The recording begins at ``start`` (s) and lasts ``duration`` (s).
        """
        return ~self._first(t - start, duration) & ~self.between(t, start, duration)

    def between(self, t: Array, start: float, duration: float) -> NDArray[np.bool_]:
        """Mask (N,) of the times among ``t`` (N,), s, that lie in a guard band.

        The recording begins at ``start`` (s) and lasts ``duration`` (s).
        """
        since = np.asarray(t) - start
        if self.kind == "none" or self.guard == 0.0:
            return np.zeros(len(since), bool)
        if self.kind == "first":
            return np.asarray(np.abs(since - self.value * duration) < self.guard)
        if self.kind == "fold":
            part = duration / self.parts
            borders = [k * part for k in (self.value - 1, self.value) if 0 < k < self.parts]
            return np.asarray(np.any([np.abs(since - border) < self.guard for border in borders], axis=0))
        border = np.round(since / self.value)  # the nearest one; neither end of the recording is a border
        near = np.abs(since - border * self.value) < self.guard
        return np.asarray(near & (border > 0) & (border * self.value < duration))

    def _first(self, since: Array, duration: float) -> NDArray[np.bool_]:
        """Mask (N,) of the times ``since`` (N,), s after the start, on the fitted side, guard bands disregarded."""
        if self.kind == "first":
            return np.asarray(since < self.value * duration)
        if self.kind == "fold":
            part = np.minimum(np.floor(since * self.parts / max(duration, 1e-300)), self.parts - 1)
            return np.asarray(part != self.value - 1)
        if self.kind == "blocks":
            return np.asarray(np.floor(since / self.value) % 2 == 0)
        return np.ones(len(since), bool)

    def __str__(self) -> str:
        text = {
            "none": "fitted and scored on the same data",
            "first": f"fitted on the first {100 * self.value:g} %, scored on the rest",
            "fold": f"fitted without part {self.value:g} of {self.parts}, scored on it",
            "blocks": f"fitted on every other block of {self.value:g} s, scored on the blocks between",
        }[self.kind]
        return f"{text}, without {self.guard:.3g} s on either side of a border" if self.guard else text
