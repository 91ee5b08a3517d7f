"""What Windows lacks is not used where it would be missed; files are written alike everywhere.

Nothing here runs on Windows. The package is read for calls that only POSIX has, and a run does without them.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import rrrgen

PACKAGE = Path(rrrgen.__file__).parent

POSIX_MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "posix", "syslog", "crypt"}

POSIX_NAMES = {
    "os": {
        "fork", "forkpty", "getuid", "geteuid", "getgid", "getegid", "setsid", "killpg", "getpgid", "setpgid", "chown",
        "lchown", "fchown", "fchmod", "mkfifo", "mknod", "nice", "uname", "sysconf", "statvfs", "getloadavg", "wait",
        "sched_getaffinity", "sched_setaffinity", "O_NOFOLLOW", "O_CLOEXEC", "O_DIRECTORY", "O_NONBLOCK", "getpriority",
    },
    "signal": {"SIGKILL", "SIGALRM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGPIPE", "SIGXCPU",
               "alarm", "setitimer", "pthread_sigmask", "sigwait"},
    "time": {"tzset", "clock_gettime"},
}  # fmt: skip

GUARDED = {
    "base/cache.py": {"os.geteuid"},  # hasattr
    "base/exchange.py": {"fcntl", "os.chown"},  # ImportError; where owners differ, on Windows all are 0
    "base/parallel.py": {"os.sched_getaffinity"},  # on Linux only
    "runtime/build.py": {"os.statvfs"},  # hasattr
    "lab/data/tables/reading_process.py": {"resource", "os.sysconf"},  # not on win32; after /proc was read
}
"""Where a name of POSIX is used, behind a test."""

WITHOUT = """
import os, signal, sys
import cffi, click, joblib, numpy, subprocess, sympy, tempfile  # these know where they are
for module in {modules!r}:
    sys.modules[module] = None
for name in {names!r}:
    if hasattr(os, name):
        delattr(os, name)
for name in {signals!r}:
    if hasattr(signal, name):
        delattr(signal, name)
sys.platform = "win32"
import rrrgen.base.parallel
rrrgen.base.parallel.may_fork = lambda: False
from rrrgen.cli.main import run
steps = (
    ["new", "arm"],
    ["check", "arm.yaml"],
    ["generate", "pendulum", "-o", "model", "--jobs", "1", "--no-casadi-files"],
    ["generate", "pendulum", "-o", "model", "--real", "float", "--jobs", "1", "--no-casadi-files"],
    ["generate", "pendulum", "-o", "model", "--real", "float", "--jobs", "1", "--no-casadi-files", "--check"],
    ["verify", "pendulum", "--backend", "numpy", "--samples", "1", "--no-libraries"],
    ["export", "pendulum", "--to", "urdf"],
)
for step in steps:
    if code := run(step):
        sys.exit(f"exit code {{code}}: {{step}}")
"""


def modules(words: str) -> Iterator[tuple[str, ast.Module]]:
    """The modules of the package in which one of the words, a regular expression, stands."""
    for file in sorted(PACKAGE.rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if re.search(words, text):
            yield file.relative_to(PACKAGE).as_posix(), ast.parse(text)


def posix_names(tree: ast.Module) -> set[str]:
    """Modules, and names of modules, that only POSIX has."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & POSIX_MODULES
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            found |= {module} & POSIX_MODULES
            found |= {f"{module}.{each.name}" for each in node.names if each.name in POSIX_NAMES.get(module, ())}
        elif isinstance(node, ast.Attribute) and node.attr in POSIX_NAMES.get(ast.unparse(node.value), ()):
            found.add(ast.unparse(node))
    return found


def test_what_windows_lacks_is_used_behind_a_test_only() -> None:
    words = "|".join(rf"\b{word}\b" for word in (*POSIX_MODULES, *set().union(*POSIX_NAMES.values())))
    assert {file: names for file, tree in modules(words) if (names := posix_names(tree))} == GUARDED


def test_text_files_have_the_same_bytes_everywhere() -> None:
    """Every text file states its encoding, and is written with line ends of LF; no command is run by a shell."""
    faults = []
    for file, tree in modules(r"\bopen\(|\.(read|write)_text\(|\bshell=|\bos\.(system|popen)\("):
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            name, given = ast.unparse(call.func), {word.arg for word in call.keywords}
            place = f"{file}:{call.lineno}: {ast.unparse(call)[:100]}"
            binary = name == "open" and any("b" in ast.unparse(mode) for mode in call.args[1:2])
            if "shell" in given or name in ("os.system", "os.popen"):
                faults.append(f"{place}: by a shell")
            elif ((name == "open" and not binary) or name.endswith(".read_text")) and "encoding" not in given:
                faults.append(f"{place}: no encoding")
            elif name.endswith(".write_text") and len(call.args) == 1 and not given >= {"encoding", "newline"}:
                faults.append(f"{place}: encoding or line ends of the system")
    faults = [fault for fault in faults if "formatter.write_text" not in fault]  # click's help
    assert not faults, "\n".join(faults)


def test_the_main_commands_run_without_what_windows_lacks(tmp_path: Path) -> None:
    code = WITHOUT.format(modules=POSIX_MODULES, names=POSIX_NAMES["os"], signals=POSIX_NAMES["signal"] - {"SIGKILL"})
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    assert "all comparisons pass" in done.stdout
    written = [file for file in tmp_path.rglob("*") if file.suffix in (".c", ".h", ".json", ".md", ".yaml", ".urdf")]
    assert len(written) > 10
    assert not [file for file in written if b"\r" in file.read_bytes()]
