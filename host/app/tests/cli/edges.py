"""Reads results with programs that are not ours, and prints what they found: the test beside compares it.

Needs evo, plyfile, pypcd4, PyYAML and Pillow. Arguments: the folder of a map, the folder of a cloud.
"""

import sys

import numpy as np
import yaml
from evo.tools import file_interface
from PIL import Image
from plyfile import PlyData
from pypcd4 import PointCloud

visit, cloud = sys.argv[1:]

path = file_interface.read_tum_trajectory_file(f"{visit}/trajectory.tum")
valid, details = path.check()
assert valid, details
print("path", path.num_poses, f"{path.path_length:.3f}")

# As map_server's documentation has it: p = (255 - x) / 255, occupied above one threshold, free below the other.
about = yaml.safe_load(open(f"{visit}/map.yaml"))
picture = np.asarray(Image.open(f"{visit}/{about['image']}")).astype(float)
p = picture / 255 if about["negate"] else (255 - picture) / 255
occupied, free = p > about["occupied_thresh"], p < about["free_thresh"]
print("map", picture.shape[1], picture.shape[0], occupied.sum(), free.sum(), f"{about['resolution']:.3f}", *about["origin"])

ply = PlyData.read(f"{cloud}/cloud.ply")["vertex"]
points = np.stack([ply[axis] for axis in "xyz"], axis=1)
colours = np.stack([ply[colour] for colour in ("red", "green", "blue")], axis=1)
pcd = PointCloud.from_path(f"{cloud}/cloud.pcd")
assert np.array_equal(pcd.numpy(("x", "y", "z")), points), "PLY and PCD have other points"
assert np.array_equal(PointCloud.decode_rgb(pcd.numpy(("rgb",))).reshape(-1, 3), colours), "and other colours"
print("cloud", len(points), *(f"{value:.3f}" for value in (*points.min(axis=0), *points.max(axis=0))))
