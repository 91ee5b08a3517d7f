"""The controller of a robot in Python: the structs of its C by name, and its functions as methods.

This file imports nothing but NumPy, because wheels of a robot contain it as it is.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np


class Struct:
    """One struct of the C with its fields as attributes; numbers are read and written in place.

    Args:
        description: size and fields of the struct.
        real: the type of its numbers, "double" or "float".
    """

    def __init__(self, description: Mapping[str, Any], real: str) -> None:
        self.__dict__["data"] = np.zeros((), struct_type(description, real))

    def __getattr__(self, name: str) -> Any:
        data = self.__dict__["data"]
        if name not in (data.dtype.names or ()):
            raise AttributeError(_unknown(name, data.dtype.names or ()))
        value = data[name]
        return value if value.shape else value.item()

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in (self.data.dtype.names or ()):
            raise AttributeError(_unknown(name, self.data.dtype.names or ()))
        kind, shape = self.data.dtype[name].base, self.data.dtype[name].shape
        if kind.kind in "iu":
            self.data[name] = _whole_number(name, value, np.iinfo(kind))
            return
        try:
            given = np.asarray(value)
            given = given.astype(float, casting="same_kind" if given.dtype.kind == "c" else "unsafe")
        except (TypeError, ValueError):
            raise ValueError(f"{name} must be {'numbers' if shape else 'a number'}, not {value!r}") from None
        if given.shape not in ((), shape) and given.size != np.prod(shape, dtype=int):
            raise ValueError(f"{name} must be {shape[0] if shape else 1} numbers, not {given.shape}")
        self.data[name] = given if given.shape in ((), shape) else given.reshape(shape)

    def __dir__(self) -> list[str]:
        return list(self.data.dtype.names or ())

    def __repr__(self) -> str:
        return "\n".join(f"{name} = {getattr(self, name)}" for name in dir(self))

    @property
    def address(self) -> int:
        """The address of the struct, for C."""
        return int(self.data.ctypes.data)


def _whole_number(name: str, value: Any, limits: Any) -> int:
    """The whole number ``value`` of the field ``name``; raises ValueError for another one or one beyond ``limits``."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name} must be a whole number, not {value!r}") from None
    if not limits.min <= number <= limits.max:
        raise ValueError(f"{name} must be from {limits.min} to {limits.max}, not {number}")
    return number


def struct_type(description: Mapping[str, Any], real: str) -> np.dtype[Any]:
    """The structured type of NumPy that lays out a struct of the description like C."""
    kinds = {"real": "f8" if real == "double" else "f4", "int32": "i4", "uint32": "u4"}
    fields = description["fields"]
    formats = [kinds[f["type"]] if f["count"] is None else (kinds[f["type"]], (f["count"],)) for f in fields]
    return np.dtype(
        {
            "names": [f["name"] for f in fields],
            "formats": formats,
            "offsets": [f["offset"] for f in fields],
            "itemsize": description["size"],
        }
    )


@contextmanager
def _restore_on_error(*arrays: Any) -> Iterator[None]:
    """Give arrays back the values that they have now if the block ends with an error, since it then changes nothing."""
    before = [array.copy() for array in arrays]
    try:
        yield
    except BaseException:
        for array, values in zip(arrays, before, strict=True):
            array[...] = values
        raise


def _take(struct: Struct, values: Mapping[str, Any]) -> None:
    """Set fields of ``struct`` by name; raises ValueError for an unknown name or a value that cannot be one."""
    for name, value in values.items():
        try:
            setattr(struct, name, value)
        except AttributeError as error:
            raise ValueError(str(error)) from None


def _unknown(name: str, known: Sequence[str]) -> str:
    import difflib

    near = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(known)}"
    return f"the controller has no field '{name}'; {hint}"


