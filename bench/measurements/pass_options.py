"""The effect of every option of the passes: operations and time over the bundled robots, one option changed at a time.

    python -m bench.measurements.pass_options [ROBOT ...]

prints for every change the operations of all functions together, relative to the options as they are, the largest
change of one function, and the time. The comments beside the options in ``rrrgen/program/passes`` quote this table.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import click

from rrrgen.base.parallel import without_collection
from rrrgen.derive import derive_model
from rrrgen.derive.derived_model import DerivedModel, RecordedModel
from rrrgen.derive.optimizer import Optimizer
from rrrgen.program import count_operations
from rrrgen.program.passes.cheapest import Weights
from rrrgen.program.passes.rewriting import CutSet
from rrrgen.robot.file import bundled_names, load_spec


def changes() -> Iterator[tuple[str, Optimizer]]:
    """The changes of one option each: a name, and the optimizer with that option."""
    usual = Optimizer()
    yield "as it is", usual
    chosen = usual.cheapest

    def changed(**options: object) -> Optimizer:
        return replace(usual, cheapest=replace(chosen, **options))  # type: ignore[arg-type]

    for cut_set in CutSet:
        if cut_set is CutSet.LOCAL:
            yield "no local expansion", changed(max_operations={**chosen.max_operations, cut_set: 0})
            continue
        for factor in (0, 0.5, 2):
            limits = {**chosen.max_operations, cut_set: int(factor * chosen.max_operations[cut_set])}
            yield f"max operations {cut_set.name} x {factor}", changed(max_operations=limits)
    for ratio in (1.0, 1.1, 1.2, 1.3, 1.5, 3.0):
        yield f"max cost ratio {ratio}", changed(max_cost_ratio=dict.fromkeys(CutSet, ratio))
    for count in (1, 3):
        yield f"expanded variants {count}", changed(expanded_variants=count)
    for terms in (50, 200):
        yield f"max terms {terms}", changed(max_terms=terms)
    for pairs in (750, 3000):
        yield f"max pairs {pairs}", changed(max_pairs=pairs)
    for sincos in (10, 20, 80):
        yield f"weight of an angle {sincos}", changed(cost=Weights(sincos=sincos))
    for div in (0, 20):
        yield f"weight of a division {div}", changed(cost=Weights(div=div))
    for limit in (0, 60, 230):
        yield f"chain rule up to {limit}", replace(usual, max_chain_rule=limit)
    for share in (0.0, 0.6, 0.9, 1.0):
        yield f"search anew below {share}", replace(usual, search_anew_below=share)


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
    """Measure every option of the passes and print the table."""
    recorded = [derive_model(load_spec(name)) for name in robots]
    programs = [program for model in recorded for variants in model.alternatives.values() for program in variants]
    click.echo(f"{', '.join(robots)}: {sum(count_operations(each).total for each in programs)} operations as recorded")
    usual: dict[str, int] = {}
    for name, optimizer in changes():
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
