"""The playground as a stranger meets it: seconds to the first picture, and from a table to the C package in a file.

    python -m bench.measurements.playground

It needs Chromium, node, and the npm packages pyodide and playwright-core, which ``make playground`` fetches into
build/npm; the variable RRRGEN_NPM names another folder. The time to the picture is the median of five browsers that
have not seen the page. Two arms are typed in by clicks, each on a page that was just opened, while the compiler loads,
and again with the compiler loaded.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import click

from rrrgen.cli.playground import build, server

ROOT = Path(__file__).resolve().parents[2]
NPM = Path(os.environ.get("RRRGEN_NPM", ROOT / "build" / "npm" / "node_modules"))

ARMS = {"spherical": "with a spherical wrist", "general": "of general geometry"}


@dataclass(frozen=True)
class Waiting:
    """Seconds of a visitor; for every arm those from an unvisited page and with the compiler loaded."""

    picture: float
    second_picture: float
    compiler: float
    arms: dict[str, tuple[float, float]]


def waiting() -> Waiting:
    """Build the page, serve it on this machine, and visit it. Raises UsageError where a tool is missing."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    node = shutil.which("node")
    if chromium is None or node is None or not (NPM / "playwright-core").is_dir():
        raise click.UsageError("this needs Chromium, node and the npm packages that 'make playground' fetches")
    with tempfile.TemporaryDirectory(prefix="rrrgen-playground-") as place:
        site = Path(place)
        build(site, NPM / "pyodide", ["ur5"])
        service = server(site, 0)
        threading.Thread(target=service.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{service.server_address[1]}/"
        script = Path(__file__).with_suffix(".mjs")
        command = [node, str(script), address, chromium, str(NPM / "playwright-core")]
        printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        service.shutdown()
    seconds = json.loads(printed)
    arms = {name: (float(cold), float(warm)) for name, (cold, warm) in seconds["arms"].items()}
    picture, second = (float(each) for each in seconds["picture"])
    return Waiting(picture, second, float(seconds["compiler"]), arms)


def table(found: Waiting) -> str:
    """The seconds as text."""
    lines = [
        f"{'first picture':40} {found.picture:6.2f} s, on the second visit {found.second_picture:.2f} s",
        f"{'compiler ready':40} {found.compiler:6.1f} s",
    ]
    for name, (cold, warm) in found.arms.items():
        what = f"six joints {ARMS[name]}, C in a file"
        lines.append(f"{what:40} {cold:6.1f} s from an unvisited page, {warm:.1f} s with the compiler loaded")
    return "\n".join(lines)


if __name__ == "__main__":
    click.echo(table(waiting()))
