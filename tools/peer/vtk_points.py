"""Draws frames with VTK, off screen; `edl` adds its eye-dome lighting."""

import json
import time

import numpy as np
import vtk
from scene import BACKGROUND, FOV, eye, points, words
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

scan, width, height, frames, picture, more = words()
xyz, rgb, diagonal = points(scan)
cloud = vtk.vtkPolyData()
places = vtk.vtkPoints()
places.SetData(numpy_to_vtk(xyz))
cloud.SetPoints(places)
ids = np.arange(len(xyz), dtype=np.int64)
single = vtk.vtkCellArray()
single.SetData(numpy_to_vtkIdTypeArray(np.array([0, len(xyz)], dtype=np.int64)),
               numpy_to_vtkIdTypeArray(ids))
cloud.SetVerts(single)
colors = numpy_to_vtk(rgb)
cloud.GetPointData().SetScalars(colors)
mapper = vtk.vtkPolyDataMapper()
mapper.SetInputData(cloud)
actor = vtk.vtkActor()
actor.SetMapper(mapper)
actor.GetProperty().SetPointSize(1)
actor.GetProperty().LightingOff()
renderer = vtk.vtkRenderer()
renderer.SetBackground(*BACKGROUND)
renderer.AddActor(actor)
if "edl" in more:
    shading = vtk.vtkEDLShading()
    shading.SetDelegatePass(vtk.vtkRenderStepsPass())
    renderer.SetPass(shading)
window = vtk.vtkRenderWindow()
window.SetOffScreenRendering(1)
window.SetMultiSamples(0)
window.SetSize(width, height)
window.AddRenderer(renderer)
camera = renderer.GetActiveCamera()
camera.SetViewAngle(FOV)
camera.SetFocalPoint(0, 0, 0)
camera.SetViewUp(0, 0, 1)
seconds = []
pixels = vtk.vtkUnsignedCharArray()
for frame in range(frames + (0 if frames == 1 else 2)):
    camera.SetPosition(*eye(diagonal, frame))
    renderer.ResetCameraClippingRange()
    start = time.perf_counter()
    window.Render()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 1, pixels)
    seconds.append(time.perf_counter() - start)
shot = vtk.vtkWindowToImageFilter()
shot.SetInput(window)
shot.ReadFrontBufferOff()
writer = vtk.vtkPNGWriter()
writer.SetFileName(picture)
writer.SetInputConnection(shot.GetOutputPort())
writer.Write()
print(json.dumps(dict(version=vtk.vtkVersion().GetVTKVersion(), points=len(xyz),
                      seconds_of_frames=seconds[0 if frames == 1 else 2:])))
