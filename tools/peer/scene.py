"""What every program draws: the points of a file, and the camera around their middle."""

import math
import sys

import laspy
import numpy as np

FOV = 45.0
BACKGROUND = (1.0, 0.0, 1.0)


def words():
    """Returns scan, width, height, frames, picture and further words of the command line."""
    scan, width, height, frames, picture, *more = sys.argv[1:]
    return scan, int(width), int(height), int(frames), picture, more


def points(scan):
    """Returns places from the middle of the bounds [m], colours of 8 bits, and the diagonal [m]."""
    las = laspy.read(scan)
    xyz = np.stack([las.x, las.y, las.z], axis=1)
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    xyz -= (low + high) / 2
    rgb = np.stack([las.red, las.green, las.blue], axis=1) >> 8
    return xyz.astype(np.float32), rgb.astype(np.uint8), float(np.linalg.norm(high - low))


def eye(diagonal, frame):
    """Returns the eye of a frame: each is turned a little, so that none can be kept."""
    angle = math.radians(200 + 0.01 * frame)
    return (0.75 * diagonal * math.cos(angle), 0.75 * diagonal * math.sin(angle), 0.5 * diagonal)
