"""A run in numbers: the summary in its manifest, and the lines that the command ends with."""

import datetime
import platform
from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from .. import __version__
from ..errors import many
from ..recording.accounts import SIGN, change, changes
from ..recording.reasons import MEANS, NOTHING, refused, usual
from ..recording.why import LEAST, PARTS, lasting
from ..simulation import Simulation
from ..step.attempt import TOUCH
from ..step.records import Tally

FELL_BACK = 0.3  # part of the steps that may be redone so without a word
NO_ROOM = "solids leave it no room, as an arm that is pressed into a trunk"
OUTPUT = {"draw": "to draw pictures", "write": "to write files"}  # parts of a run beside its steps
MANY = 0.25  # part of them with inexact contact that is no reason to change anything


def summary(sim: Simulation) -> dict:
    """Steps, rejections by name, smallest step, worst residual, iterations and seconds by part of a run."""
    t = sim.tally
    return {"steps": t.steps, "rejections": dict(t.rejections), "smallest_h": t.smallest_h, "worst_residual": t.residual,
            "not_converged": t.not_converged, "cg_iterations": t.iterations, "solves": t.solves,
            "fallbacks": t.fallbacks.total(), "contacts": t.contacts, "unsolved_contact": t.unsolved,
            "contact_error": t.contact_error, "solid_intersections": t.solid_intersections, "layers": t.layers,
            "min_gap_ratio": t.min_gap_ratio, "known_intersections": t.known_intersections, "pinched": t.pinched,
            "intersections": t.intersections,
            "largest_stretch": t.stretch, "energy": {**t.ledger, "moved": t.moved, "astray": t.astray},
            "seconds": {k: round(v, 4) for k, v in t.seconds.items()}}


def _seams(sim: Simulation) -> str:
    """A line on seams that are open, not yet closed or torn apart; "" without seams."""
    seams = sim.scene.seams
    sewn = [k for k, seam in enumerate(seams) if not seam.tears]
    if not sewn:
        return ""
    gaps, opened = np.where([seam.tears for seam in seams], 0.0, sim.seam_gaps()), sim.stitches_open()
    given = [opened[k] for k in sewn]
    count = sum(int(o.sum()) for o in given)
    if count:
        return f"seams: {count} of {sum(map(len, given))} stitches have opened, at most {gaps.max():.3g} m\n"
    if not (gaps > 0).any():
        return f"seams: {len(sewn)} of {many(len(sewn), 'seam')} closed\n"
    k = int(np.argmax(gaps))
    names = seams[k].cloth.mesh.groups
    joined = [next((n for n, g in names.items() if np.isin(row, g).all()), f"vertices {row[0]} to {row[-1]}")
              for row in (seams[k].a, seams[k].b)]
    return (f"seams: {int((gaps > 0).sum())} of {len(sewn)} are open, at most {gaps[k]:.3g} m: seam {k} of "
            f"{seams[k].cloth.name!r}, {joined[0]} to {joined[1]}\n")


def _tears(sim: Simulation) -> str:
    """A line on edges that are torn or cut; "" if none may be."""
    edges = [(seam.cloth.split.edge, opened)  # type: ignore[union-attr]
             for seam, opened in zip(sim.scene.seams, sim.stitches_open()) if seam.tears]
    torn, all_of = (sum(len(np.unique(e)) for e in part) for part in ([e[o] for e, o in edges], [e for e, _ in edges]))
    return f"tears: {torn} of {all_of} edges are torn or cut\n" if edges else ""


def _damps(tally: Tally) -> str:
    """A line on free steps that were to be of second order and are not: how many, when, why and where."""
    reasons = {reason: count for reason, count in tally.fallbacks.most_common() if reason != TOUCH}
    count, steps = sum(reasons.values()), tally.steps
    if count <= FELL_BACK * steps or tally.damped is None:
        return ""
    first, last = tally.damped
    why = ", ".join(f"{MEANS.get(reason, reason)} in {n}" for reason, n in reasons.items())
    where = f"; fastest at {tally.damped_at}" if tally.damped_at else ""
    return (f"note: {count} of {steps} steps were too large for their motion, from t = {first:.3g} to {last:.3g} s, which "
            f"damps it visibly: a smaller --h follows it ({why}{where})\n")


