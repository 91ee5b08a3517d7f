"""Controllers of the reference robot."""

from __future__ import annotations

Ts = 1e-3
