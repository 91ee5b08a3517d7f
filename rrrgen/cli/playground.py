"""The command ``rrrgen playground``: build the page that runs the compiler in a browser, and serve it."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.terminal import say

if TYPE_CHECKING:
    from http.server import ThreadingHTTPServer

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval' blob:; worker-src 'self'; connect-src 'self'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; form-action 'none'"
)
"""What the page and its workers may load: their own files alone. ``blob:`` is the emitted JavaScript of an arm."""

PAGE = ("index.html", "page.css", "page.js", "arm-worker.js", "compiler-worker.js", "offline.js")
RUNTIME = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
LIBRARIES = ("sympy", "mpmath", "jinja2", "markupsafe", "ruamel.yaml", "click")
"""What the compiler imports on the way from robot file to text."""

UNUSED = frozenset({"tests", "benchmarks", "physics", "stats", "holonomic", "diffgeom", "categories", "crypto"})
"""Folders of the libraries that the compiler does not import."""

OWN = """\
schema: rrrgen/1
name: my_arm
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {type: revolute, alpha: 90, a: 0, d: 0.4, theta: 0}
  - {type: revolute, alpha: 0, a: 0.45, d: 0, theta: 0}
  - {type: revolute, alpha: 90, a: 0.05, d: 0, theta: 90}
  - {type: revolute, alpha: -90, a: 0, d: 0.4, theta: 0}
  - {type: revolute, alpha: 90, a: 0, d: 0, theta: 0}
  - {type: revolute, alpha: 0, a: 0, d: 0.1, theta: 0}
