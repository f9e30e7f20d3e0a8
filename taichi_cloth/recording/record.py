"""Recorded data of cloth and solids: constant data once, moving data frame by frame. Arrays by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..backend.ordering import components
from ..output import described
from ..scene.cloth import Cloth
from ..scene.mesh import face_edges
from ..scene.primitives import Plane
from ..scene.scene import Scene
from ..scene.solids import Placed, Solid
from ..scene.view import CameraKeys

if TYPE_CHECKING:  # data of a scene by itself need no Taichi
    from ..simulation import Simulation


def geometry(sim: Simulation) -> dict[str, np.ndarray]:
    """Constant data: everything that pictures and exports need besides `frame`.

    The arrays of `as_built`; `hinges` with stiffness [N m] and rest angle. Besides, if the scene has them:

    - bending by curvatures: `patches` of vertices round triangles, their weights and stiffness;
    - seams: `sewn`, the vertex that stands for the cluster of each, `panel` of each face with `panel_names`, and
      `seam_length` [m] of each vertex;
    - limits of strain: `face_limit`;
    - fabrics that yield, or creases: `creases`, with the arrays from which curvatures of hinges or triangles are computed;
    - cloth that may tear: `corners` (m, 3), faces over corners of their own.
    """
    out = as_built(sim.scene)
    if any(c.split is not None for c in sim.scene.cloths):
        out["corners"] = np.concatenate([c.mesh.faces + c.start for c in sim.scene.cloths]).astype(np.int32)
    out |= {"hinges": np.zeros((0, 4), dtype=np.int64), "hinge_k": np.zeros(0), "hinge_rest": np.zeros(0)}
    for force in sim.force_terms:
        out |= force.geometry()
    return out | (_sewn(sim) if any(not s.tears for s in sim.scene.seams) else {})


def as_built(scene: Scene) -> dict[str, np.ndarray]:
    """Data of a scene by itself, at time 0.

    Faces and uv of all cloths in one, `polygon` of faces that were cut from larger ones, `cloth_start` (first vertex of each
    and the end), `cloth_thickness`, `cloth_names`, `cloth_colors` (NaN if left to the renderer), groups of faces, and the
    arrays of `described.of_appearances`. The same for solids (`solid_*`, without those drawn as ground;
    `solid_thickness` 0 if nothing touches it); `ground_solid`, height and thickness [m] of the highest of those that cloth
    touches. The view, as `described.of_view` gives it.
    """
    cloths, solids = scene.cloths, drawn_solids(scene)
    surfaces = [s.shape.surface() for s in solids]
    starts = np.cumsum([0] + [len(x) for x, _ in surfaces])
    grounds = [float(s.pose(0.0)[1][1]) for s in (*scene.solids, *scene.props) if is_ground(s)]
    ground = scene.view.ground if scene.view.ground is not None or not grounds else max(grounds)
    return {
        "faces": _concatenate([c.whole.faces + c.start for c in cloths], (0, 3)).astype(np.int32),
        "uv": _concatenate([c.mesh.corner_uv for c in cloths], (0, 3, 2)).astype(np.float32),
        **_image_uv(cloths),
        **_polygons(cloths),
        **_thickness(cloths),
        "cloth_start": np.array([c.start for c in cloths] + [scene.vertex_count]),
        "cloth_faces": np.cumsum([0] + [c.mesh.face_count for c in cloths]),
        "cloth_names": np.array([c.name for c in cloths], dtype=str),
        **described.of_appearances([c.appearance for c in cloths]),
        **_face_colors(cloths),
        **_face_groups(cloths),
        "x": _concatenate([c.positions for c in cloths], (0, 3)),
        "solid_faces": _concatenate([f + k for (_, f), k in zip(surfaces, starts)], (0, 3)).astype(np.int32),
        "solid_start": starts,
        "solid_names": np.array([s.name for s in solids], dtype=str),
        "solid_colors": _concatenate([np.array([s.color or (np.nan,) * 3]) for s in solids], (0, 3)),
        "solid_thickness": np.array([s.thickness if isinstance(s, Solid) else 0.0 for s in solids]),
        "solid_x": _concatenate([s.surface_at(0.0) for s in solids], (0, 3)),
        **_ground_solid(scene),
        **described.of_view(scene.view, ground),
    }


def _ground_solid(scene: Scene) -> dict[str, np.ndarray]:
    """`ground_solid` (2,) [m], where there is one."""
    planes = [(float(s.pose(0.0)[1][1]), s.thickness) for s in scene.solids if is_ground(s)]
    return {"ground_solid": np.array(max(planes))} if planes else {}


def _image_uv(cloths: list[Cloth]) -> dict[str, np.ndarray]:
    """`image_uv` (m, 3, 2), NaN if it is the pattern, where meshes have texture coordinates of their own."""
    own = [c.mesh.texture for c in cloths]
    if all(texture is None for texture in own):
        return {}
    return {"image_uv": np.concatenate([np.full((c.mesh.face_count, 3, 2), np.nan) if texture is None else texture
                                        for c, texture in zip(cloths, own)]).astype(np.float32)}


def _polygons(cloths: list[Cloth]) -> dict[str, np.ndarray]:
    """`polygon` (m,), the number of the polygon that each face was cut from, where meshes know them."""
    if all(c.mesh.polygon is None for c in cloths):
        return {}
    own = [np.arange(c.mesh.face_count) if c.mesh.polygon is None else c.mesh.polygon for c in cloths]
    starts = np.cumsum([0] + [int(of.max()) + 1 for of in own])
    return {"polygon": np.concatenate([of + k for of, k in zip(own, starts)]).astype(np.int32)}


def _thickness(cloths: list[Cloth]) -> dict[str, np.ndarray]:
    """`cloth_thickness` (c,) [m], NaN if a cloth passes through others, where any does not."""
    if all(c.contact is None for c in cloths):
        return {}
    return {"cloth_thickness": np.array([np.nan if c.contact is None else c.contact.thickness for c in cloths])}


def _face_colors(cloths: list[Cloth]) -> dict[str, np.ndarray]:
    """`face_colors` (m, 3), NaN if a face has its cloth's, where panels have colours of their own."""
    own = [c.face_colors() for c in cloths]
    if all(colors is None for colors in own):
        return {}
    return {"face_colors": np.concatenate([np.full((c.mesh.face_count, 3), np.nan) if colors is None else colors
                                           for c, colors in zip(cloths, own)])}


