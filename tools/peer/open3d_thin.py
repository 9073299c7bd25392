"""Leaves one point in each cell of 10 cm with Open3D, PLY to PLY."""

import sys

import open3d as o3d

scan, output = sys.argv[1:]
o3d.io.write_point_cloud(output, o3d.io.read_point_cloud(scan).voxel_down_sample(0.1))
