"""Every reader of the project with a sound file for it, and what becomes of a damaged one."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
ROWS = 160
NAMES = ("t", "q1", "q2", "tau1", "tau2")

MAPPING = """\
schema: rrrgen-log/1
files: {file}
time: {{column: '{c[0]}', unit: s}}
units: {{position: rad, torque: N*m}}
joints:
  - {{name: a, position: '{c[1]}', torque: '{c[3]}'}}
  - {{name: b, position: '{c[2]}', torque: '{c[4]}'}}
"""

FULL_MAPPING = """\
schema: rrrgen-log/1
name: two joints on a bench
files: {a: {path: log.csv, separator: ',', decimal: '.', header: 1, comment: '#', encoding: utf-8}}
time: {file: a, column: t, unit: ms}
units: {position: deg, torque: A}
side: motor
joints:
  - {name: a, position: {column: q1, zero: 0.1, sign: -1, wraps_at: 360}, torque: {column: tau1, constant: 0.12 N*m/A}}
  - {name: b, position: {column: q2, unit: counts, counts_per_turn: 4096}, torque: {column: 5, unit: '%', rated: 9 N*m}}
transmission: {matrix: [[10, 0], [1, 20]]}
max_gap: 0.2 s
processing: {method: butterworth, cutoff: 20 Hz, order: 4, decimate: 2, low_speed: [0.01, 0.02]}
"""

EXPERIMENT = """\
schema: rrrgen-experiment/1
excitation:
  harmonics: 4
  base_frequency: 0.2 Hz
  objective: cond
  at_rest: true
  starts: 2
  max_iterations: 20
  row_weights: [1, 2, 3]
  limits:
    lower: [-90 deg, -1, -1]
    upper: 2
    speed: [1, 1, 100 deg/s]
    acceleration: 8
    torque: [20, 20, 10]
    box: {x: [-1, 1], z: [0.2, 1.5]}
writing:
  text: RRR
  duration: 10 s
  peak_speed: 0.7
  pace: [1, 1.2]
  margin: 20 mm
  start: [0, 0.3, 0.5]
  plane: {x: [-0.25, 0.25], y: -0.4, z: [0.35, 0.85]}
virtual_robot:
  friction:
    law: coulomb_viscous
    joints: [&j {coulomb: 1, viscous: 0.2}, *j, {coulomb: 1, viscous: 0.2}]
  encoder_resolution: 1e-5
  torque_limit: [40, 40, 20]
  torque_noise: 0.05
  torque_record: centred
  flexible_joints: {rotor_inertia: 0.1, stiffness: [4000, 4000, 3000], damping: 1}
  flexible_base: {inertia: 10, frequency: 28 Hz, damping_ratio: 0.02}
