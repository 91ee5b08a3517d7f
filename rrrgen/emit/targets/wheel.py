"""Export as a Python wheel for one robot: its C as a shared library, called through ctypes with NumPy arrays."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rrrgen.base.files import as_bytes
from rrrgen.base.templates import render
from rrrgen.emit.description import title
from rrrgen.emit.targets.c_package import (
    FURTHER,
    Code,
    any_gravity_code,
    described_functions,
    emitted_code,
    loops,
    nominal_values,
)
from rrrgen.emit.targets.interface import Contents, Exported, Exporter, ExportOptions
from rrrgen.emit.targets.shared_libraries import platforms, shared_library, zip_archive
from rrrgen.ik.result_layout import most_rows, reasons_of
from rrrgen.robot.spec import RobotSpec

_HASH_DIGITS = 12  # of the hash of the contents, in the version of the package: pip tells wheels apart by it


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    chosen = platforms(options.platforms)
    words = tuple(word for word in options.further if word != "gravity")
    code = replace(emitted_code(spec, options.real, words, options.unit), further=options.further)
    modules = {"": code}
    if "gravity" in options.further:
        modules["any_gravity"] = any_gravity_code(spec, options.real, words)
    controller: dict[str, Contents] = {}
    if options.unit is not None:
        controller = {"controller.py": options.unit.python, "controller.json": json.dumps(options.unit.description)}
    release = f"{code.identity.tool_version}+{_contents_hash(modules, controller)}"
    values = _values(code, release)
    files: dict[str, Contents] = {}
    for platform in chosen:
        package: dict[str, Contents] = {"py.typed": ""}
        for name, module in modules.items():
            stem = f"{values['package']}_{name}" if name else values["package"]  # any_gravity.so would be imported
            library = f"{stem}{platform.suffix}"
            package[f"{name or '__init__'}.py"] = _module(module, release, library)
            package[library] = shared_library(module.files | loops(module), platform)
        wheel = f"{values['package']}-{release}-py3-none-{platform.tag}.whl"
        files[wheel] = _wheel(values, platform.tag, package | controller)
    readme = render("wheel/README.md.j2", **values, wheels=list(files))
    return Exported({**files, "README.md": readme})


def _contents_hash(modules: Mapping[str, Code], controller: Mapping[str, Contents]) -> str:
    """Hash what the package is made from, which is the same for all platforms: C and Python sources, description."""
    sources = {f"controller/{name}": data for name, data in controller.items()}
    for name, module in modules.items():
        sources |= {f"{name}/{file}": data for file, data in (module.files | loops(module)).items()}
        sources[f"{name}.py"] = _module(module, "", "")
    sources["METADATA"] = render("wheel/METADATA.j2", **_values(modules[""], ""))
    digests = "".join(f"{name},{_digest(data)}\n" for name, data in sorted(sources.items()))
    return hashlib.sha256(digests.encode()).hexdigest()[:_HASH_DIGITS]


def _module(code: Code, release: str, library: str) -> str:
    return render("wheel/module.py.j2", **_values(code, release), library=library)


def _values(code: Code, release: str) -> dict[str, Any]:
    spec = code.model.spec
    solved = code.plan.solvable
    return {
        **code.naming,
        "package": f"{spec.name.lower()}_model",
        "distribution": f"{spec.name.lower()}-model",
        "release": release,
        "title": title(spec),
        "description": spec.description,
        "functions": described_functions(code),
        "rows": most_rows(code.plan) if solved else 0,
        "reasons": reasons_of(code.plan) if solved else (),
        "nominal": nominal_values(code),
    }


def _wheel(values: dict[str, Any], tag: str, package: dict[str, Contents]) -> bytes:
    """Bytes of the wheel archive: the files of ``package``, metadata, and the list of hashes (RECORD)."""
    information = f"{values['package']}-{values['release']}.dist-info"
    contents = {f"{values['package']}/{name}": data for name, data in package.items()}
    contents[f"{information}/METADATA"] = render("wheel/METADATA.j2", **values)
    contents[f"{information}/WHEEL"] = (
        f"Wheel-Version: 1.0\nGenerator: rrrgen {values['version']}\nRoot-Is-Purelib: false\nTag: py3-none-{tag}\n"
    )
    record = [f"{name},sha256={_digest(data)},{len(as_bytes(data))}" for name, data in contents.items()]
    contents[f"{information}/RECORD"] = "\n".join([*record, f"{information}/RECORD,,", ""])
    return zip_archive(contents)


def _digest(contents: Contents) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(as_bytes(contents)).digest()).rstrip(b"=").decode()


EXPORTER = Exporter(
    "wheel",
    "Python wheel of the robot: needs NumPy alone, neither rrrgen nor a compiler",
    _write,
    one_file=False,
    mechanisms=True,
    loops=True,
    options=("real", "platforms"),
    further=FURTHER,
)