def _face_groups(cloths: list[Cloth]) -> dict[str, np.ndarray]:
    """`face_group` (m,), row of `face_groups` (names, blanks between several of a face) or -1, if meshes have groups of
    whole faces. All vertices of such a group are corners of faces that have all of their corners in it."""
    labels: list[np.ndarray] = []
    names: list[str] = []
    for cloth in cloths:
        faces = cloth.whole.faces
        of_face = np.full(len(faces), "", dtype=object)
        for name, index in cloth.whole.groups.items():
            inside = np.isin(faces, index).all(axis=1)
            if len(np.unique(faces[inside])) == len(np.unique(index)):
                of_face[inside] += " " + "_".join(name.split())
        found, row = np.unique(of_face.astype(str), return_inverse=True)
        labels.append(np.where(of_face == "", -1, row + len(names)))
        names += [name.strip() for name in found]
    return {"face_group": np.concatenate(labels), "face_groups": np.array(names, dtype=str)} if any(names) else {}


def _sewn(sim: Simulation) -> dict[str, np.ndarray]:
    """Seams and panels: parts of cloths that hang together without seams, named by the group that has just their vertices."""
    sewn = np.arange(sim.vertex_count)
    sewn[sim.model.user] = sim.model.user[sim.model.sewn.representative]
    panel, names = [], []
    for cloth in sim.scene.cloths:
        mesh = cloth.mesh
        label = components(mesh.vertex_count, *face_edges(cloth.whole.faces).T)[cloth.whole.faces[:, 0]]
        of = {np.unique(index).tobytes(): name for name, index in mesh.groups.items()}
        parts = np.unique(label)
        for k, part in enumerate(parts):
            mine = of.get(np.unique(mesh.faces[label == part]).astype(np.int64).tobytes(), f"{cloth.name}_{k}")
            names.append(cloth.name if len(parts) == 1 else mine)
        panel.append(np.searchsorted(parts, label) + len(names) - len(parts))
    return {"sewn": sewn, "panel": np.concatenate(panel), "panel_names": np.array(names, dtype=str),
            "seam_length": _seam_lengths(sim)}