class Controller:
    """The controller of one robot: parameters, and one call a period, ``step``; made by ``Model.controller``.

    ``params`` are the parameters; after a change call ``set``. All names, units and defaults are those of the C struct;
    ``describe()`` lists them.

    Args:
        call: ``call(function, *addresses)`` runs the C function ``<name>_controller_<function>``.
        name_of: the C function ``<name>_controller_field_name``: the name of a parameter from the number of its fault.
        description: modes, status bits and structs, as in ``<name>_controller.json``.
        mode: the mode of the first tick, until ``step`` gets another one.
        parameters: parameters by name that replace their defaults.

    Raises:
        ValueError: a mode or a parameter is unknown or wrong.
    """

    def __init__(
        self,
        call: Callable[..., int],
        name_of: Callable[[int], str],
        description: Mapping[str, Any],
        mode: str | None = None,
        **parameters: Any,
    ) -> None:
        self._call, self._name_of, self.description = call, name_of, description
        real, structs = description["real"], description["structs"]
        head = [("size", 0, "uint32"), ("abi", 4, "uint32")]
        fields = [{"name": n, "offset": o, "type": t, "count": None} for n, o, t in head] + structs["params"]["fields"]
        self.params = Struct({**structs["params"], "fields": fields}, real)
        self._state = np.zeros(description["state_size"] // 8, np.int64)
        self._input, self._output = Struct(structs["input"], real), Struct(structs["output"], real)
        self._model = int(description["model"], 16)
        call("default", self._whole())
        self.mode = mode or next(reversed(description["modes"]))
        self._number(self.mode)
        _take(self.params, parameters)
        self._refuse(call("check", self._whole()))

    def __repr__(self) -> str:
        return f"<Controller in mode '{self.mode}', of {', '.join(self.modes)}>"

    def _whole(self) -> int:
        return self.params.address

    @property
    def modes(self) -> list[str]:
        """The modes that this controller has."""
        return list(self.description["modes"])

    def _number(self, mode: str) -> int:
        if mode not in self.description["modes"]:
            raise ValueError(f"there is no mode '{mode}'; this controller has {', '.join(self.modes)}")
        return int(self.description["modes"][mode])

    def _refuse(self, result: int) -> None:
        if result:
            text = self._name_of(result)
            raise ValueError(
                f"controller: {text}" + (" is not finite, out of its range, or contradicts another" * (result > 0))
            )

    def start(self, **readings: Any) -> None:
        """Start, or start again, at rest or in motion, at the first readings ``q`` and ``dq``.

        Args:
            readings: fields of the input by name.

        Raises:
            ValueError: a parameter is wrong, or the readings are not finite; a controller that runs goes on as before.
        """
        with _restore_on_error(self._input.data, self._state):
            _take(self._input, readings)
            self._refuse(self._call("init", self._state.ctypes.data, self._whole(), self._input.address))

    def set(self, **parameters: Any) -> None:
        """Use the parameters as they are in ``params`` from the next tick on, after a change of those given by name.

        Args:
            parameters: parameters by name.

        Raises:
            ValueError: a parameter is wrong; those in use stay, and those given by name are as before.
        """
        with _restore_on_error(self.params.data, self._state):
            _take(self.params, parameters)
            self._refuse(self._call("set", self._state.ctypes.data, self._whole()))

    def reset(self, **readings: Any) -> None:
        """Leave a stop, the brake, or the reaction to a contact.

        Args:
            readings: fields of the input by name.

        Raises:
            ValueError: the reset is refused, since samples are not good yet, or readings not finite.
        """
        with _restore_on_error(self._input.data, self._state):
            _take(self._input, readings)
            self._refuse(self._call("reset", self._state.ctypes.data, self._input.address))

    def step(
        self, *, mode: str | None = None, dt: float | None = None, sample: int | None = None, **inputs: Any
    ) -> Struct:
        """One tick: measurements and reference to torques.

        Args:
            mode: the wanted mode; by default that of the last call.
            dt: time since the last tick, s; by default the period ``params.Ts``.
            sample: counter of the measurements; by default one more than in the last tick.
            inputs: fields of the input by name; those that are not given stay as they were.

        Returns:
            The output: ``tau``, ``status``, ``phase`` and so on. It is overwritten by the next call.
        """
        wanted = self.mode if mode is None else mode
        with _restore_on_error(self._input.data):
            _take(self._input, inputs)
            self._input.mode = self._number(wanted)
            self._input.dt = self.params.Ts if dt is None else dt
            self._input.sample = (self._input.sample + 1) % 2**32 if sample is None else sample
        self.mode = wanted
        self._call("step", self._state.ctypes.data, self._input.address, self._output.address)
        return self._output

    def run(self, inputs: Mapping[str, Any]) -> Any:
        """Many ticks over recorded inputs.

        Args:
            inputs: fields of the input by name, each with one row a tick; ``mode`` are numbers. ``dt`` and ``sample``
                may be missing.

        Returns:
            The outputs as a structured array with one element a tick; ``result["tau"]`` is (ticks, n).
        """
        if not inputs:
            raise ValueError("run needs at least one field of the input, with one row a tick")
        ticks = max(len(np.atleast_1d(value)) for value in inputs.values())
        given = np.zeros(ticks, self._input.data.dtype)
        outputs = np.zeros(ticks, self._output.data.dtype)
        given[:] = self._input.data
        given["mode"], given["dt"] = self._number(self.mode), self.params.Ts
        given["sample"] = np.arange(ticks) + self._input.sample + 1
        for name, value in inputs.items():
            if name not in given.dtype.names:
                raise ValueError(_unknown(name, given.dtype.names))
            given[name] = value
        state, source, sink = self._state.ctypes.data, given.ctypes.data, outputs.ctypes.data
        for k in range(ticks):
            self._call("step", state, source + k * given.itemsize, sink + k * outputs.itemsize)
        if ticks:
            self._input.data[...] = given[-1]
        return outputs

    def faults(self, status: int) -> dict[str, str]:
        """The bits of a status, each name with its text.

        Args:
            status: the status of an output.

        Returns:
            Names to texts; empty if there is no fault.
        """
        texts = self.description["status"]
        return {name: text for k, (name, text) in enumerate(texts.items()) if status >> k & 1}

    def describe(self) -> str:
        """All parameters with unit and meaning, one a line."""
        rows = self.description["structs"]["params"]["fields"]
        return "\n".join(f"{row['name']:18} {row['unit']:22} {row['text']}" for row in rows)

    @property
    def state_bytes(self) -> bytes:
        """The whole state, to be kept and restored."""
        return self._state.tobytes()

    @state_bytes.setter
    def state_bytes(self, data: bytes) -> None:
        self._state[...] = np.frombuffer(data, np.int64)
