"""Garments that are worn, one over the other, and the result of putting one on. numpy only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from ..scene.cloth import panels_of
from ..scene.fabric import ClothContact, Fabric
from ..scene.fabrics import as_fabric
from ..scene.garment import Garment
from ..scene.intersections import self_crossings

NAMED = 3  # pairs of panels that a report names


@dataclass(frozen=True, eq=False)
class Worn:
    """A garment where it is worn, of its fabric.

    Args:
        fabric: or the name of a measured one.

    Attributes:
        contact: how it meets itself and garments worn over it.
        name: by which reports call it, and the cloth that it becomes.
        panels: fabrics of some panels, as in `Scene.add_cloth`.
    """

    garment: Garment
    fabric: Fabric
    contact: ClothContact | None
    name: str = "garment"
    panels: dict[str, Fabric] | None = None

    def __post_init__(self) -> None:
        checks.instance("worn: garment", self.garment, Garment)
        object.__setattr__(self, "fabric", as_fabric("worn: fabric", self.fabric))
        checks.maybe(self.contact, checks.instance, "worn: contact", ClothContact)
        object.__setattr__(self, "name", checks.name("worn: name", self.name))
        if self.panels is not None:
            panels_of(self.garment.mesh, checks.instance("worn: panels", self.panels, dict))

    def __repr__(self) -> str:
        return f"<Worn {self.name!r}, {self.garment.mesh.vertex_count:,} vertices>"


@dataclass(frozen=True)
class Dressed:
    """Result of `dress`.

    Attributes:
        garment: as it is worn.
        sewn: s that closing the seams took; settled: s until it came to rest or had to end; rests: whether it came to rest.
        speed: RMS at the end [m/s].
        intersections: edges of cloth through triangles of cloth at the end, in the garment and those under it, counted
            exactly; None if it does not meet itself.
        crossed: how many of them are between which two panels, the most first; of several garments each by "garment: panel".
        worn: all that is worn now, as it lies, from inside outwards; the garment is the last.
        notes: a sentence each on panels that were hung further out, or that no seam holds.
    """

    garment: Garment
    sewn: float
    settled: float
    rests: bool
    speed: float
    intersections: int | None
    crossed: tuple[tuple[str, str, int], ...] = ()
    worn: tuple[Worn, ...] = ()
    notes: tuple[str, ...] = ()

    def report(self) -> str:
        """A few words."""
        under = "" if len(self.worn) < 2 else " and with those under it"
        crossed = "" if self.intersections is None else f", {self.intersections} crossings with itself{under}"
        if self.crossed:
            crossed += " (" + ", ".join(f"{n} of {a!r} and {b!r}" for a, b, n in self.crossed[:NAMED])
            crossed += ", ...)" if len(self.crossed) > NAMED else ")"
        rest = "at rest" if self.rests else f"still moving at {self.speed:.2g} m/s"
        return f"seams closed after {self.sewn:.2f} s, {rest} after {self.settled:.2f} s more{crossed}"


def worn_under(over: object, contact: ClothContact | None, name: str) -> tuple[Worn, ...]:
    """The garments under the one that `dress` puts on, checked: each has a contact and a name of its own.

    Raises:
        SceneError: no tuple of Worn, one without a contact, or a name that is there twice.
    """
    if not isinstance(over, (list, tuple)):
        raise SceneError(f"dress: over = {shown(over)}: must be worn garments, from inside outwards, such as another's "
                         "`.worn`")
    worn = tuple(checks.instance("dress: over", one, Worn) for one in over)
    names = [w.name for w in worn] + [name]
    twice = next((n for n, many in Counter(names).items() if many > 1), None)
    if twice is not None:
        raise SceneError(f"dress: two garments are named {twice!r}: name them apart, by dress(name=)")
    bare = next((w.name for w in worn if w.contact is None), None)
    if bare is None and worn and contact is None:
        bare = name
    if bare is not None:
        raise SceneError(f"dress: {bare!r} has no contact, and would pass through garments worn with it: give it a "
                         "ClothContact")
    return worn


def crossed_of(worn: Sequence[Worn]) -> tuple[tuple[str, str, int], ...]:
    """(panel, panel, number of crossings) of panels that pass through themselves or each other, the most first."""
    count = [w.garment.mesh.vertex_count for w in worn]
    first = np.cumsum([0, *count])
    faces = np.concatenate([w.garment.mesh.faces + start for w, start in zip(worn, first)])
    edges, rows = self_crossings(np.concatenate([w.garment.positions for w in worn]), faces)

    def panel(vertex: int) -> tuple[int, str]:
        k = int(np.searchsorted(first, vertex, "right")) - 1
        name = worn[k].garment.panel_of(vertex - first[k])
        return k, name if len(worn) == 1 else f"{worn[k].name}: {name}"

    ends = [(panel(e), panel(f)) for e, f in zip(edges[:, 0], faces[rows, 0])]
    meets = [w.contact is None or w.contact.itself for w in worn]
    pairs = [(min(a, b), max(a, b)) for (i, a), (j, b) in ends if i != j or meets[i]]
    return tuple((a, b, n) for (a, b), n in Counter(pairs).most_common())
