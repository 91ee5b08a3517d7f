"""Names of local variables: readable, unique within their function, and not reserved by the language."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from rrrgen.program import Port, Program


class Names:
    """Generates the local names of one function, different from those in ``reserved`` and ``taken``."""

    def __init__(self, reserved: frozenset[str], taken: Iterable[str] = ()) -> None:
        self._taken = {*reserved, *taken}
        self._temporaries = 0
        self._serials: dict[str, int] = {}

    def temporary(self) -> str:
        """The next unused name of the sequence t1, t2, ..."""
        while True:
            self._temporaries += 1
            name = f"t{self._temporaries}"
            if name not in self._taken:
                self._taken.add(name)
                return name

    def suggested(self, hint: str) -> str:
        """The name ``hint``, made a valid identifier; a number is appended if it is taken."""
        base = re.sub(r"\W+", "_", hint, flags=re.ASCII).strip("_") or "t"
        if base[0].isdigit():
            base = f"t{base}"
        name = base
        while name in self._taken:
            self._serials[base] = self._serials.get(base, 1) + 1
            name = f"{base}_{self._serials[base]}"
        self._taken.add(name)
        return name


def with_free_ports(program: Program, taken: frozenset[str]) -> Program:
    """The program with an underscore behind those names of inputs and outputs that are in ``taken``.

    For languages in which a variable must not have the name of a keyword, or of a constant of the emitted file.
    """

    def renamed(port: Port) -> Port:
        return replace(port, name=f"{port.name}_") if port.name in taken else port

    return replace(program, inputs=tuple(map(renamed, program.inputs)), outputs=tuple(map(renamed, program.outputs)))
