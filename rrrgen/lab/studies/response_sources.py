"""Recordings of a loop for its frequency response, from a response file or from arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import FileSource, TimeSource
from rrrgen.lab.response.response_file import ResponseFile, SignalColumn, load_response
from rrrgen.lab.studies.sources import checked_arrays, hash_of_arrays

ResponseSource = str | os.PathLike[str] | Mapping[str, Any] | Sequence[Mapping[str, Any]]
"""A response file, arrays by name (``t``, ``n``, ``u``, ``q``, (N,) each), or a list of these: realisations."""


@dataclass(frozen=True, eq=False)
class ResponseInput:
    """A ``response`` file or what it would say of arrays, the ``files`` read by role, and the hashes of arrays."""

    response: ResponseFile
    files: dict[str, Path]
    settings: dict[str, Any]


def response_input(data: ResponseSource) -> ResponseInput:
    """Find out how recordings of a loop are read; raises :class:`InputError` for a faulty file or arrays."""
    if isinstance(data, (str, os.PathLike)):
        response = load_response(data)
        files = {f"file {source.name}": Path(source.path) for source in response.files}
        return ResponseInput(response, {"log": Path(data)} | files, {})
    recordings = [data] if isinstance(data, Mapping) else list(data)
    sources, hashes = [], {}
    for k, recording in enumerate(recordings, start=1):
        name = f"recording{k}"
        if not isinstance(recording, Mapping):
            raise InputError(f"recording {k} is of type {type(recording).__name__}, not arrays by name")
        arrays = checked_arrays(recording, 1, name, allowed=("t", "n", "u", "q"), needed=("t", "u", "q"))
        hashes[name] = hash_of_arrays(arrays)
        columns = {key: values.ravel() for key, values in arrays.items()}
        sources.append(FileSource(name, Path(name), arrays=columns))
    if not sources:
        raise InputError("there is no recording")
    excited = ["n" in (source.arrays or {}) for source in sources]
    if any(excited) and not all(excited):
        raise InputError("some recordings have the excitation 'n' and some have not")
    u, q, n = (SignalColumn("", key) for key in ("u", "q", "n"))
    response = ResponseFile(tuple(sources), TimeSource(column="t"), u, q, n if all(excited) else None)
    return ResponseInput(response, {}, {"arrays": hashes})
