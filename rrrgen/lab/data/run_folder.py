"""The folder of one run: its inputs (hashes, settings, seed), its results, and the checkpoints to resume it from.

    run.json          command, versions, inputs with their SHA-256, settings, seed, status
    results/          JSON, CSV, YAML
    figures/          SVG and PNG
    checkpoints/      state of unfinished work

Every file is either complete or absent. The same inputs give the same bytes: no file holds a date or a host name.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from rrrgen.base.errors import InputError
from rrrgen.base.exchange import is_staged, remove_abandoned
from rrrgen.base.files import write_file
from rrrgen.base.version import VERSION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Content = TypeVar("Content")

SCHEMA = "rrrgen-run/1"
PACKAGES = ("numpy", "scipy", "casadi", "cvxpy", "clarabel")

PARTS = ("results", "figures", "checkpoints")

Status = Literal["clearing", "running", "interrupted", "failed", "finished"]


class RunFolder:
    """One run on disk; a context manager that records whether the run finished, failed or was interrupted.

    ``path`` is the folder, ``command`` the name of the command, ``inputs`` maps a name such as "robot" to a file or
    folder, ``settings`` and ``seed`` are all else that the results depend on. If the folder already holds a run with
    the same command, contents of inputs, settings, seed and version of rrrgen, that run is resumed. If it holds another
    run, :class:`InputError` is raised, unless ``fresh`` is set, which clears the folder and starts over.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        command: str,
        inputs: Mapping[str, str | os.PathLike[str]],
        settings: Mapping[str, Any],
        seed: int = 0,
        fresh: bool = False,
    ) -> None:
        self.path = Path(path)
        hashed = {name: {"file": str(file), "sha256": hash_of(Path(file))} for name, file in inputs.items()}
        self.record = {
            "schema": SCHEMA,
            "command": command,
            "versions": {"rrrgen": VERSION} | {name: release for name in PACKAGES if (release := _version(name))},
            "inputs": hashed,
            "settings": plain(settings),
            "seed": seed,
        }
        contents = {name: entry["sha256"] for name, entry in hashed.items()}
        essence = [VERSION, command, contents, self.record["settings"], seed]
        self.digest = hashlib.sha256(json.dumps(essence, sort_keys=True).encode()).hexdigest()
        self._remove_abandoned()
        before = self._before()
        if before is not None and before.get("digest") != self.digest and not fresh:
            raise InputError(
                f"{self.path} holds a run of '{before.get('command')}' with {self._difference(before)}; "
                "name another folder, or ask for a fresh start"
            )
        cleared = before is None or before.get("status") != "clearing"
        if fresh or not cleared:
            # the status is written first: if the process ends while clearing, the next run clears again, so that
            # results of another run never stand beside the record of this one
            self._set_status("clearing")
            self._clear()
        self.resumed = before is not None and not fresh
        self._set_status("running")

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._set_status("finished")
        else:
            interrupted = issubclass(kind, (KeyboardInterrupt, SystemExit))
            self._set_status("interrupted" if interrupted else "failed")

    def checkpoint(self, name: str) -> Path:
        """Path of a file in which unfinished work may keep its state; its folder is created."""
        folder = self.path / "checkpoints"
        folder.mkdir(parents=True, exist_ok=True)
        return folder / name

    def stage(self, name: str, compute: Callable[[], Any]) -> Any:
        """The result of ``compute()`` as plain data, read from the checkpoint if an interrupted run has stored it.

        ``name`` identifies the stage within the run.
        """
        place = self.checkpoint(f"{name}.json")
        try:
            kept = json.loads(place.read_text(encoding="utf-8"))
            if kept["digest"] == self.digest:
                return kept["data"]
        except (OSError, ValueError, KeyError, TypeError):
            pass
        data = plain(compute())
        write_file(place, json.dumps({"digest": self.digest, "data": data}))
        return data

    def write_json(self, name: str, data: Any) -> Path:
        """Write ``results/name`` as JSON; infinities and NaN become null. Returns the path."""
        return self.write_text(name, json.dumps(plain(data), indent=1) + "\n")

    def write_csv(self, name: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
        """Write ``results/name`` as a CSV table; every float reads back exactly. Returns the path."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([_cell(value) for value in row] for row in rows)
        return self.write_text(name, text.getvalue())

    def write_text(self, name: str, text: str) -> Path:
        """Write ``results/name`` with this text. Returns the path."""
        place = self.path / "results" / name
        write_file(place, text)
        return place

    def figure(self, name: str, figure: Figure) -> list[Path]:
        """Write ``figures/name.svg`` and ``figures/name.png``. Returns both paths."""
        from rrrgen.lab.data.figure_style import save_figure

        return save_figure(figure, self.path / "figures" / name)

    def _difference(self, before: Mapping[str, Any]) -> str:
        """Text for an error message: how the run recorded in the folder, ``before``, differs from this one."""
        versions = before.get("versions")
        made_by = versions.get("rrrgen", "") if isinstance(versions, Mapping) else ""
        if made_by != VERSION and all(before.get(key) == self.record[key] for key in ("command", "inputs", "settings")):
            return f"rrrgen {made_by or 'of another version'}, and this is {VERSION}"
        return "other inputs, settings or seed"

    def _before(self) -> dict[str, Any] | None:
        place = self.path / "run.json"
        if not place.exists():
            if self.path.is_dir() and not all(is_staged(entry) for entry in self.path.iterdir()):
                raise InputError(f"{self.path} is not empty and holds no run; name another folder")
            return None
        try:
            record: dict[str, Any] = json.loads(place.read_text(encoding="utf-8"))
            return record if record.get("schema") == SCHEMA else {}
        except (OSError, ValueError, AttributeError):
            return {}

    def _remove_abandoned(self) -> None:
        """Remove the temporary files that killed runs left behind."""
        for place in (self.path, *(self.path / part for part in PARTS)):
            remove_abandoned(place)

    def _clear(self) -> None:
        """Remove the files in the subfolders that runs write to, and nothing else."""
        for part in PARTS:
            for file in sorted((self.path / part).glob("*")):
                if file.is_file():
                    file.unlink()

    def _set_status(self, status: Status) -> None:
        record = {**self.record, "digest": self.digest, "status": status}
        write_file(self.path / "run.json", json.dumps(record, indent=1) + "\n")


def plain(value: Any) -> Any:
    """Convert ``value`` (arrays, dataclasses, mappings, sequences) to JSON types; infinities and NaN become None."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return plain_record(value)
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, str) else str(value)


def plain_record(values: Mapping[Any, Any]) -> dict[str, Any]:
    """Convert ``values`` to a JSON object, as :func:`plain` does."""
    return {str(key): plain(item) for key, item in values.items()}


def read_json(path: str | os.PathLike[str], what: str, read: Callable[[Any], Content]) -> Content:
    """What ``read`` makes of the content of a JSON file, which is ``what``, such as "frequency response of `...`".

    Raises :class:`InputError` where the file cannot be read or ``read`` raises for a file of another kind.
    """
    try:
        return read(json.loads(Path(path).read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except InputError:  # a ValueError that says already what is wrong
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path} is no {what}: {error!r}") from None


def hash_of(path: Path) -> str:
    """SHA-256 of a file, or of all files below a folder in sorted order; raises :class:`InputError` if unreadable."""
    digest = hashlib.sha256()
    try:
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            with file.open("rb") as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    return digest.hexdigest()


def _cell(value: Any) -> Any:
    return repr(float(value)) if isinstance(value, (float, np.floating)) else value


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
