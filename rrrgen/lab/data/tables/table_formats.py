"""Chooses the reader of a recorded file from its declared format or its suffix."""

from __future__ import annotations

from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables.interface import Table, table_fault

SUFFIXES = {
    ".csv": "csv", ".tsv": "csv", ".txt": "csv", ".dat": "csv", ".log": "csv", ".asc": "csv",
    ".npy": "npy", ".npz": "npz", ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".parquet": "parquet",
    ".pq": "parquet", ".mcap": "rosbag", ".db3": "rosbag", ".bag": "rosbag",
}  # fmt: skip

NATIVE = ("mat", "hdf5", "parquet", "rosbag")
"""Formats read in a separate process, because libraries parse them in native code or decompress without bounds."""


def open_table(source: FileSource) -> Table:
    """Open one file as a table, in a separate process for native formats; raises :class:`InputError` if unreadable."""
    if source.arrays is not None:
        from rrrgen.lab.data.tables.arrays import MemoryTable

        return MemoryTable(source.path, source.arrays)
    if kind_of(source) in NATIVE:
        from rrrgen.lab.data.tables.guarded_table import GuardedTable

        return GuardedTable(source)
    return open_here(source)


def open_here(source: FileSource) -> Table:
    """Open one file as a table in this process; raises :class:`InputError` if it cannot be read."""
    kind, path = kind_of(source), source.path
    if kind == "csv":
        from rrrgen.lab.data.tables.csv import CsvTable

        return CsvTable(source)
    if kind == "parquet":
        from rrrgen.lab.data.tables.arrays import ParquetTable

        return ParquetTable(path)
    if kind == "rosbag":
        from rrrgen.lab.data.tables.ros_bags import BagTable

        return BagTable(source)
    from rrrgen.lab.data.tables import arrays as array_tables

    return array_tables.open_arrays(path, kind)


def kind_of(source: FileSource) -> str:
    """The format of a file: as declared, by its suffix, or a ROS recording for a folder.

    Raises :class:`InputError` if the file does not exist or its format is not known.
    """
    path = source.path
    try:
        folder = path.is_dir()
        if not folder and not path.exists():
            raise table_fault(path, "there is no such file")
    except (OSError, ValueError) as error:  # a name too long, a zero byte in it
        raise table_fault(path, f"cannot be opened: {error}") from None
    kind = source.format or ("rosbag" if folder else SUFFIXES.get(path.suffix.lower()))
    if kind is None:
        allowed = " | ".join(sorted(set(SUFFIXES.values())))
        raise table_fault(path, f"the format of '{path.name}' is not known", f"name it with format: {allowed}")
    if folder and kind != "rosbag":
        raise table_fault(path, f"a folder, where a file in the format {kind} is needed")
    return kind
