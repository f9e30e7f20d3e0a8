"""A hand that pulls on cloth: soft attachments of a small patch to a place that moves with the mouse.

A patch, not a vertex: a fine mesh's vertex alone would be drawn out to a spike. The patch's springs together pull with twice
the cloth's weight at most, so that a hand lifts it and does not tear it out of its pins. The pull is full a quarter of the
cloth's size away, and less nearer.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np

from ..errors import SceneError
from ..forces import pulled_softly
from ..forces.pulls import Pulls
from ..scene.cloth import Cloth
from ..scene.scene import Scene
from ..simulation import Simulation

PATCH = 0.05  # of the cloth's size: the patch's radius
REACH = 0.25  # of the cloth's size: how far from the hand its pull is full
WEIGHTS = 2.0  # of the cloth: the full pull
EARTH = 9.81  # m/s^2, for weights in a scene without gravity


@contextlib.contextmanager
def pullable(scene: Scene) -> Iterator[None]:
    """Within it, simulations that are made of a scene can be pulled at."""
    adds = not pulled_softly(scene)
    if adds:
        scene.forces.append(Pulls)
    try:
        yield
    finally:
        if adds:
            scene.forces.remove(Pulls)


class Hand:
    """Holds a patch of cloth in a simulation.

    Args:
        point: (3,) [m] near which it takes hold.

    Attributes:
        place: (3,) [m] where the hand is.

    Raises:
        SceneError: the simulation has no soft attachments, or all of the patch is held already.
    """

    def __init__(self, sim: Simulation, point: np.ndarray) -> None:
        if sim.prescribed.pulls is None:
            raise SceneError("this simulation was made without soft attachments, so nothing can pull: tc.view(scene) makes "
                             "one that can be pulled at")
        if sim.integrator.system is None:  # it takes the jump of a place from step to step for energy from nowhere
            raise SceneError(f"cloth of the explicit method {sim.integrator_name!r} cannot be pulled at: choose another "
                             "integrator")
        self.sim = sim
        self.cloth, self.patch, self.vertex = self._patch(np.asarray(point, dtype=np.float64))
        self._start = sim.positions()[self.cloth.start + self.vertex]
        self.place = self._start
        size = float(np.linalg.norm(np.ptp(self.cloth.positions, axis=0)))
        mass = float((self.cloth.mesh.material_areas * self.cloth.density).sum())
        most = WEIGHTS * mass * (float(np.linalg.norm(sim.scene.gravity)) or EARTH) / len(self.patch)
        sim.move(self.cloth, self.patch, lambda t: self.place - self._start, relative=True,
                 stiffness=most / (REACH * size), most=most)

    def held_at(self) -> np.ndarray:
        """(3,) [m] where the middle of the patch now is."""
        return self.sim.positions()[self.cloth.start + self.vertex]

    def let_go(self) -> None:
        """The patch is free again."""
        self.sim.unpin(self.cloth, self.patch)

    def _patch(self, point: np.ndarray) -> tuple[Cloth, np.ndarray, int]:
        """The cloth with the free vertex that is nearest, those round it, and the vertex."""
        x, scene = self.sim.positions(), self.sim.scene
        best: tuple[float, Cloth, np.ndarray, np.ndarray] | None = None
        for cloth in scene.cloths:
            held = [a.vertices for a in self.sim.prescribed.script.attachments if a.cloth is cloth]
            free = np.setdiff1d(np.unique(cloth.mesh.faces), np.concatenate([np.zeros(0, dtype=int), *held]))
            away = np.linalg.norm(x[cloth.start + free] - point, axis=1)
            if len(free) and (best is None or away.min() < best[0]):
                best = float(away.min()), cloth, free, away
        if best is None:
            raise SceneError("all of the cloth is held already: nothing is left to pull at")
        _, cloth, free, away = best
        vertex = int(free[np.argmin(away)])
        size = float(np.linalg.norm(np.ptp(cloth.positions, axis=0)))
        from_it = np.linalg.norm(cloth.positions[free] - cloth.positions[vertex], axis=1)
        return cloth, free[from_it <= PATCH * size], vertex
