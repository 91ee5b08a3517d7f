"""Transposition between arrays of states and vector registers that hold one element of several states.

The states that fill the lanes occupy, in a dense array, as many whole registers as a state has elements. Loading whole
registers and shuffling their lanes takes a fifth of the instructions of loading single numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rrrgen.emit import Real

SIZES = range(2, 9)
"""Sizes of states that are transposed in registers; larger ones would take more shuffles than loads."""

WIDTHS = (16, 32, 64)
"""Sizes of vector registers in bytes."""


def transfers(taken: Iterable[int], given: Iterable[int], prefix: str, real_type: str, real: Real) -> str:
    """Print the C functions that transpose the elements of states, one for each size of an input or output.

    ``<prefix>_simd_in<size>`` loads the states of an input of a size in ``taken``, ``<prefix>_simd_out<size>`` stores
    those of an output of a size in ``given``.
    """
    bytes_per_number = 8 if real == "double" else 4
    each = [_gather(size, prefix, real_type, bytes_per_number) for size in sorted(taken)]
    each += [_scatter(size, prefix, real_type, bytes_per_number) for size in sorted(given)]
    return "\n".join(each)


def exchanges(wanted: list[tuple[int, int]], names: list[str]) -> str:
    """The C expression of the register whose lane k is lane ``wanted[k][1]`` of the register ``wanted[k][0]``.

    ``names`` are the C variables of the registers.
    """
    lanes = len(wanted)
    sources = sorted({source for source, _ in wanted})
    value, held = names[sources[0]], {sources[0]}
    if len(sources) == 1:
        return f"SIMD_EXCHANGE({value}, {value}, {', '.join(str(place) for _, place in wanted)})"
    for step, source in enumerate(sources[1:]):
        picked = [
            lanes + place if at == source else (place if step == 0 else k) if at in held else k
            for k, (at, place) in enumerate(wanted)
        ]
        value = f"SIMD_EXCHANGE({value}, {names[source]}, {', '.join(map(str, picked))})"
        held.add(source)
    return value


def _gather(size: int, prefix: str, real: str, number: int) -> str:
    registers = [f"r{k}" for k in range(size)]

    def dense(lanes: int) -> list[str]:
        flat = [[divmod(lane * size + element, lanes) for lane in range(lanes)] for element in range(size)]
        return [f"to[{element}] = {exchanges(flat[element], registers)};" for element in range(size)]

    return "\n".join(
        [
            f"static inline void {prefix}_simd_in{size}(const {real} *x, long long step, {prefix}_simd *to)",
            "{",
            f"    if (step != {size}) {{",
            f"        for (int element = 0; element < {size}; element++)",
            f"            to[element] = ({prefix}_simd)SIMD_GATHER(x + element, step);",
            "        return;",
            "    }",
            f"    {prefix}_simd {', '.join(registers)};",
            *(f"    memcpy(&{name}, x + {k}*SIMD_LANES, sizeof {name});" for k, name in enumerate(registers)),
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _scatter(size: int, prefix: str, real: str, number: int) -> str:
    registers = [f"from[{element}]" for element in range(size)]

    def dense(lanes: int) -> list[str]:
        lines = []
        for k in range(size):
            wanted = [divmod(k * lanes + lane, size) for lane in range(lanes)]
            lines.append(f"r = {exchanges([(element, state) for state, element in wanted], registers)};")
            lines.append(f"memcpy(x + {k * lanes}, &r, sizeof r);")
        return lines

    return "\n".join(
        [
            f"static inline void {prefix}_simd_out{size}(const {prefix}_simd *from, {real} *x)",
            "{",
            f"    {prefix}_simd r;",
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _by_width(body: Callable[[int], list[str]], number: int) -> list[str]:
    """The lines of ``body(lanes)`` for every width of register, selected by the preprocessor.

    ``number`` is the size of one number in bytes, 8 or 4, on which the count of lanes depends.
    """
    lines: list[str] = []
    for k, width in enumerate(WIDTHS):
        lines.append(f"#{'elif' if k else 'if'} SIMD_BYTES == {width}")
        lines += [f"    {line}" for line in body(width // number)]
    return [*lines, "#endif"]
