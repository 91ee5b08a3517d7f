"""Check whether emitted code and its certificate belong together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import InputError
from rrrgen.base.files import MANIFEST, checksum
from rrrgen.base.templates import templates_digest
from rrrgen.derive import derive_once
from rrrgen.derive.functions.table import GROUPS
from rrrgen.evidence.boxes import Ranges
from rrrgen.evidence.certificate import (
    CERTIFICATE,
    FOLDER,
    MARKDOWN,
    PAGE,
    SCHEMA,
    content_digest,
    json_text,
    rounding_entries,
)
from rrrgen.evidence.page import html, markdown
from rrrgen.robot.identity import identify

if TYPE_CHECKING:
    from rrrgen.base.parallel import Tell
    from rrrgen.robot.spec import RobotSpec

_KEYS = (
    "robot",
    "model_hash",
    "tool",
    "real",
    "files",
    "templates",
    "options",
    "functions",
    "evidence",
    "without_bound",
    "skipped",
    "not_claimed",
    "digest",
)


def read_certificate(directory: Path) -> dict[str, Any]:
    """The content of the certificate below ``directory``. Raises InputError if there is none, or if it is no JSON."""
    place = directory / CERTIFICATE
    try:
        content = json.loads(place.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{place}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{place}: is no JSON: {error}") from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(f"{place}: is no certificate of the schema {SCHEMA}")
    missing = [key for key in _KEYS if key not in content]
    if missing:
        raise InputError(f"{place}: has no {', '.join(missing)}")
    return content


def disagreements(directory: Path) -> list[str]:
    """What does not agree between the certificate below ``directory`` and the files beside it, one sentence each.

    Compared are the digest of the certificate, the SHA-256 of every file, the pages, and the functions and the model of
    the manifest. Raises InputError if there is no certificate.
    """
    content = read_certificate(directory)
    faults = []
    if content_digest(content) != content["digest"]:
        faults.append(f"{CERTIFICATE}: its content does not have the digest that it states")
        return faults
    for path, expected in {**content["files"], **content["evidence"]}.items():
        fault = _file_fault(directory, path, expected)
        if fault:
            faults.append(fault)
    if (directory / CERTIFICATE).read_bytes() != json_text(content).encode():
        faults.append(f"{CERTIFICATE}: is not as rrrgen writes it")
    for path, text in ((MARKDOWN, markdown(content)), (PAGE, html(content))):
        fault = _file_fault(directory, path, checksum(text))
        if fault:
            faults.append(fault)
    known = {*content["files"], *content["evidence"], CERTIFICATE, MARKDOWN, PAGE}
    for path in sorted(directory.rglob("*")):
        name = path.relative_to(directory).as_posix()
        if path.is_file() and name not in known and (path.suffix in (".c", ".h") or name.startswith(f"{FOLDER}/")):
            faults.append(f"{name}: is not in the certificate")
    return faults + ([] if faults else _manifest_faults(directory, content))


def _file_fault(directory: Path, path: str, expected: str) -> str | None:
    if PurePosixPath(path).is_absolute() or ".." in PurePosixPath(path).parts:
        return f"{path}: is no path below the directory"
    try:
        data = (directory / path).read_bytes()
    except OSError:
        return f"{path}: is missing"
    return None if checksum(data) == expected else f"{path}: has changed since the certificate was written"


def _manifest_faults(directory: Path, content: dict[str, Any]) -> list[str]:
    """Compare with the manifest: the model, and a row for every emitted function."""
    manifest = json.loads((directory / MANIFEST).read_text(encoding="utf-8"))
    faults = []
    if manifest["model_hash"] != content["model_hash"]:
        faults.append(f"{MANIFEST}: is of another model")
    for name in manifest["functions"]:
        if name not in content["functions"]:
            faults.append(f"{name}: is emitted, and not in the certificate")
    return faults


def another_robot(content: dict[str, Any], spec: RobotSpec) -> list[str]:
    """One sentence if the robot ``spec`` is not the one of the certificate ``content``, else nothing."""
    if identify(replace(spec, ik=content["options"]["ik"])).model_hash == content["model_hash"]:
        return []
    return [f"{spec.name}: the robot file is not the one of the certificate"]


def bounds_that_differ(content: dict[str, Any], spec: RobotSpec, tell: Tell | None = None) -> list[str]:
    """Derive the robot ``spec`` anew, prove its bounds anew, and compare them and the templates with the ``content``.

    The robot is that of the certificate (:func:`another_robot`). Returns one sentence for every difference; versions of
    other tools than those that wrote the certificate may round the proof differently, so bounds are compared to 1e-9.
    """
    options = content["options"]
    spec = replace(spec, ik=options["ik"])
    groups = ("model", *(name for name in sorted(options["with"]) if name in GROUPS))
    model = derive_once(spec, groups)
    ranges = Ranges(options["speed"], options["acceleration"])
    differences = []
    if content["templates"] != templates_digest():
        differences.append("the templates of the C code are not those of this version of rrrgen")
    for name, entry in rounding_entries(model, options["trig"], ranges, tell=tell).items():
        stated = content["functions"].get(name)
        if stated is None:
            differences.append(f"{name}: is not in the certificate")
        else:
            differences += [f"{name}: {fault}" for fault in _entry_faults(stated["rounding"], entry)]
    return differences


def _entry_faults(stated: dict[str, Any], entry: dict[str, Any]) -> list[str]:
    if ("none" in stated) != ("none" in entry):
        return ["a bound is stated and none can be proven, or the other way round"]
    if "none" in entry:
        return []
    faults = []
    if any(stated.get(key) != entry.get(key) for key in ("conditional", "assumption", "quantity")):
        faults.append("the bounds suppose something else")
    for precision in ("double", "float"):
        old, new = stated[precision], entry[precision]
        if old["box"] != new["box"]:
            faults.append(f"the box in {precision} is another one")
        pairs = [
            (a, b)
            for port, row in new["bounds"].items()
            for a, b in zip(old["bounds"].get(port, []), row, strict=False)
        ]
        if any(abs(a - b) > 1e-9 * abs(b) for a, b in pairs):
            faults.append(f"the bounds in {precision} are others")
    return faults
