"""What there is and what is done to it: cloths, pins, prescribed motion, air, events. numpy only; runs nothing."""

import contextlib
import warnings
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, did_you_mean, shown
from . import units
from .air import Air
from .appearance import Appearance
from .attachment import Attachment, Event, Path, Script, check_overlap, orthonormal
from .cloth import Cloth, panels_of, used_vertices
from .crease import Crease
from .crease import make as make_crease
from .fabric import ClothContact, Fabric
from .garment import Garment
from .inflation import ATMOSPHERE, Drive, Inflation
from .inflation import make as make_inflation
from .mesh import TriMesh
from .score import Score, score
from .sewing import Seam, corners, make_stitches
from .sewing import make as make_seam
from .solids import Shape, Solid, Value
from .tear import Tear, split
from .view import Color, View


class Scene:
    """A scene.

    Args:
        gravity: (3,) acceleration [m/s^2]; None or zeros model none. y is up.
        air: drag and wind, or None.
        view: how to draw it.
    """

    def __init__(self, gravity: ArrayLike | None = (0.0, -9.81, 0.0), air: Air | None = None,
                 view: View | None = None) -> None:
        self.gravity = checks.vector("gravity", np.zeros(3) if gravity is None else gravity, "m/s^2")
        self.air: Air | None = checks.maybe(air, checks.instance, "air", Air)
        self.view = View() if view is None else checks.instance("view", view, View)
        self.cloths: list[Cloth] = []
        self.solids: list[Solid] = []
        self.apart: list[tuple[Cloth, Cloth]] = []  # pairs that pass through each other
        self.masses: list[tuple[Cloth, np.ndarray, float]] = []
        self.forces: list[Callable] = []
        self.seams: list[Seam] = []
        self.creases: list[Crease] = []
        self.scores: list[Score] = []  # of cloth that may tear
        self.pieces: list[Inflation] = []  # the first inflation of each piece that has one
        self.script, self._running = Script(), False
        self.followers: weakref.WeakSet = weakref.WeakSet()  # simulations of it that are open

    def __repr__(self) -> str:
        cloths = ", ".join(f"{c.name} ({c.mesh.vertex_count:,} vertices)" for c in self.cloths) or "no cloth"
        solids = ", ".join(s.name for s in self.solids) or "none"
        return f"<Scene of {cloths}; solids: {solids}; {len(self.seams)} seams>"

    def add_cloth(self, mesh: TriMesh, fabric: Fabric, positions: ArrayLike | None = None,
                  velocities: ArrayLike | None = None, name: str | None = None,
                  color: str | Color | Appearance | None = None, contact: ClothContact | None = None,
                  panels: dict[str, Fabric] | None = None, tear: Tear | None = None) -> Cloth:
        """Adds a piece of cloth.

        Args:
            positions: (n, 3) at time 0 [m]; the mesh's own where None.
            velocities: (n, 3) or (3,) at time 0 [m/s]; zero where None.
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
        self.cloths.append(cloth)
        if apart is not None:
            self.seams.append(corners(cloth))
        units.say(cloth, self.gravity)
        return cloth

    def add_garment(self, garment: Garment, fabric: Fabric, velocities: ArrayLike | None = None, name: str | None = None,
                    color: str | Color | Appearance | None = None, contact: ClothContact | None = None,
                    panels: dict[str, Fabric] | None = None, pull: float | None = None) -> Cloth:
        """Adds a garment's panels as one piece of cloth, and sews its seams.

        Args:
            velocities, name, color, contact, panels: as in `add_cloth`; pull: as in `sew`.
        """
        checks.instance("add_garment: garment", garment, Garment)
        cloth = self.add_cloth(garment.mesh, fabric, garment.positions, velocities, name, color, contact, panels)
        for a, b, rest in garment.seams:
            self.sew(cloth, a, b, rest, pull=pull if len(a) > 1 else None)
        return cloth

    def add_force(self, make: Callable) -> None:
        """Adds a force of your own.

        Args:
            make: a class, or a function, that makes a `forces.force.Force` of (fields, model, scene, K).
        """
        self.forces.append(checks.function("add_force: make", make, "fields", "model", "scene", "K"))

    def sew(self, cloth: Cloth, a: ArrayLike, b: ArrayLike, rest: float | str = "flat", stiffness: float = 1.0,
            strength: float | None = None, pull: float | None = None) -> Seam:
        """Sews two rows of vertices of a cloth to each other, one by one.

        They move as one, exactly; what is apart comes together first, at .5 m/s at most. Where vertices that follow each
        other in a row are the ends of an edge, in both rows, the two edges have a hinge. Three and more layers are seams
        between two of them each.

        Args:
            a, b: (k,) vertices; where both are the same, as at the tip of a dart, nothing is sewn.
            rest: "flat", "given" (the angle in the cloth's mesh), or the angle of the seam at rest [rad].
            stiffness: factor of its hinges' bending stiffness; with 0 there are none.
            strength: force a length [N/m] at which it rips, stitch by stitch; None never does. Each stitch bears it over
                half the way to the next on either side, from when it is closed.
            pull: force a length [N/m] that draws it together while it is apart; what bears more stays apart, and
                `Simulation.seam_gaps` says how far. None draws by whatever force it takes.

        Raises:
            SceneError: rows of different lengths, a vertex twice in a row, nothing to sew, or a strength that is not
                positive.
        """
        self._own(cloth)
        self.seams.append(make_seam(cloth, a, b, rest, stiffness, strength, pull))
        return self.seams[-1]

    def stitch(self, cloth: Cloth, a: ArrayLike, b: ArrayLike, force: float | None = None) -> Seam:
        """Sews vertices to each other by stitches that stand alone, as buttons do: without hinges, each for itself.

        Args:
            a, b: vertices, one or (k,).
            force: [N] at which each gives; None never does.

        Raises:
            SceneError: as `sew`.
        """
        self._own(cloth)
        self.seams.append(make_stitches(cloth, a, b, force))
        return self.seams[-1]

    def unsew(self, seam: Seam, vertices: object = None) -> None:
        """Opens a seam, or those of its stitches that are at `vertices` of its cloth; in an event, from then on.

        Raises:
            SceneError: a seam of another scene, or no stitch there.
        """
        if not any(seam is s for s in self.seams):
            raise SceneError(f"unsew: not a seam of this scene: {shown(seam)}")
        rows = seam.stitches(vertices)
        self._warn_followers()
        self.script.opened.append((seam, rows))

    def crease(self, cloth: Cloth, angle: ArrayLike, line: ArrayLike | None = None, edges: ArrayLike | None = None,
               stiffness: float = 1.0) -> Crease:
        """Bends edges of a cloth at rest, as ironed pleats are; later creases take the place of earlier ones.

        Args:
            angle: at rest [rad], -pi to pi, one or (k,) for `edges`; positive where the side that normals point to opens.
            line: (p, 2) points of the pattern [m]; the mesh's edges on the straight ways between them.
            edges: (k, 2) vertices, instead.
            stiffness: factor of the edges' bending stiffness; with 0 they are free to turn.

        Raises:
            SceneError: no edge there, a fabric that does not bend over hinges, or an angle beyond pi.
        """
        self._own(cloth)
        self.creases.append(make_crease(cloth, angle, line, edges, stiffness))
        return self.creases[-1]

    def score(self, cloth: Cloth, line: ArrayLike, fraction: float) -> Score:
        """Weakens cloth that may tear along a line: it tears there at a fraction of its strength, and at 0 is cut.

        Args:
            line: (p, 2) points of the pattern [m]; the mesh's edges on the straight ways between them.

        Raises:
            SceneError: cloth that does not tear, no edge there, or a fraction beyond 0 to 1.
        """
        self._own(cloth)
        self.scores.append(score(cloth, line, fraction))
        if self.scores[-1].fraction == 0:
            seam = next(s for s in self.seams if s.cloth is cloth and s.tears)
            self.script.opened.append((seam, np.flatnonzero(cloth.split.on_line(self.scores[-1].edges))))  # type: ignore[union-attr]
        return self.scores[-1]

    def inflate(self, cloth: Cloth, pressure: Drive | None = None, gas: str = "constant", volume: Drive | None = None,
                part: object = None, ambient: float = ATMOSPHERE, bulk: float = 1e6) -> Inflation:
        """Fills closed cloth with gas, which presses on it from inside. Seams count as closed; each closed piece is a room of
        its own. What is inflated again, as in an event, gets the new gas instead of the old.

        Args:
            pressure: p over that outside [Pa], a number or a function of time [s], such as a ramp.
            gas: "constant": p is what it is, whatever the volume V, as with a fan or a line. "isothermal": an amount of gas,
                (p + ambient) V stays what it is at `volume`; without a pressure, what there is is shut in. "volume": the piece
                is full of a liquid, of which there is `volume`: p = bulk (1 - V/volume).
            volume: [m^3], of a liquid it may be a function of time [s]; the one when this begins where None.
            part: vertices as in `pin`: the faces that have all corners among them; all of the cloth where None.
            ambient: pressure outside [Pa].
            bulk: modulus of the liquid [Pa]: the volume is off by p/bulk.

        Raises:
            SceneError: an impossible value; in an event, a piece that was not inflated when the simulation was made. That a
                piece is open is found out when the scene is simulated.
        """
        self._own(cloth)
        new = make_inflation(cloth, pressure, gas, volume, part, ambient, bulk, self.script.made)
        known = any(p.of(cloth, new.part) for p in self.pieces)
        if self._running and not known:
            raise SceneError(f"inflate: {new.name!r} was not inflated when the simulation was made: do so, with pressure 0")
        self._warn_followers()
        if not known:
            self.pieces.append(new)
        self.script.inflations[:] = [i for i in self.script.inflations if not i.of(cloth, new.part)] + [new]
        self.script.made += 1
        return new

    def deflate(self, cloth: Cloth, part: object = None) -> None:
        """Opens what was inflated: nothing presses on it any more.

        Raises:
            SceneError: a piece that is not inflated.
        """
        self._own(cloth)
        vertices = None if part is None else np.unique(cloth.mesh.select(part))
        kept = [i for i in self.script.inflations if not i.of(cloth, vertices)]
        if len(kept) == len(self.script.inflations):
            where = "" if part is None else f" in part = {shown(part)}"
            raise SceneError(f"deflate: {cloth.name!r} is not inflated{where}")
        self._warn_followers()
        self.script.inflations[:] = kept

    def pass_through(self, a: Cloth, b: Cloth) -> None:
        """Lets two cloths that have a contact pass through each other."""
        for cloth in (a, b):
            self._own(cloth)
        if a is b:
            raise SceneError(f"pass_through: {a.name!r} twice; for a cloth and itself use ClothContact(itself=False)")
        self.apart.append((a, b))

    def passes(self, a: Cloth, b: Cloth) -> bool:
        """Whether two cloths pass through each other."""
        return (a, b) in self.apart or (b, a) in self.apart or a.contact is None or b.contact is None

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
        if name in (s.name for s in self.solids):
            raise SceneError(f"there is a solid named {name!r} already")
        self.solids.append(solid)
        return solid

    @property
    def touches(self) -> bool:
        """Whether cloth can meet anything: solids, other cloth or itself."""
        return bool(self.solids) or any(c.contact is not None for c in self.cloths)

    @property
    def vertex_count(self) -> int:
        """Number of vertices of all cloths."""
        return sum(c.mesh.vertex_count for c in self.cloths)

    def pin(self, cloth: Cloth, vertices: object, directions: object = None) -> None:
        """Holds vertices where they are, in all directions or in 1, 2 or 3 given ones.

        Args:
            vertices: index, list, mask, group name or list of names.
            directions: None (all), axis letters such as "y" or "xz", or (3,) or (1..3, 3) vectors.
        """
        self._attach(cloth, vertices, directions, None, False)

    def move(self, cloth: Cloth, vertices: object, path: Path, relative: bool = False,
             directions: object = None) -> None:
        """Leads vertices along a path.

        Args:
            path: function of time [s] that returns (k, 3) positions [m] of the k selected vertices in the order
                given ((3,) where k is 1); with `relative`, displacements from where they are when the motion
                begins, (k, 3) or one (3,) for all.
            directions: as in `pin`; the other directions stay free.
        """
        checks.function("move: path", path, "time")
        self._attach(cloth, vertices, directions, path, checks.flag("move: relative", relative))

    def attach(self, cloth: Cloth, vertices: object, solid: Solid, since: float = 0.0, stiffness: float | None = None,
               most: float | None = None) -> None:
        """Lets vertices ride on a solid, from where they are: at the nearest place of its surface, as that turns and moves.

        Hard, or by springs, which give where a solid presses the cloth away. `detach` lets go.

        Args:
            since: when this begins [s]; in an event, the event's own time.
            stiffness: of a spring from each vertex to its place [N/m]; None holds them there exactly.
            most: largest force of each spring [N]; None sets no bound.

        Raises:
            SceneError: a solid of another scene, or a largest force without a stiffness.
        """
        if not any(solid is s for s in self.solids):
            names = [s.name for s in self.solids]
            raise SceneError(f"attach: not a solid of this scene: {shown(getattr(solid, 'name', solid))}; there are {names}")
        since = checks.number("attach: since", since, "s", least=0.0)
        if most is not None and stiffness is None:
            raise SceneError("attach: most bounds the force of a spring: give a stiffness with it")
        stiffness = checks.maybe(stiffness, checks.number, "attach: stiffness", "N/m", positive=True)
        most = np.inf if most is None else checks.number("attach: most", most, "N", positive=True)
        self._attach(cloth, vertices, None, None, False, solid, since, stiffness, most)

    def detach(self, cloth: Cloth, vertices: object = None) -> None:
        """Releases vertices (all of the cloth's where None) from solids that they are attached to; pins and motions stay.

        Raises:
            SceneError: where none of them is attached.
        """
        self._release(cloth, vertices, "detach", "attached to a solid", lambda a: a.solid is not None)

    def unpin(self, cloth: Cloth, vertices: object = None) -> None:
        """Releases vertices (all of the cloth's where None) from every pin, motion and attachment.

        Raises:
            SceneError: where none of them is held.
        """
        self._release(cloth, vertices, "unpin", "pinned or moved", lambda a: True)

    def _release(self, cloth: Cloth, vertices: object, what: str, held: str, which: Callable[[Attachment], bool]) -> None:
        self._own(cloth)
        free = np.arange(cloth.mesh.vertex_count) if vertices is None else cloth.mesh.select(vertices)
        kept, found = [], False
        for a in self.script.attachments:
            stay = a.vertices if a.cloth is not cloth or not which(a) else a.vertices[~np.isin(a.vertices, free)]
            found |= len(stay) < len(a.vertices)
            if len(stay):
                kept.append(replace(a, vertices=stay))
        if not found:
            raise SceneError(f"{what}: no such vertex of {cloth.name!r} is {held}")
        self._warn_followers()
        self.script.attachments[:] = kept

    def at(self, t: float, f: Callable) -> None:
        """Calls f() or f(scene) when simulated time reaches t [s]; steps end exactly there.

        Pins and motions that f changes hold for the running simulation only; the scene stays as it was built.
        """
        t = checks.number("at: t", t, "s", least=0.0)
        checks.function("at: f", f)
        if checks.takes(f, 0) is False and checks.takes(f, 1) is False:
            raise SceneError(f"at: f = {shown(f)}: must be a function of nothing, or of the scene")
        self.script.events.append(Event(t, f))

    def add_mass(self, cloth: Cloth, vertices: object, mass: float) -> None:
        """Adds a point mass [kg] to each of the vertices."""
        self._own(cloth)
        mass = checks.number("point mass", mass, "kg", positive=True)
        self.masses.append((cloth, used_vertices(cloth, vertices), mass))

    @contextlib.contextmanager
    def running(self, script: Script) -> Iterator[None]:
        """Lets pins, motions and events act on `script` instead of the scene's own."""
        own, self.script, was = self.script, script, self._running
        self._running = True
        try:
            yield
        finally:
            self.script, self._running = own, was

    def fire(self, event: Event) -> None:
        """Calls an event's function with as many arguments as it takes: none, or this scene."""
        event.action(*([] if checks.takes(event.action, 0) else [self]))

    def _warn_followers(self) -> None:
        """Says that simulations keep what was there when they were made."""
        if not self._running and len(self.followers):
            warnings.warn("a simulation of this scene has begun and does not follow changes of its pins and motions: use "
                          "sim.pin, unpin, move or attach, or an event (scene.at)", stacklevel=3)

    def _own(self, cloth: Cloth) -> None:
        if not any(cloth is c for c in self.cloths):
            names = [c.name for c in self.cloths]
            what = cloth.name if isinstance(cloth, Cloth) else cloth
            raise SceneError(f"not a cloth of this scene: {shown(what)}; {did_you_mean(what, names)}")

    def _attach(self, cloth: Cloth, vertices: object, directions: object, path: Path | None, relative: bool,
                solid: Solid | None = None, since: float = 0.0, stiffness: float | None = None,
                most: float = np.inf) -> None:
        self._own(cloth)
        index = used_vertices(cloth, vertices)
        order = np.argsort(index, kind="stable")
        if path is not None and len(np.unique(index)) < len(index):
            raise SceneError("move: a vertex is named twice")
        basis = orthonormal(directions)
        selected = np.unique(index)
        attachment = Attachment(cloth, selected, basis, path, relative, self.script.made, selected, order, solid, since,
                                stiffness, most)
        if path is not None:
            attachment.checked(0.0)
        check_overlap(self.script.attachments, attachment)
        self._warn_followers()
        self.script.attachments.append(attachment)
        self.script.made += 1
