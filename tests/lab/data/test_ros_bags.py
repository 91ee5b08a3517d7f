"""Recordings of ROS."""

import numpy as np
import pytest

from lab.data.three_joints import TAU, N, Q, T, mapped
from rrrgen.lab.data.recordings import read_log


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_ros_recordings(tmp_path, storage):
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags reads ROS recordings")
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    state, header = kinds["sensor_msgs/msg/JointState"], kinds["std_msgs/msg/Header"]
    stamp = kinds["builtin_interfaces/msg/Time"]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for k in range(N):
            ns = 10**9 + round(T[k] * 1e9)
            # a gripper publishes on the same topic, and the arm's joints come in another order than in the mapping
            for names, q, tau in ((["grip"], [0.1], [0.0]), (["b", "a"], Q[k, ::-1], TAU[k, ::-1])):
                head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
                message = state(
                    header=head, name=names, position=np.array(q), velocity=np.array([]), effort=np.array(tau)
                )
                writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))
    mapping = mapped(tmp_path, "bag", "position.a", "position.b", "effort.a", "effort.b")
    for path in (tmp_path / "bag", next(p for p in (tmp_path / "bag").iterdir() if p.suffix in (".mcap", ".db3"))):
        log = read_log(path, mapping)
        np.testing.assert_array_equal(log.q, Q)
        np.testing.assert_array_equal(log.tau, TAU)