"""
"""An arm to start from: without links, so that joints can be added and removed."""


def package(
    text: str, folder: str, words: Sequence[str], real: str, modes: Sequence[str] = (), parts: Sequence[str] = ()
) -> dict[str, object]:
    """Run ``rrrgen generate`` on the robot file ``text`` in ``folder``, which the worker has in memory.

    ``words`` are those of ``--with``, ``modes`` and ``parts`` those of the controller, the usual ones if empty.
    Returns the exit ``code``, what the command printed, the ``files`` (path -> text), and the folder of the archive
    ``zip`` with them: the bytes are those that the command line writes, and the archive of the same files is the same.
    """
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO

    from rrrgen.cli.main import run

    place = Path(folder)
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    (place / "robot.yaml").write_text(text, encoding="utf-8", newline="\n")
    arguments = ["generate", str(place / "robot.yaml"), "-o", str(place / "out"), "-j", "1", "--no-casadi-files"]
    arguments += ["--real", real]
    for option, chosen in (("--with", words), ("--modes", modes), ("--parts", parts)):
        arguments += [option, ",".join(chosen)] if chosen else []
    printed = StringIO()
    with redirect_stdout(printed), redirect_stderr(printed):
        code = run(arguments)
    written = sorted(file for file in (place / "out").rglob("*") if file.is_file()) if code == 0 else []
    files = {file.relative_to(place / "out").as_posix(): file.read_text(encoding="utf-8") for file in written}
    with zipfile.ZipFile(place / "files.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            archive.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    return {"code": code, "printed": printed.getvalue(), "files": files, "zip": str(place / "files.zip")}


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False), default="playground")
@click.option(
    "--build",
    "runtime",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="PYODIDE",
    help="Write the page into FOLDER, with the runtime in this folder of the npm package pyodide, and exit.",
)
@click.option("--robot", "robots", multiple=True, help="With --build: only these bundled robots; repeat for several.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0 for any free one."
)
def playground(folder: Path, runtime: Path | None, robots: tuple[str, ...], port: int) -> None:
    """Serve the playground, a page that runs the compiler in the browser, on this machine alone.

    FOLDER holds a built page. It is made of files only and may be put on any file server: the browser asks for nothing
    outside it. `make playground` builds it, and fetches the runtime through npm.

    \b
    Examples:
      rrrgen playground site --build node_modules/pyodide    # after npm install pyodide
      rrrgen playground site
    """
    if robots and runtime is None:
        raise click.UsageError("--robot goes with --build")
    if runtime is not None:
        if click.get_current_context().get_parameter_source("port") is not click.core.ParameterSource.DEFAULT:
            raise click.UsageError("--port has no effect with --build")
        build(folder, runtime, robots)
        click.echo(f"{folder} written: serve it with 'rrrgen playground {folder}'", err=True)
        return
    if not (folder / "index.html").exists():
        raise click.UsageError(f"{folder} holds no playground; build one with --build, or with 'make playground'")
    with server(folder, port) as service:
        say(f"http://127.0.0.1:{service.server_address[1]}/ (end with Ctrl-C)")
        service.serve_forever()


def server(folder: Path, port: int) -> ThreadingHTTPServer:
    """A server of the files in ``folder`` on the loopback address, with the content security policy of the page."""
    from contextlib import suppress
    from functools import partial
    from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

    class Files(SimpleHTTPRequestHandler):
        extensions_map = SimpleHTTPRequestHandler.extensions_map | {
            ".mjs": "text/javascript",
            ".js": "text/javascript",
            ".wasm": "application/wasm",
        }

        def end_headers(self) -> None:
            self.send_header("Content-Security-Policy", POLICY)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.send_header("Cache-Control", "no-cache")
            super().end_headers()

        def copyfile(self, source: Any, outputfile: Any) -> None:
            with suppress(ConnectionError):  # a visitor who leaves while the compiler loads
                super().copyfile(source, outputfile)

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    return ThreadingHTTPServer(("127.0.0.1", port), partial(Files, directory=str(folder)))


def build(folder: Path, runtime: Path, robots: Sequence[str] = ()) -> None:
    """Write the page into ``folder``: its files, the runtime, the compiler as an archive, and the bundled robots.

    Raises UsageError for a runtime that is not the npm package pyodide.
    """
    from rrrgen.base.templates import template_text
    from rrrgen.controller.table import MODES, PARTS
    from rrrgen.emit.html.playground import precompute
    from rrrgen.robot.file.fields import EMIT
    from rrrgen.robot.robots import bundled_names, bundled_path

    if missing := [name for name in RUNTIME if not (runtime / name).is_file()]:
        raise click.UsageError(f"{runtime} is not the npm package pyodide: {missing[0]} is missing")
    texts = {name: bundled_path(name).read_text(encoding="utf-8") for name in robots or bundled_names()}
    folder.mkdir(parents=True, exist_ok=True)
    for name in PAGE:
        text = template_text(f"playground/{name}").replace("POLICY", POLICY)
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    for name in ("viewer.js", "style.css"):
        (folder / name).write_text(template_text(f"report/{name}"), encoding="utf-8", newline="\n")
    (folder / "pyodide").mkdir(exist_ok=True)
    for name in RUNTIME:
        shutil.copyfile(runtime / name, folder / "pyodide" / name)
    (folder / "robots").mkdir(exist_ok=True)
    for name, text in {**texts, "my_arm": OWN}.items():
        click.echo(f"deriving {name}", err=True)
        content = json.dumps(precompute(text), separators=(",", ":"))
        (folder / "robots" / f"{name}.json").write_text(content, encoding="utf-8", newline="\n")
    controller = {"modes": {mode.name: mode.text for mode in MODES}, "parts": PARTS}
    offered = json.dumps({"robots": [*texts, "my_arm"], "with": EMIT, "controller": controller})
    (folder / "offered.json").write_text(offered, encoding="utf-8", newline="\n")
    sizes = {"compiler.zip": write_compiler(folder / "compiler.zip")}
    sizes |= {f"pyodide/{name}": (folder / "pyodide" / name).stat().st_size for name in RUNTIME}
    (folder / "sizes.json").write_text(json.dumps(sizes), encoding="utf-8", newline="\n")
    files = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())  # kept offline
    (folder / "files.json").write_text(json.dumps(files), encoding="utf-8", newline="\n")


def write_compiler(file: Path) -> int:
    """Write the archive of the compiler with the libraries that it imports; returns its size in bytes."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, source in sorted(compiler_files()):
            archive.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), source.read_bytes(), zipfile.ZIP_DEFLATED)
    return file.stat().st_size


def compiler_files() -> Iterator[tuple[str, Path]]:
    """Path in the archive, and file, of every module and template: rrrgen without its laboratory, and its libraries."""
    from importlib import import_module

    package_folder = Path(__file__).resolve().parents[1]
    for source in package_folder.rglob("*"):
        path = source.relative_to(package_folder)
        if source.suffix in (".py", ".yaml") and path.parts[0] not in ("lab", "verify", "templates"):
            yield f"rrrgen/{path.as_posix()}", source
    inside = package_folder / "templates"
    templates = inside if inside.is_dir() else package_folder.parent / "templates"
    for source in templates.rglob("*"):
        if (source.is_file() and source.parent.name not in ("playground", "ros2", "fmu")) or source.suffix == ".j2":
            yield f"rrrgen/templates/{source.relative_to(templates).as_posix()}", source
    for name in LIBRARIES:
        place = Path(str(import_module(name).__file__)).parent
        for source in place.rglob("*.py"):
            path = source.relative_to(place)
            if not UNUSED & set(path.parts[:-1]):
                yield f"{name.replace('.', '/')}/{path.as_posix()}", source
