"""Tasks in forked and in new processes. Every test is a process of its own: one with further threads must not fork."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")

OPENING = '''
import contextlib, os, signal, threading, time
from pathlib import Path
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
        assert parallel_map(lambda k: os.getpid(), range(5), 4) == [first] * 5
        done.set()
        thread.join()
        """)


def test_an_error_is_raised_where_it_is_seen():
    done = run("""
        def task(k):
            time.sleep(0.02)
            if k == 5:
                raise ValueError(f"task {k} in {'the first' if os.getpid() == first else 'another'} process")
            return k

        try:
            parallel_map(task, range(8), 3)
        finally:
            assert not alive()
        """)
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.endswith("ValueError: task 5 in the first process\n")


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
        signal.setitimer(signal.ITIMER_REAL, 0.3)
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
        reading, writing = os.pipe()

        def task(k):
            time.sleep(0.01)
            return k

        def tell(done, total, message):
            os.write(writing, bytes([done, total]) + message[:1].encode())

        assert parallel_map(task, range(10), {jobs}, tell, "squaring") == list(range(10))
        os.close(writing)
        told = os.read(reading, 1000)
        assert sorted(told[::3]) == list(range(1, 11))
        assert set(told[1::3]) == {{10}} and told[2::3] == b"s" * 10
        """)


TASKS = """
import os, signal, time

def square(k):
    time.sleep(0.02)
    print("noise on the standard output")
    return k * k, os.getpid()

def fails(k):
    time.sleep(0.02)
    if k == 5:
        raise ValueError(f"task {k}")
    return k

def dies(first, k):
    time.sleep(0.02)
    if os.getpid() != first:
        os._exit(3)
    return k

def sleeps(k):
    time.sleep(30)
"""

FRESH = """
import sys
from functools import partial
sys.path.insert(0, {folder!r})  # new processes find modules where this one does
import rrrgen.base.parallel
import tasks
rrrgen.base.parallel.may_fork = lambda: False
"""


@pytest.fixture
def fresh(tmp_path):
    """Run a script, without a guard of its main module, whose processes must be new ones."""
    (tmp_path / "tasks.py").write_text(TASKS, encoding="utf-8")

    def script(text: str) -> subprocess.CompletedProcess[str]:
        file = tmp_path / "script.py"
        file.write_text(OPENING + FRESH.format(folder=str(tmp_path)) + textwrap.dedent(text), encoding="utf-8")
        return subprocess.run([sys.executable, str(file)], capture_output=True, text=True, check=False, timeout=60)

    return script


def test_new_processes_share_the_tasks(fresh):
    done = fresh("""
        told = []
        results = parallel_map(tasks.square, range(60), 3, lambda *step: told.append(step), "squaring")
        assert [square for square, _ in results] == [k * k for k in range(60)]
        assert len({process for _, process in results}) == 3
        assert told == [(k, 60, "squaring") for k in range(1, 61)]
        again = parallel_map(tasks.square, range(60), 3)  # the same processes, which have imported everything
        assert {process for _, process in again} == {process for _, process in results}
        """)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_new_processes_cannot_do_is_done_here(fresh):
    done = fresh("""
        from rrrgen.base.parallel import fresh
        assert parallel_map(lambda k: os.getpid(), range(6), 3) == [first] * 6
        assert parallel_map(partial(tasks.dies, first), range(6), 3) == list(range(6))
        try:
            parallel_map(tasks.fails, range(8), 3)
        except ValueError as error:
            assert str(error) == "task 5"
        else:
            raise AssertionError
        # a process that was given no task by then has not failed, and waits for the next map
        assert sorted(alive()) == sorted(str(worker._popen.pid) for worker in fresh._idle)
        """)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_interrupt_ends_new_processes(fresh):
    done = fresh("""
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        try:
            parallel_map(tasks.sleeps, range(3), 3)
        except KeyboardInterrupt:
            assert not alive()
            print("interrupted")
        """)
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")


def test_a_robot_is_generated_by_new_processes(fresh):
    """The same bytes as by one process; every kind of task can be pickled, and new processes did some."""
    done = fresh("""
        from collections import Counter
        from rrrgen import load_spec
        from rrrgen.base.parallel import fresh
        from rrrgen.derive import derive
        from rrrgen.emit.package import emit

        received = Counter()
        result = fresh._Worker.result
        def counted(self, index):
            received[self._popen.pid] += 1
            return result(self, index)
        fresh._Worker.result = counted
        spec = load_spec("pendulum")
        model = derive(spec, 2)
        simplified = sum(received.values())
        files = emit(model, jobs=2, languages=("cpp", "rust"))
        assert simplified and sum(received.values()) > simplified
        assert files == emit(derive(spec, 1), languages=("cpp", "rust"))
        """)
    assert (done.returncode, done.stderr) == (0, "")