def _still_sewn(sim: Simulation) -> np.ndarray:
    """(n,) the vertex that stands for the present cluster of each, by a seam or where cloth may tear."""
    pairs = [(s.cloth.start + s.a[~o], s.cloth.start + s.b[~o]) for s, o in zip(sim.scene.seams, sim.stitches_open())]
    return components(sim.vertex_count, *(np.concatenate(side) for side in zip(*pairs)))


def _seam_lengths(sim: Simulation) -> np.ndarray:
    """(n,) length of seam [m] that each vertex stands for: half of the edges beside it, as the pattern has them."""
    out = np.zeros(sim.vertex_count)
    for seam in (s for s in sim.scene.seams if not s.tears):
        mesh, n = seam.cloth.mesh, seam.cloth.mesh.vertex_count
        ends = np.stack([mesh.faces[:, [0, 1, 2]], mesh.faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2)
        length = np.linalg.norm(mesh.corner_uv[:, [0, 1, 2]] - mesh.corner_uv[:, [1, 2, 0]], axis=2).ravel()
        code, first = np.unique(np.sort(ends, axis=1) @ np.array([n, 1]), return_index=True)
        for side in (seam.a, seam.b):
            way = np.sort(np.column_stack([side[:-1], side[1:]]), axis=1)
            at = np.minimum(np.searchsorted(code, way @ np.array([n, 1])), len(code) - 1)
            half = np.where(code[at] == way @ np.array([n, 1]), length[first[at]] / 2, 0.0)
            np.add.at(out, seam.cloth.start + way, half[:, None])
    return out


def _seam_tension(sim: Simulation) -> np.ndarray:
    """(n,) force of seams on each vertex over the length that it stands for [N/m]; 0 elsewhere."""
    length = _seam_lengths(sim)
    force = np.linalg.norm(sim.seam_forces(), axis=1)
    return np.where(length > 0, force / np.where(length > 0, length, 1.0), 0.0)


def frame(sim: Simulation) -> dict[str, np.ndarray]:
    """Moving data, now: t [s]; f32 x (n, 3) [m], v [m/s], with solids contact [N], surfaces and camera where they move.

    With seams, `seam`: their tension [N/m] at each vertex. With fabrics that yield, `hinge_crease` [rad] and
    `patch_crease` [1/m].
    With cloth that may tear, `faces` (m, 3) as they now hang together, over one vertex for all that are joined. With open
    seams, `sewn`; hinges over openings are not among `hinge_whole`.
    """
    solids = drawn_solids(sim.scene)
    out = {"t": np.array(sim.time), "x": sim.positions().astype(np.float32), "v": sim.velocities().astype(np.float32)}
    for force in sim.force_terms:
        out |= force.recorded()
    if sim.scene.seams:
        out["seam"] = _seam_tension(sim).astype(np.float32)
    if sim.contacts is not None:
        out["contact"] = sim.contact_forces().astype(np.float32)
    if any(c.split is not None for c in sim.scene.cloths):
        out["faces"] = sim.faces().astype(np.int32)
    if any(not s.tears for s in sim.scene.seams) and any(o.any() for o in sim.stitches_open()):
        out["sewn"] = _still_sewn(sim)
    if any(s.moves for s in solids):
        out["solid_x"] = np.concatenate([s.surface_at(sim.time) for s in solids]).astype(np.float32)
    if isinstance(sim.scene.view.camera, CameraKeys):
        out["camera"] = sim.scene.view.camera.at(sim.time).numbers
    return out


def drawn_solids(scene: Scene) -> list[Placed]:
    """Solids and props in their order in a recording, without those that are drawn as ground."""
    return [s for s in (*scene.solids, *scene.props) if not is_ground(s)]


def is_ground(solid: Placed) -> bool:
    """A level plane that stays is drawn as the ground."""
    if not isinstance(solid.shape, Plane) or solid.moves:
        return False
    return bool((solid.pose(0.0)[0] @ np.array(solid.shape.normal))[1] > 1 - 1e-9)


def _concatenate(parts: list[np.ndarray], empty: tuple[int, ...]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(empty)
