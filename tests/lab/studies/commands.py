"""The command of a study beside the function: what it prints, and the files that both write."""

import json

from rrrgen.cli.main import run


def printed_json(capsys, *words):
    """The exit code of a command with ``--json``, and what it printed."""
    code = run([*map(str, words), "--json"])
    printed = capsys.readouterr()
    assert printed.out, printed.err
    return code, json.loads(printed.out)


def assert_same_files(folder, other, but=()):
    """Two run folders hold the same files, those called ``but`` excepted in their content."""
    listed = [{file.relative_to(place) for file in place.rglob("*") if file.is_file()} for place in (folder, other)]
    assert listed[0] == listed[1]
    assert listed[0]
    for file in listed[0]:
        assert file.name in but or (folder / file).read_bytes() == (other / file).read_bytes(), file
