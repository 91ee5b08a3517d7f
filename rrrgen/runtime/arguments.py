"""Checks the arguments of calls and converts them to dense arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import real_array
from rrrgen.program import REFUSED, Port, Program, Status

Array = NDArray[Any]
Batch = tuple[int, ...]


def prepare(
    function: str, ports: Sequence[Port], values: Sequence[Any], dtype: np.dtype[Any]
) -> tuple[Batch, list[Array]]:
    """Convert the ``values`` of a call of ``function`` to dense, aligned arrays of ``dtype``, and find its batch shape.

    There is one value per input port. It has the shape of its port, with any leading (batch) dimensions, which are
    broadcast against each other; a value without leading dimensions is not copied for every state. Raises TypeError for
    None, for complex, boolean, text, object or masked arrays, ValueError for wrong shapes.
    """
    if any(value is None for value in values):
        missing = [port.name for port, value in zip(ports, values, strict=True) if value is None]
        raise TypeError(f"{function}: {', '.join(missing)} must be given")
    arrays: list[Array] = []
    batches: list[Batch] = []
    for port, value in zip(ports, values, strict=True):
        array = (
            value
            if type(value) is np.ndarray and value.dtype == dtype
            else real_array(f"{function}: {port.name}", value, dtype)
        )
        shape, wanted = array.shape, port.shape
        if shape == wanted:
            batches.append(())
        else:
            split = len(shape) - len(wanted)
            if split < 0 or shape[split:] != wanted:
                raise ValueError(_wrong_shape(function, port, shape))
            batches.append(shape[:split])
        arrays.append(array)
    batch = _common(function, ports, batches)
    for k, array in enumerate(arrays):
        if batches[k] != batch and batches[k]:
            array = np.broadcast_to(array, (*batch, *ports[k].shape))
        if not array.flags.carray:  # np.require copies only arrays that are not contiguous or not aligned
            array = np.require(array, dtype, ["C_CONTIGUOUS", "ALIGNED"])
        arrays[k] = array
    return batch, arrays


def prepare_one(function: str, port: Port, value: Any, dtype: np.dtype[Any]) -> Array:
    """Convert one ``value`` of a bound ``function`` to an array of ``dtype`` with exactly the shape of its ``port``.

    Raises as :func:`prepare`, and ValueError for leading (batch) dimensions.
    """
    batch, (array,) = prepare(function, (port,), (value,), dtype)
    if batch:
        what = f"{function}: {port.name} of a bound function is that of one state"
        raise ValueError(f"{what}, without the leading dimensions {batch}")
    return array


def check_positions(function: str, q: Any, n: int) -> Array:
    """Joint positions ``q`` (..., n) of a call of ``function`` as float64. Raises as :func:`prepare`."""
    port = Port("q", (n,), "rad | m", meaning="joint positions")
    return prepare(function, (port,), (q,), np.dtype(np.float64))[1][0]


def _common(function: str, ports: Sequence[Port], batches: Sequence[Batch]) -> Batch:
    """Common leading dimensions of all arguments; raises ValueError if they cannot be broadcast.

    The usual case, all equal or absent, is decided without calling NumPy, which costs time.
    """
    longest: Batch = ()
    for batch in batches:
        if len(batch) > len(longest):
            longest = batch
    for batch in batches:
        if batch and batch != longest:
            break
    else:
        return longest
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shown = ", ".join(f"{port.name} {batch}" for port, batch in zip(ports, batches, strict=True))
        raise ValueError(f"{function}: the leading dimensions do not fit each other: {shown}") from None


def _wrong_shape(function: str, port: Port, shape: tuple[int, ...]) -> str:
    wanted = ", ".join(map(str, port.shape))
    single = f"({wanted},)" if len(port.shape) == 1 else f"({wanted})"
    unit = f" [{port.unit}]" if port.unit else ""
    meaning = f": {port.meaning}{unit}" if port.meaning else unit
    return f"{function}: {port.name} must have shape {single} or (..., {wanted}), got {shape}{meaning}"


def join_parameters(function: str, dtype: np.dtype[Any], beta: Any, Ia: Any, sizes: tuple[int, int]) -> Array:
    """Join base parameters (..., b) and drive inertias (..., d) to the argument beta of emitted code, (..., b + d).

    ``sizes`` are b and d. Raises as :func:`prepare` for wrong shapes and types.
    """
    ports = (
        Port("beta", sizes[:1], "SI", meaning="base parameters"),
        Port("Ia", sizes[1:], "kg m^2 | kg", meaning="drive inertias"),
    )
    batch, arrays = prepare(function, ports, (beta, Ia), dtype)
    return np.concatenate([np.broadcast_to(array, (*batch, array.shape[-1])) for array in arrays], axis=-1)


def check_status(program: Program, result: Any, status: Any, with_status: bool) -> Any:
    """Return ``result``, or raise numpy.linalg.LinAlgError if the ``status`` of any state is not 0.

    With ``with_status``, ``(result, status)`` is returned instead and nothing is raised. For a refused input it is a
    ValueError that is raised.
    """
    status = np.asarray(status).astype(np.intc, copy=False)
    if with_status:
        return result, status
    if program.status is not None and np.any(status):
        raise status_error(program.name, program.status, status)
    return result


def status_error(function: str, described: Status, status: Array) -> Exception:
    """The error for the first state of ``status`` that is not 0."""
    count, first = np.count_nonzero(status), int(np.argmax(status != 0))
    place = f"; {count} of {status.size} states, the first at flat index {first}" if status.ndim else ""
    code = int(status.flat[first])
    failure = next(candidate for candidate in described.failures if candidate.code == code)
    kind = ValueError if failure.code == REFUSED.code else np.linalg.LinAlgError
    return kind(f"{function}: {failure.message}{place}")


def nominal_values(values: Any) -> Array | None:
    """Convert nominal ``values`` to a read-only array of floats; None stays None.

    It is read-only because the values are folded into compiled code, which would not see a change.
    """
    return None if values is None else read_only(np.array([float(value) for value in values]))


def read_only(array: Array) -> Array:
    """Make ``array`` read-only in place and return it."""
    array.setflags(write=False)
    return array
