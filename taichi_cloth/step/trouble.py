"""The place of a rejected or slow step in its scene: the cloth, its vertex, its position, and the surface in contact."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..scene.cloth import Cloth
from ..scene.solids import Solid
from ..system.held import Held
from ..system.place import Place
from ..system.state import ParticleState

SQUEEZED = "held hard where it is pressed: unpin it, or attach it with a stiffness and a largest force"


@dataclass(frozen=True, slots=True)
class Trouble:
    """The worst place of an attempt at a step.

    Attributes:
        name: of the rejection; "" for a step that was accepted.
        h: step that was tried [s].
        detail: more about the rejection.
        cloth, vertex: by the cloth's own numbers.
        at: (3,) where it was then [m]; speed: how fast it went [m/s].
        against: name of the solid or cloth that it is in contact with, or "".
        held: whether a pin, motion or attachment holds it in all directions.
        gap: part left there of the distance to keep, 1 is all of it; below 0 it has passed the surface.
    """

    name: str
    h: float
    detail: str
    cloth: str
    vertex: int
    at: tuple[float, float, float]
    speed: float
    against: str = ""
    gap: float = 1.0
    held: bool = False

    def __str__(self) -> str:
        at = ", ".join(f"{c:.4g}" for c in self.at)
        near = f", {self.gap:.2g} thicknesses from {self.against!r}" if self.against else ""
        squeezed = f", {SQUEEZED}" if self.held and self.against and self.gap < 1 else ""
        return f"vertex {self.vertex} of {self.cloth!r} at ({at}) m, {self.speed:.3g} m/s{near}{squeezed}"


class Locator:
    """Finds the place of a model's state in its scene."""

    def __init__(self, model: ParticleState, cloths: Sequence[Cloth], solids: Sequence[Solid]) -> None:
        self.model, self.cloths, self.solids = model, cloths, solids
        self.starts = np.array([c.start for c in cloths])

    def find(self, name: str, h: float, detail: str, place: Place | None, pins: Held | None = None) -> Trouble:
        """At a place, or, where there is none, at the particle whose velocity changed most."""
        x, v = self.model.read_particles()
        if place is None:
            change = np.linalg.norm(v - self.model.read_saved()[1], axis=1)
            i = int(np.argmax(np.where(np.isfinite(change), change, np.inf)))
            against, gap = "", 1.0
        else:
            i, gap = place.particles[0], place.gap
            against = self.solids[place.solid].name if place.solid >= 0 else self._of(place.particles[-1])[0].name
        cloth, vertex = self._of(i)
        x_i = x[i] + self.model.origin
        held = pins is not None and bool((np.trace(pins.projector[pins.index == i], axis1=1, axis2=2) > 2.5).any())
        return Trouble(name, h, detail, cloth.name, vertex, (float(x_i[0]), float(x_i[1]), float(x_i[2])),
                       float(np.linalg.norm(v[i])), against, gap, held)

    def name(self, particle: int) -> str:
        """A particle as people know it, with where it is."""
        (cloth, vertex), x = self._of(particle), self.model.read_particles()[0][particle] + self.model.origin
        return f"vertex {vertex} of {cloth.name!r} at ({', '.join(f'{c:.4g}' for c in x)}) m"

    def _of(self, particle: int) -> tuple[Cloth, int]:
        """A particle's cloth, and its number there."""
        vertex = int(self.model.user[particle])
        k = int(np.searchsorted(self.starts, vertex, side="right")) - 1
        return self.cloths[k], vertex - self.cloths[k].start
