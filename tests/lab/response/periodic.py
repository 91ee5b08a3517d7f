"""Periodic recordings of a joint, with disturbance."""

import numpy as np

from samples.flexible_joint import flexible_joint

SAMPLES = 20000  # 20 s


def errors(found, highest=200.0):
    """Relative complex error, band and whether it holds the truth, magnitude and phase error, of lines below
    ``highest``.
    """
    use = found.frequency < highest
    truth, P = flexible_joint().response(found.frequency[use]), found.P[use]
    held = np.abs(P - truth) < found.band95[use] * np.abs(P)
    ratio = P / truth
    return np.abs(ratio - 1), found.band95[use], held, np.abs(np.abs(ratio) - 1), np.abs(np.angle(ratio, deg=True))


def write(folder, recording, extra="", columns=("1", "2", "3")):
    np.save(folder / "log.npy", np.column_stack([recording.n, recording.u, recording.q]))
    n, u, q = columns
    (folder / "response.yaml").write_text(
        "schema: rrrgen-response/1\nfiles: log.npy\ntime: {rate: 1 kHz}\n"
        f"excitation: {{column: {n}}}\ninput: {{column: {u}}}\noutput: {{column: {q}, unit: rad}}\n{extra}"
    )
    return folder / "response.yaml"
