"""Finds the 40 nearest neighbours of every point with a library, on all processors."""

import json
import os
import sys
import time
from importlib.metadata import version

from scene import points

scan, library = sys.argv[1:]
K = 40
xyz, _, _ = points(scan)
if library == "pykdtree":
    from pykdtree.kdtree import KDTree

    start = time.perf_counter()
    KDTree(xyz).query(xyz, k=K)
elif library == "scipy":
    from scipy.spatial import cKDTree

    start = time.perf_counter()
    cKDTree(xyz).query(xyz, k=K, workers=os.cpu_count())
else:
    import numpy as np
    import open3d as o3d

    search = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(np.ascontiguousarray(xyz)))
    start = time.perf_counter()
    search.knn_index()
    search.knn_search(o3d.core.Tensor(np.ascontiguousarray(xyz)), K)
print(json.dumps(dict(version=version(library.lower()), seconds_of_frames=[time.perf_counter() - start])))
