"""Writes the points of class 2 to LAZ with laspy."""

import sys

import laspy

scan, output = sys.argv[1:]
las = laspy.read(scan)
las.points = las.points[las.classification == 2]
las.write(output)
