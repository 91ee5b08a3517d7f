"""The folder of one run: what went in (hashes, settings, seed), what came out, and what is needed to go on.

    run.json          command, versions, inputs with their SHA-256, settings, seed, status
    results/          JSON, CSV, YAML
    figures/          SVG and PNG
    checkpoints/      state of unfinished work

Every file is either complete or absent. The same inputs give the same bytes: nothing holds a date or a host name.
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
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.errors import InputError
from rrrgen.output.staging import is_staged, remove_abandoned
from rrrgen.output.writer import write_file
from rrrgen.version import VERSION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "rrrgen-run/1"
PACKAGES = ("numpy", "scipy", "casadi", "cvxpy", "clarabel")

PARTS = ("results", "figures", "checkpoints")

Status = Literal["clearing", "running", "interrupted", "failed", "finished"]


class RunFolder:
    """One run on disk; a context manager that records how the run ended.

    A folder with the same command, inputs, settings and seed of the same version of rrrgen is taken up again; with
    others it is refused, unless ``fresh`` asks to start over.
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
            "versions": {"rrrgen": VERSION} | {name: found for name in PACKAGES if (found := _version(name))},
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
            # results of another run never stand beside this run's record, whatever ends the process in between
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
        """Where unfinished work may keep its state."""
        folder = self.path / "checkpoints"
        folder.mkdir(parents=True, exist_ok=True)
        return folder / name

    def stage(self, name: str, compute: Callable[[], Any]) -> Any:
        """The plain data of ``compute()``; read back where an earlier, interrupted run has already finished this
        stage.
        """
        place = self.checkpoint(f"{name}.json")
        try:
            kept = json.loads(place.read_text(encoding="utf-8"))
            if kept["digest"] == self.digest:
                return kept["data"]
        except (OSError, ValueError, KeyError, TypeError):
            pass
        data = plain(compute())
        write_atomically(place, json.dumps({"digest": self.digest, "data": data}))
        return data

    def write_json(self, name: str, data: Any) -> Path:
        """``results/name`` with plain data; infinities and NaN become null."""
        return self.write_text(name, json.dumps(plain(data), indent=1) + "\n")

    def write_csv(self, name: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
        """``results/name`` as a table; numbers read back exactly."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([_cell(value) for value in row] for row in rows)
        return self.write_text(name, text.getvalue())

    def write_text(self, name: str, text: str) -> Path:
        """``results/name`` with this text."""
        place = self.path / "results" / name
        write_atomically(place, text)
        return place

    def figure(self, name: str, figure: Figure) -> list[Path]:
        """``figures/name.svg`` and ``.png``."""
        from rrrgen.runs.figures import save_figure

        return save_figure(figure, self.path / "figures" / name)

    def _difference(self, before: Mapping[str, Any]) -> str:
        """In what a run that is there differs from this one."""
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
            found: dict[str, Any] = json.loads(place.read_text(encoding="utf-8"))
            return found if found.get("schema") == SCHEMA else {}
        except (OSError, ValueError, AttributeError):
            return {}

    def _remove_abandoned(self) -> None:
        """Remove the unfinished files of killed runs."""
        for place in (self.path, *(self.path / part for part in PARTS)):
            remove_abandoned(place)

    def _clear(self) -> None:
        """Remove what earlier runs wrote, and only that."""
        for part in PARTS:
            for file in sorted((self.path / part).glob("*")):
                if file.is_file():
                    file.unlink()

    def _set_status(self, status: Status) -> None:
        record = {**self.record, "digest": self.digest, "status": status}
        write_atomically(self.path / "run.json", json.dumps(record, indent=1) + "\n")


def write_atomically(path: Path, text: str) -> None:
    """Write ``text`` (UTF-8, LF) so that the file is either complete or absent, whatever interrupts the writing."""
    write_file(path, text)


def plain(value: Any) -> Any:
    """``value`` in JSON's own types; infinities and NaN become None."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
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


def hash_of(path: Path) -> str:
    """SHA-256 of a file, or of all files of a folder in order."""
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
