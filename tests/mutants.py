"""Mutation testing: do the tests notice when one operator, number or condition of the source is another?

Draws mutants of the package's hard rooms and of the C templates, one change each, and runs for every one the tests that
its module stands closest to: the test file of its name, the comparison of the reference robot's code with the
committed one, then the files that import it. A mutant is killed by the first test that fails. What the tests do not
decide within the time limit counts as a survivor, like what they let pass.

    make mutants                             the fixed sample: 30 mutants of seed 1
    python tests/mutants.py --seed 7 --count 60

Survivors whose change cannot be seen from outside (an equivalent program, a figure that only costs time) stand with the
reason in `tests/mutants.yaml`, and are not counted. The run fails if the score is below 90 %, or if an entry of
that file does not match the source any more.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
EXPLAINED = Path(__file__).with_suffix(".yaml")
ROOMS = ("rrrgen/derive", "rrrgen/program", "rrrgen/ik", "rrrgen/emit", "rrrgen/lab/estimate", "templates/c")
FOLDERS = {
    **{"rrrgen/emit/targets": ("emit/targets",), "rrrgen/emit/html": ("emit/html", "emit")},
    **{"rrrgen/emit/c/ik": ("ik",), "rrrgen/emit/controller": ("controller",)},
    **{"rrrgen/emit": ("emit",), "rrrgen/derive": ("derive", "pipeline"), "rrrgen/ik": ("ik",)},
    **{"rrrgen/program": ("program", "program/passes"), "rrrgen/lab/estimate": ("lab/estimate",)},
    "templates/c": ("emit", "controller", "ik"),
}
"""Folders of tests for the modules of a room, the innermost room first."""

LEAST_SCORE = 0.9
SECONDS = 120.0
"""Time for the tests of one mutant."""

OPERATORS = {
    **{"+": "-", "-": "+", "*": "+", "/": "*", "//": "*", "%": "+", "@": "*"},
    **{"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="},
    **{"in": "not in", "not in": "in", "is": "is not", "is not": "is", "and": "or", "or": "and"},
}


@dataclass(frozen=True)
class Mutant:
    """One change: the characters ``start`` to ``stop`` of the file ``path`` are replaced by ``text``."""

    path: str
    line: int
    start: int
    stop: int
    text: str

    def source(self) -> str:
        return (ROOT / self.path).read_text(encoding="utf-8")

    def mutated(self) -> str:
        source = self.source()
        return source[: self.start] + self.text + source[self.stop :]

    @property
    def before(self) -> str:
        """The changed line as it stands."""
        return self.source().splitlines()[self.line - 1].strip()

    @property
    def after(self) -> str:
        """The changed line with the change."""
        return self.mutated().splitlines()[self.line - 1].strip()


# -- mutants ---------------------------------------------------------------------------------------------------------


def mutants_of(path: str) -> list[Mutant]:
    """Every mutant of a Python module or of a template of C."""
    source = (ROOT / path).read_text(encoding="utf-8")
    return list(_of_python(path, source) if path.endswith(".py") else _of_c(path, source))


def _of_python(path: str, source: str) -> Iterator[Mutant]:
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))
    lines = source.splitlines()

    def place(line: int, column: int) -> int:  # columns of the syntax tree count bytes
        return starts[line - 1] + len(lines[line - 1].encode()[:column].decode())

    def begin(node: ast.expr) -> int:
        return place(node.lineno, node.col_offset)

    def end(node: ast.expr) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return place(node.end_lineno, node.end_col_offset)

    def between(left: ast.expr, right: ast.expr) -> Iterator[Mutant]:
        """The operator between two operands, which may stand in parentheses."""
        at, to = end(left), begin(right)
        found = re.search(r"not\s+in|is\s+not|\bin\b|\bis\b|\band\b|\bor\b|//|<=|>=|==|!=|[-+*/%@<>]", source[at:to])
        if found is None or source[at : at + found.start()].strip(" )\n") or found.group() + "*" == "**":
            return
        if source[at + found.start() : at + found.start() + 2] == "**":
            return
        operator = re.sub(r"\s+", " ", found.group())
        line = source.count("\n", 0, at + found.start()) + 1
        yield Mutant(path, line, at + found.start(), at + found.end(), OPERATORS[operator])

    for node in _behaviour(ast.parse(source)):
        if isinstance(node, ast.BinOp):
            yield from between(node.left, node.right)
        elif isinstance(node, ast.Compare) and len(node.ops) == 1:
            yield from between(node.left, node.comparators[0])
        elif isinstance(node, ast.BoolOp):
            yield from between(node.values[0], node.values[1])
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
            yield Mutant(path, node.lineno, begin(node), begin(node.operand), "")
        elif isinstance(node, (ast.If, ast.IfExp)) and not isinstance(node.test, ast.UnaryOp):
            test = source[begin(node.test) : end(node.test)]
            yield Mutant(path, node.test.lineno, begin(node.test), end(node.test), f"(not ({test}))")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield Mutant(path, node.lineno, begin(node), end(node), repr(node.value + 1))


def _behaviour(tree: ast.AST) -> Iterator[ast.AST]:
    """The nodes that decide what the program computes: no annotations, messages, or code for type checkers alone."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)):
            continue
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            continue
        if isinstance(child, ast.FunctionDef) and child.name == "__repr__":
            continue
        if isinstance(child, ast.arg):
            continue
        if isinstance(child, ast.AnnAssign):
            if child.value is not None:
                yield child.value
                yield from _behaviour(child.value)
            continue
        if isinstance(child, ast.FunctionDef):
            child.returns = None
        yield child
        yield from _behaviour(child)


