"""The case study of the chapter on the virtual RRR: excitation, experiment, base parameters, writing task.

Repeats section 14.6 of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion Control,
Robotics and Automation Handbook, CRC Press 2005 ("the chapter"), with simulated data: an exciting trajectory within the
limits of the chapter, an experiment under PD control with a Kalman observer, batch least squares for base parameters
and friction, and validation on a motion that was not fitted. Every stage stores its result in a run folder, from which
an interrupted run is resumed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.kalman import KalmanMatrices, kalman_matrices
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log, read_log
from rrrgen.lab.data.run_folder import RunFolder
from rrrgen.lab.design.design import ExcitationDesign, design_excitation
from rrrgen.lab.design.robot import limits_of, robot_problem
from rrrgen.lab.design.starts import Progress
from rrrgen.lab.experiment.case_study.flexible_dynamics import FlexibleDynamics, FlexibleSettings, flexible_dynamics
from rrrgen.lab.experiment.case_study.joint_friction import JointFriction, JointFrictionSettings, joint_friction
from rrrgen.lab.experiment.writing_task import (
    InverseKinematics,
    JointPath,
    newton_inverse_kinematics,
    solver_inverse_kinematics,
    writing_task,
)
from rrrgen.lab.identify.identification import Identification, Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.scores import common_share, fingerprint
from rrrgen.lab.identify.validation import Thresholds, Validation, column_model, validate_recordings
from rrrgen.robot.friction.models import FrictionModel, coulomb_viscous

BRANCH = (-1.0, -1.5, 2.0)
"""Joint positions (rad) near which the writing task is done, with the elbow down as in the range of Fig. 14.6."""

LARGEST_CONDITION = 1.6
MOST_DEVIATIONS = 3.0
LARGEST_ERROR = 0.01


@dataclass(frozen=True)
class CaseStudySettings:
    """Settings that the chapter does not state, and the effort of the search.

    ``harmonics`` and ``starts`` belong to the search for the exciting trajectory; ``text`` and ``pace`` (relative speed
    of each letter segment) to the writing task; ``viscous``, ``coulomb`` friction (N m s/rad, N m), ``torque_noise`` (N
    m) and ``bandwidth`` (Hz) of the PD control to the virtual robot; ``low_speed`` (rad/s) and ``decimate`` to the
    estimation. ``symmetric_links`` assumes, as the chapter does, that the centres of mass of links 2 and 3 have y = 0,
    which leaves 13 of 15 base parameters. ``period`` (s) is that of the sampling, ``duration`` (s) that of each motion.
    """

    robot: str = "rrr"
    harmonics: int = 15
    starts: int = 4
    text: str = "RRR"
    pace: tuple[float, ...] = (1.0, 0.55)
    viscous: tuple[float, ...] = (1.1, 0.3, 0.2)
    coulomb: tuple[float, ...] = (3.0, 1.5, 0.8)
    torque_noise: tuple[float, ...] = (0.15, 0.08, 0.04)
    bandwidth: float = 4.0
    low_speed: float = 0.05
    decimate: int = 10
    symmetric_links: bool = True
    period: float = 1e-3
    duration: float = 10.0
    seed: int = 1
    flexible: FlexibleSettings = field(default_factory=FlexibleSettings)
    joint_friction: JointFrictionSettings = field(default_factory=JointFrictionSettings)


QUICK = CaseStudySettings(
    harmonics=12,
    starts=1,
    flexible=FlexibleSettings(postures=((0.0, 0.0, 1.5), (0.0, 0.0, 0.0)), periods=7),
    joint_friction=JointFrictionSettings(duration=20.0, laws=("coulomb_viscous", "stribeck")),
)
"""Settings with which every result meets the same limits in about half the time."""


@dataclass(frozen=True, eq=False)
class CaseStudy:
    """All results of the case study, from which its tables and figures are made.

    ``design`` is that of the exciting trajectory, ``observer`` the Kalman filters of the joints, ``path`` the joint
    motion of the writing task by closed-form inverse kinematics, ``recursive`` the iterative inverse kinematics
    compared with it.
    """

    settings: CaseStudySettings
    model: Any
    design: ExcitationDesign
    observer: tuple[KalmanMatrices, ...]
    friction: FrictionModel
    path: JointPath
    recursive: InverseKinematics
    excitation_log: Log
    writing_log: Log
    identification: Identification
    validation: Validation
    flexible: FlexibleDynamics
    joint_friction: JointFriction

    @property
    def truth(self) -> Array:
        """The true values of the identified parameters: those of the virtual robot."""
        values = dict(zip(self.model.base_parameter_names, self.model.beta, strict=True))
        for i, (viscous, coulomb) in enumerate(zip(self.settings.viscous, self.settings.coulomb, strict=True)):
            values |= {f"fv{i + 1}": viscous, f"fc{i + 1}": coulomb}
        return np.array([values[name] for name in self.identification.names])

    @property
    def deviations(self) -> Array:
        """Errors of the identified parameters in units of their reported standard deviations."""
        estimate = self.identification.estimate
        return np.asarray((estimate.x - self.truth) / estimate.std)

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences that name the required accuracies which are missed; empty if the case study passes."""
        problems = [*self.validation.failures, *self.flexible.failures, *self.joint_friction.failures]
        check = self.design.best.check
        if not check.condition <= LARGEST_CONDITION:
            problems.append(f"condition number {check.condition:.3g} exceeds {LARGEST_CONDITION}")
        worst = int(np.argmax(np.abs(self.deviations)))
        if not abs(self.deviations[worst]) <= MOST_DEVIATIONS:
            name = self.identification.names[worst]
            problems.append(f"{name} is {abs(self.deviations[worst]):.2g} standard deviations off")
        return tuple(problems)

    def to_json(self) -> dict[str, Any]:
        """The results as plain data for JSON."""
        check, estimate = self.design.best.check, self.identification.estimate
        rows = zip(self.identification.names, estimate.x, estimate.std, self.truth, self.deviations, strict=True)
        return {
            "passed": not self.failures,
            "failures": list(self.failures),
            "excitation": check.to_json(),
            "parameters": [{"name": n, "estimate": x, "std": s, "truth": p, "deviations": d} for n, x, s, p, d in rows],
            "relative_error_fit": self.identification.fit["relative_error"],
            "indefinite_mass_matrix_share": self.identification.indefinite,
            "validation": self.validation.to_json(),
            "flexible_dynamics": self.flexible.to_json(),
            "joint_friction": self.joint_friction.to_json(),
        }


