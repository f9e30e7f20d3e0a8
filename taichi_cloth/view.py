"""How a scene wants to be seen. Description only: the renderer is in output/."""

from dataclasses import dataclass

from .errors import SceneError


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
        if not 1 <= self.fov <= 150:
            raise SceneError(f"camera fov = {self.fov!r} degrees: must be between 1 and 150")
        if tuple(self.eye) == tuple(self.target):
            raise SceneError(f"camera eye and target are the same point {self.eye!r}")


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
