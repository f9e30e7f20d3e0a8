"""Check of starts: panels inside a solid, or through it, are refused, since they would be sewn through it."""

from collections.abc import Iterable

import numpy as np

from ..contact.solid.query import SolidCollisionDetector
from ..errors import SceneError
from ..scene.cloth import Cloth
from ..scene.garment import Garment
from ..scene.intersections import count_crossings
from ..scene.solids import Solid, SolidMesh
from ..system.state import ParticleState

FIT = "fit a pattern that is drawn for the shipped figure to the body (--fit of `dress`, tc.fitted), "
OUT = ("hang the panels further out (Garment.moved), or turn and move the garment to where the body stands (Garment.placed; "
       "turn and shift of `dress` and of the scene dress_up)")


def refuse_inside(hung: Iterable[tuple[Cloth, Garment]], model: ParticleState, detector: SolidCollisionDetector,
                  solids: list[Solid]) -> None:
    """Refuses garments that start inside solids.

    Args:
        hung: each cloth with its garment.
        detector: has inspected the start.

    Raises:
        SceneError: the garment, its panel, the solid, how many vertices and how deep.
    """
    found = detector.inside
    for cloth, garment in hung:
        vertex = model.user[found.particles] - cloth.start
        mine = (vertex >= 0) & (vertex < cloth.mesh.vertex_count)
        if mine.any():
            deep = (found.depth - detector.thickness[found.solid])[mine].max()
            solid = solids[int(found.solid[mine][0])].name
            raise SceneError(f"{cloth.name}: {len(np.unique(vertex[mine]))} vertices start inside the body, the first of them "
                             f"of {garment.panel_of(int(vertex[mine][0]))!r} in {solid!r}, at most {1e3 * deep:.3g} mm deep: "
                             f"{_way(garment)}")


def refuse_through(hung: Iterable[tuple[Cloth, Garment]], solids: Iterable[Solid]) -> None:
    """Refuses garments that a solid's mesh passes through between their vertices."""
    meshes = [(s.name, s.surface_at(0.0), s.shape.faces) for s in solids if isinstance(s.shape, SolidMesh)]
    for cloth, garment in hung:
        for name, x, faces in meshes:
            count = count_crossings(cloth.positions, cloth.mesh.faces, x, faces)
            if count:
                raise SceneError(f"{cloth.name}: panels pass through {name!r}, in {count} pairs of an edge and a triangle: "
                                 f"{_way(garment)}")


def _way(garment: Garment) -> str:
    """How a garment comes out of the body: not by fitting one that was fitted."""
    return OUT if garment.fitted else FIT + OUT
