"""JointState messages of ROS recordings (rosbag2 in SQLite or MCAP, ROS 1 bags), without ROS."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import MissingExtraError
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables import foreign_reader, table_fault, unknown_column

JOINT_STATE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
ROS = "a ROS recording"


class BagTable:
    """One JointState topic of a ROS recording as a table with one row per message.

    The columns are ``t`` (header stamp, s, from the first message), ``position.<joint>``, ``velocity.<joint>`` and
    ``effort.<joint>``. A message without a wanted joint, such as one of another publisher on the same topic, is
    skipped.
    """

    def __init__(self, source: FileSource) -> None:
        self.path = source.path
        with self._reader() as reader:
            topics = sorted({c.topic for c in reader.connections if c.msgtype == JOINT_STATE})
            if source.topic is None and len(topics) == 1:
                self.topic = topics[0]
            elif source.topic is not None and source.topic in topics:
                self.topic = source.topic
            else:
                what = "no topic is named" if source.topic is None else f"no JointState topic '{source.topic}'"
                raise table_fault(self.path, what, f"topic: {' | '.join(topics) or '(the bag has no JointState)'}")
            self.columns: tuple[str, ...] = ()
            self.start = 0
            for stamp, message in self._messages(reader):
                if not self.columns:
                    self.start = stamp
                names = [f"{f}.{joint}" for f in FIELDS if len(getattr(message, f)) for joint in message.name]
                new = [name for name in names if name not in self.columns]
                if not new and self.columns:
                    break
                self.columns = (*(self.columns or ("t",)), *new)
        if not self.columns:
            raise table_fault(self.path, f"no message on {self.topic}")

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks (up to ``size`` rows, columns) of the ``wanted`` columns, one row per message."""
        asked = [self._split(str(name)) for name in wanted]
        block: list[list[float]] = []
        with self._reader() as reader:
            for stamp, message in self._messages(reader):
                places = {name: i for i, name in enumerate(message.name)}
                values = [self._value(stamp, message, places, field, joint) for field, joint in asked]
                if any(value is None for value in values):
                    continue
                block.append([float(value) for value in values if value is not None])
                if len(block) == size:
                    yield np.array(block)
                    block = []
        if block:
            yield np.array(block)

    def _split(self, name: str) -> tuple[str, str]:
        if name == "t":
            return "t", ""
        field, dot, joint = name.partition(".")
        if field not in FIELDS or not dot:
            raise unknown_column(self.path, name, self.columns)
        if name not in self.columns and joint not in {c.partition(".")[2] for c in self.columns}:
            raise unknown_column(self.path, name, self.columns)
        return field, joint

    def _value(self, stamp: int, message: Any, places: dict[str, int], field: str, joint: str) -> float | None:
        if field == "t":
            return (stamp - self.start) * 1e-9
        place = places.get(joint)
        values = getattr(message, field)
        if place is None:
            return None
        return float(values[place]) if place < len(values) else float("nan")

    @contextmanager
    def _reader(self) -> Iterator[Any]:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingExtraError("reading ROS recordings", "rosbags", "logs") from None
        types = get_typestore(Stores.ROS2_HUMBLE)
        with foreign_reader(self.path, ROS), AnyReader([self.path], default_typestore=types) as reader:
            yield reader

    def _messages(self, reader: Any) -> Iterator[tuple[int, Any]]:
        """Iterate over the messages of the topic with their stamps (ns), or the time of recording if unstamped."""
        connections = [c for c in reader.connections if c.topic == self.topic]
        for connection, received, data in reader.messages(connections=connections):
            message = reader.deserialize(data, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            yield stamp or received, message
