"""Design of an exciting trajectory: its options, the study and its result."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import require
from rrrgen.base.parallel import CLUSTER
from rrrgen.lab.studies.options import ExperimentOptions, option, with_changes
from rrrgen.lab.studies.results import FigureMaker, Run, StudyResult

if TYPE_CHECKING:
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.check import ExcitationCheck
    from rrrgen.lab.design.design import ExcitationDesign
    from rrrgen.lab.design.fourier_series import FourierTrajectory
    from rrrgen.lab.experiment.experiment_file import Experiment
    from rrrgen.lab.studies.sources import FindingsCallback, ProgressCallback, RobotInput, RobotSource


@dataclass(frozen=True)
class ExciteOptions(ExperimentOptions):
    """Options of the design of an exciting trajectory; None: as the experiment file says."""

    harmonics: int | None = option(None, "Number of harmonics of the Fourier series; default 15.", least=1)
    duration: float | None = option(None, "Period of the motion in seconds; default 10.", unit="s", above=0)
    starts: int | None = option(None, "Number of random starts of the search; default 4.", least=1)
    jobs: int = option(1, "Number of parallel processes.", least=1, flags=("-j", "--jobs"), shown=True, recorded=False)
    cluster: str | None = option(
        None,
        "Address of a Dask scheduler that distributes the work, tcp://HOST:PORT.",
        metavar="ADDRESS",
        recorded=False,
    )

    def of_file(self, joints: int) -> Experiment:
        """The experiment with harmonics, period and starts of these options, for a robot of ``joints`` joints."""
        experiment = super().of_file(joints)
        excitation = dict(experiment.excitation)
        if self.harmonics is not None:
            excitation["harmonics"] = self.harmonics
        if self.duration is not None:
            excitation["base_frequency"] = 1.0 / self.duration
        return replace(
            experiment, excitation=excitation, starts=experiment.starts if self.starts is None else self.starts
        )

    def settings(self) -> dict[str, Any]:
        """What ``run.json`` keeps of the options."""
        return {"harmonics": self.harmonics, "cycle": self.duration, "rate": self.rate, "starts": self.starts}


@dataclass(frozen=True, eq=False, repr=False)
class ExcitationResult(StudyResult):
    """The result of :func:`rrrgen.excite`; ``design`` holds the problem and the results of all starts.

    ``overloads`` are sentences about the joints whose torques, by the robot file, exceed what their drives give.
    """

    design: ExcitationDesign
    overloads: tuple[str, ...] = ()

    @property
    def trajectory(self) -> FourierTrajectory:
        """The exciting trajectory."""
        return self.design.trajectory

    @property
    def check(self) -> ExcitationCheck:
        """Condition number and use of the limits, at the rate of the controller."""
        return self.design.best.check

    def lines(self, width: int | None = None) -> list[str]:
        """The report: the condition number, and the joints whose drives are too weak."""
        columns = self.design.problem.columns
        return [f"condition number {self.check.condition:.4g} with {columns} columns, all limits met", *self.overloads]

    def table(self) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
        """Header and rows of the starts of the search, the best first."""
        rows = [(start.seed, start.check.feasible, float(start.check.condition)) for start in self.design.starts]
        return ("seed", "limits met", "condition number"), list(rows)

    def to_json(self) -> dict[str, Any]:
        """The content of ``excitation.json``."""
        return self.design.to_json()

    def figures(self) -> dict[str, FigureMaker]:
        """The figures: motion, singular_values, convergence."""
        from rrrgen.lab.design.plots import plot_convergence, plot_motion, plot_singular_values

        return {
            "motion": lambda: plot_motion(self.trajectory),
            "singular_values": lambda: plot_singular_values(self.design),
            "convergence": lambda: plot_convergence(self.design),
        }

    def write(self, folder: RunFolder) -> None:
        """Write coefficients (JSON), samples for the controller (CSV) and figures into an open run folder."""
        results = folder.path / "results"
        results.mkdir(parents=True, exist_ok=True)
        self.design.write(results)
        for name in self.figures():
            folder.figure(name, self.plot(name))


def excite(
    robot: RobotSource,
    options: ExciteOptions | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    progress: ProgressCallback | None = None,
    findings: FindingsCallback | None = None,
    **changes: Any,
) -> ExcitationResult:
    """Design an exciting trajectory within the limits of a robot, or of an experiment file.

    The condition number of the regressor is minimised from several random starts, and every limit is checked at the
    rate of the controller.

    Args:
        robot: name of a bundled robot, robot file, ``RobotSpec`` or compiled model.
        options: an :class:`ExciteOptions`; the default options if None.
        folder: run folder to write to, from which an interrupted run is resumed; without, nothing is written.
        fresh: discard the run that the folder holds.
        progress: called as ``progress(done, total, message)``; total is 0 where the end is not known.
        findings: called with warnings of the robot file.
        changes: single options by name, such as ``harmonics=5``.

    Raises:
        InputError: robot or options cannot be used; an OptionError for the options.
        DerivationError: no start meets every limit.
    """
    chosen = with_changes(ExciteOptions, options, changes)
    require("rrrgen experiment excite", "casadi", "matplotlib", *(CLUSTER if chosen.cluster else ()))
    from rrrgen.lab.design.robot import limits_of
    from rrrgen.lab.studies.sources import ignore, robot_input

    arm = robot_input(robot, findings or ignore)
    experiment = chosen.of_file(arm.spec.n)
    settings = {**chosen.settings(), "limits": asdict(limits_of(arm.spec)), **arm.settings}
    run = Run("excite", arm.files | chosen.files(), settings, experiment.seed)
    return run.result(partial(_design, run, arm, experiment, chosen, progress or ignore), folder, fresh)


def _design(
    run: Run,
    arm: RobotInput,
    experiment: Experiment,
    chosen: ExciteOptions,
    progress: ProgressCallback,
    folder: RunFolder | None,
) -> ExcitationResult:
    """Search from all starts; ``folder`` keeps those that are finished."""
    from rrrgen.lab.design.design import design_excitation
    from rrrgen.lab.experiment.setup import overloads, problem_of

    design = design_excitation(
        problem_of(experiment, arm.model),
        experiment.starts,
        seed=experiment.seed,
        jobs=chosen.jobs,
        cluster=chosen.cluster,
        checkpoints=None if folder is None else folder.checkpoint("starts"),
        progress=progress,
    )
    motion = design.trajectory
    too_much = overloads(experiment, arm.model, motion.evaluate, motion.period)
    return ExcitationResult(design, tuple(too_much), run=run)
