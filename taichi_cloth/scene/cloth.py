"""A piece of cloth in a scene. numpy only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .appearance import Appearance, appearance
from .fabric import ClothContact, Fabric
from .fabrics import as_fabric
from .mesh import TriMesh
from .tear import Split, Tear
from .view import Color


@dataclass(frozen=True, eq=False)
class Cloth:
    """A piece of cloth in a scene; made by `Scene.add_cloth` and handed to `pin`, `move` and the rest.

    Attributes:
        start: index of its first vertex in the simulation's arrays.
        color: of its front, linear RGB; given as a colour or as an `Appearance`, which then stands in `appearance`.
        positions, velocities: (n, 3) at time 0 [m], [m/s].
        contact: how it meets other cloth; None passes through.
        panels: (rows of faces, their fabric): parts that are of another fabric.
        tear, split: how it tears, and its mesh with corners apart; None does not.
    """

    name: str
    mesh: TriMesh
    fabric: Fabric
    positions: np.ndarray
    velocities: np.ndarray
    start: int
    color: str | Color | Appearance | None = None
    contact: ClothContact | None = None
    panels: tuple[tuple[np.ndarray, Fabric], ...] = ()
    tear: Tear | None = None
    split: Split | None = None
    appearance: Appearance = field(init=False, default=Appearance())

    def __post_init__(self) -> None:
        what = checks.name("cloth name", self.name)
        n = checks.instance(f"mesh of {what!r}", self.mesh, TriMesh).vertex_count
        object.__setattr__(self, "fabric", as_fabric(f"fabric of {what!r}", self.fabric))
        object.__setattr__(self, "positions", checks.array(f"positions of {what!r}", self.positions, (n, 3), row="vertex"))
        v = checks.array(f"velocities of {what!r}", self.velocities, (n, 3), (3,), row="vertex")
        object.__setattr__(self, "velocities", np.broadcast_to(v, (n, 3)).copy())
        object.__setattr__(self, "start", checks.integer(f"start of {what!r}", self.start, least=0))
        object.__setattr__(self, "appearance", appearance(f"color of {what!r}", self.color))
        object.__setattr__(self, "color", self.appearance.color)
        self.face_colors()
        checks.maybe(self.contact, checks.instance, f"contact of {what!r}", ClothContact)
        object.__setattr__(self, "panels", _checked_panels(what, self.panels, self.mesh.face_count))
        for rest in (f.bend.rest for f in self.fabrics if f.bend):
            if isinstance(rest, tuple) and len(rest) != (edges := len(self.whole.inner_edges)):
                raise SceneError(f"bend rest of {what!r}: {len(rest)} angles, but its mesh has {edges} inner edges")
        checks.maybe(self.tear, checks.instance, f"tear of {what!r}", Tear)
        checks.maybe(self.split, checks.instance, f"split of {what!r}", Split)
        if self.tear is not None and any(f.bend and f.bend.model == "curvature" for f in self.fabrics):
            raise SceneError(f"{what!r} may tear: it bends over hinges, not by Bend(model=\"curvature\")")
        if self.tear is not None and not any(f.stretch or f.shear for f in self.fabrics):
            raise SceneError(f"{what!r} may tear: it needs stretch or shear, from which its stress comes")
        models = {f.bend.model for f in self.fabrics if f.bend}
        if len(models) > 1 or (self.panels and models == {"curvature"}):
            raise SceneError(f"panels of {what!r}: all fabrics of a cloth bend over hinges, or it has one fabric")

    def of_fabric(self, fabric: Fabric | str, panels: tuple[tuple[np.ndarray, Fabric], ...]) -> None:
        """Makes it of another fabric, and its panels; users call `Scene.set_fabric`.

        Raises:
            SceneError: a fabric that it cannot be of; it stays as it was.
        """
        new = replace(self, fabric=as_fabric(f"fabric of {self.name!r}", fabric), panels=panels, color=self.appearance)
        for name in ("fabric", "panels"):
            object.__setattr__(self, name, getattr(new, name))

    def __repr__(self) -> str:
        return f"<Cloth {self.name!r} of {self.whole.vertex_count:,} vertices, {self.whole.face_count:,} triangles>"

    @property
    def fabrics(self) -> tuple[Fabric, ...]:
        """All that it is made of, the cloth's own first."""
        return self.fabric, *(fabric for _, fabric in self.panels)

    def shares(self, vertices: np.ndarray) -> np.ndarray:
        """(k,) shares of loads that are put on each of vertices (k,): where cloth may tear, corners at one vertex share it."""
        if self.split is None:
            return np.ones(len(vertices))
        return 1 / np.bincount(self.split.of[np.unique(vertices)])[self.split.of[vertices]]

    @property
    def whole(self) -> TriMesh:
        """Its mesh as it was handed in."""
        return self.mesh if self.split is None else self.split.whole

    @property
    def fabric_of(self) -> np.ndarray:
        """(m,) row of `fabrics` of each face."""
        out = np.zeros(self.mesh.face_count, dtype=np.int64)
        for k, (rows, _) in enumerate(self.panels, 1):
            out[rows] = k
        return out

    def face_colors(self) -> np.ndarray | None:
        """(m, 3) linear RGB of faces in panels that have a colour of their own, NaN elsewhere; None if none has.

        Raises:
            SceneError: a panel that is no group of the mesh, or has no face.
        """
        if not self.appearance.panels:
            return None
        out = np.full((self.mesh.face_count, 3), np.nan)
        for name, color in self.appearance.panels.items():
            out[panel_faces(self.mesh, name)] = color
        return out

    @property
    def density(self) -> np.ndarray:
        """(m,) of each face [kg/m^2]."""
        return np.array([f.density for f in self.fabrics])[self.fabric_of]


