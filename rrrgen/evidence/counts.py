"""Counted instructions and stack of compiled functions: the longest path through the machine code, the deepest calls.

Emitted model functions have no loops, so the machine code of one, with the functions that it calls, is a graph without
cycles. The most instructions that a call can execute are the longest path from its entry to a return, by the recursion

    longest(a) = cost(a) + max over the successors of a,  cost(a) = 1, and for a call 1 + longest(entry of the callee)

over the instructions that objdump lists. Nothing is run. Paths that call the C library are left out, because nothing
bounds them; in model functions these are the paths of angles beyond the range of the sine kernel. A function that has a
loop, a jump through a table, or no other path than one through the C library has no figure, and the reason is stated.
Instructions are not cycles: they bound no execution time.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from rrrgen.base.files import Contents
    from rrrgen.emit import Real


@dataclass(frozen=True)
class Processor:
    """A processor with the compiler and the disassembler for it; ``single_only`` if it computes double by calls."""

    name: str
    compiler: tuple[str, ...]
    objdump: str
    single_only: bool = False

    @property
    def missing(self) -> list[str]:
        """The tools that are not installed."""
        return [tool for tool in (self.compiler[0], self.objdump) if shutil.which(tool) is None]


FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-reorder-blocks-and-partition", "-fno-jump-tables")
"""Flags of every compilation; the certificate states them."""

PROCESSORS = (
    Processor("x86-64", ("gcc", "-march=x86-64"), "objdump"),
    Processor(
        "Cortex-M4F",
        ("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        "arm-none-eabi-objdump",
        single_only=True,
    ),
)


class Instruction(NamedTuple):
    """One instruction: the addresses it may continue at, whether it may return, and the function that it calls."""

    successors: tuple[int, ...]
    returns: bool
    callee: str | None
    indirect: bool = False


class NoPathError(ValueError):
    """The longest path of a function is not known; the message says why."""


# -- machine code ----------------------------------------------------------------------------------------------------

_FUNCTION = re.compile(r"^([0-9a-f]+) <([^>]+)>:$")
_LINE = re.compile(r"^\s*([0-9a-f]+):\s+(\S+)\s*(.*)$")
_RELOCATION = re.compile(r"^\s+[0-9a-f]+: R_\w+\s+(\S+?)(?:[-+]0x[0-9a-f]+)?$")
_PLACE = re.compile(r"([0-9a-f]+) <([^>+]+)(?:\+0x[0-9a-f]+)?>")

_CONDITION = "eq|ne|cs|hs|cc|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le"
_RETURN_X86 = re.compile(r"^(rep[z]? )?ret\w*$")
_RETURN_ARM = re.compile(
    rf"^(bx({_CONDITION})?\s+lr|(pop|ldmia|ldm)({_CONDITION})?(\.w)?\s.*\bpc\}}|ldr({_CONDITION})?(\.w)?\s+pc,)"
)
_BRANCH_ARM = re.compile(rf"^b({_CONDITION})?(\.n|\.w)?$")


def disassemble(processor: Processor, file: Path) -> dict[str, dict[int, Instruction]]:
    """The functions of an object file: name -> address -> instruction."""
    command = [processor.objdump, "-dr", "--no-show-raw-insn", file.name]
    text = subprocess.run(command, cwd=file.parent, capture_output=True, text=True, check=True).stdout
    functions: dict[str, list[tuple[int, str, str, str | None]]] = {}
    name = ""
    for line in text.splitlines():
        if heading := _FUNCTION.match(line):
            name = heading[2]
            functions[name] = []
        elif (relocation := _RELOCATION.match(line)) and name and functions[name]:
            functions[name][-1] = (*functions[name][-1][:3], relocation[1])
        elif (row := _LINE.match(line)) and name:
            functions[name].append((int(row[1], 16), row[2], row[3], None))
    return {name: _instructions(name, rows) for name, rows in functions.items()}


def _instructions(name: str, rows: list[tuple[int, str, str, str | None]]) -> dict[int, Instruction]:
    following = dict(zip([row[0] for row in rows], [row[0] for row in rows[1:]], strict=False))
    return {
        address: _instruction(name, operation, operands, symbol, following.get(address))
        for address, operation, operands, symbol in rows
    }


def _instruction(name: str, operation: str, operands: str, symbol: str | None, following: int | None) -> Instruction:
    """Read one line of the listing of the function ``name``; ``symbol`` is what the linker puts in."""
    onwards = () if following is None else (following,)
    if _RETURN_X86.match(operation) or _RETURN_ARM.match(f"{operation} {operands}"):
        conditional = re.search(rf"^(bx|pop|ldmia|ldm|ldr)({_CONDITION})", operation) is not None
        return Instruction(onwards if conditional else (), True, None)
    place = _PLACE.search(operands)
    if operation in ("call", "bl", "blx"):
        callee = symbol or (place[2] if place else None)
        return Instruction(onwards, False, callee, callee is None)
    branch = _BRANCH_ARM.match(operation)
    always = operation == "jmp" or (branch is not None and branch[1] is None)
    if not (always or branch or operation in ("cbz", "cbnz") or re.match(r"^j[a-z]+$", operation)):
        return Instruction(onwards, False, None, operation in ("tbb", "tbh"))
    if place is None:
        return Instruction((), False, None, True)
    elsewhere = symbol if symbol is not None else place[2] if place[2] != name else None
    if elsewhere is not None:  # the last call of a function, which returns for it
        return Instruction(() if always else onwards, True, elsewhere)
    return Instruction((int(place[1], 16), *(() if always else onwards)), False, None)


class LongestPaths:
    """The longest path of every function among the ``functions`` of one or more object files."""

    def __init__(self, functions: Mapping[str, Mapping[int, Instruction]]) -> None:
        self.functions = functions
        self._known: dict[str, int | NoPathError] = {}

    def of(self, name: str) -> int:
        """The most instructions of one call; raises NoPathError."""
        if name not in self._known:
            self._known[name] = NoPathError("recursion")
            try:
                self._known[name] = self._longest(name)
            except NoPathError as reason:
                self._known[name] = reason
        known = self._known[name]
        if isinstance(known, NoPathError):
            raise known
        return known

    def _longest(self, name: str) -> int:
        """Depth first, a successor before what leads to it; -1 marks instructions from which no path returns."""
        code = self.functions[name]
        length: dict[int, int] = {}
        entered: set[int] = set()
        waiting = [min(code)]
        while waiting:
            address = waiting[-1]
            if address in length:
                waiting.pop()
                continue
            instruction = code[address]
            if instruction.indirect:
                raise NoPathError("a jump or call through a table")
            if address not in entered:
                entered.add(address)
                ahead = [successor for successor in instruction.successors if successor not in length]
                if any(successor in entered for successor in ahead):
                    raise NoPathError("a loop")
                waiting += ahead
                continue
            waiting.pop()
            rest = [length[successor] for successor in instruction.successors]
            if instruction.returns:
                rest.append(0)
            longest = max(rest, default=-1)
            cost = self._cost(instruction)
            length[address] = -1 if longest < 0 or cost is None else longest + cost
        if length[min(code)] < 0:
            raise NoPathError("every path calls the C library")
        return length[min(code)]

    def _cost(self, instruction: Instruction) -> int | None:
        """Instructions that it stands for; None for a call of the C library."""
        if instruction.callee is None:
            return 1
        return 1 + self.of(instruction.callee) if instruction.callee in self.functions else None


def deepest(name: str, functions: Mapping[str, Mapping[int, Instruction]], frames: Mapping[str, int]) -> int:
    """Bytes of stack of a function and the deepest chain of its callees, without those of the C library."""
    called = {code.callee for code in functions[name].values() if code.callee is not None and code.callee in functions}
    return frames.get(name, 0) + max((deepest(callee, functions, frames) for callee in called - {name}), default=0)


# -- counts of emitted files -----------------------------------------------------------------------------------------


class Count(NamedTuple):
    """Counts of one function: instructions of the longest path, or the reason why there is none; bytes of stack."""

    instructions: int | str
    stack: int


def count_instructions(processor: Processor, files: Mapping[str, Contents], directory: Path) -> dict[str, Count]:
    """Compile the C sources among ``files`` in ``directory`` for a processor; counts by the name of the C function."""
    functions: dict[str, dict[int, Instruction]] = {}
    frames: dict[str, int] = {}
    for path, text in files.items():
        if "/" not in path and path.endswith((".c", ".h")) and isinstance(text, str):
            (directory / path).write_text(text, encoding="utf-8", newline="\n")
    for path in sorted(files):
        if "/" in path or not path.endswith(".c") or "selftest" in path:
            continue
        stem = Path(path).stem
        command = [*processor.compiler, *FLAGS, "-fstack-usage", "-c", path, "-o", f"{stem}.o"]
        subprocess.run(command, cwd=directory, check=True, capture_output=True)
        functions |= disassemble(processor, directory / f"{stem}.o")
        for line in (directory / f"{stem}.su").read_text(encoding="utf-8").splitlines():
            place, size, _ = line.split("\t")
            frames[place.split(":")[-1]] = int(size)
    paths = LongestPaths(functions)
    counts = {}
    for name in functions:
        try:
            instructions: int | str = paths.of(name)
        except NoPathError as reason:
            instructions = str(reason)
        counts[name] = Count(instructions, deepest(name, functions, frames))
    return counts


def not_applicable(real: Real) -> list[tuple[str, str]]:
    """Targets for which code in ``real`` has no longest path by its nature, each with the reason."""
    reason = (
        "it has no arithmetic in double: every operation is a call of the compiler's library, whose division loops, so "
        "that no path is longest; `--real float` has the counts"
    )
    return [(f"instructions on {t.name}", reason) for t in PROCESSORS if t.single_only and real == "double"]


def counts_entry(
    robot: str, functions: Iterable[str], files: Mapping[str, Contents], real: Real
) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """The certificate's entry about instructions and stack of the model ``functions``; what was not counted and why."""
    skipped: list[tuple[str, str]] = []
    by_processor: dict[str, dict[str, Count]] = {}
    for processor in (candidate for candidate in PROCESSORS if not (candidate.single_only and real == "double")):
        if processor.missing:
            skipped.append((f"instructions on {processor.name}", f"not installed: {', '.join(processor.missing)}"))
        else:
            with tempfile.TemporaryDirectory(prefix="rrrgen-counts-") as folder:
                by_processor[processor.name] = count_instructions(processor, files, Path(folder))
    if not by_processor:
        return {}, skipped
    rows = []
    for function in functions:
        row: list[Any] = [function]
        for counts in by_processor.values():
            count = counts[f"{robot}_{function}"]
            row += [count.instructions if isinstance(count.instructions, int) else f"none: {count.instructions}"]
            row += [count.stack]
        rows.append(row)
    entry = {
        "summary": f"Longest path through the machine code of gcc {' '.join(FLAGS)}, without paths that call the C "
        "library (angles beyond the range of the sine kernel), and bytes of stack of the deepest chain of calls. These "
        "are instructions, not cycles.",
        "headings": ["function", *(f"{what}, {name}" for name in by_processor for what in ("instructions", "stack"))],
        "rows": rows,
    }
    return {"instructions": entry}, skipped