def run_case_study(
    folder: Path,
    settings: CaseStudySettings | None = None,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> CaseStudy:
    """Run section 14.6 of the chapter on the virtual RRR and write results and figures to ``folder``.

    ``jobs`` processes, or the Dask scheduler at ``cluster``, share the search for the exciting trajectory. An
    interrupted run in the same folder is resumed with the same result. ``progress(done, total, message)`` is called as
    the work proceeds.
    """
    from rrrgen.lab.experiment.case_study.figures import write_figures
    from rrrgen.runtime.load import compile

    chosen = settings if settings is not None else CaseStudySettings()
    with RunFolder(folder, "case-study", {}, asdict(chosen), chosen.seed) as run:
        work = _Work(run, chosen, compile(chosen.robot), jobs, cluster, progress or (lambda *_: None))
        study = work.study()
        work.tell(0, 0, "figures")
        run.write_json("case_study.json", study.to_json())
        write_figures(run, study)
    return study


class _Work:
    """The stages of the case study; each stores its result in the run folder and reads it where it exists already."""

    def __init__(
        self, run: RunFolder, settings: CaseStudySettings, model: Any, jobs: int, cluster: str | None, tell: Progress
    ) -> None:
        self.run, self.settings, self.model = run, settings, model
        self.jobs, self.cluster, self.tell = jobs, cluster, tell
        self.joints = [joint.name for joint in model.spec.joints]
        self.resolution = [joint.drive.encoder_resolution for joint in model.spec.joints]
        self.friction = coulomb_viscous(settings.viscous, settings.coulomb)

    def study(self) -> CaseStudy:
        """Run all stages in order."""
        design = self.excitation()
        observer = self.observer(design)
        path, recursive = self.writing()
        excitation = self.experiment("excitation", design.trajectory.evaluate, observer, self.settings.seed)
        identification = self.identify_parameters(excitation)
        writing = self.experiment("writing", path.evaluate, observer, self.settings.seed + 1)
        self.tell(0, 0, "validation on the writing task")
        validation = self.validate_torques(identification, writing, excitation)
        flexible = flexible_dynamics(
            self.model,
            self.friction,
            self.settings.flexible,
            self.run.path / "results" / "flexible_dynamics",
            self.settings.period,
            self.settings.seed + 2,
            self.tell,
        )
        friction = joint_friction(
            self.model,
            self.friction,
            self.settings.joint_friction,
            self.settings.torque_noise,
            self.run.path / "results",
            self.settings.period,
            self.settings.seed + 3,
            self.tell,
        )
        return CaseStudy(
            settings=self.settings,
            model=self.model,
            design=design,
            observer=observer,
            friction=self.friction,
            path=path,
            recursive=recursive,
            excitation_log=excitation,
            writing_log=writing,
            identification=identification,
            validation=validation,
            flexible=flexible,
            joint_friction=friction,
        )

    def excitation(self) -> ExcitationDesign:
        """An exciting trajectory under the limits of the robot file, (14.24)."""
        settings = self.settings
        problem = robot_problem(
            self.model,
            limits_of(self.model.spec),
            harmonics=settings.harmonics,
            base_frequency=1.0 / settings.duration,
            sample_period=settings.period,
            at_rest=True,
        )
        design = design_excitation(
            problem,
            settings.starts,
            jobs=self.jobs,
            cluster=self.cluster,
            checkpoints=self.run.path / "checkpoints",
            progress=self.tell,
        )
        design.write(self.run.path / "results")
        return design

    def observer(self, design: ExcitationDesign) -> tuple[KalmanMatrices, ...]:
        """Design the Kalman observer of every joint by the chapter's rules.

        The measurement variance is that of the encoder's quantisation, the process variance the largest jerk squared.
        """
        trajectory = design.trajectory
        jerk = np.abs(trajectory.derivative(trajectory.times(self.settings.period), 3)).max(axis=0)
        return tuple(
            kalman_matrices(self.settings.period, step**2 / 12.0, float(top) ** 2)
            for step, top in zip(self.resolution, jerk, strict=True)
        )

    def writing(self) -> tuple[JointPath, InverseKinematics]:
        """The writing task with closed-form inverse kinematics, and the recursive solver with which it is compared."""
        from rrrgen.runtime.inverse_kinematics import load_solver

        settings = self.settings
        task = writing_task(settings.text, duration=settings.duration, pace=settings.pace)
        closed = solver_inverse_kinematics(load_solver(self.model.spec), BRANCH)
        return JointPath(task, self.model, closed), newton_inverse_kinematics(self.model, BRANCH)

    def experiment(
        self,
        name: str,
        reference: Callable[[Array], tuple[Array, Array, Array]],
        observer: tuple[KalmanMatrices, ...],
        seed: int,
    ) -> Log:
        """The recording of one motion of the virtual robot under PD control, (14.25), (14.33)."""
        from rrrgen.lab.plant.controllers import DeviationFilter, pd_gains
        from rrrgen.lab.plant.experiment import Instruments, VirtualRobot
        from rrrgen.lab.plant.friction import Friction
        from rrrgen.lab.plant.plant import make_plant
        from rrrgen.lab.plant.recording_files import write_recording

        settings, results = self.settings, self.run.path / "results"
        mapping = results / f"{name}_log.yaml"
        if not mapping.exists():  # written last: with it, the recording is complete
            limits = tuple(float(joint.limits.torque) for joint in self.model.spec.joints)
            instruments = Instruments(tuple(self.resolution), limits, torque_noise=settings.torque_noise)
            robot = VirtualRobot(make_plant(self.model, friction=Friction(self.friction)), instruments, settings.period)
            recording = robot.run(
                reference,
                settings.duration,
                pd_gains(self.typical_inertia(), settings.bandwidth),
                DeviationFilter([m.E for m in observer], [m.k for m in observer]),
                seed=seed,
                progress=lambda done, total, message: self.tell(done, total, f"{name}: {message}"),
            )
            write_recording(results, f"{name}_log", recording, joints=self.joints, instruments=instruments)
        return read_log(mapping)

    def typical_inertia(self) -> Array:
        """Mean diagonal of M over random poses, kg m^2."""
        poses = np.random.default_rng(self.settings.seed).uniform(-np.pi, np.pi, (1000, self.model.n))
        return np.asarray(np.mean(np.diagonal(self.model.mass_matrix(poses), axis1=1, axis2=2), axis=0))

    @property
    def terms(self) -> DriveTerms:
        """The friction terms that are estimated beside the base parameters, (14.11)."""
        return DriveTerms.everywhere(self.model.n, "viscous", "coulomb")

    @property
    def processing(self) -> Processing:
        """Kalman smoother tuned by its innovations, parallel decimation, and low speeds left out."""
        settings = self.settings
        speeds = (settings.low_speed,) * self.model.n
        return Processing(method="kalman", decimate=settings.decimate, low_speed=speeds)

    def identify_parameters(self, log: Log) -> Identification:
        """Base parameters and friction by weighted least squares, (14.20)."""
        fixed = {"my2": 0.0, "my3": 0.0} if self.settings.symmetric_links else {}
        options = Options(terms=self.terms, fixed_standard=fixed, seed=self.settings.seed)
        return identify(self.model, [log], self.processing, options, progress=self.tell)

    def validate_torques(self, identification: Identification, log: Log, fitted: Log) -> Validation:
        """Compare the torques of the identified model with those of the writing task, which was not fitted."""
        return validate_recordings(
            column_model(FullRegressor(self.model, self.terms), identification.theta),
            [log],
            replace(
                self.processing, var_eta=identification.processing.var_eta, var_xi=identification.processing.var_xi
            ),
            noise=self.settings.torque_noise,
            label=common_share([fingerprint([fitted])], [log]).label,
            indefinite=identification.indefinite.get(
                identification.estimate.method, next(iter(identification.indefinite.values()))
            ),
            thresholds=Thresholds(relative_error=0.1, beyond_noise=LARGEST_ERROR, indefinite_share=0.0),
        )
