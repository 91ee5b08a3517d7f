"""Documents of YAML: what is read a second time is what was read the first time."""

from rrrgen.base.yamltext import document
from rrrgen.base.yamltext.document import FaultList, parse_document


def parsed(text):
    return parse_document(text, FaultList("robot.yaml", text))


def test_a_text_is_parsed_once_and_read_as_before(monkeypatch):
    text = "name: arm\njoints: [{a: 1}, &one {a: 2}, *one]\n"
    first = parsed(text)
    monkeypatch.setattr("ruamel.yaml.YAML.parse", None)
    again = parsed(text)
    assert again == first
    assert again is not first
    for number in range(document.LATEST + 3):
        monkeypatch.undo()
        parsed(f"name: arm{number}\n")
    assert len(document._latest) == document.LATEST
