"""Places of unfinished files: what a living process has not finished stays, the rest is cleaned up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from base.killed_runs import NEW, OLD
from rrrgen.base import staging
from rrrgen.base.files import write

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writer is killed in a forked process")


def test_what_a_living_process_has_not_finished_stays(tmp_path):
    place = staging.staging_directory(tmp_path, "out")
    with staging.locked(place):
        write(NEW, tmp_path / "out")
        assert place.exists()
    write(OLD, tmp_path / "out")
    assert not place.exists()


def test_sigterm_cleans_up_at_once(tmp_path):
    """In the middle of generating: at once, without files or staging folders, with the exit code of the signal."""
    program = (
        "import sys, time\n"
        "from rrrgen.base import files as writer\n"
        "def slow(folder, files, fill=writer._fill):\n"
        "    fill(folder, files)\n"
        "    print('filled', flush=True)\n"
        "    time.sleep(30)\n"
        "writer._fill = slow\n"
        "from rrrgen.cli.main import main\n"
        "main(['generate', 'pendulum', '-o', sys.argv[1], '--no-casadi-files', '-j', '1'])\n"
    )
    running = subprocess.Popen([sys.executable, "-c", program, tmp_path / "out"], stdout=subprocess.PIPE)
    assert running.stdout.readline() == b"filled\n"
    assert list(tmp_path.iterdir())
    start = time.monotonic()
    running.terminate()
    assert running.wait() == 128 + signal.SIGTERM
    assert time.monotonic() - start < 5.0
    assert not list(tmp_path.iterdir())