control: {kind: pd, bandwidth: 4 Hz, damping: 1, observer: kalman, jerk: 300}
period: 1 ms
seed: 3
"""


def table() -> np.ndarray:
    """Columns t, q1, q2, tau1, tau2."""
    t = 0.01 * np.arange(ROWS)
    return np.column_stack([t, np.sin(3 * t), np.cos(2 * t), 5 * np.sin(3 * t), 2 * np.cos(5 * t)])


@dataclass(frozen=True)
class Reader:
    """A reader: the file that it reads, how a sound one is made, and how it is read.

    ``located`` says that errors name a line and a column of the file, but for those of ``WHOLE_FILE``.
    """

    name: str
    file: str
    make: Callable[[Path], None]
    read: Callable[[Path], None]
    text: bool = False
    native: bool = False
    located: bool = False


WHOLE_FILE = (
    "the file is not UTF-8",
    "the file is empty",
    "there is no list '",
    "the file has no measurements",
    "--set ",
)
"""Messages about a file as a whole."""


def outcome(reader: Reader, folder: Path) -> tuple[int, str]:
    """The exit code of the command line for what reading raises, and the message."""
    from rrrgen.base.errors import RrrgenError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader.read(folder)
    except RrrgenError as error:
        return error.exit_code, str(error)
    return 0, ""


# -- recordings ------------------------------------------------------------------------------------------------------


def recording(name: str, file: str, make: Callable[[Path], None], columns=NAMES, **kind: bool) -> Reader:
    """A reader of recordings: the whole way from the file to reconstructed motion."""

    def prepare(folder: Path) -> None:
        make(folder / file)
        (folder / "log.yaml").write_text(MAPPING.format(file=file, c=columns), encoding="utf-8")

    return Reader(name, file, prepare, lambda folder: reconstruct(folder / "log.yaml"), **kind)


def reconstruct(mapping: Path) -> None:
    """Read a recording into memory and differentiate it, as every command that takes recordings does first."""
    from rrrgen.lab.data.reconstruction import Butterworth
    from rrrgen.lab.data.recordings import read_log

    log = read_log(mapping, chunk=100)
    method = Butterworth(0.1 / log.period)
    for part in log.parts():
        method(part.t, part.q)


def write_csv(path: Path) -> None:
    np.savetxt(path, table(), fmt="%.10g", delimiter=",", header=",".join(NAMES), comments="")


def write_npy(path: Path) -> None:
    np.save(path, table())


def write_npz(path: Path) -> None:
    np.savez_compressed(path, t=table()[:, 0], q=table()[:, 1:3], tau=table()[:, 3:].T.copy())


def write_mat(path: Path) -> None:
    import scipy.io

    content = {"t": table()[:, :1], "q": table()[:, 1:3], "tau": table()[:, 3:]}
    scipy.io.savemat(path, {"log": content, "note": "a text", "c": {"x": [1, 2]}}, do_compression=False)


def write_hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["log/t"] = table()[:, 0]
        file.create_dataset("log/q", data=table()[:, 1:3], chunks=(50, 2), compression="gzip")
        file["log/tau"] = table()[:, 3:]
        file["log"].attrs["note"] = "a text"


def write_parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    content = pyarrow.table(dict(zip(NAMES, table().T, strict=True)))
    pyarrow.parquet.write_table(content, path, row_group_size=60)


def write_bag(path: Path) -> None:
    """A rosbag2 of SQLite or MCAP, by the suffix, alone in its file."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    with Writer(path.with_suffix(""), version=9, storage_plugin=plugin) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for t, q1, q2, tau1, tau2 in table():
            ns = 10**9 + round(t * 1e9)
            head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            message = state(
                header=head,
                name=["a", "b"],
                position=np.array([q1, q2]),
                velocity=np.array([]),
                effort=np.array([tau1, tau2]),
            )
            writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))
    (found,) = path.with_suffix("").glob(f"*{path.suffix}")
    found.rename(path)


# -- files of text ---------------------------------------------------------------------------------------------------


def read_robot(folder: Path) -> None:
    """A robot file, its normal form and its text printed back, as ``check`` and ``show`` need them."""
    from rrrgen.robot.file import load_spec
    from rrrgen.robot.file.writer import dumps
    from rrrgen.robot.model.canonical_frames import build_model

    spec = load_spec(folder / "robot.yaml")
    build_model(spec)
    dumps(spec)


def make_robot(folder: Path) -> None:
    (folder / "robot.yaml").write_bytes((ROOT / "rrrgen/robot/robots/rrr.yaml").read_bytes())


def make_par(folder: Path) -> None:
    from tests.robot.file.par_files import SLIDING, inertia, text

    (folder / "arm.par").write_text(text({**SLIDING, **inertia(3, 1)}), encoding="utf-8")


def read_par(folder: Path) -> None:
    """An OpenSYMORO file, with the one value that it leaves open, to the text of a robot file."""
    from rrrgen.robot.importers.importing import import_robot

    import_robot(folder / "arm.par", "symoro", values={"L2": "350 mm"})


def make_calibration(folder: Path) -> None:
    from tests.robot.file.test_ur_calibration import FAR_AWAY

    (folder / "ur.yaml").write_text(FAR_AWAY, encoding="utf-8")


def read_calibration(folder: Path) -> None:
    from rrrgen.robot.importers.importing import import_robot

    import_robot(folder / "ur.yaml", "ur-calibration")


def make_mechanism(folder: Path) -> None:
    (folder / "robot.yaml").write_bytes((ROOT / "examples/palletiser/robot.yaml").read_bytes())


def make_urdf(folder: Path) -> None:
    from tests.robot.importers.urdf_files import ARM

    (folder / "arm.urdf").write_text(ARM, encoding="utf-8")


def make_mjcf(folder: Path) -> None:
    from tests.robot.importers.test_mjcf import ARM

    (folder / "arm.xml").write_text(ARM, encoding="utf-8")


def read_tree(folder: Path, form: str, file: str) -> None:
    """A URDF or an MJCF, to the text of a robot file."""
    from rrrgen.robot.importers.importing import import_robot

    import_robot(folder / file, form)


