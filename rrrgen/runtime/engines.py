"""The engines that evaluate the functions of a robot: compiled C, or NumPy as a reference without a compiler."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.program import Program, evaluate
from rrrgen.runtime.arguments import prepare, prepare_one, status_error

Array = NDArray[Any]

EngineName = Literal["c", "numpy"]
"""The engine of a model: "c", the compiled C code, or "numpy", evaluation in Python."""


SMALLEST_SHARE = 2048
"""Smallest number of states per thread; with fewer, another thread costs more than it gains."""


class Engine(Protocol):
    """Interface of an engine, which evaluates the functions ("programs") of one robot.

    ``name`` is "c" or "numpy", ``dtype`` the type of all numbers; up to ``threads`` threads share one batch of states.
    """

    threads: int

    @property
    def name(self) -> EngineName:
        """The kind of engine."""
        ...

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of all numbers."""
        ...

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` (one per input port) and evaluate the program ``name``.

        Returns one array (..., *port.shape) per output, status included. Raises ValueError for wrong shapes, TypeError
        for values that are no real numbers.
        """
        ...

    def prepare(self) -> None:
        """Build at once everything that first calls would build one by one; saves time if most functions are called."""
        ...

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """Bind the program ``name`` to arrays; returns a function without arguments that evaluates it for one state.

        That function reads ``inputs`` and writes ``outputs``; it returns the status, or None if the program cannot
        fail. The arrays must be dense and of the engine's ``dtype``; they are not checked.
        """
        ...


class NumpyEngine:
    """Engine that evaluates programs with NumPy, operation by operation: slow, but it needs no compiler."""

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
        """Do nothing: NumPy evaluates programs without building anything."""

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
    """Engine that calls the emitted C through cffi.

    Nothing is compiled before it is called: who evaluates batches needs no functions of one state, and those of large
    robots take seconds. ``build_functions(names)`` compiles C functions for one state, with all others in the same
    source files, ``build_loops(names)`` vectorized loops over states; both return what they compiled by program name. A
    loop is built alone, at the first batch of its function, because all loops of a robot take longer to compile than
    everything else; :meth:`prepare` builds all. ``address`` is ``from_buffer`` of cffi, which releases the global
    interpreter lock during a call, so that threads run in parallel.
    """

    name: ClassVar[EngineName] = "c"

    def __init__(
        self,
        programs: Mapping[str, Program],
        address: Any,
        build_functions: Callable[[Sequence[str]], Mapping[str, Any]],
        build_loops: Callable[[Sequence[str]], Mapping[str, Any]],
        dtype: np.dtype[Any],
    ) -> None:
        self.dtype = dtype
        self.threads = 1
        self._pointer = "double[]" if dtype == np.float64 else "float[]"
        self._address, self._build_functions, self._build_loops = address, build_functions, build_loops
        self._functions: dict[str, Any] = {}
        self._loops: dict[str, Any] = {}
        self._programs, self._codes = programs, _codes(programs.values())
        codes = list(self._codes.values())
        self._calls = {
            name: CompiledCall(program, address, self._function, self._loop, dtype, self._pointer, codes)
            for name, program in programs.items()
        }

    def prepare(self) -> None:
        """Build everything at once: faster than one by one if more than about ten functions are called."""
        for held, build in (self._functions, self._build_functions), (self._loops, self._build_loops):
            missing = [name for name in self._calls if name not in held]
            if missing:
                held.update(build(missing))

    def _function(self, name: str) -> Any:
        """The C function that evaluates the program ``name`` for one state, compiled if needed."""
        if name not in self._functions:
            self._functions |= self._build_functions([name])
        return self._functions[name]

    def _loop(self, name: str) -> Any:
        """The C function that evaluates the program ``name`` for a batch of states, compiled if needed."""
        if name not in self._loops:
            self._loops |= self._build_loops([name])
        return self._loops[name]

    def call(self, name: str, values: Sequence[Any]) -> Sequence[Array]:
        """Check ``values`` and call the C function ``name``, or its loop for a batch; one array per output."""
        return self._calls[name](values, self.threads)

    def bind(self, name: str, inputs: Sequence[Array], outputs: Sequence[Array]) -> Callable[[], Any]:
        """Bind the C function ``name`` to the memory of the arrays; returns a function without arguments."""
        function, codes = self._function(name), list(self._codes.values())
        arguments = [self._address(self._pointer, array) for array in (*inputs, *outputs)]
        scalars = [(k, array.item) for k, array in enumerate(inputs) if not array.ndim]  # C takes them by value
        renumbered = self._is_renumbered(name)
        if not scalars and not renumbered:
            return functools.partial(function, *arguments)

        def call() -> Any:
            for k, read in scalars:
                arguments[k] = read()
            status = function(*arguments)
            return codes[status] if renumbered else status

        return call

    def _is_renumbered(self, name: str) -> bool:
        """Whether C numbers a failure of the program ``name`` by another number than its code."""
        status = self._programs[name].status
        names = () if status is None else tuple(failure.name for failure in status.failures)
        return any(k != code for k, (failure, code) in enumerate(self._codes.items()) if failure in names)


def _codes(programs: Iterable[Program]) -> dict[str, int]:
    """The codes of all failures by name, after that of success, in the order in which the status in C numbers them."""
    failures = [failure for program in programs if program.status is not None for failure in program.status.failures]
    return {"": 0, **{failure.name: failure.code for failure in failures}}


class CompiledCall:
    """A callable for one C function and its loop over states; all that does not depend on arguments is precomputed."""

    def __init__(
        self,
        program: Program,
        address: Any,
        function: Callable[[str], Any],
        loop: Callable[[str], Any],
        dtype: np.dtype[Any],
        pointer: str,
        codes: Sequence[int] = (0, 1),
    ) -> None:
        self._ports, self._dtype, self._find, self._find_loop = program.inputs, dtype, function, loop
        self._shapes = [port.shape for port in program.inputs]
        self._name, self._function = program.name, program.function
        self._inputs = [(len(port.shape), port.size) for port in program.inputs]
        is_status = [program.is_status(k) for k in range(len(program.outputs))]
        integer = np.dtype(np.intc)
        self._outputs = [
            (port.shape, integer if s else dtype) for port, s in zip(program.outputs, is_status, strict=True)
        ]
        status_first = sorted(range(len(is_status)), key=lambda k: not is_status[k])
        self._written = [(k, "int[]" if is_status[k] else pointer) for k in status_first]
        self._status = program.status.output if program.status else None
        self._codes = codes
        self._plain = self._status is None and bool(self._shapes) and all(self._shapes)
        self._alike = len(set(self._shapes)) == 1
        self._address, self._pointer = address, pointer

    def __call__(self, values: Sequence[Any], threads: int = 1) -> Sequence[Array]:
        """Check ``values`` and evaluate the function; returns one array per output, (..., *shape of the output)."""
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
            outputs[self._status][...] = self._codes[status]

    def _dense(self, values: Sequence[Any]) -> int | None:
        """Number of states of a call whose arrays need no conversion, copy or broadcast; 0 for one state without batch.

        None for every other call, which must be prepared first.
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


# ------------------------------------------------------------------------------------------------------------------
# Fast calls for control loops: buffers are allocated once, and a call neither checks nor allocates anything.
# ------------------------------------------------------------------------------------------------------------------


class BoundFunction:
    """One function of a model with preallocated input and output arrays.

    Write the state into ``inputs`` (``f.inputs["q"][:] = q``), call ``f()``, and read the result, which is always the
    same array. ``run`` is the bare call for the tightest loops; it returns the status of a function that can fail, 0 or
    the code of the failure as in a plain call with ``with_status``, else None.

    Args:
        program: the function with its input and output ports.
        engine: evaluates it.
        parameters: values of input ports by name, copied into ``inputs``; the other inputs start at zero.

    Raises:
        TypeError: a parameter holds no real numbers.
        ValueError: a parameter does not have the shape of its input.
    """

    __slots__ = ("_dtype", "_function", "_places", "_ports", "_result", "_status", "inputs", "name", "outputs", "run")

    def __init__(self, program: Program, engine: Engine, parameters: Mapping[str, Any]) -> None:
        self.name, self._function, self._dtype = program.name, program.function, engine.dtype
        inputs = {port.name: np.zeros(port.shape, dtype=engine.dtype) for port in program.inputs}
        for port in program.inputs:
            if port.name in parameters:  # C reads as many numbers as the input has, whatever the array holds
                inputs[port.name][...] = prepare_one(program.function, port, parameters[port.name], engine.dtype)
        self._ports = program.inputs
        self._places = tuple((array, array.shape) for array in inputs.values())
        outputs = {port.name: np.zeros(port.shape, dtype=engine.dtype) for port in program.data_outputs}
        self.run: Callable[[], Any] = engine.bind(program.name, list(inputs.values()), list(outputs.values()))
        self._status = program.status
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

        ``values``, if any, are first copied into the inputs, in their order; inputs behind the last value keep theirs.
        A value has the shape of its input. Raises TypeError for more values than inputs and for values that are no real
        numbers, ValueError for wrong shapes. If the status is not 0 it raises the error of a plain call: ValueError for
        a refused input, else numpy.linalg.LinAlgError.
        """
        if values:
            places, dtype, dense = self._places, self._dtype, np.ndarray
            if len(values) > len(places):
                raise self._surplus_error(values)
            k = 0
            for value in values:  # zip(.., strict=False) or enumerate would take longer than the checks
                array, shape = places[k]
                if type(value) is not dense or value.dtype is not dtype or value.shape != shape:
                    value = prepare_one(self._function, self._ports[k], value, dtype)
                array[...] = value
                k += 1  # noqa: SIM113 - slower, see above
        if self.run():
            raise self._status_error()
        return self._result

    def _status_error(self) -> Exception:
        """The error of a plain call for these inputs, evaluated again, since calls that succeed keep no status."""
        assert self._status is not None
        return status_error(self.name, self._status, np.asarray(self.run()))

    def _surplus_error(self, values: Sequence[Any]) -> TypeError:
        """The error for more ``values`` than inputs."""
        names = ", ".join(self.inputs)
        return TypeError(f"{self._function} takes at most {len(self.inputs)} values ({names}), got {len(values)}")
