"""Checks the mappings of a file against their key tables: unknown, duplicate, missing and empty keys."""

from __future__ import annotations

from itertools import pairwise

from rrrgen.base.yamltext.advice import comma_advice, key_cut_by_comma, number_cut_by_comma
from rrrgen.base.yamltext.document import FaultList, Mapping, Node, Scalar, Sequence
from rrrgen.base.yamltext.keys import Format, Key
from rrrgen.base.yamltext.suggest import did_you_mean, nearest


def describe(node: Node) -> str:
    """Describe a node in a message: ``'its text'``, ``nothing``, ``a list`` or ``a mapping``."""
    if isinstance(node, Scalar):
        return "nothing" if node.is_null else f"'{shorten(node.text)}'"
    return "a list" if isinstance(node, Sequence) else "a mapping"


def shorten(text: str, width: int = 40) -> str:
    """Shorten ``text`` to one line of at most ``width`` characters, with ``...`` where it is cut."""
    text = " ".join(text.split())
    return text if len(text) <= width else text[: width - 3] + "..."


def read_entries(node: Node, what: str, faults: FaultList) -> dict[str, tuple[Scalar, Node]] | None:
    """The entries of a mapping as key text -> (key node, value node); a fault and None if ``node`` is not a mapping.

    Duplicate keys and keys that are not plain words are faults; the first of several equal keys is kept.
    """
    if not isinstance(node, Mapping):
        faults.error(
            node, f"{what} is {describe(node)}, not a mapping", "write {key: value, ...} or indented key: value"
        )
        return None
    entries: dict[str, tuple[Scalar, Node]] = {}
    for place, (key, value) in enumerate(node.entries):
        if not isinstance(key, Scalar):
            faults.error(key, f"{describe(key)} as a key of {what}", "keys are plain words")
        elif number := key_cut_by_comma(node, place):
            faults.error(key, f"unknown key '{shorten(key.text)}' in {what}", comma_advice(number))
        elif key.text in entries:
            first = entries[key.text][0].place
            faults.error(key, f"duplicate key '{shorten(key.text)}'", f"first given at line {first.line}")
        else:
            entries[key.text] = (key, value)
    return entries


def read_section(node: Node, section: str, what: str, faults: FaultList, form: Format) -> dict[str, Node] | None:
    """The values of a mapping by key, checked against the key table ``section`` of the file format ``form``.

    Unknown, missing and empty keys are faults; keys without a value are left out. None if ``node`` is not a mapping. A
    misspelt key that is required is one fault, not two: its value is read as that of the key that was meant.
    """
    entries = read_entries(node, what, faults)
    if entries is None:
        return None
    table = {key.name: key for key in form.sections[section]}
    values: dict[str, Node] = {}
    for name, (key, value) in list(entries.items()):
        if name not in table:
            faults.error(key, f"unknown key '{shorten(name)}' in {what}", _unknown_hint(name, table, form))
            meant = nearest(name, table, _synonyms(table, form))
            if meant is not None and table[meant].required and meant not in entries:
                entries[meant] = (key, value)
                values[meant] = value
        elif isinstance(value, Scalar) and value.is_null and table[name].kind != "mapping":
            faults.error(key, f"'{name}' has no value", table[name].meaning)
        else:
            values[name] = value
    for name, required in table.items():
        if required.required and name not in entries:
            faults.error(node, f"{what} needs the key '{name}'", _required_hint(required, form))
    return values


def _unknown_hint(name: str, table: dict[str, Key], form: Format) -> str:
    if name == "<<":
        return "merge keys are not supported; write the keys out"
    allowed = f"allowed are {', '.join(table)}"
    suggestion = did_you_mean(name, table, _synonyms(table, form))
    return f"{suggestion} {allowed}" if suggestion else allowed


def _synonyms(table: dict[str, Key], form: Format) -> dict[str, str]:
    """Words of other formats for the keys of ``table``."""
    return {word: key for word, key in form.aliases.items() if key in table}


def _required_hint(key: Key, form: Format) -> str:
    if key.choices:
        return f"{key.name}: {' | '.join(key.choices)} ({key.meaning})"
    if key.kind == "mapping":
        parts = [
            f"{inner.name}: {' | '.join(inner.choices) or '...'}"
            for inner in form.sections[key.section]
            if inner.required
        ]
        return f"{key.name}: {{{', '.join(parts)}}} ({key.meaning})"
    return f"{key.name}: {key.meaning}"


def read_text(node: Node, what: str, faults: FaultList) -> str:
    """The stripped text of a scalar; a fault and an empty string for a list or mapping."""
    if isinstance(node, Scalar):
        return "" if node.is_null else node.text.strip()
    faults.error(node, f"{what} is {describe(node)}, not text", "put the text in quotes")
    return ""


def read_choice(node: Node, key: Key, faults: FaultList) -> str | None:
    """One of the words in ``key.choices``; a fault and None for anything else."""
    if isinstance(node, Scalar) and node.text in key.choices:
        return node.text
    word = node.text if isinstance(node, Scalar) else ""
    hint = did_you_mean(word, key.choices) if word else ""
    allowed = "allowed is " if len(key.choices) == 1 else "allowed are "
    hint = f"{hint} {allowed}{', '.join(key.choices)}".strip()
    faults.error(node, f"{key.name}: {describe(node)} is not allowed", hint)
    return None


def read_choices(node: Node, key: Key, faults: FaultList) -> tuple[str, ...]:
    """Read a list of different words, each one of ``key.choices``; other words are faults and left out."""
    chosen: dict[str, None] = {}
    for item in read_list(node, key.name, None, faults) or ():
        word = read_choice(item, key, faults)
        if word in chosen:
            faults.error(item, f"{key.name}: '{word}' stands twice", "name each once")
        elif word is not None:
            chosen[word] = None
    return tuple(chosen)


def read_list(node: Node, what: str, length: int | None, faults: FaultList) -> list[Node] | None:
    """The items of a list, which must have ``length`` entries unless that is None; a fault and None otherwise."""
    if not isinstance(node, Sequence):
        faults.error(node, f"{what} is {describe(node)}, not a list", f"write [{', '.join('...' for _ in range(3))}]")
        return None
    if length is not None and len(node.items) != length:
        hint = f"{what} takes {length} values"
        if len(node.items) > length:
            hint += _decimal_commas(node.items, len(node.items) - length)
        faults.error(node, f"{what} has {len(node.items)} values instead of {length}", hint)
        return None
    return node.items


def _decimal_commas(items: list[Node], surplus: int) -> str:
    """Hint for a list that has ``surplus`` entries too many because its numbers were written with decimal commas."""
    pairs = list(pairwise(items))
    cut = [number_cut_by_comma(*pair) for pair in pairs]
    tight = [
        number if right.place.column == left.place.column + len(left.text) + 1 else None
        for number, (left, right) in zip(cut, pairs, strict=True)
        if isinstance(left, Scalar)
    ]
    meant = [number for number in tight if number]
    if len(meant) == surplus:
        return "; " + (comma_advice(meant[0]) if surplus == 1 else f"decimal comma? write {' and '.join(meant)}")
    return "; decimal comma? numbers are written with a point" if any(cut) else ""
