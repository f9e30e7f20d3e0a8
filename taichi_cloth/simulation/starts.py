"""Check of starts: cloth inside a solid, or through it, is told of, with a way out of it. Panels there are refused, since they
would be sewn through it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..contact.solid.query import SolidCollisionDetector
from ..errors import SceneError
from ..scene.cloth import Cloth
from ..scene.garment import Garment
from ..scene.intersections import count_crossings
from ..scene.primitives import Plane
from ..scene.scene import Scene
from ..scene.solids import Solid, SolidMesh
from ..system.state import ParticleState

OUTSIDE = 1.01  # times the way out of a solid, by which cloth is clear of it
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


@dataclass(frozen=True)
class Start:
    """A cloth that starts inside a solid, or through it.

    Attributes:
        told: a sentence, with the solid's name, the cloth's, and the deepest vertex.
        move: another, on where the cloth could start.
        particles: (k,) that are inside, or of triangles that cross.
        through: whether the ways out of its vertices leave it crossing the solid.
    """

    told: str
    move: str
    particles: np.ndarray
    through: bool

    def __str__(self) -> str:
        return f"{self.told}: {self.move if self.through else 'they are pushed out over the first steps'}"


def find(scene: Scene, model: ParticleState, detector: SolidCollisionDetector) -> Iterator[Start]:
    """Cloths that start inside solids or through them; the detector has inspected the start."""
    found = detector.inside
    if not (len(found.particles) or len(detector.crossed)):
        return
    sewn = [seam.cloth for seam in scene.seams if not seam.tears]
    for cloth in scene.cloths:
        vertex, crossed = (model.user[i] - cloth.start for i in (found.particles, detector.crossed.ravel()))
        here, there = ((v >= 0) & (v < cloth.mesh.vertex_count) for v in (vertex, crossed))
        for k, solid in enumerate(detector.solids):
            mine = here & (found.solid == k)
            x = cloth.positions.copy()
            x[vertex[mine]] += (OUTSIDE * found.depth[:, None] * found.normal)[mine]
            crossings = 0
            if (mine.any() or there.any()) and not isinstance(solid.shape, Plane):
                crossings = count_crossings(x, cloth.mesh.faces, solid.surface_at(0.0), solid.shape.surface()[1])
            if mine.any():
                deep = found.depth[mine] - detector.thickness[k]
                yield Start(_inside(cloth, solid, vertex[mine], deep, crossings), _move(cloth, solid, cloth in sewn),
                            found.particles[mine], crossings > 0)
            elif crossings:
                yield Start(f"{solid.name}: {cloth.name!r} starts through it, in {crossings} pairs of an edge and a triangle",
                            _move(cloth, solid, cloth in sewn), detector.crossed.ravel()[there], True)


def _inside(cloth: Cloth, solid: Solid, vertices: np.ndarray, deep: np.ndarray, crossings: int) -> str:
    """On vertices (k,) that start as deep (k,) [m] in a solid, and whether their ways out lead to different sides."""
    worst, count = int(vertices[np.argmax(deep)]), f"{len(vertices)} of {cloth.mesh.vertex_count} vertices"
    at = ", ".join(f"{c:.4g}" for c in cloth.positions[worst])
    where = f"the deepest, vertex {worst} at ({at}) m, by {deep.max():.3g} m"
    if crossings:
        return (f"{solid.name}: {cloth.name!r} starts through it: {count} start inside, {where}, and their nearest ways out "
                "lead to different sides")
    return f"{solid.name}: {count} of {cloth.name!r} start inside it, {where}"


def _move(cloth: Cloth, solid: Solid, sewn: bool) -> str:
    """Where the cloth could start instead: moved along an axis, the least way by which it is clear of the solid; a garment
    that is sewn already is put on."""
    if sewn and isinstance(solid.shape, SolidMesh):
        return ("put the garment on the body as it is at the start: `dress`, or tc.dress, with the same scale, clip and rest "
                "as load_solid has")
    other = "or let the solid come to it (its position a function of time)"
    if isinstance(solid.shape, Plane):
        return f"start it above the plane, {other}"
    (low, high), (from_, to) = ((x.min(axis=0), x.max(axis=0)) for x in (cloth.positions, solid.surface_at(0.0)))
    up, down = to - low + solid.thickness, high - from_ + solid.thickness
    axis, sign = min(((axis, sign) for axis in (1, 0, 2) for sign in (1, -1)),
                     key=lambda way: round(float((up if way[1] > 0 else down)[way[0]]), 9))
    way = np.zeros(3)
    way[axis] = sign * (up if sign > 0 else down)[axis] * OUTSIDE
    if abs(way[axis]) > np.ptp(cloth.positions, axis=0).max():  # it is all round the solid
        return f"start it further out, {other}"
    return f"start it clear, such as with positions moved by ({', '.join(f'{c:.3g}' for c in way)}) m, {other}"
