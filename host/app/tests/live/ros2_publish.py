"""Publishes the scans of a file, a line of numbers each: stamp in us, first angle, step, largest range, ranges. `RATE FILE`."""
import sys
import time

from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from ros2_types import *

rate, lines = float(sys.argv[1]), open(sys.argv[2]).read().splitlines()
node = participant()
# As drivers of lasers do: reliable, which a subscriber may do without.
writer = DataWriter(node, Topic(node, "rt/left/scan", LaserScan), qos=quality(RELIABLE, 10))
while not writer.get_matched_subscriptions():
    time.sleep(0.05)
time.sleep(0.5)
began = time.time()
for number, line in enumerate(lines):
    stamp, first, step, far, *ranges = [float(word) for word in line.split()]
    header = Header(Time(int(stamp) // 1_000_000, int(stamp) % 1_000_000 * 1000), "laser_link")
    last = first + step * (len(ranges) - 1)
    writer.write(LaserScan(header, first, last, step, 0.0, 0.0, 0.0, far, ranges, []))
    time.sleep(max(0.0, began + (number + 1) / rate - time.time()))
print(len(lines))
