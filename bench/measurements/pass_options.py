"""What the options of the passes are worth: operations and time over the bundled robots, one option changed at a time.

    python -m bench.measurements.pass_options [ROBOT ...]

prints for every change the operations of all functions together, relative to the options as they are, the largest
change of one function, and the time. The comments beside the options in ``rrrgen/optimize`` quote this table.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import click

from rrrgen.derive import derive_model
from rrrgen.derive.derived_model import DerivedModel, RecordedModel
from rrrgen.optimize.choosing import Weights
from rrrgen.optimize.expansion import Cutting
from rrrgen.optimize.optimizer import Optimizer
from rrrgen.pipeline import without_collection
from rrrgen.program import count_operations
from rrrgen.robotfile import bundled_names, load_spec


def variants() -> Iterator[tuple[str, Optimizer]]:
    """A name for every change, and the optimizer that has it."""
    usual = Optimizer()
    yield "as it is", usual
    chosen = usual.cheapest

    def changed(**options: object) -> Optimizer:
        return replace(usual, cheapest=replace(chosen, **options))  # type: ignore[arg-type]

    for cutting in Cutting:
        if cutting is Cutting.LOCAL:
            yield "no local expansion", changed(largest={**chosen.largest, cutting: 0})
            continue
        for factor in (0, 0.5, 2):
            largest = {**chosen.largest, cutting: int(factor * chosen.largest[cutting])}
            yield f"largest {cutting.name} x {factor}", changed(largest=largest)
    for ratio in (1.0, 1.1, 1.2, 1.3, 1.5, 3.0):
        yield f"hopeless {ratio}", changed(hopeless=dict.fromkeys(Cutting, ratio))
    for ways in (1, 3):
        yield f"expanded ways {ways}", changed(expanded_ways=ways)
    for terms in (50, 200):
        yield f"max terms {terms}", changed(max_terms=terms)
    for pairs in (750, 3000):
        yield f"max pairs {pairs}", changed(max_pairs=pairs)
    for sincos in (10, 20, 80):
        yield f"weight of an angle {sincos}", changed(cost=Weights(sincos=sincos))
    for div in (0, 20):
        yield f"weight of a division {div}", changed(cost=Weights(div=div))
    for short in (0, 60, 230):
        yield f"chain rule up to {short}", replace(usual, short=short)
    for share in (0.0, 0.6, 0.9, 1.0):
        yield f"stripped {share}", replace(usual, stripped=share)


def operations(derived: DerivedModel) -> dict[str, int]:
    """Operations of every function; an angle counts as 40."""
    cost = Weights()
    return {f"{derived.name}.{name}": cost(program)[0] for name, program in derived.programs.items()}


@without_collection()
def measured(recorded: Sequence[RecordedModel], optimizer: Optimizer) -> tuple[dict[str, int], float]:
    """Cost of every function of every robot, and the processor time it took."""
    start = time.process_time()
    found: dict[str, int] = {}
    for model in recorded:
        found |= operations(optimizer(model))
    return found, time.process_time() - start


def main(robots: Sequence[str]) -> None:
    """Print the table."""
    recorded = [derive_model(load_spec(name)) for name in robots]
    programs = [way for model in recorded for ways in model.alternatives.values() for way in ways]
    click.echo(f"{', '.join(robots)}: {sum(count_operations(way).total for way in programs)} operations as recorded")
    usual: dict[str, int] = {}
    for name, optimizer in variants():
        found, seconds = measured(recorded, optimizer)
        usual = usual or found
        total = sum(found.values()) / sum(usual.values())
        ratios = {function: found[function] / usual[function] for function in found if usual[function]}
        worst, best = max(ratios, key=ratios.__getitem__), min(ratios, key=ratios.__getitem__)
        changed = sum(ratio != 1 for ratio in ratios.values())
        line = f"{name:32} {100 * (total - 1):+7.3f} %  {seconds:6.1f} s  {changed:3} changed"
        if changed:
            line += f"  {ratios[best]:.3f} {best}, {ratios[worst]:.3f} {worst}"
        click.echo(line)


if __name__ == "__main__":
    main(sys.argv[1:] or bundled_names())
