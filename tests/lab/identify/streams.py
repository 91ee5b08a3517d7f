"""A recording of a planar arm in a file, and the ways it is processed."""

import numpy as np

from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion, planar_arm, write_log

N, PERIOD = 6000, 1e-3
TERMS = DriveTerms.everywhere(2, "viscous", "coulomb", "offset")


def recording(tmp_path, seed=0):
    arm = planar_arm()
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(N)
    q, dq, ddq = fourier_motion(t, 2, seed)
    regressor = FullRegressor(arm, TERMS)
    x = rng.uniform(0.2, 2.0, len(regressor.names))
    tau = regressor(q, dq, ddq) @ x + 0.05 * rng.normal(size=q.shape)
    write_log(tmp_path / f"log{seed}.csv", Log(("a", "b"), t, np.round(q, 5), tau))
    return tmp_path / f"log{seed}.csv", regressor, x


PROCESSINGS = [
    Processing("butterworth", cutoff=20.0),
    Processing("butterworth", cutoff=40.0, decimate=10, low_speed=(0.02, 0.02)),
    Processing("kalman", var_eta=(8e-12,) * 2, var_xi=(1e4,) * 2, decimate=4),
    Processing("differences"),
]
