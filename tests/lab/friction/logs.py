"""Recordings of one joint as logs of an arm."""

import numpy as np


def write_log(path, found, joints=("q1", "q2", "q3"), moving="q3"):
    """The recording of one joint as a log of rrrgen's own columns; the other joints stand still."""
    still = np.zeros_like(found["t"])
    columns = {"t": found["t"]}
    columns |= {f"q_{name}": found["q"] if name == moving else still for name in joints}
    columns |= {f"tau_{name}": found["tau"] if name == moving else still for name in joints}
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.15g")
    return path
