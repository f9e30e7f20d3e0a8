"""Dressing a body: panels that hang round it are sewn without weight, then let down.

1. Sewing: no gravity, air that calms, seams that close by a bounded pull (`forces.closing`), the body smooth; cloth meets
   itself. Seams that close no further get a stronger pull. Layers of a pleat narrower than a triangle have no room for their
   thickness: their contact is released if no step passes, and in the end for all cloth beside stitches still apart.
2. Settling: gravity, the body's friction; until the cloth rests, and no more crossings from the sewing come apart.

Garments that are worn already are there from the start: panels hang outside them (`outside`), and they give way.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

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
from ..simulation.starts import refuse_inside
from .outside import hung_outside
from .worn import Dressed, Worn, crossed_of, worn_under

CALM = 2.0  # N s/m^3, drag of the air in which seams are closed
SEWING, LONGEST = 3.0, 12.0  # s in which seams have to close, or else close so fast that they will have by the second
LATELY = 6  # tenths of a second, ends included, over which it is seen how fast they close; at the strongest pull, no longer
PULL = 5.0  # N/m at most, with which seams are closed,
FIRMER, FIRMEST = 4.0, 1024.0  # times as much where they close no further; at most in all
FIRM = 64.0  # times as much at which contact beside stitches that do not close is released
FINEST, LOCKED = 32, 0.3  # part of h; part of their distance below which layers are released at it
NEARER, SLOWEST = 0.2, 0.1  # part of the widest gap, and m/s, by the lesser of which it closes, or else closes no further
ROUGH = 1e-3  # relative residual of the solves: only the rest shape counts. Contact is not solved (`contact_tol`) either: with
# that the pattern dress slides off a shoulder at four of five spacings, without at none of three
SPARED = 0.5  # of the solids' thickness that cloth keeps from them meanwhile
SLOW, SHORTEST = 0.05, 0.5  # m/s, RMS, at which cloth rests, not before so many s
TENTH, ROUND = 0.1, 1e-9  # s after which it is seen how far things are; part of it that is too little for a step
FELL = 1 / 3  # of a garment's height by which it comes down, and more is told
PATIENCE = 4  # tenths of a second in which some crossing has to come apart


def dress(garment: Garment, fabric: Fabric | str, body: Scene, contact: ClothContact | None = None, longest: float = 4.0,
          h: float = 1 / 60, tell: Callable[[str], None] | None = None, pull: float | None = PULL,
          meets: bool = True, over: Sequence[Worn] = (), name: str = "garment",
          panels: dict[str, Fabric] | None = None) -> Dressed:
    """Dresses the solids of a scene, as they are at time 0.

    Args:
        garment: panels round the body, outside of it.
        contact: how the cloth meets itself, and the garments under it.
        longest: s after which settling ends, at rest or not.
        tell: called with a line a tenth of a second of simulated time.
        pull: force a length [N/m] that closes seams, raised fourfold whenever they close no further;
            None sets no limit to the force.
        meets: whether cloth with a contact meets itself while it is sewn too, so that layers keep their order. Without it,
            sewing a dress with pleats takes little more than half the time.
        over: garments worn already, from inside outwards, such as another's `Dressed.worn`. Panels that would start within
            them hang further out, and so do panels that lie over these. The garment moves them while it is put on.
        name: of the garment, in reports; panels: fabrics of some of its panels, as in `Scene.add_cloth`.

    Raises:
        SceneError: a body without solids or in another unit; panels that start inside the body or seams that do not close, by
            name; a garment or a loose panel that falls off the body.
    """
    fabric = as_fabric("dress: fabric", fabric)
    h, longest = _checked(garment, body, contact, h, longest, tell, meets)
    worn = worn_under(over, contact, checks.name("dress: name", name))
    if worn and not meets:
        raise SceneError("dress: over worn garments, cloth has to meet the garments under it: leave out meets=False")
    still = [_still(s) for s in body.solids]
    new, notes = Worn(garment, fabric, contact, name, panels), garment.loose()
    if worn:
        assert contact is not None
        hung, moved = hung_outside(garment, worn, contact.thickness, body)
        new, notes = replace(new, garment=hung), notes + moved
    all_of = [*worn, new]
    whole = [replace(w, garment=_unrippable(w.garment)) for w in all_of]  # none rips meanwhile
    placed, sewn = _sewn(whole if meets else [replace(whole[0], contact=None)], still, h, pull, tell)
    settling = [replace(w, garment=p, contact=c) for w, p, c in zip(whole, placed, _contacts(all_of, placed))]
    scene = Scene(gravity=body.gravity, air=body.air)
    scene.solids += still
    for w in settling:
        scene.add_garment(w.garment, w.fabric, name=w.name, contact=w.contact, panels=w.panels)
    sim = Simulation(scene, h=h, cg_tol=ROUGH, contact_tol=None)
    try:
        speed, crossed = np.inf, [0 if contact is None else sim.intersections()]
        while sim.time < longest and (speed > SLOW or sim.time < SHORTEST or _part(crossed)):
            _advance(sim, tell, "settling" + (f", {speed:.2g} m/s" if np.isfinite(speed) else ""))
            speed = float(np.sqrt(np.mean(np.sum(sim.velocities() ** 2, axis=1))))
            _refuse_fallen(sim, whole[-1].garment, still)
            if contact is not None:
                crossed.append(sim.intersections())
        now = [replace(w, garment=replace(w.garment, positions=x)) for w, x in zip(all_of, _each(sim))]
        count, where = (None, ()) if contact is None else (crossed[-1], crossed_of(now))
        return Dressed(now[-1].garment, sewn, sim.time, speed <= SLOW, speed, count, where, tuple(now),
                       notes + _caught(now) + _fallen(new.garment, now[-1].garment, body.gravity))
    finally:
        sim.close()


def _checked(garment: Garment, body: Scene, contact: ClothContact | None, h: float, longest: float,
             tell: Callable[[str], None] | None, meets: bool) -> tuple[float, float]:
    """(h, longest) of `dress`, whose arguments are checked here."""
    checks.instance("dress: garment", garment, Garment)
    checks.instance("dress: body", body, Scene)
    if not body.solids:
        raise SceneError("dress: the body is a scene without solids")
    doubts = [doubt for solid in body.solids for doubt in doubts_of_solid(solid)]
    if doubts:
        raise SceneError(f"dress: {doubts[0]}")
    checks.maybe(contact, checks.instance, "dress: contact", ClothContact)
    checks.maybe(tell, checks.function, "dress: tell", "line")
    checks.flag("dress: meets", meets)
    h = checks.number("dress: h", h, "s", positive=True, most=0.1)
    return h, checks.number("dress: longest", longest, "s", positive=True)


def _caught(worn: Sequence[Worn]) -> tuple[str, ...]:
    """A note on the garment under the last one that was caught where edges closed, and is not apart yet."""
    x, faces = worn[-1].garment.positions, worn[-1].garment.mesh.faces
    for w in worn[:-1]:
        count = count_crossings(x, faces, w.garment.positions, w.garment.mesh.faces)
        if count:
            return (f"{w.name!r} sticks out where seams of {worn[-1].name!r} closed, and was caught: {count} crossings are "
                    "left; hang the garment nearer, end it above, or make it wider",)
    return ()


def _fallen(hung: Garment, now: Garment, gravity: np.ndarray) -> tuple[str, ...]:
    """A note on a garment that came down by much of its height from where it hung."""
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-300)
    height = hung.positions @ down
    by = float((now.positions @ down).mean() - height.mean())
    return (f"the garment fell by {by:.2f} m: nothing holds it up there",) if by > FELL * np.ptp(height) > 0 else ()


def _unrippable(garment: Garment) -> Garment:
    return replace(garment, seams=tuple(seam._replace(strength=None) for seam in garment.seams))


def _each(sim: Simulation) -> list[np.ndarray]:
    """Positions (n, 3) [m] of each cloth."""
    x = sim.positions()
    return [x[c.start:c.start + c.mesh.vertex_count] for c in sim.scene.cloths]


def _contacts(worn: Sequence[Worn], placed: Sequence[Garment]) -> list[ClothContact | None]:
    """How each meets others while it settles: where one passes through another after sewing, as layers."""
    ends = [(g.positions, g.mesh.faces) for g in placed]
    if any(count_crossings(*a, *b) for k, a in enumerate(ends) for b in ends[:k]):
        return [None if w.contact is None else replace(w.contact, layer=k) for k, w in enumerate(worn)]
    return [w.contact for w in worn]


def _sewn(worn: Sequence[Worn], solids: list[Solid], h: float, pull: float | None,
          tell: Callable[[str], None] | None) -> tuple[list[Garment], float]:
    """(the garments where all seams of the last, the outermost, are closed, s that it took); see `dress`."""
    scene, garment = Scene(gravity=None, air=Air(CALM, CALM)), worn[-1].garment
    scene.solids += [replace(s, thickness=SPARED * s.thickness, friction=0.0) for s in solids]
    for w in worn:
        contact = None if w.contact is None else replace(w.contact, thickness=SPARED * w.contact.thickness, layer=0)
        scene.add_garment(w.garment, w.fabric, name=w.name, contact=contact, panels=w.panels, pull=pull)
    sim, meets = Simulation(scene, h=h, cg_tol=ROUGH, contact_tol=None), contact is not None
    try:
        if sim.contacts is not None:
            refuse_inside(zip(scene.cloths, [w.garment for w in worn]), sim.model, sim.contacts.detector, scene.solids)
        firm, before, gaps, spent = 1.0, np.inf, [], 0
        rests = meets and len(worn) == 1
        while (gap := sim.seam_gaps().max(initial=0.0)) > 0:
            gaps.append(float(gap))
            if (sim.time > SEWING or spent > LATELY) and closing(gaps) * max(LONGEST - sim.time, 0.0) < gap:
                raise SceneError(_left_open(_each(sim)[-1], garment, sim.time, closing(gaps)))
            if pull is not None and before - gap < min(NEARER * before, SLOWEST * TENTH):
                if rests and firm >= FIRM:
                    sim.contacts.layers.release_around(sim.stitch_failure.stitches.apart)
                spent += firm >= FIRMEST and not rests
                if firm < FIRMEST:
                    firm *= FIRMER
                    sim.stepper.pull_firmer(FIRMER)
            before = gap
            _advance(sim, tell, f"sewing, gap {gap:.3g} m", h / FINEST if meets else 0.0)
        return [replace(w.garment, positions=x) for w, x in zip(worn, _each(sim))], sim.time
    finally:
        sim.close()


def closing(gaps: Sequence[float]) -> float:
    """How fast the widest gap closes [m/s], of those [m] that were seen every tenth of a second."""
    lately = gaps[-LATELY:]
    return (lately[0] - lately[-1]) / (TENTH * max(len(lately) - 1, 1))


def _refuse_fallen(sim: Simulation, garment: Garment, solids: list[Solid]) -> None:
    """Refuses a garment, or a part that no seam holds to the rest, that has fallen past all solids."""
    g = sim.scene.gravity
    if not g.any():
        return
    height, parts = _each(sim)[-1] @ g, garment.parts()
    lowest = max(float((solid.surface_at(0.0) @ g).max()) for solid in solids)
    for rows in parts:
        if height[rows].min() > lowest:
            if len(parts) > 1:
                raise SceneError(f"dress: {garment.panel_of(int(rows[0]))!r} fell off the body: no seam holds it to the rest "
                                 "of the garment")
            raise SceneError("dress: the garment slid off the body and fell: is the body too small for it, or in another unit "
                             "(--scale)?")


def _part(crossed: list[int]) -> bool:
    """Whether there are crossings, of those counted every tenth of a second, and they have become fewer within PATIENCE."""
    return 0 < min(crossed[-PATIENCE:]) < min(crossed[:-PATIENCE], default=np.inf)


def _advance(sim: Simulation, tell: Callable[[str], None] | None, what: str, finest: float = 0.0) -> None:
    """Simulates a tenth of a second. If no step of `finest` [s] passes, contact of the layers pressed most is released;
    without such layers smaller steps are tried."""
    end, usual, meets = sim.time + TENTH, sim.control, finest > 0
    while end - sim.time > ROUND * TENTH:
        if finest:
            sim.stepper.control = replace(usual, h_min=finest)
        try:
            sim.step(min(usual.h_max, end - sim.time))
        except SimulationError as error:
            nearest = sim.contacts.layers.nearest() if meets else None
            if nearest is not None and nearest.gap < LOCKED:
                sim.contacts.layers.release_around(np.array(nearest.particles))
                sim.stepper.h = usual.h_max
            elif finest:
                finest = 0.0
            else:
                raise SimulationError(f"{error}{_folded(sim.scene.solids)}", error.reason, error.time) from None
        sim.stepper.control = usual
    if tell is not None:
        tell(f"{sim.time:.1f} s, {what}")


def _folded(solids: list[Solid]) -> str:
    """Half a sentence on where meshes pass through themselves, as in an armpit; "" where none does."""
    x = [s.surface_at(0.0)[self_crossings(s.surface_at(0.0), s.shape.faces)[0]].reshape(-1, 3)
         for s in solids if isinstance(s.shape, SolidMesh)]
    if not len(at := np.concatenate([np.zeros((0, 3)), *x])):
        return ""
    low, high = (", ".join(f"{v:.2g}" for v in end(axis=0)) for end in (at.min, at.max))
    return (f" The body passes through itself between ({low}) and ({high}) m, and cloth has no place there: take a pose in "
            "which these parts are apart, such as a character's rest pose, by --rest or load_solid's rest=, or a garment "
            "that stays clear of them")


def _still(solid: Solid) -> Solid:
    """A solid as it is at time 0."""
    R, p = solid.pose(0.0)
    shape = solid.shape
    if isinstance(shape, SolidMesh) and len(shape.x) > 1:
        shape = SolidMesh(shape.shape_at(0.0), shape.faces, groups=shape.groups)
    return replace(solid, shape=shape, position=p, rotation=R)


def _left_open(x: np.ndarray, garment: Garment, time: float, speed: float) -> str:
    gaps = [float(np.linalg.norm(x[a] - x[b], axis=1).max()) for a, b, *_ in garment.seams]
    k = int(np.argmax(gaps))
    of = [garment.panel_of(row[len(row) // 2]) for row in garment.seams[k][:2]]
    how = "closes no further" if speed <= 0 else f"closes by {speed:.2g} m/s, too slowly"
    return (f"dress: {sum(g > 0 for g in gaps)} of {len(gaps)} seams are still open after {time:.1f} s; the widest is seam "
            f"{k}, of {of[0]!r} and {of[1]!r}, with {max(gaps):.3g} m, and {how}: hang these panels nearer to where they are "
            "worn, sleeves round the body's arms (Garment.moved, Garment.bent), make them wider, or pull with more (pull=, "
            "--pull)")
