"""Contents of a scene: cloths, solids, point masses, the air, a user's own forces. numpy only; runs nothing."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, shown
from . import units
from .air import Air
from .appearance import Appearance
from .attachment import Script
from .cloth import Cloth, panels_of, used_vertices
from .crease import Crease
from .fabric import ClothContact, Fabric
from .garment import Garment
from .inflation import Inflation
from .mesh import TriMesh
from .score import Score
from .sewing import Seam, corners
from .solids import Prop, Shape, Solid, Value
from .tear import Tear, split
from .view import Color, View


class Contents:
    """The part of a `Scene` that stays as it was built."""

    def __init__(self, gravity: ArrayLike | None = (0.0, -9.81, 0.0), air: Air | None = None,
                 view: View | None = None) -> None:
        self.script, self._running = Script(), False
        self.followers: weakref.WeakSet = weakref.WeakSet()  # simulations of it that are open
        self.gravity, self.air = gravity, air
        self.view = view
        self.cloths: list[Cloth] = []
        self.solids: list[Solid] = []
        self.props: list[Prop] = []
        self.apart: list[tuple[Cloth, Cloth]] = []  # pairs that pass through each other
        self.masses: list[tuple[Cloth, np.ndarray, np.ndarray]] = []
        self.forces: list[Callable] = []
        self.damped = False  # whether kernels have damping where no fabric has: one that has is then no reason to compile
        self.seams: list[Seam] = []
        self.hung: list[tuple[Cloth, Garment]] = []  # garments whose panels are apart at the start, to be sewn as it runs
        self.creases: list[Crease] = []
        self.scores: list[Score] = []  # of cloth that may tear
        self.pieces: list[Inflation] = []  # the first inflation of each piece that has one

    @property
    def gravity(self) -> np.ndarray:
        """(3,) [m/s^2], to be read, and assigned as a whole; zeros if none was given."""
        return self._gravity

    @gravity.setter
    def gravity(self, gravity: ArrayLike | None) -> None:
        new = checks.vector("gravity", np.zeros(3) if gravity is None else gravity, "m/s^2")
        self._refuse_followed("gravity")
        new.setflags(write=False)
        self._gravity = new

    @property
    def air(self) -> Air | None:
        """Drag and wind, or None."""
        return self._air

    @air.setter
    def air(self, air: Air | None) -> None:
        new = checks.maybe(air, checks.instance, "air", Air)
        self._refuse_followed("air")
        self._air = new

    @property
    def view(self) -> View:
        """How to draw it."""
        return self._view

    @view.setter
    def view(self, view: View | None) -> None:
        self._view = View() if view is None else checks.instance("view", view, View)

    def __repr__(self) -> str:
        cloths = ", ".join(f"{c.name} ({c.mesh.vertex_count:,} vertices)" for c in self.cloths) or "no cloth"
        solids = ", ".join(s.name for s in self.solids) or "none"
        props = f"; props: {', '.join(p.name for p in self.props)}" if self.props else ""
        return f"<Scene of {cloths}; solids: {solids}{props}; {len(self.seams)} seams>"

    def add_cloth(self, mesh: TriMesh, fabric: Fabric | str, positions: ArrayLike | None = None,
                  velocities: ArrayLike | None = None, name: str | None = None,
                  color: str | Color | Appearance | None = None, contact: ClothContact | None = None,
                  panels: Mapping[str, Fabric | str] | None = None, tear: Tear | None = None) -> Cloth:
        """Adds a piece of cloth.

        Args:
            fabric: one, or the name of a measured one, such as "denim"; `tc.fabrics` has them.
            positions: (n, 3) at time 0 [m]; the mesh's own if None.
            velocities: (n, 3) or (3,) at time 0 [m/s]; zero if None.
            color: for pictures: a name of CSS, "#rrggbb" in sRGB, or linear RGB in 0..1; or an `Appearance`.
            contact: how it meets itself and other cloth that has a contact; None passes through, and costs nothing.
            panels: fabrics of faces all of whose corners are in a group of the mesh, by the groups' names.
            tear: how it tears; None does not. Its `mesh` then has more vertices than the one given, behind those.
        """
        name = f"cloth{len(self.cloths)}" if name is None else name
        checks.instance("add_cloth: mesh", mesh, TriMesh)
        apart = None if tear is None else split(name, mesh, checks.instance("add_cloth: tear", tear, Tear))
        x = mesh.x if positions is None else positions
        v = np.zeros(3) if velocities is None else velocities
        if apart is not None:
            mesh, x, v = apart.mesh, apart.spread(x), apart.spread(v)
        parts = panels_of(mesh, {} if panels is None else checks.instance("add_cloth: panels", panels, dict))
        cloth = Cloth(name, mesh, fabric, x, v, self.vertex_count, color, contact, parts, tear, apart)  # type: ignore[arg-type]
        if name in (c.name for c in self.cloths):
            raise SceneError(f"there is a cloth named {name!r} already")
        self._refuse_followed("add_cloth")
        self.cloths.append(cloth)
        if apart is not None:
            self.seams.append(corners(cloth))
        units.say(units.doubts(cloth, self.gravity))
        return cloth

    def set_fabric(self, cloth: Cloth, fabric: Fabric | str, panels: bool = False) -> None:
        """Makes a cloth of another fabric.

        Args:
            fabric: one, or the name of a measured one.
            panels: whether panels of fabrics of their own are of this one too.

        Raises:
            SceneError: a fabric that this cloth cannot be of.
        """
        self._own(cloth)
        self._refuse_followed("set_fabric")
        cloth.of_fabric(fabric, () if checks.flag("set_fabric: panels", panels) else cloth.panels)

    def add_solid(self, shape: Shape, friction: float, thickness: float, position: Value = (0.0, 0.0, 0.0),
                  rotation: Value = (0.0, 0.0, 0.0), name: str | None = None,
                  color: str | Color | None = None,
                  parts: dict[str, float | None] | None = None) -> Solid:
        """Adds a solid that cloth cannot enter.

        Args:
            shape: Plane, Sphere, Capsule, Box, Cylinder or SolidMesh.
            friction: Coulomb's coefficient, 0 is smooth.
            thickness: distance [m] that cloth keeps from the surface.
            position: of the shape's origin [m], (3,) or a function of time [s].
            rotation: rotation vector (3,) [rad] or matrix (3, 3), or a function of time [s].
            color: for pictures: a name of CSS, "#rrggbb" in sRGB, or linear RGB in 0..1.
            parts: of a mesh, friction of the faces of its groups, by their names; None lets cloth pass there, as through hands
                that press it.
        """
        name = f"solid{len(self.solids)}" if name is None else name
        solid = Solid(name, shape, friction, thickness, position, rotation, color,  # type: ignore[arg-type]
                      {} if parts is None else parts)
        self._refuse_twice(name)
        self._refuse_followed("add_solid")
        self.solids.append(solid)
        units.say(units.doubts_of_solid(solid))
        return solid

    def add_prop(self, shape: Shape, position: Value = (0.0, 0.0, 0.0), rotation: Value = (0.0, 0.0, 0.0),
                 name: str | None = None, color: str | Color | None = None) -> Prop:
        """Adds a shape that pictures and exports show and cloth does not meet: a ring, a table's legs. It costs a simulation
        nothing.

        Cloth may ride on it (`attach`).

        Args:
            shape, position, rotation, color: as in `add_solid`.
        """
        prop = Prop(f"prop{len(self.props)}" if name is None else name, shape, position, rotation, color)  # type: ignore[arg-type]
        self._refuse_twice(prop.name)
        self._refuse_followed("add_prop")
        self.props.append(prop)
        return prop

    def _refuse_twice(self, name: str) -> None:
        for one in (*self.solids, *self.props):
            if one.name == name:
                raise SceneError(f"there is a {one.WHAT} named {name!r} already")

    def add_mass(self, cloth: Cloth, vertices: object, mass: float) -> None:
        """Adds a point mass [kg] to each of the vertices; corners at one vertex of cloth that may tear share it."""
        self._own(cloth)
        mass, index = checks.number("point mass", mass, "kg", positive=True), used_vertices(cloth, vertices)
        self._refuse_followed("add_mass")
        self.masses.append((cloth, index, mass * cloth.shares(index)))

    def add_force(self, make: Callable) -> None:
        """Adds a force of your own.

        Args:
            make: the result of `MembraneLaw.on` or `BendLaw.on`, or a class or function that makes a `forces.force.Force` of
                (fields, model, scene, K).
        """
        checks.function("add_force: make", make, "fields", "model", "scene", "K")
        self._refuse_followed("add_force")
        self.forces.append(make)

    def pass_through(self, a: Cloth, b: Cloth) -> None:
        """Lets two cloths that have a contact pass through each other."""
        for cloth in (a, b):
            self._own(cloth)
        if a is b:
            raise SceneError(f"pass_through: {a.name!r} twice; for a cloth and itself use ClothContact(itself=False)")
        self._refuse_followed("pass_through")
        self.apart.append((a, b))

    def passes(self, a: Cloth, b: Cloth) -> bool:
        """Whether two cloths pass through each other."""
        return (a, b) in self.apart or (b, a) in self.apart or a.contact is None or b.contact is None

    @property
    def touches(self) -> bool:
        """Whether cloth can meet anything: solids, other cloth or itself."""
        return bool(self.solids) or any(c.contact is not None for c in self.cloths)

    @property
    def vertex_count(self) -> int:
        """Number of vertices of all cloths."""
        return sum(c.mesh.vertex_count for c in self.cloths)

    def _refuse_followed(self, change: str, live: bool = False) -> None:
        """Refuses a change that simulations which have begun would not follow.

        Args:
            change: the method; live: whether simulations have it too, and events may call it.
        """
        if live and self._running:
            return
        if self.followers:
            gc.collect()  # simulations that nobody knows any more are there until then
        if any(sim.is_open for sim in self.followers):
            instead = f"; or change the simulation, by sim.{change} or in an event (scene.at)" if live else ""
            raise SceneError(f"{change}: a simulation of this scene has begun and would not follow: close it first "
                             f"(sim.close()){instead}")

    def _own(self, cloth: Cloth) -> None:
        if not any(cloth is c for c in self.cloths):
            what = cloth.name if isinstance(cloth, Cloth) else cloth
            raise SceneError(f"not a cloth of this scene: {shown(what)}; pass the one that its add_cloth returned, not a "
                             "name")
