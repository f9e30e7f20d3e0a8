"""Starts nearer than the thickness: cloth is moved apart from solids before the first step, layers with it. numpy only.

Scans, and what other programs drape, start nearer to a body than a scene's thickness, edges at micrometres from edges. To throw
such cloth out within a step takes speeds that no step passes. So it is moved out by small displacements, vertices and
pairs of edges alike, as far as both keep most of their distance. Layers that would come nearer to each other than they should
move as one. What is left after that has a part of its thickness that grows (`growth`).
"""

from dataclasses import dataclass

import numpy as np

from .cloth.contact_pairs import ContactPairs
from .growth import NEAR
from .solid.pairs import PAIR, Pairs
from .solid.vertices import VertexContacts

NEARER = 0.1  # of what layers keep: what starts nearer is moved apart
SWEEPS = 60
PATIENCE, BETTER = 8, 0.98  # sweeps in which what lacks has to become so much less of itself
LAYERS, SPARE = 0.6, 0.2  # of what layers keep: to which they are moved apart, and what they may lack more
AIM, ENOUGH = 0.9, 0.05  # of what is kept: to which cloth is moved apart; what may lack of that in the end
MOST = 0.1  # of the thickness by which anything is moved in a sweep
TOGETHER = 12  # times that layers which would come too near are moved as one, before all of it is made smaller


@dataclass(frozen=True)
class Moved:
    """What was moved apart: how many particles were near, and how far [m] any was moved."""

    near: int
    furthest: float


def move_apart(contacts, fixed: np.ndarray) -> Moved:
    """Moves cloth apart from mesh solids; the model is at rest where it starts.

    Args:
        contacts: a model's `Contacts`.
        fixed: (k,) particles that scripts hold.
    """
    scan, model, layers = contacts.scan, contacts.model, contacts.layers
    scan.set_time(scan.time, 0.0)
    model.save()
    (x, v), still = model.read_particles(), np.zeros(model.n, dtype=bool)
    pairs, between = scan.find_pairs(), _near_layers(layers)
    near = [np.zeros(0, dtype=np.int64), between.vertices[between.end < NEARER * between.radius]]
    if pairs is not None:
        part = scan.part_of(pairs)
        near.append(pairs.vertices[(part > 0) & (part < NEAR)])
    count = len(np.unique(np.concatenate([rows.ravel() for rows in near])))
    if not count:
        return Moved(0, 0.0)
    still[fixed] = True
    x_0, x = x, _sweeps(contacts, x, v, still, False)
    if model.sewn is not None:
        x = _sewn(x, model, still, max([*scan.thickness, 0.0 if layers is None else 2 * layers.intersections.half.max()]))
        model.write_particles(x, v)
        x = _sweeps(contacts, x, v, still, True)
    elif layers is not None:
        x = _sweeps(contacts, x, v, still, True)
    model.write_particles(x, v)
    model.save()
    return Moved(count, float(np.linalg.norm(x - x_0, axis=1).max()))


def _sweeps(contacts, x: np.ndarray, v: np.ndarray, still: np.ndarray, layered: bool) -> np.ndarray:
    """Positions (n, 3) to which cloth can be moved apart from x; what layers lack counts where `layered`."""
    scan, model, layers = contacts.scan, contacts.model, contacts.layers
    crossed, best, since, still = len(scan.find_crossings()), np.inf, 0, still.copy()
    if layers is not None:
        layers.intersections.look(x)
        layers.intersections.commit()
        layers.detector.let_rest(layers.intersections.resting)
    for sweep in range(SWEEPS):
        model.save()
        between = _near_layers(layers) if layered else ContactPairs.none()
        by, lacks = _shift(scan.detect(), scan.find_pairs(), between, scan.thickness, model.n)
        best, since = (lacks, sweep) if lacks < BETTER * best else (best, since)
        if lacks < ENOUGH or sweep - since > PATIENCE:
            break
        by = _free_of_layers(_welded(by, still, model), x, v, model, layers)
        for _ in range(TOGETHER):
            model.write_particles(x + by, v)
            through = scan.find_crossings()
            if len(through) <= crossed:
                break
            still[through] = True
            by = _welded(by, still, model)
        else:
            break
        x = x + by
    model.write_particles(x, v)
    return x


