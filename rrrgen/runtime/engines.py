"""The engines that evaluate programs: compiled C, and the reference evaluation with NumPy."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.program import Program, evaluate
from rrrgen.runtime.arguments import prepare

Array = NDArray[Any]

EngineName = Literal["c", "numpy"]
"""The engine of a model: "c", the compiled C code, or "numpy", evaluation in Python."""


SMALLEST_SHARE = 2048
"""Smallest number of states per thread; with fewer, another thread costs more than it gains."""


class Engine(Protocol):
    """Evaluates the programs of one robot in ``dtype``; up to ``threads`` threads share one batch."""

    name: ClassVar[EngineName]
    dtype: np.dtype[Any]
    threads: int

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` (one per input port) and evaluate the program ``name``.

        Returns one array (..., *port.shape) per output, status included. Raises ValueError for wrong shapes, TypeError
        for values that are no real numbers.
        """
        ...

    def prepare(self) -> None:
        """Build what first calls would build one by one; for callers of most functions."""
        ...

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """A function without arguments that reads ``inputs`` and writes ``outputs``; it returns the status or None.

        The arrays hold one state and are dense, of the engine's ``dtype``, and not checked again.
        """
        ...


class NumpyEngine:
    """The reference evaluation with NumPy: slow, but it needs no compiler."""

    name: ClassVar[EngineName] = "numpy"
    dtype: np.dtype[Any] = np.dtype(np.float64)

    def __init__(self, programs: Mapping[str, Program]) -> None:
        self.threads = 1
        self._programs = programs

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` and evaluate the program ``name`` node by node; one array per output."""
        program = self._programs[name]
        _, arrays = prepare(program.function, program.inputs, values, self.dtype)
        return evaluate(program, *arrays)

    def prepare(self) -> None:
        """Nothing: programs are evaluated as they are."""

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """A function that evaluates the program for the state in ``inputs`` and copies the results to ``outputs``."""
        program = self._programs[name]
        status = program.status

        def call() -> int | None:
            results = list(evaluate(program, *inputs))
            code = None if status is None else int(results.pop(status.output))
            for array, result in zip(outputs, results, strict=True):
                array[...] = result
            return code

        return call


class CompiledEngine:
    """Emitted C called through cffi.

    ``functions`` are C functions for one state by program name. ``build_more()`` builds those that are missing there,
    which take as long to compile and are called less often; it is called when one of them is needed.
    ``build_loops(names)`` builds the vectorized loops over states of these programs. A loop is built alone at the first
    batch of its function, since the loops of a whole robot take longer to compile than all the rest, or with all others
    by :meth:`prepare`. cffi releases the global interpreter lock during a call, so threads run in parallel.
    """

    name: ClassVar[EngineName] = "c"

    def __init__(
        self,
        programs: Mapping[str, Program],
        ffi: Any,
        functions: Mapping[str, Any],
        build_more: Callable[[], Mapping[str, Any]],
        build_loops: Callable[[Sequence[str]], Mapping[str, Any]],
        dtype: np.dtype[Any],
    ) -> None:
        self.dtype = dtype
        self.threads = 1
        self._pointer = "double[]" if dtype == np.float64 else "float[]"
        self._ffi, self._functions = ffi, dict(functions)
        self._build_more, self._build_loops = build_more, build_loops
        self._loops: dict[str, Any] = {}
        self._calls = {
            name: CompiledCall(program, ffi.from_buffer, self._function, self._loop, dtype, self._pointer)
            for name, program in programs.items()
        }

    def prepare(self) -> None:
        """Build the loops of all functions at once, which is faster than one by one for more than about ten."""
        missing = [name for name in self._calls if name not in self._loops]
        if missing:
            self._loops |= self._build_loops(missing)

    def _function(self, name: str) -> Any:
        """The C function for one state."""
        if name not in self._functions:
            self._functions |= self._build_more()
        return self._functions[name]

    def _loop(self, name: str) -> Any:
        """The loop over states of one function."""
        if name not in self._loops:
            self._loops |= self._build_loops([name])
        return self._loops[name]

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` and call the C function ``name``, or its loop for a batch; one array per output."""
        return self._calls[name](values, self.threads)

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """The C function with the pointers of the arrays bound to its parameters."""
        pointers = [self._ffi.from_buffer(self._pointer, array) for array in (*inputs, *outputs)]
        return functools.partial(self._function(name), *pointers)


class CompiledCall:
    """One C function and its loop over states; whatever does not depend on the arguments is precomputed."""

    def __init__(
        self,
        program: Program,
        address: Any,
        function: Callable[[str], Any],
        loop: Callable[[str], Any],
        dtype: np.dtype[Any],
        pointer: str,
    ) -> None:
        self._ports, self._dtype, self._find, self._find_loop = program.inputs, dtype, function, loop
        self._shapes = [port.shape for port in program.inputs]
        self._name, self._function = program.name, program.function
        self._inputs = [(len(port.shape), port.size) for port in program.inputs]
        is_status = [program.is_status(k) for k in range(len(program.outputs))]
        codes = np.dtype(np.intc)
        self._outputs = [
            (port.shape, codes if s else dtype) for port, s in zip(program.outputs, is_status, strict=True)
        ]
        status_first = sorted(range(len(is_status)), key=lambda k: not is_status[k])
        self._written = [(k, "int[]" if is_status[k] else pointer) for k in status_first]
        self._status = program.status.output if program.status else None
        self._plain = self._status is None and bool(self._shapes) and all(self._shapes)
        self._alike = len(set(self._shapes)) == 1
        self._address, self._pointer = address, pointer

    def __call__(self, values: Sequence[Any], threads: int = 1) -> Sequence[Array]:
        """Check ``values`` and evaluate the function; one array (..., *port.shape) per output."""
        dense = self._dense(values) if self._plain else None
        address, pointer = self._address, self._pointer
        if dense == 0:
            results = [np.empty(shape, dtype) for shape, dtype in self._outputs]
            self._single(*[address(pointer, array) for array in (*values, *results)])
            return results
        if dense and threads == 1:
            results = [np.empty((dense, *shape), dtype) for shape, dtype in self._outputs]
            arguments: list[Any] = [dense]
            for (_, size), array in zip(self._inputs, values, strict=True):
                arguments.append(address(pointer, array))
                arguments.append(size)
            for array in results:
                arguments.append(address(pointer, array))
            self._loop(*arguments)
            return results
        batch, arrays = prepare(self._function, self._ports, values, self._dtype)
        outputs = [np.empty(batch + shape, dtype) for shape, dtype in self._outputs]
        count = math.prod(batch)
        if not batch:
            self._one_state(arrays, outputs)
        elif threads > 1 and count >= 2 * SMALLEST_SHARE:
            self._share(count, threads, arrays, outputs)
        elif count:
            arguments = [count]
            for (rank, size), array in zip(self._inputs, arrays, strict=True):
                arguments += address(pointer, array), size if array.ndim > rank else 0
            for k, kind in self._written:
                arguments.append(address(kind, outputs[k]))
            self._loop(*arguments)
        return outputs

    @functools.cached_property
    def _single(self) -> Any:
        return self._find(self._name)

    @functools.cached_property
    def _loop(self) -> Any:
        return self._find_loop(self._name)

    def _one_state(self, arrays: Sequence[Array], outputs: Sequence[Array]) -> None:
        """Call the function for one state; scalars are passed by value, and the status is the return value."""
        address, pointer = self._address, self._pointer
        arguments = [address(pointer, a) if a.ndim else a.item() for a in arrays]
        arguments += [address(pointer, out) for k, out in enumerate(outputs) if k != self._status]
        status = self._single(*arguments)
        if self._status is not None:
            outputs[self._status][...] = status

    def _dense(self, values: Sequence[Any]) -> int | None:
        """Recognizes the usual calls, whose arrays need no conversion, copy or broadcast.

        Returns 0 for one state, the number of states for a one-dimensional batch, None for everything else.
        """
        first = values[0]
        if type(first) is not np.ndarray:
            return None
        given, dtype, alike = first.shape, self._dtype, True
        for value in values:
            if type(value) is not np.ndarray or value.dtype is not dtype or not value.flags.carray:
                return None
            if value.shape != given:
                alike = False
        batch = given[: len(given) - len(self._shapes[0])]
        if not (alike and self._alike):
            expected = [batch + shape for shape in self._shapes]
            if [value.shape for value in values] != expected:
                return None
        elif batch + self._shapes[0] != given:
            return None
        if not batch:
            return 0
        return batch[0] or None if len(batch) == 1 else None

    def _share(self, count: int, threads: int, arrays: Sequence[Array], outputs: Sequence[Array]) -> None:
        """Split a batch of ``count`` states between threads, which write disjoint rows of the outputs."""
        shares = min(threads, count // SMALLEST_SHARE)
        bounds = [count * k // shares for k in range(shares + 1)]
        inputs = [
            (array.reshape(count, -1), size) if array.ndim > rank else (array.reshape(1, -1), 0)
            for (rank, size), array in zip(self._inputs, arrays, strict=True)
        ]
        rows = [output.reshape(count, -1) for output in outputs]

        def work(start: int, stop: int) -> None:
            arguments: list[Any] = [stop - start]
            for array, step in inputs:
                arguments += [self._address(self._pointer, array[start:stop] if step else array), step]
            arguments += [self._address(kind, rows[k][start:stop]) for k, kind in self._written]
            self._loop(*arguments)

        with ThreadPoolExecutor(shares) as pool:
            list(pool.map(work, bounds[:-1], bounds[1:]))
