"""Cloths and solids, and changes to them as a run goes on: pins, prescribed motion, gas, loads, wind, events. numpy only."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .air import Wind
from .attachment import Attachment, Event, Path, Script, check_overlap, orthonormal
from .cloth import Cloth, used_vertices
from .inflation import ATMOSPHERE, Drive, Inflation
from .inflation import make as make_inflation
from .load import Force, Load
from .load import make as make_load
from .sewn import Sewn
from .solids import Prop, Solid


class Scene(Sewn):
    """A scene.

    Args:
        gravity: (3,) acceleration [m/s^2]; None or zeros model none. y is up.
        air: drag and wind, or None.
        view: how to draw it.
    """

    def pin(self, cloth: Cloth, vertices: object, directions: object = None, stiffness: float | None = None) -> None:
        """Holds vertices where they are, in all directions or in 1, 2 or 3 given ones.

        Args:
            vertices: index, list, mask, group name or list of names.
            directions: None (all), axis letters such as "y" or "xz", or (3,) or (1..3, 3) vectors.
            stiffness: [N/m] of a group with weights (`TriMesh.weights`). Weight 1 holds exactly. A weight w below it holds by
                a spring to the vertex's place, of `stiffness` w / (1 - w): that is `stiffness` at one half.

        Raises:
            SceneError: weights below 1 without a stiffness, or with directions.
        """
        stiffness = checks.maybe(stiffness, checks.number, "pin: stiffness", "N/m", positive=True)
        self._own(cloth)
        weights = cloth.mesh.select_weights(vertices)
        if (weights == 1).all():
            self._attach(cloth, vertices, directions, None, False)
            return
        index = cloth.mesh.select(vertices)
        soft = np.flatnonzero(weights < 1)
        if stiffness is None or directions is not None:
            way = ("give stiffness= [N/m], of a spring at weight one half, or pin mesh.select(...) to hold all"
                   if stiffness is None else "springs hold them in all directions: leave out directions")
            raise SceneError(f"pin: {len(soft)} of {len(index)} vertices in {shown(vertices)} have weights between 0 and 1, "
                             f"as {index[soft[0]]} has {weights[soft[0]]:.3g}: {way}")
        if len(soft) < len(index):
            self._attach(cloth, index[weights == 1], None, None, False)
        w = weights[soft]
        self._attach(cloth, index[soft], None, None, False, stiffness=stiffness * w / (1 - w))

    def move(self, cloth: Cloth, vertices: object, path: Path, relative: bool = False,
             directions: object = None, stiffness: float | None = None, most: float | None = None) -> None:
        """Leads vertices along a path, exactly, or by springs that pull them after it.

        Args:
            path: function of time [s] that returns (k, 3) positions [m] of the k selected vertices in the order
                given ((3,) where k is 1). With `relative`, displacements from their places when the motion begins, (k, 3) or
                one (3,) for all.
            directions: as in `pin`; the other directions stay free.
            stiffness, most: of springs, as in `attach`; they pull in all directions.

        Raises:
            SceneError: a wrong shape, a largest force or directions that do not go with the stiffness.
        """
        checks.function("move: path", path, "time")
        soft = _spring("move", stiffness, most)
        if stiffness is not None and directions is not None:
            raise SceneError("move: a spring pulls in all directions: leave out directions, or the stiffness")
        self._attach(cloth, vertices, directions, path, checks.flag("move: relative", relative), None, 0.0, *soft)

    def attach(self, cloth: Cloth, vertices: object, solid: Solid | Prop, since: float = 0.0,
               stiffness: float | None = None, most: float | None = None) -> None:
        """Lets vertices ride on a solid or a prop, from where they are: with the nearest place of its surface, as it moves.

        Each keeps its offset from that place; it is not drawn to the surface. Hard, or by springs, which give where a solid
        presses the cloth away. `detach` lets go.

        Args:
            since: when this begins [s]; in an event, the event's own time.
            stiffness: of a spring from each vertex to its place [N/m]; None holds them there exactly.
            most: largest force of each spring [N]; None sets no bound.

        Raises:
            SceneError: a solid of another scene, or a largest force without a stiffness.
        """
        there = [*self.solids, *self.props]
        if not any(solid is s for s in there):
            names = [s.name for s in there]
            raise SceneError(f"attach: not a solid of this scene: {shown(getattr(solid, 'name', solid))}; there are {names}")
        since = checks.number("attach: since", since, "s", least=0.0)
        self._attach(cloth, vertices, None, None, False, solid, since, *_spring("attach", stiffness, most))

    def detach(self, cloth: Cloth, vertices: object = None) -> None:
        """Releases vertices (all of the cloth's if None) from solids that they are attached to; pins and motions stay.

        Raises:
            SceneError: where none of them is attached.
        """
        self._release(cloth, vertices, "detach", "attached to a solid", lambda a: a.solid is not None)

    def unpin(self, cloth: Cloth, vertices: object = None) -> None:
        """Releases vertices (all of the cloth's if None) from every pin, motion and attachment.

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
        self._refuse_followed(what, live=True)
        self.script.attachments[:] = kept

    def _attach(self, cloth: Cloth, vertices: object, directions: object, path: Path | None, relative: bool,
                solid: Solid | Prop | None = None, since: float = 0.0, stiffness: float | np.ndarray | None = None,
                most: float = np.inf) -> None:
        self._own(cloth)
        index = used_vertices(cloth, vertices)
        order = np.argsort(index, kind="stable")
        if path is not None and len(np.unique(index)) < len(index):
            raise SceneError("move: a vertex is named twice")
        basis = orthonormal(directions)
        selected, first = np.unique(index, return_index=True)
        if isinstance(stiffness, np.ndarray):
            stiffness = stiffness[first]
        attachment = Attachment(cloth, selected, basis, path, relative, self.script.made, selected, order, solid, since,
                                stiffness, most)
        if path is not None:
            attachment.checked(0.0)
        check_overlap(self.script.attachments, attachment)
        self._refuse_followed("attach" if solid is not None else "pin" if path is None else "move", live=True)
        self.script.attachments.append(attachment)
        self.script.made += 1

    def inflate(self, cloth: Cloth, pressure: Drive | None = None, gas: str = "constant", volume: Drive | None = None,
                part: object = None, ambient: float = ATMOSPHERE, bulk: float = 1e6) -> Inflation:
        """Fills closed cloth with gas, which presses on it from inside. Seams count as closed; each closed piece is a room of
        its own. A piece that is inflated again, as in an event, gets the new gas instead of the old.

        Args:
            pressure: p over that outside [Pa], a number or a function of time [s], such as a ramp.
            gas: "constant": p is given, whatever the volume V, as with a fan or a line. "isothermal": an amount of gas:
                (p + ambient) V keeps its value at `volume`; without a pressure, the present gas is shut in. "volume": the
                piece is full of a liquid, of which there is `volume`: p = bulk (1 - V/volume).
            volume: [m^3], of a liquid it may be a function of time [s]; the one when this begins if None.
            part: vertices as in `pin`: the faces that have all corners among them; all of the cloth if None.
            ambient: pressure outside [Pa].
            bulk: modulus of the liquid [Pa]: the volume is off by p/bulk.

        Raises:
            SceneError: an impossible value; in an event, a piece that was not inflated when the simulation was made. A
                piece that is open is refused later, when the scene is simulated.
        """
        self._own(cloth)
        new = make_inflation(cloth, pressure, gas, volume, part, ambient, bulk, self.script.made)
        known = any(p.of(cloth, new.part) for p in self.pieces)
        if self._running and not known:
            raise SceneError(f"inflate: {new.name!r} was not inflated when the simulation was made: do so, with pressure 0")
        self._refuse_followed("inflate", live=True)
        if not known:
            self.pieces.append(new)
        self.script.inflations[:] = [i for i in self.script.inflations if not i.of(cloth, new.part)] + [new]
        self.script.made += 1
        return new

    def deflate(self, cloth: Cloth, part: object = None) -> None:
        """Opens an inflated piece: nothing presses on it any more.

        Raises:
            SceneError: a piece that is not inflated.
        """
        self._own(cloth)
        vertices = None if part is None else np.unique(cloth.mesh.select(part))
        kept = [i for i in self.script.inflations if not i.of(cloth, vertices)]
        if len(kept) == len(self.script.inflations):
            where = "" if part is None else f" in part = {shown(part)}"
            raise SceneError(f"deflate: {cloth.name!r} is not inflated{where}")
        self._refuse_followed("deflate", live=True)
        self.script.inflations[:] = kept

    def add_load(self, cloth: Cloth, vertices: object, force: Force) -> Load:
        """Puts a force on vertices, whatever they do.

        Args:
            vertices: as in `pin`.
            force: [N]: (3,) on each of them, (k, 3) in the order given, or a function of time [s] that returns one of these.

        Raises:
            SceneError: an impossible value; in an event, where the scene was built without a load.
        """
        self._own(cloth)
        load = make_load(cloth, vertices, force)
        if self._running and not self.script.bears:
            raise SceneError("add_load: the simulation was made without loads: give its scene one before, of 0 N if need be")
        self._refuse_followed("add_load", live=True)
        self.script.loads.append(load)
        self.script.bears = True
        return load

    def remove_load(self, load: Load) -> None:
        """Takes a load away.

        Raises:
            SceneError: it is not there.
        """
        if not any(load is known for known in self.script.loads):
            raise SceneError(f"remove_load: not a load that is there now: {shown(load)}")
        self._refuse_followed("remove_load", live=True)
        self.script.loads[:] = [known for known in self.script.loads if known is not load]

    def set_wind(self, wind: Wind) -> None:
        """Lets another wind blow; drag and lift stay as they are in `air`.

        Args:
            wind: as in `Air`.

        Raises:
            SceneError: a scene without air, or an impossible value; in an event, a wind that varies in space where the scene's
                air did not when the simulation was made.
        """
        if self.air is None:
            raise SceneError("set_wind: the scene has no air: Scene(air=Air(normal=...)) says how the cloth drags in it")
        air = replace(self.air, wind=wind)
        if not self._running:
            self._refuse_followed("set_wind", live=True)
            self.air = air
            return
        if air.varies_in_space and not self.air.local:
            raise SceneError("set_wind: the simulation was made with air that is the same everywhere: give its scene a wind "
                             "that is a function of positions and time")
        self.script.air = air

    def at(self, t: float, f: Callable) -> None:
        """Calls f() or f(scene) when simulated time reaches t [s]; steps end exactly there.

        Changes by f of pins, motions, gas, loads and wind hold for the running simulation only; the scene stays as it was
        built.
        """
        t = checks.number("at: t", t, "s", least=0.0)
        checks.function("at: f", f)
        if checks.takes(f, 0) is False and checks.takes(f, 1) is False:
            raise SceneError(f"at: f = {shown(f)}: must be a function of nothing, or of the scene")
        if not self._running:
            self._refuse_followed("at")
        self.script.events.append(Event(t, f))

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


def _spring(what: str, stiffness: float | None, most: float | None) -> tuple[float | None, float]:
    """Stiffness [N/m] and largest force [N] of soft attachments; (None, infinite) where they are exact.

    Raises:
        SceneError: an impossible value, or a largest force without a stiffness.
    """
    if most is not None and stiffness is None:
        raise SceneError(f"{what}: most bounds the force of a spring: give a stiffness with it")
    return (checks.maybe(stiffness, checks.number, f"{what}: stiffness", "N/m", positive=True),
            np.inf if most is None else checks.number(f"{what}: most", most, "N", positive=True))
