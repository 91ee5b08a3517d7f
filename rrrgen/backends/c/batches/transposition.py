"""Moving vectors of several states between arrays, state by state, and packs, element by element.

A dense array of states holds as many whole registers as a state has elements. Loading those and exchanging their lanes
takes a fifth of the instructions of loading number by number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rrrgen.backends import Real

SIZES = range(2, 9)
"""Elements of a state that are moved so; larger ones take more exchanges than loads."""

WIDTHS = (16, 32, 64)
"""Bytes of a register."""


def transfers(taken: Iterable[int], given: Iterable[int], prefix: str, real_type: str, real: Real) -> str:
    """``<prefix>_pack_in<size>`` for sizes of inputs, ``<prefix>_pack_out<size>`` for those of outputs."""
    bytes_per_number = 8 if real == "double" else 4
    each = [_gather(size, prefix, real_type, bytes_per_number) for size in sorted(taken)]
    each += [_scatter(size, prefix, real_type, bytes_per_number) for size in sorted(given)]
    return "\n".join(each)


def exchanges(wanted: list[tuple[int, int]], names: list[str]) -> str:
    """C for the register whose lane k is lane ``wanted[k][1]`` of register ``wanted[k][0]``."""
    lanes = len(wanted)
    sources = sorted({source for source, _ in wanted})
    value, held = names[sources[0]], {sources[0]}
    if len(sources) == 1:
        return f"PACK_EXCHANGE({value}, {value}, {', '.join(str(place) for _, place in wanted)})"
    for step, source in enumerate(sources[1:]):
        picked = [
            lanes + place if at == source else (place if step == 0 else k) if at in held else k
            for k, (at, place) in enumerate(wanted)
        ]
        value = f"PACK_EXCHANGE({value}, {names[source]}, {', '.join(map(str, picked))})"
        held.add(source)
    return value


def _gather(size: int, prefix: str, real: str, number: int) -> str:
    registers = [f"r{k}" for k in range(size)]

    def dense(lanes: int) -> list[str]:
        flat = [[divmod(lane * size + element, lanes) for lane in range(lanes)] for element in range(size)]
        return [f"to[{element}] = {exchanges(flat[element], registers)};" for element in range(size)]

    return "\n".join(
        [
            f"static inline void {prefix}_pack_in{size}(const {real} *x, long long step, {prefix}_pack *to)",
            "{",
            f"    if (step != {size}) {{",
            f"        for (int element = 0; element < {size}; element++)",
            f"            to[element] = ({prefix}_pack)PACK_GATHER(x + element, step);",
            "        return;",
            "    }",
            f"    {prefix}_pack {', '.join(registers)};",
            *(f"    memcpy(&{name}, x + {k}*PACK_LANES, sizeof {name});" for k, name in enumerate(registers)),
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _scatter(size: int, prefix: str, real: str, number: int) -> str:
    packs = [f"from[{element}]" for element in range(size)]

    def dense(lanes: int) -> list[str]:
        lines = []
        for k in range(size):
            wanted = [divmod(k * lanes + lane, size) for lane in range(lanes)]
            lines.append(f"r = {exchanges([(element, state) for state, element in wanted], packs)};")
            lines.append(f"memcpy(x + {k * lanes}, &r, sizeof r);")
        return lines

    return "\n".join(
        [
            f"static inline void {prefix}_pack_out{size}(const {prefix}_pack *from, {real} *x)",
            "{",
            f"    {prefix}_pack r;",
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _by_width(body: Callable[[int], list[str]], number: int) -> list[str]:
    """What ``body`` gives for the number of lanes of every width of register."""
    lines: list[str] = []
    for k, width in enumerate(WIDTHS):
        lines.append(f"#{'elif' if k else 'if'} PACK_BYTES == {width}")
        lines += [f"    {line}" for line in body(width // number)]
    return [*lines, "#endif"]
