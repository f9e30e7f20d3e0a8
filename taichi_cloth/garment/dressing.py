"""From panels that hang round a body to a garment that it wears: sewn without weight, then let down.

1. Sewing: no gravity, air that calms, seams that close by a bounded pull (`forces.closing`), the body smooth; cloth meets
   itself. Where seams close no further they get a stronger pull. Layers of a pleat narrower than a triangle have no room for
   their thickness: where no step passes they rest, and in the end all that is beside what is still apart.
2. Settling: gravity, the body's friction; until the cloth rests, and no more of what passed through itself while it was sewn
   comes apart.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .. import checks
from ..errors import SceneError, SimulationError
from ..scene.air import Air
from ..scene.fabric import ClothContact, Fabric
from ..scene.fabrics import as_fabric
from ..scene.garment import Garment
from ..scene.intersections import count_crossings, self_crossings
from ..scene.scene import Scene
from ..scene.solids import Solid, SolidMesh
from ..scene.units import doubts_of_solid
from ..simulation import Simulation

CALM = 2.0  # N s/m^3, drag of the air in which seams are closed
SEWING = 3.0  # s in which seams have to close
PULL = 5.0  # N/m at most, with which seams are closed,
FIRMER, FIRMEST = 4.0, 1024.0  # times as much where they close no further; at most in all
FIRM = 64.0  # times as much where pairs beside what does not close rest
FINEST, LOCKED = 32, 0.3  # part of h at which layers that are nearer than that part of what they keep rest, as no step passes
NEARER, SLOWEST = 0.2, 0.1  # part of the widest gap, and m/s, by the lesser of which it closes, or else closes no further
ROUGH = 1e-3  # relative residual of the solves: only the rest shape counts
SPARED = 0.5  # of the solids' thickness that cloth keeps from them meanwhile
SLOW, SHORTEST = 0.05, 0.5  # m/s, RMS, at which cloth rests, not before so many s
TENTH, ROUND = 0.1, 1e-9  # s after which it is seen how far things are; part of it that is too little for a step
NAMED = 3  # pairs of panels that a report names
PATIENCE = 4  # tenths of a second in which some crossing has to come apart


@dataclass(frozen=True)
class Dressed:
    """What came of dressing.

    Attributes:
        garment: as it is worn.
        sewn: s that closing the seams took; settled: s until it came to rest, or was told to end; rests: which of them.
        speed: RMS at the end [m/s].
        intersections: edges of cloth through triangles of cloth at the end, counted exactly; None where it does not meet
            itself.
        crossed: how many of them are between which two panels, the most first.
    """

    garment: Garment
    sewn: float
    settled: float
    rests: bool
    speed: float
    intersections: int | None
    crossed: tuple[tuple[str, str, int], ...] = ()

    def report(self) -> str:
        """A few words."""
        crossed = "" if self.intersections is None else f", {self.intersections} crossings with itself"
        if self.crossed:
            crossed += " (" + ", ".join(f"{n} of {a!r} and {b!r}" for a, b, n in self.crossed[:NAMED])
            crossed += ", ...)" if len(self.crossed) > NAMED else ")"
        rest = "at rest" if self.rests else f"still moving at {self.speed:.2g} m/s"
        return f"seams closed after {self.sewn:.2f} s, {rest} after {self.settled:.2f} s more{crossed}"


def dress(garment: Garment, fabric: Fabric | str, body: Scene, contact: ClothContact | None = None, longest: float = 4.0,
          h: float = 1 / 60, tell: Callable[[str], None] | None = None, pull: float | None = PULL,
          meets: bool = True) -> Dressed:
    """Dresses the solids of a scene, as they are at time 0.

    Args:
        garment: panels round the body, outside of it.
        contact: how the cloth meets itself.
        longest: s after which settling ends, at rest or not.
        tell: called with a line a tenth of a second of simulated time.
        pull: force a length [N/m] that closes seams, four times as much and again where they close no further; None closes
            them by whatever force it takes.
        meets: whether cloth with a contact meets itself while it is sewn too. So layers keep their order; where not, sewing a
            dress with pleats takes little more than half the time.

    Raises:
        SceneError: a body without solids, or of a size that shows another unit; panels that start inside the body, or seams
            that do not close, by name; a garment that falls off the body.
    """
    checks.instance("dress: garment", garment, Garment)
    checks.instance("dress: body", body, Scene)
    if not body.solids:
        raise SceneError("dress: the body is a scene without solids")
    doubts = [doubt for solid in body.solids for doubt in doubts_of_solid(solid)]
    if doubts:
        raise SceneError(f"dress: {doubts[0]}")
    fabric = as_fabric("dress: fabric", fabric)
    checks.maybe(contact, checks.instance, "dress: contact", ClothContact)
    checks.maybe(tell, checks.function, "dress: tell", "line")
    h = checks.number("dress: h", h, "s", positive=True, most=0.1)
    longest = checks.number("dress: longest", longest, "s", positive=True)
    checks.flag("dress: meets", meets)
    still = [_still(s) for s in body.solids]
    whole = replace(garment, seams=tuple(seam._replace(strength=None) for seam in garment.seams))  # none rips meanwhile
    x, sewn = _sewn(whole, fabric, still, h, pull, contact if meets else None, tell)
    scene = Scene(gravity=body.gravity, air=body.air)
    scene.solids += still
    scene.add_garment(replace(whole, positions=x), fabric, contact=contact)
    sim = Simulation(scene, h=h, cg_tol=ROUGH)
    try:
        speed, crossed = np.inf, [0 if contact is None else sim.intersections()]
        while sim.time < longest and (speed > SLOW or sim.time < SHORTEST or _part(crossed)):
            _advance(sim, tell, "settling" + (f", {speed:.2g} m/s" if np.isfinite(speed) else ""))
            speed = float(np.sqrt(np.mean(np.sum(sim.velocities() ** 2, axis=1))))
            if _below(sim.positions(), still, body.gravity):
                raise SceneError("dress: the garment slid off the body and fell: is the body too small for it, or in another "
                                 "unit (--scale)?")
            if contact is not None:
                crossed.append(sim.intersections())
        made = replace(garment, positions=sim.positions())
        count, where = (None, ()) if contact is None else (crossed[-1], _crossed(made))
        return Dressed(made, sewn, sim.time, speed <= SLOW, speed, count, where)
    finally:
        sim.close()


def _sewn(garment: Garment, fabric: Fabric, solids: list[Solid], h: float, pull: float | None, contact: ClothContact | None,
          tell: Callable[[str], None] | None) -> tuple[np.ndarray, float]:
    """(positions (n, 3) [m] in which all seams are closed, s that it took); see `dress`."""
    scene = Scene(gravity=None, air=Air(CALM, CALM))
    scene.solids += [replace(s, thickness=SPARED * s.thickness, friction=0.0) for s in solids]
    if contact is not None:
        contact = replace(contact, thickness=SPARED * contact.thickness)
    scene.add_garment(garment, fabric, contact=contact, pull=pull)
    sim = Simulation(scene, h=h, cg_tol=ROUGH)
    try:
        _refuse_inside(sim, garment)
        firm, before = 1.0, np.inf
        while (gap := sim.seam_gaps().max(initial=0.0)) > 0:
            if sim.time > SEWING:
                raise SceneError(_left_open(sim.positions(), garment))
            if pull is not None and before - gap < min(NEARER * before, SLOWEST * TENTH):
                if contact is not None and firm >= FIRM:
                    sim.contacts.layers.release_around(sim.giving.stitches.apart)
                if firm < FIRMEST:
                    firm *= FIRMER
                    sim.stepper.pull_firmer(FIRMER)
            before = gap
            _advance(sim, tell, f"sewing, gap {gap:.3g} m", h / FINEST if contact is not None else 0.0)
        return sim.positions(), sim.time
    finally:
        sim.close()


def _below(x: np.ndarray, solids: list[Solid], gravity: np.ndarray) -> bool:
    """Whether cloth at x (n, 3) [m] has fallen past all solids."""
    lowest = max(float((solid.surface_at(0.0) @ gravity).max()) for solid in solids)
    return bool(gravity.any() and (x @ gravity).min() > lowest)


def _part(crossed: list[int]) -> bool:
    """Whether there are crossings, of those counted every tenth of a second, and they have become fewer within PATIENCE."""
    return 0 < min(crossed[-PATIENCE:]) < min(crossed[:-PATIENCE], default=np.inf)


def _advance(sim: Simulation, tell: Callable[[str], None] | None, what: str, finest: float = 0.0) -> None:
    """A tenth of a second. Where no step of `finest` [s] passes for layers that are pressed together, they rest; else smaller
    ones are tried."""
    end, usual = sim.time + TENTH, sim.control
    while end - sim.time > ROUND * TENTH:
        if finest:
            sim.stepper.control = replace(usual, h_min=finest)
        try:
            sim.step(min(usual.h_max, end - sim.time))
        except SimulationError:
            if not finest:
                raise
            nearest = sim.contacts.layers.nearest()
            if nearest is not None and nearest.gap < LOCKED:
                sim.contacts.layers.release_around(np.array(nearest.particles))
                sim.stepper.h = usual.h_max
            else:
                finest = 0.0
        sim.stepper.control = usual
    if tell is not None:
        tell(f"{sim.time:.1f} s, {what}")


def _still(solid: Solid) -> Solid:
    """A solid as it is at time 0."""
    R, p = solid.pose(0.0)
    shape = solid.shape
    if isinstance(shape, SolidMesh) and len(shape.x) > 1:
        shape = SolidMesh(shape.shape_at(0.0), shape.faces)
    return replace(solid, shape=shape, position=p, rotation=R)


def _refuse_inside(sim: Simulation, garment: Garment) -> None:
    """Refuses panels that start inside a solid, or through one."""
    if sim.contacts is None:
        return
    scan, model = sim.contacts.scan, sim.model
    model.save()
    scan.set_time(0.0, sim.control.h_max)
    found = scan.detect()
    inside = found.start_gap + scan.thickness[found.solid] < 0
    if not inside.any():
        _refuse_through(sim.scene.solids, garment)
        return
    vertex = model.user[found.index[inside]]
    solid = sim.scene.solids[int(found.solid[inside][0])].name
    raise SceneError(f"dress: {len(np.unique(vertex))} vertices start inside the body, the first of them of "
                     f"{garment.panel_of(vertex[0])!r} in {solid!r}: hang the panels further out")


def _refuse_through(solids: list[Solid], garment: Garment) -> None:
    """Refuses panels that a solid's mesh passes through between their vertices."""
    for solid in solids:
        if isinstance(shape := solid.shape, SolidMesh):
            R, p = solid.pose(0.0)
            count = count_crossings(garment.positions, garment.mesh.faces, shape.shape_at(0.0) @ R.T + p, shape.faces)
            if count:
                raise SceneError(f"dress: panels pass through {solid.name!r}, in {count} pairs of an edge and a triangle: "
                                 "hang them further out")


def _crossed(garment: Garment) -> tuple[tuple[str, str, int], ...]:
    """(panel, panel, number) of what passes through itself, the most first."""
    edges, faces = self_crossings(garment.positions, garment.mesh.faces)
    pairs = (sorted((garment.panel_of(e), garment.panel_of(f))) for e, f in zip(edges[:, 0], garment.mesh.faces[faces, 0]))
    return tuple((a, b, n) for (a, b), n in Counter((a, b) for a, b in pairs).most_common())


def _left_open(x: np.ndarray, garment: Garment) -> str:
    gaps = [float(np.linalg.norm(x[a] - x[b], axis=1).max()) for a, b, *_ in garment.seams]
    k = int(np.argmax(gaps))
    of = [garment.panel_of(row[len(row) // 2]) for row in garment.seams[k][:2]]
    return (f"dress: {sum(g > 0 for g in gaps)} of {len(gaps)} seams are still open after {SEWING:g} s; the widest is seam "
            f"{k}, of {of[0]!r} and {of[1]!r}, with {max(gaps):.3g} m: hang the panels nearer, or pull with more")
