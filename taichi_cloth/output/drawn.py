"""Surfaces of a recorded geometry: triangles with their colours, finer and with a thickness where that is asked for."""

import numpy as np

from ..scene.appearance import Appearance
from .colors import PALETTE, STONE
from .described import appearances_of, image_uv
from .hems import borders
from .look import Look
from .objects import COLUMNS, HEM, Textures, object_row
from .shell import Shell
from .smooth import Smooth
from .surfaces import Surfaces, back_of

Frame = dict[str, np.ndarray]


def shell_of(geometry: Frame, look: Look, smooth: Smooth | None) -> Shell | None:
    """Cloth's thickness, where any has one."""
    thick = np.array([look.appearance(str(name), own).thickness or 0.0
                      for name, own in zip(geometry["cloth_names"], appearances_of(geometry))])
    if not thick.any():
        return None
    owner, faces = np.repeat(np.arange(len(thick)), np.diff(geometry["cloth_faces"])), joined(geometry)
    n = len(geometry["x"])
    if smooth is not None:
        owner, faces, n = np.repeat(owner, smooth.each), smooth.faces, smooth.count
    thickness = np.zeros(n)
    thickness[faces] = thick[owner][:, None]
    return Shell(faces, n, thickness)


def joined(geometry: Frame) -> np.ndarray:
    """(m, 3) faces over one vertex for all that are sewn together."""
    return geometry["sewn"][geometry["faces"]] if "sewn" in geometry else geometry["faces"]


def surfaces(geometry: Frame, look: Look, smooth: Smooth | None, shell: Shell | None = None,
             whole: Frame | None = None) -> Surfaces:
    """Surfaces of a geometry: cloths one after the other, then solids; whole: as it was before it tore, for hems."""
    faces, (corner_uv, units), solid_faces = geometry["faces"], image_uv(geometry), geometry["solid_faces"]
    starts, names = geometry["cloth_faces"], [str(name) for name in geometry["cloth_names"]]
    corner_uv = corner_uv * np.repeat(np.where(np.isnan(units), 1.0, units), np.diff(starts))[:, None, None].astype(np.float32)
    textures = Textures()
    colors, backs, rows = [], [], []
    for k, (name, own) in enumerate(zip(names, appearances_of(geometry))):
        one = look.appearance(name, own)
        color = np.array(PALETTE[k % len(PALETTE)] if one.color is None else one.color)
        mine = np.tile(color, (int(starts[k + 1] - starts[k]), 1))
        if "face_colors" in geometry and look.appearance(name, Appearance()).color is None:
            panels = geometry["face_colors"][starts[k]: starts[k + 1]]
            mine = np.where(np.isnan(panels), mine, panels)
        colors.append(mine)
        backs.append(back_of(mine) if one.back is None else np.tile(one.back, (len(mine), 1)))
        rows.append(object_row(one, corner_uv[starts[k]: starts[k + 1]], textures, units[k]))
    owner = np.repeat(np.arange(len(names)), np.diff(starts))
    near = np.zeros((1, 8))
    hem = np.array([row[HEM] for row in rows])
    if hem.any():
        near = borders(joined(whole or geometry), corner_uv.astype(np.float64), hem[owner])
    n = len(geometry["x"])
    if smooth is not None:
        faces, corner_uv, n = smooth.faces, smooth.corners(corner_uv), smooth.count
        owner = np.repeat(owner, smooth.each)
        near = np.repeat(near, smooth.each, axis=0) if hem.any() else near
        colors, backs = ([np.repeat(c, smooth.each, axis=0) for c in part] for part in (colors, backs))
    if shell is not None:
        faces, n, of = shell.faces, shell.count, shell.source
        owner, corner_uv, near = owner[of], corner_uv[of[:, None], shell.turn], near[of] if hem.any() else near
        colors, backs = ([np.concatenate(part)[of]] for part in (colors, backs))
    solid = np.searchsorted(geometry["solid_start"], solid_faces[:, 0], side="right") - 1
    stone = np.array([STONE if np.isnan(c).any() else c for c in geometry["solid_colors"]]).reshape(-1, 3)
    rows += [object_row(Appearance(squares=False), np.zeros((0, 3, 2)), textures)] * len(stone)
    objects = np.array(rows).reshape(-1, COLUMNS)
    uv = np.concatenate([corner_uv, np.zeros((len(solid_faces), 3, 2), dtype=np.float32)])
    return Surfaces(np.concatenate([faces, solid_faces + n]), uv, np.concatenate([*colors, stone[solid]]),
                    np.concatenate([*backs, stone[solid]]), np.concatenate([owner, solid + len(names)]), objects, len(faces),
                    textures, near)
