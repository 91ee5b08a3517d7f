"""Spelling suggestions: the allowed word nearest to a misspelt one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping


def did_you_mean(word: str, allowed: Iterable[str], also: Mapping[str, str] | None = None) -> str:
    """The sentence ``did you mean 'x'?`` for the allowed word nearest to ``word``; empty if none is near.

    ``also`` maps synonyms from other tools to allowed words, for example ``twist`` to ``alpha``.
    """
    meant = nearest(word, allowed, also)
    return f"did you mean '{meant}'?" if meant else ""


def nearest(word: str, allowed: Iterable[str], also: Mapping[str, str] | None = None) -> str | None:
    """The allowed word nearest to ``word`` in spelling or by the synonyms ``also``; None if none is near."""
    known = {key.lower(): value for key, value in (also or {}).items()}
    known |= {key.lower(): key for key in allowed}
    close = difflib.get_close_matches(word[:60].lower(), known, n=1, cutoff=0.6)
    return known[close[0]] if close else None
