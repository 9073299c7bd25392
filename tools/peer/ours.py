"""Draws frames with pointillist's Python package."""

import json
import time

import numpy as np
import pointillist
from covered import write
from scene import FOV, eye, points, words

LOOK = dict(style="points", effects=["visibility=off", "edl=off"], background="ff00ff")
scan, width, height, frames, picture, _ = words()


def camera(diagonal, frame):
    return dict(eye=eye(diagonal, frame), target=(0, 0, 0), up=(0, 0, 1), fov_y=FOV)


xyz, rgb, diagonal = points(scan)
renderer = pointillist.Renderer(**LOOK, lod=0, point_budget=1 << 31)
renderer.add_points(xyz, rgb)
seconds = []
for frame in range(frames + 2):
    start = time.perf_counter()
    pixels = renderer.render(camera(diagonal, frame), (width, height))
    seconds.append(time.perf_counter() - start)

write(picture, np.asarray(pixels)[..., :3])
print(json.dumps(dict(points=len(xyz), seconds_of_frames=seconds[2:])))
