"""Run folders: complete files or none, taken up again or refused, the same bytes every time."""

import json
import os
import re
import signal

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.base.files import write_file
from rrrgen.base.version import VERSION
from rrrgen.lab.data.run_folder import RunFolder, hash_of, plain


def opened(tmp_path, settings=None, seed=0, fresh=False, text="a"):
    (tmp_path / "input.txt").write_text(text)
    return RunFolder(tmp_path / "run", "identify", {"log": tmp_path / "input.txt"}, settings or {}, seed, fresh)


def status(folder):
    return json.loads((folder.path / "run.json").read_text())["status"]


def test_what_went_in_and_how_it_ended_is_recorded(tmp_path):
    with opened(tmp_path, {"cutoff": 50.0, "kinds": ("a", np.float64(1.5))}, seed=3) as folder:
        assert status(folder) == "running"
    record = json.loads((folder.path / "run.json").read_text())
    assert record["status"] == "finished"
    assert record["seed"] == 3
    assert record["settings"] == {"cutoff": 50.0, "kinds": ["a", 1.5]}
    assert record["inputs"]["log"]["sha256"] == hash_of(tmp_path / "input.txt")
    assert "numpy" in record["versions"]
    for error, told in ((KeyboardInterrupt, "interrupted"), (ValueError, "failed")):
        with pytest.raises(error), opened(tmp_path, {"cutoff": 50.0, "kinds": ("a", 1.5)}, seed=3) as folder:
            raise error
        assert status(folder) == told


def test_finished_stages_are_not_done_again(tmp_path):
    calls = []

    def work():
        calls.append(1)
        return {"x": np.array([1.0, 2.0])}

    with opened(tmp_path) as folder:
        assert folder.stage("first", work) == {"x": [1.0, 2.0]}
    with opened(tmp_path) as folder:
        assert folder.resumed
        assert folder.stage("first", work) == {"x": [1.0, 2.0]}
        assert len(calls) == 1
        folder.checkpoint("first.json").write_text("damaged")
        folder.stage("first", work)
        assert len(calls) == 2


@pytest.mark.parametrize("change", [{"settings": {"a": 1}}, {"seed": 1}, {"text": "b"}])
def test_a_run_of_something_else_is_refused_unless_asked_for(tmp_path, change):
    with opened(tmp_path) as folder:
        folder.write_json("result.json", {"a": 1})
        folder.stage("first", lambda: 1)
    with pytest.raises(InputError, match="other inputs, settings or seed"):
        opened(tmp_path, **change)
    with opened(tmp_path, **change, fresh=True) as folder:
        assert not folder.resumed
        assert not (folder.path / "results" / "result.json").exists()
        assert folder.stage("first", lambda: 2) == 2


def test_a_run_of_another_version_is_refused_and_says_so(tmp_path, monkeypatch):
    with opened(tmp_path) as folder:
        folder.stage("first", lambda: 1)
    digest = folder.digest
    with monkeypatch.context() as patch:
        patch.setattr("rrrgen.lab.data.run_folder.VERSION", "99.1")
        with pytest.raises(InputError, match=rf"with rrrgen {re.escape(VERSION)}, and this is 99\.1"):
            opened(tmp_path)
        with opened(tmp_path, fresh=True) as other:
            assert other.digest != digest
            assert other.stage("first", lambda: 2) == 2


def test_a_folder_with_foreign_files_is_left_alone(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "thesis.tex").write_text("years of work")
    for fresh in (False, True):
        with pytest.raises(InputError, match="holds no run"):
            opened(tmp_path, fresh=fresh)
    assert (tmp_path / "run" / "thesis.tex").read_text() == "years of work"


def test_tables_and_records_read_back_exactly(tmp_path):
    with opened(tmp_path) as folder:
        numbers = np.random.default_rng(0).normal(size=5)
        place = folder.write_csv("t.csv", ("name", "value"), (("a, b", x) for x in numbers))
        assert [float(line.rsplit(",", 1)[1]) for line in place.read_text().splitlines()[1:]] == list(numbers)
        assert place.read_text().splitlines()[1].startswith('"a, b",')
        found = json.loads(folder.write_json("r.json", {"x": numbers, "bad": [np.nan, np.inf]}).read_text())
        assert found["x"] == list(numbers)
        assert found["bad"] == [None, None]


def test_a_file_is_complete_or_absent(tmp_path, monkeypatch):
    import os

    write_file(tmp_path / "a.txt", "before")

    def interrupted(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_file(tmp_path / "a.txt", "after")
    assert (tmp_path / "a.txt").read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_plain_data(tmp_path):
    assert plain({1: (np.int64(2), np.bool_(True), None, {3})}) == {"1": [2, True, None, [3]]}
    with pytest.raises(InputError, match="cannot read"):
        RunFolder(tmp_path / "r", "x", {"log": tmp_path / "none"}, {})


def test_files_have_the_permissions_that_the_umask_leaves(tmp_path):
    before = os.umask(0o027)
    try:
        with opened(tmp_path) as folder:
            folder.write_json("found.json", {"x": 1})
    finally:
        os.umask(before)
    for file in (folder.path / "run.json", folder.path / "results" / "found.json"):
        assert file.stat().st_mode & 0o777 == 0o640


def killed_at(step, action):
    """Run ``action`` in a process that is killed before its ``step``-th rename or removal; False if it has fewer."""
    process = os.fork()
    if not process:
        status, count = 9, 0

        def counting(original):
            def call(*arguments, **options):
                nonlocal count
                count += 1
                if count == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return original(*arguments, **options)

            return call

        try:
            for name in ("replace", "rename", "unlink", "rmdir"):
                setattr(os, name, counting(getattr(os, name)))
            action()
            status = 0
        finally:
            os._exit(status)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code in (0, -signal.SIGKILL)
    return code != 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the run is killed in a forked process")
def test_killed_anywhere_results_never_stand_beside_the_record_of_another_run(tmp_path):
    def run(place, seed):
        with opened(place, seed=seed, fresh=seed == 2) as folder:
            folder.write_json(f"of_{seed}.json", {"seed": seed})
            folder.write_json("common.json", {"seed": seed})

    for step in range(1, 100):
        place = tmp_path / str(step)
        place.mkdir()
        run(place, 1)
        killed = killed_at(step, lambda place=place: run(place, 2))
        record = json.loads((place / "run" / "run.json").read_text())
        seeds = {json.loads(file.read_text())["seed"] for file in (place / "run" / "results").glob("*.json")}
        assert seeds <= {record["seed"]} or record["status"] == "clearing", step
        if record["seed"] == 2:  # resumed without being asked to start over
            with opened(place, seed=2) as folder:
                folder.write_json("common.json", {"seed": 2})
            assert not (place / "run" / "results" / "of_1.json").exists()
        assert not [path for path in (place / "run").rglob(".*") if record["seed"] == 2]
        if not killed:
            break
    assert step > 6


def test_a_run_that_was_killed_at_its_very_beginning_can_be_started_again(tmp_path):
    assert killed_at(1, lambda: opened(tmp_path))
    assert [path.name[:10] for path in (tmp_path / "run").iterdir()] == [".run.json."]
    with opened(tmp_path) as folder:
        assert status(folder) == "running"
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["run.json"]


def test_a_run_that_is_told_to_end_is_interrupted(tmp_path):
    with pytest.raises(SystemExit), opened(tmp_path) as folder:
        raise SystemExit(143)
    assert status(folder) == "interrupted"
