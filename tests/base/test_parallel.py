"""Tasks in forked and in new processes. Every test is a process of its own: one with further threads must not fork."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest

from rrrgen.base.errors import InputError
from rrrgen.base.parallel import as_computed

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")

OPENING = '''
import contextlib, os, signal, threading, time
from pathlib import Path
from rrrgen.base.errors import InputError
from rrrgen.base.parallel import parallel_map

first = os.getpid()

def alive():
    """Processes that this one started."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # those of others may end while they are looked at
            if f"PPid:\\t{first}\\n" in (place / "status").read_text():
                found.append(place.name)
    return found
'''


def run(script: str) -> subprocess.CompletedProcess[str]:
    text = OPENING + textwrap.dedent(script)
    return subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False, timeout=60)


def succeeds(script: str) -> None:
    done = run(script)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_results_come_in_order_from_several_processes():
    succeeds("""
        def task(k):
            time.sleep(0.05)
            return k * k, os.getpid()

        results = parallel_map(task, range(12), 3)
        assert [square for square, _ in results] == [k * k for k in range(12)]
        assert len({process for _, process in results}) == 3
        assert not alive()
        """)


def test_a_stream_keeps_its_order():
    succeeds("""
        from rrrgen.base.parallel import ordered_map
        assert list(ordered_map(abs, (-k for k in range(20)), 2)) == list(range(20))
        """)


def test_tasks_are_functions_of_all_that_is_known():
    """What cannot be pickled may go in; only results come out."""
    succeeds("""
        known = threading.Lock()
        tasks = [lambda k=k: (k, known.locked(), "x" * 10**6) for k in range(8)]
        assert [r[:2] for r in parallel_map(lambda task: task(), tasks, 2)] == [(k, False) for k in range(8)]
        """)


@pytest.mark.parametrize(("jobs", "tasks"), [(1, 5), (4, 1), (4, 0)])
def test_one_job_or_task_needs_no_process(jobs, tasks):
    succeeds(f"assert parallel_map(lambda k: os.getpid(), range({tasks}), {jobs}) == [first] * {tasks}")


def test_a_process_with_threads_does_not_fork():
    succeeds("""
        done = threading.Event()
        thread = threading.Thread(target=done.wait)
        thread.start()
        os.fork = None
        assert first not in parallel_map(lambda k: os.getpid(), range(5), 4)
        done.set()
        thread.join()
        """)


def test_an_error_is_raised_and_ends_all_processes():
    done = run("""
        def task(k):
            time.sleep(0.02)
            if k == 1:
                raise ValueError(f"task {k}")
            time.sleep(k > 1)  # this process may have taken it, and then ends it first

        try:
            parallel_map(task, range(3), 3)
        finally:
            assert not alive()
        """)
    assert done.returncode == 1
    assert done.stderr.endswith("ValueError: task 1\n")


def test_what_a_lost_process_had_taken_is_done_again():
    succeeds("""
        def task(k):
            time.sleep(0.02)
            if os.getpid() != first:
                os.kill(os.getpid(), signal.SIGKILL)
            return k

        assert parallel_map(task, range(6), 3) == list(range(6))
        assert not alive()
        """)


def test_an_interrupt_ends_all_processes_without_a_word():
    done = run("""
        signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
        signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        try:
            parallel_map(lambda k: time.sleep(30), range(3), 3)
        except KeyboardInterrupt:
            assert not alive()
            print("interrupted")
        """)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")


@pytest.mark.parametrize("jobs", [1, 3])
def test_every_finished_task_is_told_with_the_number_of_those_done(jobs):
    succeeds(f"""
        told = []
        assert parallel_map(abs, range(10), {jobs}, lambda *step: told.append(step), "taking") == list(range(10))
        assert told == [(k, 10, "taking") for k in range(1, 11)]
        """)


TASKS = """
import os, time

def square(k):
    time.sleep(0.02)
    print("noise on the standard output")
    return k * k, os.getpid()

def dies(first, k):
    time.sleep(0.02)
    if os.getpid() != first:
        os._exit(3)
    return k
"""


@pytest.fixture
def fresh(tmp_path):
    """Run a script, without a guard of its main module, whose processes must be new ones."""
    (tmp_path / "tasks.py").write_text(TASKS, encoding="utf-8")

    def script(text: str) -> subprocess.CompletedProcess[str]:
        file = tmp_path / "script.py"
        start = "import rrrgen.base.parallel, tasks\nrrrgen.base.parallel.may_fork = lambda: False\n"
        file.write_text(OPENING + start + textwrap.dedent(text), encoding="utf-8")
        environment = {**os.environ, "PYTHONPATH": f"{os.environ.get('PYTHONPATH', '')}{os.pathsep}{tmp_path}"}
        return subprocess.run(
            [sys.executable, str(file)], capture_output=True, text=True, check=False, timeout=60, env=environment
        )

    return script


def test_new_processes_share_the_tasks(fresh):
    done = fresh("""
        told = []
        results = parallel_map(tasks.square, range(40), 3, lambda *step: told.append(step), "squaring")
        assert [square for square, _ in results] == [k * k for k in range(40)]
        assert first not in {process for _, process in results}
        assert told == [(k, 40, "squaring") for k in range(1, 41)]
        again = parallel_map(tasks.square, range(40), 3)  # the same processes, which have imported everything
        assert {process for _, process in again} <= {process for _, process in results}
        """)
    assert (done.returncode, "Error" in done.stderr) == (0, False), done.stderr


def test_what_a_lost_new_process_had_taken_is_done_here(fresh):
    done = fresh("""
        from functools import partial
        assert parallel_map(partial(tasks.dies, first), range(6), 3) == list(range(6))
        """)
    assert done.returncode == 0, done.stderr


def test_a_robot_is_generated_by_new_processes(fresh):
    """The same bytes as by one process: every kind of task can be pickled."""
    done = fresh("""
        from rrrgen import load_spec
        from rrrgen.derive import derive
        from rrrgen.emit.package import emit

        spec = load_spec("pendulum")
        files = emit(derive(spec, 2), jobs=2, languages=("cpp", "rust"))
        assert files == emit(derive(spec, 1), languages=("cpp", "rust"))
        """)
    assert done.returncode == 0, done.stderr


def test_a_word_that_is_no_address_of_a_cluster_is_refused_at_once():
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="foo is no address of a Dask scheduler; it is written as tcp://host:port"):
        list(as_computed(abs, [1, 2, 3], cluster="foo"))
