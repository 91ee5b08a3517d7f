"""Libraries of packages: flags of the user, every compiler that is here."""

from __future__ import annotations

import shutil

import pytest

from rrrgen.base.errors import BuildError
from rrrgen.emit.targets.shared_libraries import shared_library, this_machine
from rrrgen.runtime import build


def test_flags_of_the_user_apply_to_wheels_and_fmus(monkeypatch):
    monkeypatch.setenv("RRRGEN_CFLAGS", "-fnot-a-flag")
    with pytest.raises(BuildError, match="refused"):
        shared_library({"a.c": "int a(void) { return 0; }\n"}, this_machine())


"""A program that understands the options of cl as far as they are used, calls gcc, and refuses vector types."""


def test_a_library_is_built_by_every_compiler_that_is_here(monkeypatch, tmp_path):
    monkeypatch.setattr(build, "cache_directory", lambda: tmp_path)
    for name in ("gcc", "clang"):
        if shutil.which(name):
            monkeypatch.setenv("CC", name)
            _, library = build.build_extension(
                {"f.c": f"/* {name} */ int f(void) {{ return 7; }}\n"}, "int f(void);", name
            )
            assert library.f() == 7
