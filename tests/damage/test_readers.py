"""Damaged files of every format: read, or refused with exit code 3 or 4; never a fault of rrrgen, never a crash.

``RRRGEN_FUZZ=3000 pytest tests/damage/test_readers.py`` damages 3000 files of every format; an ordinary run a few.
Input k of a reader is the same in every run, and an input that fails is left beside the sound file, under ``failed``.
"""

from __future__ import annotations

import os
import random
import re
import time
import traceback

import pytest

from .mutations import damaged
from .readers import READERS, WHOLE_FILE, Reader, outcome

COUNT = int(os.environ.get("RRRGEN_FUZZ", "0"))
FIRST = int(os.environ.get("RRRGEN_FUZZ_FROM", "0"))
FEW, FEW_NATIVE = 20, 12
ALLOWED = (0, 3, 4)
SLOWEST = 30.0  # s, for files of some kilobytes


@pytest.fixture(params=READERS, ids=lambda reader: reader.name)
def prepared(request, tmp_path):
    reader: Reader = request.param
    reader.make(tmp_path)
    return reader, tmp_path


def test_a_sound_file_is_read(prepared):
    reader, folder = prepared
    assert outcome(reader, folder) == (0, "")


def test_a_damaged_file_is_read_or_refused(prepared):
    reader, folder = prepared
    sound = (folder / reader.file).read_bytes()
    failures, codes = [], set()
    for k in range(FIRST, FIRST + (COUNT or (FEW_NATIVE if reader.native else FEW))):
        data = damaged(sound, random.Random(f"{reader.name} {k}"), reader.text)
        (folder / reader.file).write_bytes(data)
        start = time.monotonic()
        try:
            code, message = outcome(reader, folder)
        except Exception:
            code, message = 70, traceback.format_exc(limit=-3)
        codes.add(code)
        if code == 3 and reader.name != "experiment YAML" and str(folder) not in message:
            failures.append((k, "the message does not name the file", message))
        if code == 3 and reader.located and not is_located(message):
            failures.append((k, "the message names no place in the file", message))
        if code not in ALLOWED or time.monotonic() - start > SLOWEST:
            failures.append((k, f"exit code {code} after {time.monotonic() - start:.1f} s", message))
        if failures and failures[-1][0] == k:
            (folder / "failed").mkdir(exist_ok=True)
            (folder / "failed" / f"{k}-{reader.file}").write_bytes(data)
    assert not failures, f"{len(failures)} of {reader.name} in {folder / 'failed'}:\n" + "\n".join(
        f"{k}: {what}: {message}" for k, what, message in failures[:20]
    )
    assert 3 in codes, "no damage was noticed"


def is_located(message: str) -> bool:
    """Whether every error names a line and a column, or is about the file as a whole."""
    errors = [line for line in message.splitlines() if ": error: " in line]
    return bool(errors) and all(
        re.search(r":[1-9]\d*:[1-9]\d*: error: ", line) or any(whole in line for whole in WHOLE_FILE) for line in errors
    )


@pytest.mark.parametrize("reader", [r for r in READERS if not r.text], ids=lambda reader: reader.name)
def test_a_file_cut_off_anywhere_is_refused(reader, tmp_path):
    reader.make(tmp_path)
    sound = (tmp_path / reader.file).read_bytes()
    for part in (0.0, 0.03, 0.4, 0.8, 0.99):
        (tmp_path / reader.file).write_bytes(sound[: int(part * len(sound))])
        code, message = outcome(reader, tmp_path)
        assert code == 3, part
        assert reader.file in message
