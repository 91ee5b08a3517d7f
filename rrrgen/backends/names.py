"""Names of local variables: readable, unique in their function, and no words of the language."""

from __future__ import annotations

import re
from collections.abc import Iterable


class Names:
    """Hands out the local names of one function; ``reserved`` and ``taken`` are not among them."""

    def __init__(self, reserved: frozenset[str], taken: Iterable[str] = ()) -> None:
        self._taken = {*reserved, *taken}
        self._temporaries = 0
        self._serials: dict[str, int] = {}

    def temporary(self) -> str:
        """The next of t1, t2, ..."""
        while True:
            self._temporaries += 1
            name = f"t{self._temporaries}"
            if name not in self._taken:
                self._taken.add(name)
                return name

    def suggested(self, hint: str) -> str:
        """A name close to ``hint``; a number is appended where the hint is taken."""
        base = re.sub(r"\W+", "_", hint, flags=re.ASCII).strip("_") or "t"
        if base[0].isdigit():
            base = f"t{base}"
        name = base
        while name in self._taken:
            self._serials[base] = self._serials.get(base, 1) + 1
            name = f"{base}_{self._serials[base]}"
        self._taken.add(name)
        return name