def _checked_panels(what: str, panels: object, count: int) -> tuple[tuple[np.ndarray, Fabric], ...]:
    """(rows of faces, fabric) of a cloth with so many faces."""
    if not isinstance(panels, (list, tuple)) or not all(isinstance(p, (list, tuple)) and len(p) == 2 for p in panels):
        raise SceneError(f"panels of {what!r}: {shown(panels)}: must be (rows of faces, fabric), any number of them")
    out = []
    for rows, fabric in panels:
        index = checks.indices(f"panels of {what!r}: faces", rows, count)
        out.append((index, as_fabric(f"panels of {what!r}: fabric", fabric)))
    return tuple(out)


def panels_of(mesh: TriMesh, fabrics: Mapping[str, Fabric | str]) -> tuple[tuple[np.ndarray, Fabric], ...]:
    """(rows of faces, fabric) of groups of vertices."""
    out = []
    for name, fabric in fabrics.items():
        out.append((panel_faces(mesh, name), as_fabric(f"fabric of panel {name!r}", fabric)))
    return tuple(out)


def panel_faces(mesh: TriMesh, name: str) -> np.ndarray:
    """(k,) rows of the faces that have all corners in a group of vertices.

    Raises:
        SceneError: there is none.
    """
    rows = np.flatnonzero(np.isin(mesh.faces, mesh.select(name)).all(axis=1))
    if not len(rows):
        raise SceneError(f"panel {name!r}: no face has all of its corners in that group")
    return rows


def used_vertices(cloth: Cloth, vertices: object) -> np.ndarray:
    """(k,) selected vertices, checked.

    Raises:
        SceneError: none is selected, or one belongs to no face.
    """
    index = cloth.mesh.select(vertices)
    if not len(index):
        raise SceneError(f"the selection {vertices!r} of {cloth.name!r} is empty")
    loose = index[~np.isin(index, cloth.mesh.faces)]
    if len(loose):
        raise SceneError(f"vertex {loose[0]} of {cloth.name!r} belongs to no face and is not simulated")
    return index