def _doubt(sim: Simulation) -> str:
    """A line on a run of which too much energy is unaccounted for."""
    said = sim.tally.doubt()
    return f"note: {said}\n" if said else ""


def percent(part: float) -> str:
    """A part in percent, to two digits."""
    return f"{100 * part:.0f} %" if part >= 0.0995 else f"{100 * part:.2g} %"


def _trouble(s: dict, largest: float, out: str | None, crossed: int = 0, other: bool = False) -> str:
    """A line on trouble of a run, by its `summary`, each with whether there is anything to do.

    Args:
        largest: step [s]; out: the run's folder; crossed: places in which cloth passes through cloth at the end.
        other: whether other lines have advice; "there is nothing to do" is said only where none is given.
    """
    steps, rejected = s["steps"], sum(s["rejections"].values())
    bounds = rejected, steps, s["smallest_h"] or 0.0, largest
    said: list[str] = []
    fine: list[str] = []
    if rejected:
        where = f": `taichi-cloth why {out}` says where" if out else ": with --out, `taichi-cloth why` says where"
        (fine if usual(*bounds) else said).append(refused(*bounds) + ("" if usual(*bounds) else where))
    if count := s["unsolved_contact"]:
        error = s["contact_error"]
        few = count <= MANY * steps and error < 1
        advice = "usual where cloth hits something" if few else "with a smaller --h there are fewer, and they are smaller"
        off = f"by {percent(error)} of all forces at most" if error < 1 else "in the worst by more than all forces together"
        (fine if few else said).append(f"forces between cloth and solids are inexact in {count} of {many(steps, 'step')}, "
                                       f"{off}: {advice}")
    if s["solid_intersections"]:
        said.append(f"cloth passes through solids in {many(s['solid_intersections'], 'place')} at most: "
                    + (NO_ROOM if s["pinched"] else "start it where there is room, or with a larger thickness of the solid"))
    if s["known_intersections"]:
        advice = NO_ROOM if s["pinched"] else "start it apart, or with a larger thickness of its contact"
        end = f"{crossed:,} at the end: {advice}" if crossed else f"none at the end{NOTHING}"
        (said if crossed else fine).append(f"cloth passed through cloth in {many(s['known_intersections'], 'place')} at most, "
                                           f"{end}")
    line = "; ".join([*(said or ["none"]), *fine])
    return f"trouble: {line.replace(NOTHING, '') if said or other else line}\n"


def _detail(s: dict) -> str:
    """A line of numbers on trouble."""
    bad = ", ".join(f"{name} {count}" for name, count in s["rejections"].items()) or "none"
    return (f"detail: rejected attempts: {bad}; steps by another method: {s['fallbacks']}; smallest h "
            f"{s['smallest_h'] * 1e3:.3g} ms, worst residual {s['worst_residual']:.1g}, contacts with solids more than 1 % "
            f"off Coulomb's law in {many(s['unsolved_contact'], 'step')}, at most {s['contact_error']:.2g} of all forces, "
            f"cloth through solids {s['solid_intersections']}\n")


