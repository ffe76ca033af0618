"""Subscribes to what a run publishes, as RViz and Nav2 do; after the run, prints all of it as JSON. Ends when its standard input does."""
import json
import sys
import threading
import time
from math import atan2

from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from ros2_types import *

over = threading.Event()
threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
node = participant()
asked = {
    "scan": ("rt/scan", LaserScan, quality(BEST_EFFORT, 100)),
    "map": ("rt/map", OccupancyGrid, quality(RELIABLE, 1, kept=True)),
    "tf": ("rt/tf", TFMessage, quality(RELIABLE, 100)),
    "odom": ("rt/odom", Odometry, quality(RELIABLE, 100)),
    "pose": ("rt/pose", PoseWithCovarianceStamped, quality(RELIABLE, 100)),
}
readers = {name: DataReader(node, Topic(node, topic, kind), qos=qos) for name, (topic, kind, qos) in asked.items()}


def plane(position, rotation):
    return [position.x, position.y, 2 * atan2(rotation.z, rotation.w)]


def scan(m):
    ranges = ["%.9g" % r for r in m.ranges]
    return [m.header.stamp.micros(), m.header.frame_id, m.angle_min, m.angle_increment, m.time_increment, m.range_max, ranges]


def grid(m):
    i, cells = m.info, bytes(c & 255 for c in m.data)
    return [m.header.frame_id, i.width, i.height, i.resolution, i.origin.position.x, i.origin.position.y, cells.hex()]


def frames(m):
    return [
        [t.header.stamp.micros(), t.header.frame_id, t.child_frame_id, plane(t.transform.translation, t.transform.rotation)]
        for t in m.transforms
    ]


def odometry(m):
    pose, twist = m.pose.pose, m.twist.twist
    return [m.header.stamp.micros(), plane(pose.position, pose.orientation), twist.linear.x, twist.angular.z, m.child_frame_id]


def placed(m):
    pose, c = m.pose.pose, m.pose.covariance
    return [m.header.stamp.micros(), plane(pose.position, pose.orientation), c[0], c[7], c[35]]


told = {"scan": scan, "map": grid, "tf": frames, "odom": odometry, "pose": placed}
heard = {name: [] for name in readers}
print("ready", flush=True)
while True:
    was_over = over.is_set()
    for name, reader in readers.items():
        # A sample without data says that its writer has gone.
        heard[name] += [told[name](m) for m in reader.take(N=200) if isinstance(m, asked[name][1])]
    if was_over:
        break
    time.sleep(0.05)
print(json.dumps(heard))