def make_measurements(folder: Path) -> None:
    rows = np.random.default_rng(0).uniform(-1, 1, (12, 9)).round(4)
    lines = ["q1 [deg],q2,q3,x [mm],y [mm],z [mm],roll,pitch,yaw", *(",".join(map(str, row)) for row in rows), ""]
    (folder / "poses.csv").write_text("\n".join(lines), encoding="utf-8")


def read_poses(folder: Path) -> None:
    """Measurements for a calibration."""
    from rrrgen.lab.calibrate.measurements import read_table

    read_table(folder / "poses.csv", ("q1", "q2", "q3")).measurements(1e-4, 1e-4)


def make_mapping(folder: Path) -> None:
    write_csv(folder / "log.csv")
    (folder / "log.yaml").write_text(FULL_MAPPING, encoding="utf-8")


def read_mapping(folder: Path) -> None:
    """A mapping file and the recording that it describes, made ready with the mapping's own processing."""
    from rrrgen.lab.data.preprocessing import Processing
    from rrrgen.lab.data.recordings import open_log, read_log

    mapping = open_log(folder / "log.yaml")
    log = read_log(folder / "log.yaml")
    processing = Processing(**dict(mapping.processing or {}))
    if processing.method == "butterworth":
        for part in log.parts():
            processing.reconstructor()(part.t, part.q)


def make_experiment(folder: Path) -> None:
    (folder / "experiment.yaml").write_text(EXPERIMENT, encoding="utf-8")


def read_experiment(folder: Path) -> None:
    """An experiment file, and the writing task and the instruments that it describes."""
    from dataclasses import fields

    from rrrgen.lab.design.problem import ExcitationProblem
    from rrrgen.lab.experiment.experiment_file import load_experiment
    from rrrgen.lab.experiment.writing_task import writing_task
    from rrrgen.lab.plant.experiment import Instruments

    experiment = load_experiment(folder / "experiment.yaml", 3)
    json.dumps({name: str(value) for name, value in vars(experiment).items()})
    names = {entry.name for entry in fields(Instruments)}
    instruments = {k: v for k, v in experiment.virtual_robot.items() if k in names}
    Instruments(**instruments)
    if experiment.limits is not None:
        settings = {"sample_period": experiment.period, "torque": "", "tip": "", **experiment.excitation}
        ExcitationProblem(joints=3, columns=1, regressor="", limits=experiment.limits, **settings)
    writing_task(**experiment.writing)


OF_STRUCT = ("log.t", "log.q(1)", "log.q(2)", "log.tau(1)", "log.tau(2)")
OF_MESSAGE = ("t", "position.a", "position.b", "effort.a", "effort.b")
READERS = (
    Reader("robot YAML", "robot.yaml", make_robot, read_robot, text=True, located=True),
    Reader("mechanism YAML", "robot.yaml", make_mechanism, read_robot, text=True, located=True),
    Reader("URDF", "arm.urdf", make_urdf, lambda f: read_tree(f, "urdf", "arm.urdf"), text=True, located=True),
    Reader("MJCF", "arm.xml", make_mjcf, lambda f: read_tree(f, "mjcf", "arm.xml"), text=True, located=True),
    Reader("OpenSYMORO", "arm.par", make_par, read_par, text=True, located=True),
    Reader("UR calibration", "ur.yaml", make_calibration, read_calibration, text=True, located=True),
    Reader("measurements", "poses.csv", make_measurements, read_poses, text=True, located=True),
    Reader("mapping YAML", "log.yaml", make_mapping, read_mapping, text=True),
    Reader("experiment YAML", "experiment.yaml", make_experiment, read_experiment, text=True),
    recording("CSV", "log.csv", write_csv, text=True),
    recording("npy", "log.npy", write_npy, ("data[0]", "2", "3", "4", "5")),
    recording("npz", "log.npz", write_npz, ("t", "q[0]", "q[1]", "tau[0]", "tau[1]")),
    recording("mat v5", "log.mat", write_mat, OF_STRUCT, native=True),
    recording("HDF5", "log.h5", write_hdf5, OF_STRUCT, native=True),
    recording("parquet", "log.parquet", write_parquet, native=True),
    recording("mcap", "log.mcap", write_bag, OF_MESSAGE, native=True),
    recording("db3", "log.db3", write_bag, OF_MESSAGE, native=True),
)
