"""A recording of three joints, written in the formats that are read."""

import numpy as np

from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.recordings import load_stream
from rrrgen.lab.data.uniform_stream import LogStream
from samples.recordings import fourier_motion

TEXT = 1e-9  # numbers written with ten decimals
N, PERIOD = 600, 0.002
T = PERIOD * np.arange(N)
Q = fourier_motion(T, 2, 3)[0]
TAU = np.column_stack([5 * np.sin(3 * T), 2 * np.cos(5 * T) + 0.1])
PLAIN = """
schema: rrrgen-log/1
files: {file}
time: {{column: t, unit: s}}
units: {{position: rad, torque: N*m}}
joints:
  - {{name: a, position: {q1}, torque: {tau1}}}
  - {{name: b, position: {q2}, torque: {tau2}}}
"""


def mapped(tmp_path, file, q1="q1", q2="q2", tau1="tau1", tau2="tau2"):
    text = PLAIN.format(file=file, q1=q1, q2=q2, tau1=tau1, tau2=tau2)
    return loads_mapping(text, str(tmp_path / "log.yaml"))


def read(mapping, **options):
    return load_stream(LogStream(mapping, **options))


def table():
    return np.column_stack([T, Q, TAU])


def write_csv(path, separator=",", decimal=".", header="t,q1,q2,tau1,tau2", before="", rows=None):
    lines = [before] if before else []
    if header:
        lines.append(header.replace(",", separator))
    for row in table() if rows is None else rows:
        cells = ["" if np.isnan(v) else f"{v:.10f}".replace(".", decimal) for v in row]
        lines.append(separator.join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def kinds(log):
    return {finding.kind: finding.count for finding in log.findings}
