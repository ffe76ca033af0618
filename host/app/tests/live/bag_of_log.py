"""Writes the scans of a CARMEN log (ROBOTLASER1) as a bag of ROS 2, with the package `rosbags` of PyPI: python3 bag_of_log.py LOG BAG."""
import gzip
import sys

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
scan, header = store.types["sensor_msgs/msg/LaserScan"], store.types["std_msgs/msg/Header"]
time = store.types["builtin_interfaces/msg/Time"]
plugin = StoragePlugin.SQLITE3 if sys.argv[3:] == ["sqlite3"] else StoragePlugin.MCAP
with gzip.open(sys.argv[1], "rt") as log, Writer(sys.argv[2], version=9, storage_plugin=plugin) as bag:
    connection = bag.add_connection("/scan", scan.__msgtype__, typestore=store)
    for words in map(str.split, log):
        if words[:1] != ["ROBOTLASER1"]:
            continue
        begin, step, range_max, count = float(words[2]), float(words[4]), float(words[5]), int(words[8])
        ranges = np.array([float(word) for word in words[9 : 9 + count]], dtype=np.float32)
        # Behind the remissions: two poses and five numbers, then the time.
        at_us = round(float(words[9 + count + 1 + int(words[9 + count]) + 11]) * 1e6)
        message = scan(
            header=header(time(at_us // 10**6, at_us % 10**6 * 1000), "laser"), angle_min=begin,
            angle_max=begin + step * (count - 1), angle_increment=step, time_increment=0.0, scan_time=0.0,
            range_min=0.0, range_max=range_max, ranges=ranges, intensities=np.zeros(0, dtype=np.float32),
        )
        bag.write(connection, at_us * 1000, store.serialize_cdr(message, scan.__msgtype__))
