#!/usr/bin/env python3
"""Makes the bags beside it, with tools of others: pip install rosbags==0.11.9 mcap-ros2-support==0.6.0

    python3 make.py .
"""
import math
import shutil
import sys
from pathlib import Path

import numpy as np
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SCANS = 12
BEGIN_S = 1000


def stamp(t):
    """Seconds and nanoseconds of t tenths of a second."""
    return BEGIN_S + t // 10, t % 10 * 100_000_000


def ranges(number):
    """Each scan has another number of beams; of some there is no range."""
    values = [1 + 0.01 * number + 0.1 * beam for beam in range(40 + number % 3)]
    values[5:8] = [math.inf, math.nan, 0.05]
    return np.array(values, dtype=np.float32)


def messages(types, is_ros1):
    """Topic, time in ns and message: a scan every 0.1 s, and odometry 0.05 s before and behind each."""
    name = lambda kind: kind if is_ros1 else kind
    scan, odometry = types[name("sensor_msgs/msg/LaserScan")], types[name("nav_msgs/msg/Odometry")]
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    head = lambda s, ns, frame: header(**({"seq": 0} if is_ros1 else {}), stamp=time(s, ns), frame_id=frame)
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    vector = types["geometry_msgs/msg/Vector3"]
    none = np.zeros(36)

    def pose_at(s, ns, x):
        pose = types["geometry_msgs/msg/Pose"](point(x, 2.0, 0.0), turn(0.0, 0.0, math.sin(0.25), math.cos(0.25)))
        twist = types["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        return odometry(
            head(s, ns, "odom"), "base_link",
            types["geometry_msgs/msg/PoseWithCovariance"](pose, none),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, none),
        )

    for number in range(SCANS):
        s, ns = stamp(number)
        t = s * 10**9 + ns
        before = t - 50_000_000
        yield "/odom", before, pose_at(before // 10**9, before % 10**9, 0.1 * number - 0.05)
        values = ranges(number)
        yield "/scan", t, scan(
            header=head(s, ns, "a_laser"), angle_min=-1.0, angle_max=-1.0 + 0.05 * (len(values) - 1), angle_increment=0.05,
            time_increment=0.001, scan_time=0.1, range_min=0.1, range_max=8.0, ranges=values,
            intensities=np.zeros(0, dtype=np.float32),
        )
    yield "/odom", t + 50_000_000, pose_at((t + 50_000_000) // 10**9, (t + 50_000_000) % 10**9, 0.1 * number + 0.05)


def framed(types, is_ros1):
    """The same scans without odometry's messages: what these say is among frames, and the laser's place on the robot too."""
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, turn = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    transform, stamped = types["geometry_msgs/msg/Transform"], types["geometry_msgs/msg/TransformStamped"]
    message = types["tf2_msgs/msg/TFMessage"]

    def frame(t, parent, child, x, y, z, yaw):
        head = header(**({"seq": 0} if is_ros1 else {}), stamp=time(t // 10**9, t % 10**9), frame_id=parent)
        place = transform(vector(x, y, z), turn(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
        return stamped(head, child, place)

    begin = BEGIN_S * 10**9
    # The laser looks backwards on a plate that is turned to the left.
    plate = frame(begin, "base_link", "plate", 0.2, 0.0, 0.1, math.pi / 2)
    laser = frame(begin, "plate", "a_laser", 0.3, 0.1, 0.05, math.pi / 2)
    yield "/tf_static", begin - 100_000_000, message([plate, laser])
    for topic, t, told in messages(types, is_ros1):
        if topic == "/scan":
            yield topic, t, told
            continue
        x = told.pose.pose.position.x
        # The robot's frame is a metre before the one that the wheels move.
        foot = frame(t, "odom", "base_footprint", x - math.cos(0.5), 2.0 - math.sin(0.5), 0.0, 0.5)
        yield "/tf", t, message([foot, frame(t, "base_footprint", "base_link", 1.0, 0.0, 0.1, 0.0)])
        yield "/tf", t, message([frame(t, "base_link", "wheel", 0.0, 0.3, 0.0, x)])


def write(writer, store, is_ros1, source=messages):
    connections = {}
    for topic, time, message in source(store.types, is_ros1):
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=store)
        pack = store.serialize_ros1 if is_ros1 else store.serialize_cdr
        writer.write(connections[topic], time, pack(message, kind))


def ros2(folder, name, plugin, compression=None, source=messages):
    place = folder / "made"
    shutil.rmtree(place, ignore_errors=True)
    writer = Ros2Writer(place, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(CompressionMode.STORAGE, compression)
    with writer:
        write(writer, get_typestore(Stores.ROS2_HUMBLE), False, source)
    (file,) = [path for path in place.iterdir() if path.suffix in (".mcap", ".db3")]
    file.rename(folder / name)
    shutil.rmtree(place)


def ros1(folder, name, compression=None, source=messages):
    (folder / name).unlink(missing_ok=True)
    writer = Ros1Writer(folder / name)
    if compression:
        writer.set_compression(compression)
    with writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        kind = "tf2_msgs/msg/TFMessage"
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
        write(writer, store, True, source)


def main():
    folder = Path(sys.argv[1])
    ros2(folder, "ros2.mcap", StoragePlugin.MCAP)
    ros2(folder, "ros2-zstd.mcap", StoragePlugin.MCAP, CompressionFormat.ZSTD)
    ros2(folder, "ros2.db3", StoragePlugin.SQLITE3)
    ros1(folder, "ros1.bag")
    ros1(folder, "ros1-bz2.bag", Ros1Writer.CompressionFormat.BZ2)
    ros1(folder, "ros1-lz4.bag", Ros1Writer.CompressionFormat.LZ4)
    ros2(folder, "tf-ros2.mcap", StoragePlugin.MCAP, source=framed)
    ros2(folder, "tf-ros2.db3", StoragePlugin.SQLITE3, source=framed)
    ros1(folder, "tf-ros1.bag", source=framed)


main()
