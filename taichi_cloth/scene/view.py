"""How a scene wants to be seen. Description only: the renderer is in output/."""

from dataclasses import dataclass

from .. import checks
from ..errors import SceneError


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Args:
        eye, target: positions [m].
        fov: vertical opening angle [degrees].
        up: the direction that is up in the picture.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 35.0
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            object.__setattr__(self, name, tuple(checks.vector(f"camera {name}", getattr(self, name)).tolist()))
        object.__setattr__(self, "fov", checks.number("camera fov", self.fov, "degrees", least=1.0, most=150.0))
        if self.eye == self.target:
            raise SceneError(f"camera eye and target are the same point {self.eye!r}")
        if not any(self.up):
            raise SceneError(f"camera up = {self.up!r}: needs a direction")


@dataclass(frozen=True)
class View:
    """What to draw round the cloth.

    Args:
        camera: None fits one to the cloth's whole motion space at the start.
        ground: height [m] of the checker ground; None puts it under the scene.
        reach: room [m] that the cloth will need round its first shape, for the fitted camera.
    """

    camera: Camera | None = None
    ground: float | None = None
    reach: float = 0.0

    def __post_init__(self) -> None:
        checks.maybe(self.camera, checks.instance, "view camera", Camera)
        object.__setattr__(self, "ground", checks.maybe(self.ground, checks.number, "view ground", "m"))
        object.__setattr__(self, "reach", checks.number("view reach", self.reach, "m", least=0.0))
