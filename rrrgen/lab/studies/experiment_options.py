"""Options of designed and simulated experiments, which override the sections of an experiment file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rrrgen.lab.studies.options import StudyOptions, option

if TYPE_CHECKING:
    from rrrgen.lab.experiment.experiment_file import Experiment


@dataclass(frozen=True)
class ExperimentOptions(StudyOptions):
    """What every experiment takes from its file or from options."""

    experiment: Path | None = option(
        None,
        "Experiment file: limits, objective, writing task, virtual robot, control; other options override it.",
        metavar="FILE",
        recorded=False,
    )
    rate: float | None = option(None, "Sampling rate of the controller; default 1000.", unit="Hz", above=0)
    seed: int | None = option(None, "Seed for all random numbers; default 0.", recorded=False)

    def of_file(self, joints: int) -> Experiment:
        """The experiment file, or the defaults, for a robot of ``joints`` joints, with what the options override."""
        from dataclasses import replace

        from rrrgen.lab.experiment.experiment_file import Experiment, load_experiment

        found = Experiment() if self.experiment is None else load_experiment(self.experiment, joints)
        return replace(
            found,
            seed=found.seed if self.seed is None else self.seed,
            period=found.period if self.rate is None else 1.0 / self.rate,
        )

    def files(self) -> dict[str, Path]:
        """The experiment file by its role."""
        return {} if self.experiment is None else {"experiment": self.experiment}
