"""Scenes and simulations in a notebook: a table, a line, a small picture."""

import base64
import html
from collections.abc import Iterable

import numpy as np

from ..errors import shown
from ..output.png import encode_png
from ..scene.cloth import Cloth
from ..scene.scene import Scene
from ..scene.sewing import Seam
from ..scene.solids import Placed, Solid, SolidMesh
from ..simulation import Simulation
from .record import drawn_solids
from .still import render

SIZE = (480, 360)  # pixels
MOST_ROWS, LONGEST = 24, 200  # of a table; letters of a name


def in_html(what: Scene | Simulation) -> str:
    """A scene's table or a simulation's state, and a picture; where one of them cannot be made, a line that says why."""
    try:
        return f"<div>{_table(what) if isinstance(what, Scene) else _state(what)}{_picture(what)}</div>"
    except Exception as error:  # a scene's own functions may raise anything, and a notebook goes on
        return _line(f"{shown(what, LONGEST)}: {type(error).__name__}: {error}")


def _picture(what: Scene | Simulation) -> str:
    if isinstance(what, Scene) and not (what.cloths or drawn_solids(what)):
        return ""
    try:
        data = base64.b64encode(encode_png(render(what, size=SIZE, quality="fast"))).decode()
    except Exception as error:
        return _line(f"no picture: {type(error).__name__}: {error}")
    width, height = SIZE
    alt = html.escape(shown(what, LONGEST))
    return f'<img src="data:image/png;base64,{data}" width="{width}" height="{height}" alt="{alt}">'


def _state(sim: Simulation) -> str:
    rejected = sim.tally.rejections.total()
    tries = f"; {rejected} attempts rejected" if rejected else ""
    return _line(f"{sim!r}{tries}")


def _table(scene: Scene) -> str:
    """A row for each cloth, each solid and prop, and for the seams of each cloth."""
    rows = [("cloth", c.name, _of_cloth(scene, c)) for c in scene.cloths]
    rows += [(s.WHAT, s.name, _of_solid(s)) for s in (*scene.solids, *scene.props)]
    seams = {c: [s for s in scene.seams if s.cloth is c and not s.tears] for c in scene.cloths}
    rows += [("seams", c.name, _of_seams(mine)) for c, mine in seams.items() if mine]
    if not rows:
        return _line("an empty scene: it has no cloth and no solid")
    more = len(rows) - MOST_ROWS
    cells = "".join(_row(row) for row in rows[:MOST_ROWS]) + (_row(("", "", f"and {more} more")) if more > 0 else "")
    return f"<table>{cells}</table>"


def _of_cloth(scene: Scene, cloth: Cloth) -> str:
    mesh = cloth.whole
    size = " x ".join(f"{length:.4g}" for length in np.ptp(cloth.positions, axis=0))
    mass = float((cloth.mesh.material_areas * cloth.density).sum())
    held = {int(v) for a in scene.script.attachments if a.cloth is cloth for v in a.vertices}
    said = [f"{mesh.vertex_count:,} vertices", f"{mesh.face_count:,} triangles", f"{size} m", f"{mass:.3g} kg"]
    said += [f"{len(held):,} vertices held"] if held else []
    said += [f"layers {cloth.contact.thickness:g} m apart"] if cloth.contact else []
    return ", ".join(said + (["may tear"] if cloth.tear else []))


def _of_solid(solid: Placed) -> str:
    said = [repr(solid.shape)]
    said += [f"friction {solid.friction:g}", f"thickness {solid.thickness:g} m"] if isinstance(solid, Solid) else []
    said += ["moves"] if solid.moves else []
    said += list(solid.shape.notes) if isinstance(solid.shape, SolidMesh) else []
    return ", ".join(said)


def _of_seams(seams: list[Seam]) -> str:
    return f"{len(seams)} of {sum(len(s.a) for s in seams):,} stitches in all"


def _row(cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>"


def _line(text: str) -> str:
    return f"<p>{html.escape(text)}</p>"
