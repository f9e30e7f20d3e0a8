"""Criterion of tearing: the stress ahead of a tip, averaged over a length, against its strength.

At a vertex the stress T is averaged over the material within the length l, weighted by (1 - r^2/l^2)^2; across its
largest principal direction runs the line along which cloth would part. Over the half disc ahead on that line it is
averaged again: where the principal value there is beyond the strength, the edge nearest to the line opens. At a stress
K / sqrt(2 pi r) round a tip the average goes as K / sqrt(l), whatever the mesh.

Tears go on from borders, tip by tip. If no tip is within the length, cloth opens in both directions at once.
"""

from collections.abc import Sequence

import numpy as np

from ..backend.ordering import components
from ..forces.membrane import Membrane
from ..forces.stress import Stress
from ..scene.cloth import Cloth
from ..scene.mesh import face_edges
from ..scene.scene import Scene
from ..scene.tear import Split
from ..system.held import Held
from ..system.stitches import Stitches

POINTS = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6  # of a triangle, each for a third of its area
ASIDE = np.cos(np.radians(50))  # of the line's angle with an edge that opens
CHUNK = 1 << 21  # pairs of vertices and points that are looked at together


class ClothTear:
    """The tears of one cloth.

    Args:
        rows: numbers of its stitches among all.
    """

    def __init__(self, cloth: Cloth, stitches: Stitches, rows: np.ndarray, fraction: np.ndarray) -> None:
        parts: Split = cloth.split  # type: ignore[assignment]
        uv: np.ndarray = parts.whole.uv
        self.rows, self.fraction, self.stitches = rows, fraction, stitches
        order = np.argsort(parts.edge, kind="stable")
        same = np.flatnonzero(parts.edge[order][1:] == parts.edge[order][:-1])
        self.other = np.arange(len(rows))  # the stitch at the other end of the same edge
        self.other[order[same]], self.other[order[same + 1]] = order[same + 1], order[same]
        self.length, self.scale = cloth.tear.length, 1 / np.sqrt(cloth.tear.strengths)  # type: ignore[union-attr]
        ends = parts.edges[parts.edge]
        here, there = np.where(parts.at == 0, ends.T, ends.T[::-1])
        self.vertex, self.uv = here, uv
        way = uv[there] - uv[here]
        self.way = way / np.linalg.norm(way, axis=1)[:, None]
        piece = components(len(uv), *face_edges(parts.whole.faces).T)
        self.piece, self.piece_of = piece, np.repeat(piece[parts.whole.faces[:, 0]], 3)
        self.point = np.einsum("pc,mci->mpi", POINTS, uv[parts.whole.faces]).reshape(-1, 2)
        self.weight = np.repeat(parts.whole.material_areas / 3, 3)

    def overloaded(self, T: np.ndarray, held: Held | None) -> np.ndarray:
        """(j,) numbers of the stitches that open under stresses T (m, 2, 2) [N/m] of its triangles."""
        T = T * np.outer(self.scale, self.scale)
        least = self.fraction.min()
        hot = np.repeat(_principal(T)[0] > least, 3)
        stitches, rows = self.stitches, self.rows[self.stitches.whole[self.rows]]
        mine = np.flatnonzero(self.stitches.whole[self.rows])
        if not hot.any() or not len(rows):
            return np.zeros(0, dtype=np.int64)
        label = stitches.clusters.label
        fans, first, fan = np.unique(label[stitches.clusters.a[rows]], return_index=True, return_inverse=True)
        vertex = self.vertex[mine[first]]
        border = np.bincount(fan) < np.bincount(label[label >= 0], minlength=stitches.clusters.count)[fans]
        free = np.ones(len(fans), dtype=bool) if held is None else ~np.isin(fans, label[held.index])
        near = free & self._within(vertex, self.point[hot], self.piece_of[hot])
        inside = np.flatnonzero(~border & near)
        edge = np.unique(vertex[border])
        near[inside] = ~self._within(vertex[inside], self.uv[edge], self.piece[edge])
        chosen = np.flatnonzero(near)
        if not len(chosen):
            return np.zeros(0, dtype=np.int64)
        part, opens = np.zeros(len(fans)), np.full((len(fans), 2), -1)
        part[chosen], opens[chosen] = self._judge(vertex[chosen], border[chosen], np.repeat(T, 3, axis=0), mine, fan, chosen)
        opened = self._foremost(part, vertex, opens)
        return self.rows[np.unique([opened, self.other[opened]])]

    def _within(self, vertex: np.ndarray, points: np.ndarray, piece: np.ndarray) -> np.ndarray:
        """(v,) whether any of points (p, 2) of pieces (p,) is within the length of vertices (v,)."""
        out = np.zeros(len(vertex), dtype=bool)
        step = max(1, CHUNK // max(1, len(points)))
        for k in range(0, len(vertex), step):
            v = vertex[k: k + step]
            d = self.uv[v][:, None] - points
            near = np.einsum("vpi,vpi->vp", d, d) < self.length**2
            out[k: k + step] = (near & (self.piece[v][:, None] == piece)).any(axis=1)
        return out

    def _average(self, vertex: np.ndarray, T: np.ndarray, line: np.ndarray | None = None) -> np.ndarray:
        """(v, 2, 2) means of T (p, 2, 2) round vertices (v,), or on the side of them that lines (v, 2) point to."""
        out = np.zeros((len(vertex), 2, 2))
        step = max(1, CHUNK // len(self.point))
        for k in range(0, len(vertex), step):
            v = vertex[k: k + step]
            d = self.point - self.uv[v][:, None]
            weight = np.maximum(1 - np.einsum("vpi,vpi->vp", d, d) / self.length**2, 0) ** 2 * self.weight
            weight *= self.piece[v][:, None] == self.piece_of
            if line is not None:
                weight *= np.einsum("vpi,vi->vp", d, line[k: k + step]) > 0
            total = weight.sum(axis=1)
            out[k: k + step] = np.einsum("vp,pij->vij", weight, T) / np.maximum(total, 1e-300)[:, None, None]
        return out

    def _judge(self, vertex: np.ndarray, border: np.ndarray, T: np.ndarray, mine: np.ndarray, fan: np.ndarray,
               chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((v,) stress over strength at vertices, (v, 2) rows of the stitches that open there; -1 for none)."""
        pull = _principal(self._average(vertex, T))[1]
        line = np.stack([-pull[:, 1], pull[:, 0]], axis=1)
        sides = [self._average(vertex, T, sign * line) for sign in (1, -1)]
        row_of = np.full(fan.max() + 1, -1)
        row_of[chosen] = np.arange(len(chosen))
        mine = mine[row_of[fan] >= 0]
        at = row_of[fan][row_of[fan] >= 0]
        best, opens = np.zeros((2, len(vertex))), np.full((2, len(vertex)), -1)
        across = np.stack([-self.way[mine, 1], self.way[mine, 0]], axis=1)
        for side, (sign, mean) in enumerate(zip((1, -1), sides)):
            along = sign * np.einsum("ki,ki->k", self.way[mine], line[at])
            normal = np.einsum("ki,kij,kj->k", across, mean[at], across) / self.fraction[mine]
            plain = self.fraction[mine] == 1
            value = np.where(plain, _principal(mean)[0][at], normal)
            rank = np.where((along > ASIDE) | (~plain & (along > 0)), normal, -np.inf)
            order = np.lexsort((rank, at))
            last = order[np.append(at[order][1:] != at[order][:-1], True)]
            last = last[rank[last] > 0]
            best[side, at[last]], opens[side, at[last]] = value[last], mine[last]
        ahead = best.argmax(axis=0)
        one = np.stack([opens[ahead, np.arange(len(vertex))], np.full(len(vertex), -1)], axis=1)
        return np.where(border, best.max(axis=0), best.min(axis=0)), np.where(border[:, None], one, opens.T)

    def _foremost(self, part: np.ndarray, vertex: np.ndarray, opens: np.ndarray) -> np.ndarray:
        """Stitches at the vertices that are loaded most within a length, of those loaded beyond their strength."""
        out: list[int] = []
        taken: list[np.ndarray] = []
        for k in np.argsort(-part, kind="stable"):
            if part[k] <= 1:
                break
            place = self.uv[vertex[k]]
            if all(np.linalg.norm(place - other) > self.length for other in taken):
                taken.append(place)
                out += [s for s in opens[k].tolist() if s >= 0]
        return np.array(out, dtype=np.int64)


class Tears:
    """The cloths of a scene that may tear.

    Args:
        forces: of the simulation, that of stretch and shear among them.
    """

    def __init__(self, scene: Scene, stitches: Stitches, forces: Sequence) -> None:
        self.stress: Stress = Stress(next(force for force in forces if isinstance(force, Membrane)))
        self.cloths: list[ClothTear] = []
        self._first = np.cumsum([0] + [c.mesh.face_count if any(f.stretch or f.shear for f in c.fabrics) else 0
                                       for c in scene.cloths])
        self._rows: list[slice] = []
        for k, cloth in enumerate(scene.cloths):
            if cloth.split is not None:
                seam = next(j for j, s in enumerate(scene.seams) if s.cloth is cloth and s.tears)
                fraction = np.ones(len(cloth.split.a))
                for score in scene.scores:
                    if score.cloth is cloth:
                        fraction[cloth.split.on_line(score.edges)] = max(score.fraction, 1e-12)
                rows = np.arange(stitches.first[seam], stitches.first[seam + 1])
                self.cloths.append(ClothTear(cloth, stitches, rows, fraction))
                self._rows.append(slice(self._first[k], self._first[k + 1]))

    def overloaded(self, held: Held | None) -> np.ndarray:
        """Numbers of the stitches that open in the model's state; held particles do not tear."""
        T = self.stress.now()
        return np.concatenate([cloth.overloaded(T[rows], held) for cloth, rows in zip(self.cloths, self._rows)])


def _principal(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((k,) largest principal values, (k, 2) their directions) of symmetric T (k, 2, 2)."""
    mean, half, shear = (T[:, 0, 0] + T[:, 1, 1]) / 2, (T[:, 0, 0] - T[:, 1, 1]) / 2, T[:, 0, 1]
    angle = np.arctan2(shear, half) / 2
    return mean + np.hypot(half, shear), np.stack([np.cos(angle), np.sin(angle)], axis=1)