def describe(sim: Simulation, wall: float, start: float = 0.0, out: str | None = None, verbose: bool = False,
             spent: Mapping[str, float] | None = None) -> str:
    """The closing lines of a run: size of the model, trouble, energy and cost.

    Args:
        wall: time that it took [s]; start: simulated time from which on it did, where a run was gone on with.
        out: its folder; verbose: whether numbers of the solver are told.
        spent: parts of `wall` on output, as a manifest's `output_seconds` [s].
    """
    s = summary(sim)
    cloths = sim.scene.cloths
    faces = sum(c.mesh.face_count for c in cloths)
    model = (f"{sim.model.n} vertices, {faces} triangles, {many(len(sim.scene.solids), 'solid')}, at most "
             f"{many(s['contacts'], 'contact')}")
    layers = ""
    if sim.contacts is not None and sim.contacts.layers is not None:
        crossings = s["known_intersections"] if s["intersections"] is None else s["intersections"]
        counted = f"in at most {many(crossings, 'place')}" if crossings else "nowhere"
        if crossings and sim.log and sim.log[-1].intersections is not None:
            counted += f", {sim.log[-1].intersections} at the end"
        squeezed = f", at most {many(s['pinched'], 'vertex', 'vertices')} squeezed between solids" if s["pinched"] else ""
        layers = (f"layers: at most {many(s['layers'], 'pair')} of cloth in contact, nearest at {s['min_gap_ratio']:.2f} of "
                  f"the distance that they keep; cloth through cloth {counted}{squeezed}\n")
    crossed = sim.last.known_intersections if sim.last else 0
    doubt, damps = _doubt(sim), _damps(sim.tally)
    trouble = _trouble(s, sim.tally.largest_h or 0.0, out, crossed, bool(doubt or damps)) + (_detail(s) if verbose else "")
    return (f"model: {model}, largest stretch {s['largest_stretch']:.3f}\n{layers}{_seams(sim)}{_tears(sim)}{trouble}"
            f"energy: {_energy(s['energy'])}\n"
            f"{doubt}{damps}"
            f"{_cost(sim, s, wall, start, spent or {})}")


def _cost(sim: Simulation, s: dict, wall: float, start: float, spent: Mapping[str, float]) -> str:
    """A line on the time that a run took, and on its parts, which add up to it; of steps alone where it was gone on with."""
    seconds, steps = s["seconds"], many(s["steps"], "step")
    own = seconds.get("total", 0.0)
    inner = ", ".join(f"{name} {lasting(seconds[key])}" for key, name in PARTS.items() if seconds.get(key))
    stepping = f"{lasting(own)} for {steps}{f' ({inner})' if inner else ''}"
    said = (f"cost: {sim.time - start:.4g} s simulated in {wall:.1f} s on {sim.runtime.arch} {sim.runtime.precision}")
    if start:
        return f"{said}, from t = {start:.4g} s on; of the whole run {stepping}, {many(s['cg_iterations'], 'CG iteration')}"
    told = {does: spent[key] for key, does in OUTPUT.items() if spent.get(key, 0.0) > LEAST * wall}
    rest = wall - own - sum(told.values())
    parts = [stepping, *(f"{lasting(took)} {does}" for does, took in told.items()),
             *([f"{lasting(rest)} for set-up and all else"] if rest > 0 else [])]
    return f"{said}: {', '.join(parts)}; {many(s['cg_iterations'], 'CG iteration')}"


def _energy(total: dict[str, float]) -> str:
    """Changes of the cloth's energy [J], in a sentence."""
    terms = (f"{name} {value:+.3g}" for name, value in changes(total).items())
    return (f"changed by {change(total):+.3g} J ({SIGN}): {', '.join(terms) or 'no work'}; "
            f"unaccounted for {total['unaccounted']:+.2g} J")


def described(sim: Simulation, duration: float, fps: float, size: tuple[int, int] | None) -> dict:
    """The part of a manifest that does not depend on the origin of its scene."""
    return {
        "taichi_cloth": __version__, "python": platform.python_version(), "numpy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "started": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "duration": duration, "fps": fps, "size": size,
        "simulation": {**sim.options.record(), **asdict(sim.control), "integrator": sim.integrator_name},
        "runtime": sim.runtime.record(),
        "model": {"vertices": sim.model.n, "triangles": sum(c.mesh.face_count for c in sim.scene.cloths),
                  "solids": len(sim.scene.solids), "notes": sim.notes},
    }
