"""Which reader reads which recorded file."""

from __future__ import annotations

from rrrgen.recordings.mapping import FileSource
from rrrgen.recordings.readers.tables import Table, table_fault

SUFFIXES = {
    ".csv": "csv", ".tsv": "csv", ".txt": "csv", ".dat": "csv", ".log": "csv", ".asc": "csv",
    ".npy": "npy", ".npz": "npz", ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".parquet": "parquet",
    ".pq": "parquet", ".mcap": "rosbag", ".db3": "rosbag", ".bag": "rosbag",
}  # fmt: skip


def open_table(source: FileSource) -> Table:
    """The table of one file; raises :class:`InputError` where it cannot be read."""
    path = source.path
    if not path.exists():
        raise table_fault(path, "there is no such file")
    kind = source.format or ("rosbag" if path.is_dir() else SUFFIXES.get(path.suffix.lower()))
    if kind == "csv":
        from rrrgen.recordings.readers.csv_table import CsvTable

        return CsvTable(source)
    if kind in ("npy", "npz", "mat", "hdf5"):
        from rrrgen.recordings.readers import array_tables

        return array_tables.open_arrays(path, kind)
    if kind == "parquet":
        from rrrgen.recordings.readers.array_tables import ParquetTable

        return ParquetTable(path)
    if kind == "rosbag":
        from rrrgen.recordings.readers.bag_table import BagTable

        return BagTable(source)
    raise table_fault(
        path, f"the format of '{path.name}' is not known", f"name it with format: {' | '.join(set(SUFFIXES.values()))}"
    )
