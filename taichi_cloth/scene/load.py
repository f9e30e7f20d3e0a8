"""Forces that a script puts on vertices. numpy only."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError
from .cloth import Cloth, used_vertices

Force = ArrayLike | Callable[[float], ArrayLike]


@dataclass(frozen=True, eq=False)
class Load:
    """A force on vertices of a cloth; made by `Scene.add_load`.

    Attributes:
        vertices: (k,) of the cloth.
        force: [N]: (3,) on each of them, (k, 3) in their order, or a function of time [s] that returns one of these.
    """

    cloth: Cloth
    vertices: np.ndarray
    force: Force

    def at(self, t: float) -> np.ndarray:
        """(3,) or (k, 3) [N] at time t [s].

        Raises:
            SceneError: where the function returns a wrong shape or a number that is not finite.
        """
        k = len(self.vertices)
        what = f"the load on {k} vertices of {self.cloth.name!r}, at t = {t:g} s"
        force = self.force(t) if callable(self.force) else self.force
        return checks.array(what, force, (3,), (k, 3), row="vertex", of=self.vertices)


def make(cloth: Cloth, vertices: object, force: object) -> Load:
    """A load.

    Raises:
        SceneError: vertices that the cloth does not have or that are named twice, or a force of a wrong shape.
    """
    index = used_vertices(cloth, vertices)
    if len(np.unique(index)) < len(index):
        raise SceneError("add_load: a vertex is named twice")
    if callable(force):
        checks.function("add_load: force", force, "time")
    else:
        force = checks.array("add_load: force", force, (3,), (len(index), 3), row="vertex", of=index)
    load = Load(cloth, index, force)  # type: ignore[arg-type]
    load.at(0.0)
    return load