def _of_c(path: str, source: str) -> Iterator[Mutant]:
    """Operators and decimal numbers of the C in a template, outside comments and Jinja's own lines."""
    plain = re.sub(r"/\*.*?\*/|\{%.*?%\}|\{#.*?#\}|\{\{.*?\}\}|\"[^\"\n]*\"|#[^\n]*", _blank, source, flags=re.DOTALL)
    for found in re.finditer(r" (<=|>=|==|!=|<|>|\+|-|\*|/) |(?<![\w.])\d+\.\d+(?![\w.])", plain):
        line = source.count("\n", 0, found.start()) + 1
        operator = found.group(1)
        if operator is None:
            yield Mutant(path, line, found.start(), found.end(), f"{float(found.group()) + 1.0!r}")
        else:
            yield Mutant(path, line, found.start(1), found.end(1), OPERATORS[operator])


def _blank(found: re.Match[str]) -> str:
    return re.sub(r"[^\n]", "\0", found.group())


def sample(seed: int, count: int) -> list[Mutant]:
    """Draw mutants, one of each of ``count`` files, so that a long table of numbers counts no more than another file.

    Files and mutants are drawn by hashes of their names and lines: a change of the source replaces the mutants of the
    files that it touches, and no others. Of more mutants than there are files, each has a second one, and so on.
    """
    tracked = subprocess.run(
        ["git", "ls-files", *ROOMS], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    files = [path for path in tracked if path.endswith((".py", ".c.j2", ".h.j2"))]
    files.sort(key=lambda path: _draw(seed, path))
    drawn: list[Mutant] = []
    for turn in range(count):
        before = len(drawn)
        for path in files:
            found = sorted(mutants_of(path), key=lambda mutant: _draw(seed, path, mutant.before, mutant.after))
            drawn += found[turn : turn + 1]
            if len(drawn) == count:
                return drawn
        if len(drawn) == before:
            break
    return drawn


def _draw(seed: int, *texts: str) -> str:
    return hashlib.sha256("\n".join([str(seed), *texts]).encode()).hexdigest()


# -- tests -----------------------------------------------------------------------------------------------------------


def stages(path: str) -> list[list[str]]:
    """The commands that decide about a mutant of ``path``, the nearest tests first."""
    tests = sorted(file.relative_to(ROOT) for file in (ROOT / "tests").rglob("test_*.py"))
    pytest = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header"]
    code = [sys.executable, "-m", "rrrgen", "generate", "rrr", "-o", "generated/rrr", "--check"]
    folders = next((folders for room, folders in FOLDERS.items() if path.startswith(f"{room}/")), ())
    if not path.endswith(".py"):
        word = Path(path).name.split(".")[0].removesuffix("_selftest")
        count = {file: len(re.findall(rf"\b{word}", (ROOT / file).read_text(encoding="utf-8"))) for file in tests}
        own = f"test_{Path(path).stem.replace('.', '_')}"  # test_controller_h of controller.h.j2
        naming = sorted((file for file in tests if count[file]), key=lambda file: (file.stem != own, -count[file]))
        printing, users = _that_print(word)
        named = [file for module in [*printing, *users] for file in _nearest(module, tests, ())[0]]
        importing = [file for module in printing for file in _nearest(module, tests, ())[1]]
        named.sort(key=lambda file: (ROOT / file).stat().st_size)
        near = dict.fromkeys([*naming, *named, *importing])
        return [code, *([*pytest, str(file)] for file in near)]
    named, near = _nearest(path, tests, folders)
    room = [file for file in tests if str(file.parent.relative_to("tests")) in folders and file not in [*named, *near]]
    return [*([*pytest, str(file)] for file in named), code, *([*pytest, str(file)] for file in [*near, *room])]


def _nearest(path: str, tests: Sequence[Path], folders: Sequence[str]) -> tuple[list[Path], list[Path]]:
    """The tests that are named after the module ``path``, those in ``folders`` first; those that import it.

    Behind these stand the tests that import another module of its folder.
    """
    module = path.removesuffix(".py").replace("/", ".")
    package, _, name = module.rpartition(".")
    imports = re.compile(
        rf"(from|import) {re.escape(module)}\b|from {re.escape(package)} import \(?[^)\n]*\b{name}\b", re.MULTILINE
    )
    named = [file for file in tests if file.stem == f"test_{name}"]
    named.sort(key=lambda file: str(file.parent.relative_to("tests")) not in folders)
    near = [file for file in tests if imports.search((ROOT / file).read_text(encoding="utf-8")) and file not in named]
    near.sort(key=lambda file: (ROOT / file).stat().st_size)
    beside = re.compile(rf"(from|import) {re.escape(package)}\b")
    further = [file for file in tests if beside.search((ROOT / file).read_text(encoding="utf-8"))]
    further.sort(key=lambda file: (ROOT / file).stat().st_size)
    return named, near + [file for file in further if file not in [*named, *near]]


def _that_print(word: str) -> tuple[list[str], list[str]]:
    """The modules that print the template ``word``, and those that import them."""
    texts = {
        file.relative_to(ROOT).as_posix(): file.read_text(encoding="utf-8")
        for file in sorted((ROOT / "rrrgen").rglob("*.py"))
    }
    named = re.compile(rf"[\"/]{re.escape(word)}[\".]")
    printing = [path for path, text in texts.items() if named.search(text)]
    modules = [path.removesuffix(".py").replace("/", ".") for path in printing]
    users = [path for path, text in texts.items() if any(f"from {module} import" in text for module in modules)]
    return printing, [path for path in users if path not in printing]


def verdict(mutant: Mutant, copy: Path, seconds: float) -> tuple[str, str]:
    """("killed", by what), ("passed", "") or ("undecided", "") for a mutant in the ``copy`` of the project."""
    deadline = time.monotonic() + seconds
    target = copy / mutant.path
    target.write_text(mutant.mutated(), encoding="utf-8", newline="\n")
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        for command in stages(mutant.path):
            left = deadline - time.monotonic()
            if left <= 0.0:
                return "undecided", ""
            code = _run(command, copy, environment, left)
            if code is None:
                return "undecided", ""
            if code not in (0, 5):  # 5: pytest found no test
                return "killed", command[-1] if "pytest" in command else "the code of the reference robot"
        return "passed", ""
    finally:
        target.write_text(mutant.source(), encoding="utf-8", newline="\n")


def _run(command: list[str], copy: Path, environment: dict[str, str], seconds: float) -> int | None:
    """Exit code of a command; None where it takes longer, and it and its children are ended."""
    silent = subprocess.DEVNULL
    process = subprocess.Popen(
        command, cwd=copy, env=environment, stdout=silent, stderr=silent, stdin=silent, start_new_session=True
    )
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def copied(directory: Path) -> Path:
    """A copy of the tracked files and what is new, in which mutants are tried."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in listed:
        if (ROOT / name).is_file():
            (directory / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, directory / name)
    return directory


# -- survivors that are explained ------------------------------------------------------------------------------------


def explained() -> dict[tuple[str, str, str], str]:
    """Reasons of known survivors by (file, line before, line after)."""
    entries = yaml.safe_load(EXPLAINED.read_text(encoding="utf-8")) or []
    return {(entry["file"], entry["before"], entry["after"]): entry["reason"] for entry in entries}


def outdated() -> list[str]:
    """Entries of the explanations that no mutant of the present source matches."""
    faults = []
    for path, before, after in explained():
        present = mutants_of(path) if (ROOT / path).is_file() else []
        if not any((mutant.before, mutant.after) == (before, after) for mutant in present):
            faults.append(f"{path}: no mutant changes '{before}' to '{after}'")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample (1)")
    parser.add_argument("--count", type=int, default=30, help="number of mutants (30)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="mutants tried at a time")
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"time for the tests of one ({SECONDS:g})")
    arguments = parser.parse_args()

    faults = outdated()
    reasons = explained()
    mutants = sample(arguments.seed, arguments.count)
    counts = {"killed": 0, "passed": 0, "undecided": 0, "explained": 0}
    lock, done = threading.Lock(), 0
    with tempfile.TemporaryDirectory(prefix="rrrgen-mutants-") as folder:
        copies = [copied(Path(folder) / str(k)) for k in range(arguments.jobs)]

        def tried(mutant: Mutant) -> None:
            nonlocal done
            reason = reasons.get((mutant.path, mutant.before, mutant.after))
            if reason is None:
                with lock:
                    copy = copies.pop()
                outcome, by = verdict(mutant, copy, arguments.seconds)
                copies.append(copy)
            else:
                outcome, by = "explained", reason
            with lock:
                done += 1
                counts[outcome] += 1
                print(f"{done:3d}/{len(mutants)} {outcome:9s} {mutant.path}:{mutant.line}  {by}", flush=True)
                if outcome != "killed":
                    print(f"      - {mutant.before}\n      + {mutant.after}", flush=True)

        with ThreadPoolExecutor(arguments.jobs) as pool:
            list(pool.map(tried, mutants))
    judged = len(mutants) - counts["explained"]
    score = counts["killed"] / judged if judged else 1.0
    print(f"seed {arguments.seed}: {counts['killed']} of {judged} killed, {100.0 * score:.0f} %", end="; ")
    print(f"{counts['passed']} passed, {counts['undecided']} undecided, {counts['explained']} explained")
    for fault in faults:
        print(f"tests/mutants.yaml: {fault}")
    return 1 if faults or score < LEAST_SCORE else 0


if __name__ == "__main__":
    sys.exit(main())
