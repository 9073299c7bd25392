# Types of the package; its documentation is that of the functions at run time.

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np
import numpy.typing as npt

Path = str | os.PathLike[str]
Preset = Literal["fit", "top", "front", "side", "iso"]
Layer = Literal["rgba", "linear", "depth", "id", "normal", "position"]

class Camera(TypedDict, total=False):
    eye: Sequence[float]
    target: Sequence[float]
    up: Sequence[float]
    fov_y: float
    projection: Literal["perspective", "orthographic"]
    ortho_height: float | None

AnyCamera = Preset | Camera | Mapping[str, Any] | Path

class Error(Exception): ...

def render(
    points: npt.ArrayLike,
    colors: npt.ArrayLike | None = None,
    camera: AnyCamera | None = None,
    size: tuple[int, int] | None = None,
    *,
    intensities: npt.ArrayLike | None = None,
    classes: npt.ArrayLike | None = None,
    device: str | None = None,
    style: Literal["auto", "surface", "points", "splats", "strokes"] = ...,
    effects: Sequence[str] = ...,
    background: str = ...,
    **options: Any,
) -> npt.NDArray[np.uint8]: ...

class Renderer:
    def __init__(self, *, device: str | None = None, validate: bool = False, **options: Any) -> None: ...
    @property
    def device(self) -> str: ...
    @property
    def clouds(self) -> list[int]: ...
    def set(self, **options: Any) -> None: ...
    def add_points(
        self,
        points: npt.ArrayLike,
        colors: npt.ArrayLike | None = None,
        *,
        intensities: npt.ArrayLike | None = None,
        classes: npt.ArrayLike | None = None,
    ) -> int: ...
    def open(self, files: Path | Sequence[Path], *, strict: bool = False) -> int: ...
    def remove(self, cloud: int) -> None: ...
    def show(self, cloud: int, visible: bool = True) -> None: ...
    def camera(
        self,
        camera: AnyCamera | None = None,
        size: tuple[int, int] | None = None,
        **options: Any,
    ) -> Camera: ...
    def render(
        self,
        camera: AnyCamera | None = None,
        size: tuple[int, int] | None = None,
        **options: Any,
    ) -> npt.NDArray[np.uint8]: ...
    def layers(
        self,
        names: Sequence[Layer],
        camera: AnyCamera | None = None,
        size: tuple[int, int] | None = None,
        **options: Any,
    ) -> dict[str, npt.NDArray[Any]]: ...
