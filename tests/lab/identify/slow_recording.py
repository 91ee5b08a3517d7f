"""Recordings of a slow motion at any rate."""

import numpy as np

from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.studies.options import PreprocessingOptions
from rrrgen.lab.studies.sources import chosen_processing
from samples.recordings import fourier_motion, planar_arm

TERMS = DriveTerms.everywhere(2, "viscous", "coulomb", "offset")
NOISE = 0.3


def recording(rate=1000.0, seconds=20.0, seed=0, noise=NOISE):
    """The planar arm on a motion of up to 1 Hz; parameters 1, noise on the torque."""
    t = np.arange(round(rate * seconds)) / rate
    q, dq, ddq = fourier_motion(t, 2, seed)
    regressor = FullRegressor(planar_arm(), TERMS)
    tau = regressor(q, dq, ddq) @ np.ones(len(regressor.names))
    rng = np.random.default_rng(seed)
    return Log(("a", "b"), t, np.round(q, 6), tau + noise * rng.normal(size=tau.shape), period=1.0 / rate)


def mapping(processing=""):
    joints = "".join(f"  - {{name: {j}, position: q_{j}, torque: tau_{j}}}\n" for j in "ab")
    return (
        "schema: rrrgen-log/1\nfiles: log.csv\ntime: {column: t, unit: s}\n"
        f"units: {{position: rad, torque: N*m}}\njoints:\n{joints}{processing}"
    )


def chosen(processing="", **options):
    return chosen_processing([loads_mapping(mapping(processing))], PreprocessingOptions(**options))
