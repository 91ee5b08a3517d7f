"""Damage as it happens to files, and as an attacker would do it: bits, numbers, cuts, repeats, swaps, wrong words."""

from __future__ import annotations

import random
import struct

NUMBERS = [
    struct.pack(form, value)
    for form, values in {
        "<b": (0, -1, 127, -128),
        "<h": (-1, 0x7FFF, -0x8000),
        "<i": (-1, 0x7FFFFFFF, -0x80000000, 10**9),
        "<q": (-1, 2**63 - 1, 10**12, 2**40),
        ">q": (10**12, 2**40),
        "<d": (float("nan"), float("inf"), 1e308, -1e300, 5e-324),
    }.items()
    for value in values
]
WORDS = (
    *("~", "null", "''", "[]", "{}", "- ", ": ", "!!python/object", "&a", "*a", "true", "deg", "N*m", "[0.4, ~]"),
    *("nan", "inf", "-inf", "1e999", "1e-400", "-1", "0", "1/0", "pi", "10**9", "9" * 40, "1_0", "0x10", "１", "é"),
    *("\ud800", "\x00", "\u2028", "\x85", "\ufeff", '"', "'", "\t", *"[]{}(),;#?|>%@"),
)

WORD_ENDS = b' \n,:;[]{}"<>='


def damaged(data: bytes, rng: random.Random, text: bool = False) -> bytes:
    """``data`` with one to six faults; most of them few, so that they get past the first checks."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        fault = rng.choice(_OF_TEXT if text else _OF_BYTES)
        fault(out, rng)
    return bytes(out)


def _place(out: bytearray, rng: random.Random) -> int:
    """Anywhere, and every second time in the first or last 512 bytes, where formats keep their headers."""
    if not out:
        return 0
    if rng.random() < 0.5:
        near = rng.randrange(min(512, len(out)))
        return near if rng.random() < 0.5 else len(out) - 1 - near
    return rng.randrange(len(out))


def _flip(out: bytearray, rng: random.Random) -> None:
    if out:
        out[_place(out, rng)] ^= 1 << rng.randrange(8)


def _byte(out: bytearray, rng: random.Random) -> None:
    if out:
        out[_place(out, rng)] = rng.randrange(256)


def _number(out: bytearray, rng: random.Random) -> None:
    number = rng.choice(NUMBERS)
    at = _place(out, rng)
    out[at : at + len(number)] = number


def _cut(out: bytearray, rng: random.Random) -> None:
    del out[_place(out, rng) :]


def _drop(out: bytearray, rng: random.Random) -> None:
    at = _place(out, rng)
    del out[at : at + rng.choice((1, 4, 16, 300))]


def _repeat(out: bytearray, rng: random.Random) -> None:
    at, to = _place(out, rng), _place(out, rng)
    out[to:to] = out[at : at + rng.choice((1, 8, 64, 1000))]


def _zero(out: bytearray, rng: random.Random) -> None:
    at = _place(out, rng)
    size = min(rng.choice((8, 64, 512)), len(out) - at)
    out[at : at + size] = bytes(size)


def _swap(out: bytearray, rng: random.Random) -> None:
    a, b, size = _place(out, rng), _place(out, rng), rng.choice((4, 8, 64))
    one, two = out[a : a + size], out[b : b + size]
    if len(one) == len(two):
        out[a : a + size], out[b : b + size] = two, one


def _word(out: bytearray, rng: random.Random) -> None:
    """Put a word in the place of one, or between two; quotes and angle brackets end those of XML."""
    word = rng.choice(WORDS).encode("utf-8", "surrogatepass")
    at = _place(out, rng)
    end = at
    if rng.random() < 0.7:
        while end < len(out) and out[end] not in WORD_ENDS:
            end += 1
        while at > 0 and out[at - 1] not in WORD_ENDS:
            at -= 1
    out[at:end] = word


def _line(out: bytearray, rng: random.Random) -> None:
    """Repeat, move or drop a line."""
    lines = out.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    line = lines[at]
    if rng.random() < 0.6:
        del lines[at]
    if rng.random() < 0.6:
        lines.insert(to, line)
    out[:] = b"\n".join(lines)


def _encoding(out: bytearray, rng: random.Random) -> None:
    """Another encoding than UTF-8, of the whole file or of one character."""
    if rng.random() < 0.3:
        out[:] = out.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-32", "utf-8-sig")))
    else:
        at = _place(out, rng)
        out[at:at] = "é".encode("latin-1")


_OF_BYTES = (_flip, _flip, _byte, _number, _number, _cut, _drop, _repeat, _zero, _swap)
_OF_TEXT = (_word, _word, _word, _word, _line, _line, _byte, _flip, _cut, _drop, _repeat, _swap, _encoding)
