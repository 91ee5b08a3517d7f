"""The keys of an experiment file, one table per section."""

from __future__ import annotations

from rrrgen.base.yamltext.keys import Entries, Entry, words
from rrrgen.lab.design.problem import OBJECTIVES
from rrrgen.lab.design.signals import SIGNALS

SCHEMA = "rrrgen-experiment/1"
FROM_ROBOT = "from_robot"
"""Word that stands in place of the values of flexible joints; they are then taken from ``drive`` in the robot file."""

CONTROL_LAWS = ("pd", "computed_torque")
OBSERVERS = ("kalman", "difference")
TORQUE_RECORDS = ("centred", "command")

KEYS: dict[str, Entries] = {
    "experiment": {
        "schema": Entry(words([SCHEMA]), required=True),
        "excitation": Entry("the exciting motion"),
        "writing": Entry("the writing task"),
        "virtual_robot": Entry("how the virtual arm differs from the model"),
        "control": Entry("control of the virtual arm"),
        "response": Entry("the experiment for a frequency response"),
        "period": Entry("sampling period; 1 ms if missing", "s"),
        "seed": Entry("of all random numbers; 0 if missing"),
    },
    "excitation": {
        "harmonics": Entry("number of harmonics of the Fourier series"),
        "base_frequency": Entry("of the Fourier series", "Hz"),
        "objective": Entry(f"what makes a motion exciting: {words(OBJECTIVES)}; `{OBJECTIVES[0]}` if missing"),
        "at_rest": Entry("`true`: the motion starts and ends at rest; `false` if missing"),
        "starts": Entry("number of random starts of the optimisation; 4 if missing"),
        "max_iterations": Entry("of one start"),
        "row_weights": Entry("1 over the standard deviation of each torque, per joint"),
        "limits": Entry("of the motion; those of the robot file if missing"),
    },
    "limits": {
        "lower": Entry("lowest position, per joint", "rad, m"),
        "upper": Entry("highest position, per joint", "rad, m"),
        "speed": Entry("largest speed, per joint", "rad/s"),
        "acceleration": Entry("largest acceleration, per joint", "rad/s^2"),
        "torque": Entry("largest torque or force, per joint", "N*m"),
        "box": Entry("of the tip, in the base frame"),
    },
    "box": {axis: Entry(f"[lowest, highest] {axis}, `~` for an open side", "m") for axis in "xyz"},
    "writing": {
        "text": Entry("what is written"),
        "duration": Entry("of the whole task", "s"),
        "peak_speed": Entry("of the tip, in place of a duration", "m/s"),
        "pace": Entry("number, or list that is repeated over the strokes: faster ones have larger numbers"),
        "margin": Entry("free space around the text", "m"),
        "start": Entry("position near which the inverse kinematics begins, per joint", "rad, m"),
        "plane": Entry("the vertical window that is written in"),
    },
    "plane": {
        "x": Entry("[lowest, highest] x", "m"),
        "y": Entry("where it stands", "m"),
        "z": Entry("[lowest, highest] z", "m"),
    },
    "virtual_robot": {
        "friction": Entry("at the joints; that of the robot file if missing"),
        "encoder_resolution": Entry("step of the measured position, per joint", "rad, m"),
        "torque_limit": Entry("where the drives saturate, per joint; that of the robot file if missing", "N*m"),
        "torque_resolution": Entry("step of the torque, per joint", "N*m"),
        "torque_noise": Entry("standard deviation of the recorded torque, per joint", "N*m"),
        "disturbance": Entry("standard deviation of a torque that acts and is not recorded, per joint", "N*m"),
        "torque_record": Entry(
            "`centred` (if missing): mean over a period around the sample; `command`: the torque from the sample on"
        ),
        "delay": Entry("from the reading of the encoders to the torque", "samples"),
        "flexible_joints": Entry(f"`{FROM_ROBOT}`: `drive` of the robot file; or a mapping"),
        "flexible_base": Entry("the base turns about the first axis"),
    },
    "friction": {
        "law": Entry("a [friction law](robot-file.md#friction-of-a-joint-or-a-motor)", required=True),
        "joints": Entry("list with a mapping of its parameters per joint", required=True),
    },
    "flexible_joints": {
        "rotor_inertia": Entry("seen at the joint, per joint", "kg m^2, kg", required=True),
        "stiffness": Entry("between rotor and link, per joint", "N m/rad, N/m", required=True),
        "damping": Entry("beside that stiffness, per joint", "N m s/rad, N s/m", required=True),
    },
    "flexible_base": {
        "inertia": Entry("of the base about that axis; from the inertia of the arm if missing", "kg m^2"),
        "frequency": Entry("of the base alone", "Hz"),
        "damping_ratio": Entry("of the base alone"),
    },
    "control": {
        "kind": Entry(f"{words(CONTROL_LAWS)}; `{CONTROL_LAWS[0]}` if missing"),
        "bandwidth": Entry(
            "of the position loop, per joint, in place of gains; if missing, 4 Hz, or more if the load needs it, as "
            "far as the loop is robust",
            "Hz",
        ),
        "damping": Entry("damping ratio of the loops; 1 if missing"),
        "kp": Entry("gain of the position, per joint; needs `kd`"),
        "kd": Entry("gain of the speed, per joint; needs `kp`"),
        "observer": Entry(f"of the speed: {words(OBSERVERS)}; `{OBSERVERS[0]}` if missing"),
        "feedforward": Entry(
            "`true`: the torques of the model along the motion are added to PD control; if missing, only where "
            "the load would bend a joint by a tenth of its motion"
        ),
        "jerk": Entry("tunes the Kalman observer, per joint; chosen for a robust loop if missing", "rad/s^3"),
    },
    "response": {
        "joint": Entry("name or number from 1 of the excited joint"),
        "signal": Entry(f"{words(SIGNALS)}; `{SIGNALS[0]}` if missing"),
        "band": Entry("[lowest, highest] excited frequency", "Hz"),
        "period": Entry("of the signal", "s"),
        "periods": Entry("number of recorded periods"),
        "settle": Entry("number of periods before them, in which transients decay"),
        "rms": Entry("of the excitation; the largest within the limits if missing", "rad/s^2"),
        "speed": Entry("mean speed of the joint; chosen if missing", "rad/s"),
        "realisations": Entry("number of experiments with different random phases"),
        "postures": Entry("list of positions of all joints, one experiment each", "rad, m"),
        "bandwidth": Entry("[of the loop of this joint, of the others]", "Hz"),
        "damping": Entry("damping ratio of all loops"),
    },
}
