"""Draws frames with Open3D's renderer off screen."""

import json
import time

import numpy as np
import open3d as o3d
from covered import write
from scene import BACKGROUND, FOV, eye, points, words

scan, width, height, frames, picture, _ = words()
xyz, rgb, diagonal = points(scan)
cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(xyz.astype(np.float64)))
cloud.colors = o3d.utility.Vector3dVector(rgb.astype(np.float64) / 255)
renderer = o3d.visualization.rendering.OffscreenRenderer(width, height)
renderer.scene.set_background([*BACKGROUND, 1.0])
renderer.scene.view.set_post_processing(False)
material = o3d.visualization.rendering.MaterialRecord()
material.shader = "defaultUnlit"
material.point_size = 1
renderer.scene.add_geometry("cloud", cloud, material)
seconds = []
for frame in range(frames + (0 if frames == 1 else 2)):
    renderer.setup_camera(FOV, [0, 0, 0], list(eye(diagonal, frame)), [0, 0, 1])
    start = time.perf_counter()
    pixels = np.asarray(renderer.render_to_image())
    seconds.append(time.perf_counter() - start)
write(picture, pixels[..., :3])
print(json.dumps(dict(version=o3d.__version__, points=len(xyz),
                      seconds_of_frames=seconds[0 if frames == 1 else 2:])), flush=True)