def _sewn(x: np.ndarray, model, still: np.ndarray, most: float) -> np.ndarray:
    """Positions with what is sewn together, and less than `most` [m] apart, at its mean."""
    knot = model.sewn.knot
    mean = _means(x, knot)
    far = np.zeros(len(x))
    np.maximum.at(far, knot, np.linalg.norm(x - mean, axis=1))
    stays = np.zeros(len(x), dtype=bool)
    stays[knot[still]] = True
    return np.where(((far < most / 2) & ~stays)[knot][:, None], mean, x)


def _near_layers(layers) -> ContactPairs:
    """Pairs of layers where the model is."""
    if layers is None:
        return ContactPairs.none()
    layers.detector.paths.begin()
    layers.detector.cover()
    return layers.detector.look()


def _shift(found: VertexContacts, pairs: Pairs | None, between: ContactPairs, thickness: np.ndarray, n: int) -> tuple[np.ndarray, float]:
    """((n, 3) displacements [m] that bring what is near out, the most that lacks, of what is kept)."""
    by, count, most = np.zeros((n, 3)), np.zeros(n), [0.0]
    t = thickness[found.solid]
    height, one = found.gap + t, np.ones((len(t), 1))
    parts = [(found.index[:, None], one, found.normal, height, t, AIM),
             (between.vertices, between.weights, between.normal, between.end, between.radius, LAYERS)]
    if pairs is not None:
        parts.append((pairs.vertices, pairs.weights, pairs.normal, pairs.distance, PAIR * thickness[pairs.solid], AIM))
    for rows, w, normal, distance, keeps, aim in parts:
        lack = np.where(distance > 0, aim * keeps - distance, 0.0)
        some = np.flatnonzero(lack > 0)
        w, lack, rows = w[some], lack[some], rows[some]
        push = w * (lack / np.maximum((w**2).sum(axis=1), 1e-12))[:, None]
        np.add.at(by, rows, push[:, :, None] * normal[some, None, :])
        np.add.at(count, rows, np.abs(w))
        most.append(float((lack / keeps[some]).max(initial=0.0)) - (SPARE if aim == LAYERS else 0.0))
    by /= np.maximum(count, 1)[:, None]
    size = np.linalg.norm(by, axis=1)
    most_of_all = max([*thickness, *between.radius])
    by *= np.minimum(1, MOST * most_of_all / np.maximum(size, 1e-30))[:, None]
    return by, max(most)


def _welded(by: np.ndarray, still: np.ndarray, model) -> np.ndarray:
    """What is sewn together moves as one, and not at all where any of it is still (n,)."""
    by[still] = 0
    if model.sewn is None:
        return by
    knot = model.sewn.knot
    stays = np.zeros(len(by), dtype=bool)
    stays[knot[still]] = True
    by = _means(by, knot)
    by[stays[knot]] = 0
    return by


def _means(by: np.ndarray, of: np.ndarray) -> np.ndarray:
    """(n, 3) means of rows over groups `of` (n,)."""
    count = np.maximum(np.bincount(of), 1)
    return np.stack([np.bincount(of, by[:, k])[of] for k in range(3)], axis=1) / count[of][:, None]


def _free_of_layers(by: np.ndarray, x: np.ndarray, v: np.ndarray, model, layers) -> np.ndarray:
    """Displacements by which no layers come nearer than they should: those that would move as one."""
    if layers is None:
        return by
    detector, four = layers.detector, np.zeros((0, 4), dtype=np.int64)
    detector.paths.begin()
    for _ in range(TOGETHER):
        model.write_particles(x + by, v)
        detector.cover()
        part, blocking = detector.collision_free_step()
        if part == 1:
            return by
        four = np.concatenate([four, detector.mesh.particles_of(blocking)])
        by = _joined(by, four, detector.mesh.knots)
    model.write_particles(x + by, v)
    detector.cover()
    return by * detector.collision_free_step()[0]


def _joined(by: np.ndarray, four: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) of particles in rows (k, 4), and of what rows with a particle in common join, replaced by their
    means."""
    group, before = knots.copy(), None
    while before is None or (group != before).any():
        before = group.copy()
        np.minimum.at(group, four, group[four].min(axis=1)[:, None])
        np.minimum.at(group, knots, group)
        group = np.minimum(group, group[knots])
    return _means(by, group)
