"""Fast calls for control loops: buffers are allocated once, and a call neither checks nor allocates anything."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.program import Program
from rrrgen.runtime.engines import Engine

Array = NDArray[Any]


class BoundFunction:
    """One function of a model with preallocated input and output arrays.

    Write the state into ``inputs`` (``f.inputs["q"][:] = q``), call ``f()``, and read the result, which is always the
    same array. ``run`` is the bare call for the tightest loops; it returns the status (0 or 1) of a function that can
    fail, else None.

    Args:
        program: the function with its input and output ports.
        engine: evaluates it.
        parameters: values of input ports by name, copied into ``inputs``; the other inputs start at zero.
    """

    __slots__ = ("_failure", "_result", "inputs", "name", "outputs", "run")

    def __init__(self, program: Program, engine: Engine, parameters: Mapping[str, Array]) -> None:
        self.name = program.name
        inputs = {
            port.name: np.array(parameters.get(port.name, np.zeros(port.shape)), dtype=engine.dtype)
            for port in program.inputs
        }
        outputs = {port.name: np.zeros(port.shape, dtype=engine.dtype) for port in program.data_outputs}
        self.run: Callable[[], Any] = engine.bind(program.name, list(inputs.values()), list(outputs.values()))
        self._failure = program.status.message if program.status else ""
        self._result = next(iter(outputs.values()))
        self.inputs: Mapping[str, Array] = MappingProxyType(inputs)  # read-only: a replaced array would not be used
        self.outputs: Mapping[str, Array] = MappingProxyType(outputs)

    def __repr__(self) -> str:
        taken, given = (
            ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
            for arrays in (self.inputs, self.outputs)
        )
        return f"<bound {self.name}: {taken} -> {given}>"

    def __call__(self, *values: Any) -> Array:
        """Evaluate the function and return its first output array.

        ``values``, if any, are first copied into the inputs, in their order. Raises numpy.linalg.LinAlgError if the
        status is not 0.
        """
        if values:
            for array, value in zip(self.inputs.values(), values, strict=False):
                array[...] = value
        if self.run():
            raise np.linalg.LinAlgError(f"{self.name}: {self._failure}")
        return self._result
