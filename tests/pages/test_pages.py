"""The pages: commands exist with their options, robot files are right, Python runs, links lead somewhere."""

from __future__ import annotations

import contextlib
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from rrrgen.cli.commands import COMMANDS, GROUPS, load_command
from rrrgen.robot.file import load_spec
from rrrgen.robot.robots import bundled_names

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md"), ROOT / "bench/README.md"])
FIGURES = {
    "gallery": "examples/gallery/figure.py",
    "control_loop": "examples/control_loop/run.py",
    "pick_up": "examples/pick_up/run.py",
    "collision": "examples/collision/run.py",
    "path-timing": "examples/path-timing/figure.py",
}
"""The scripts that draw the figures of the pages; those of the benchmark are drawn by it."""
BY_MODULES = {"cortex_m": "bench.cortex_m rrr --figure docs/figures/cortex_m.png"}
"""Figures of the pages that a module of the benchmark draws, with its command."""

BY_PAGES = {"postures": "README.md", "optimal-motion": "docs/optimal-control.md", "mpc": "docs/optimal-control.md"}
"""Figures that blocks of a page itself draw."""
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]


def blocks(text: str, *languages: str) -> Iterator[str]:
    """The fenced blocks of ``languages``."""
    for match in re.finditer(r"^```(\w+)\n(.*?)^```", text, re.S | re.M):
        if match[1] in languages:
            yield match[2]


def prose(text: str) -> str:
    """The page without its fenced blocks."""
    return re.sub(r"^ *```.*?^ *```", "", text, flags=re.S | re.M)


def calls(text: str) -> Iterator[list[str]]:
    """The words of every line that calls rrrgen, continued lines joined."""
    for line in text.replace("\\\n", " ").splitlines():
        words = line.strip().removeprefix("$ ")
        if words.startswith("rrrgen "):
            yield shlex.split(words, comments=True)[1:]


def check_call(words: list[str]) -> None:
    """Raise unless the command exists and understands every option; values and files are not looked at."""
    words = words[: min((words.index(end) for end in ("|", ">", "&&", ";") if end in words), default=len(words))]
    if not words or words[0].startswith("-"):
        return
    length = 2 if words[0] in GROUPS else 1
    path, words = " ".join(words[:length]), words[length:]
    assert path in COMMANDS, f"rrrgen {path}: no such command"
    command = load_command(path)
    command.make_parser(click.Context(command, info_name=path)).parse_args(words)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_on_the_pages_exist_with_their_options(page):
    for block in blocks(page.read_text(encoding="utf-8"), "sh", "bash", "console"):
        for words in calls(block):
            check_call(words)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_in_the_text_exist_with_their_options(page):
    """Commands in sentences and tables; an option there may be named without its value."""
    if page.name == "CHANGELOG.md":  # commands had other names then
        return
    for command in re.findall(r"`(rrrgen [^`]+)`", prose(page.read_text(encoding="utf-8"))):
        with contextlib.suppress(click.BadOptionUsage):
            check_call(shlex.split(command)[1:])


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_other_commands_on_the_pages_name_what_exists(page):
    """Targets of make; modules and scripts of this repository that Python or pytest runs."""
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    text = page.read_text(encoding="utf-8")
    commands = [line for block in blocks(text, "sh", "bash", "console") for line in block.splitlines()]
    for command in (*commands, *re.findall(r"`([^`]+)`", prose(text))):
        words = command.partition("#")[0].split()
        if words[:1] == ["make"]:
            assert set(words[1:2]) <= targets or "=" in words[1], command
        elif words[:2] == ["python", "-m"] and words[2].partition(".")[0] in ("bench", "tests", "rrrgen"):
            place = ROOT / words[2].replace(".", "/")
            assert place.with_suffix(".py").exists() or (place / "__main__.py").exists(), command
        elif words and words[0] in ("python", "pytest", ".venv/bin/pytest"):
            for word in words[1:2]:
                assert not word.startswith(("tests/", "examples/", "bench/")) or (ROOT / word).exists(), command


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_in_the_help_exist_with_their_options(name):
    found = list(calls(load_command(name).help or ""))
    assert found, "a command without an example"
    for words in found:
        check_call([word for word in words if not word.startswith("(")])


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_extras_are_quoted_for_every_shell(page):
    """zsh takes the brackets of ``pip install .[test]`` for a pattern of file names."""
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r"pip install [^`\n]*?(?<!['\"\w./-])[\w./-]+\[", text)


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_of_the_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not re.match(r"\w+:", target):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_robot_files_on_the_pages_are_right(tmp_path):
    found = 0
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8"), "yaml"):
            if block.startswith("schema: rrrgen/1\n"):
                file = tmp_path / f"{page.stem}{found}.yaml"
                file.write_text(block, encoding="utf-8")
                # an arm as it was built has small numbers, which are warned of: they may be slips in another unit
                assert all("lengths below 1 mm" in fault.message for fault in load_spec(file).faults)
                found += 1
    assert found


def test_python_on_the_first_page_runs(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    space = {}
    for block in blocks((ROOT / "README.md").read_text(encoding="utf-8"), "python"):
        exec(compile(block, "README.md", "exec"), space)  # our own page
    assert space["tau"].shape == (6,)
    assert space["postures"].shape == (8, 6)
    assert (tmp_path / "postures.png").stat().st_size > 10_000


@pytest.mark.sweep(but=["examples/control_loop/run.py", "examples/path-timing/figure.py"])
@pytest.mark.parametrize("name", sorted(FIGURES.values()))
def test_scripts_of_the_examples_take_a_folder(name, tmp_path):
    """``-o`` is an option of every script, none takes it for the name of a file; a wrong word is refused."""
    for words, code, said in ((["--help"], 0, "-o "), (["--no-such-option"], 2, "unrecognized arguments")):
        command = [sys.executable, str(ROOT / name), *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert said in done.stdout + done.stderr
    assert not list(tmp_path.iterdir())


def test_every_figure_is_made_by_a_command_on_a_page():
    pages = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    shown = {Path(target).stem for target in re.findall(r"!\[[^]]*\]\(([^)]+)\)", pages)}
    assert shown == {*FIGURES, *BY_PAGES, *BY_MODULES, "benchmark"}
    for figure, page in BY_PAGES.items():
        assert f'savefig("{figure}.png"' in (ROOT / page).read_text(encoding="utf-8")
    for figure, script in FIGURES.items():
        assert f"python {script}" in pages
        assert figure in (ROOT / script).read_text(encoding="utf-8")
    for figure, command in BY_MODULES.items():
        assert command.endswith(f" docs/figures/{figure}.png")
        assert f"python -m {command}" in pages
    assert "make bench" in pages
    assert "benchmark.svg bench/results/benchmark.png docs/" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_the_comparison_counts_the_bundled_robots():
    page = (ROOT / "docs/comparison.md").read_text(encoding="utf-8")
    assert f"| ready robots | {len(bundled_names())} bundled |" in page
