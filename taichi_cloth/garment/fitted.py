"""Fitting a pattern to a body of another size that stands elsewhere and faces another way. numpy only.

Shipped patterns hang round a figure that faces z, and whose measures are `DRAWN_FOR`. A garment is made as much wider as the
body is, where the garment is, and as much longer as the body's trunk is. Each panel keeps its shape but for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .. import checks
from ..errors import SceneError
from ..scene.connected import components
from ..scene.garment import Garment
from ..scene.mesh import TriMesh, face_edges
from ..scene.scene import Scene
from .clear import hung_clear
from .figure import AT, Figure, measured, place, surface_of
from .limbs import round_limbs
from .outside import tube_of
from .ways import ways

DRAWN_FOR = Figure(0.835, 1.455, np.zeros(2), np.array([0.0, 1.0]), True,
                   np.array([0.963, 0.819, 0.815, 0.815, 0.815, 0.815]))
UPRIGHT = 0.3  # of its length: the least rise of a panel's pattern for which it hangs upright
LOW = 0.65  # of the height: the least at which a person's neck is
UNEVEN = 1.8  # times as wide as long, or as long as wide, as the figure drawn for: beyond it, a trunk is no person's


def fitted(garment: Garment, body: Scene, thickness: float, turn: float | None = None, parts: Sequence[str] = ()
           ) -> tuple[Garment, tuple[str, ...]]:
    """Fits a shipped garment to a body: as large as it, round it as round the figure of the pattern, and clear of it.

    Args:
        body: the scene whose solids wear it, as they are at time 0.
        thickness: of the cloth [m]; panels that would start within the body go that and the solids' thickness out of it.
        turn: the way the body faces [degrees], from z towards x; None finds it.
        parts: of the body's file, by name, for the advice where it fits no pattern.

    Returns:
        (the garment, sentences on the changes).

    Raises:
        SceneError: a body without legs, trunk or neck that its surface shows, or whose trunk is as wide or narrow as no
            person's; panels that cannot be clear of it.
    """
    checks.instance("fitted: garment", garment, Garment)
    if not checks.instance("fitted: body", body, Scene).solids:
        raise SceneError("fitted: the body is a scene without solids")
    thickness = checks.number("fitted: thickness", thickness, "m", positive=True)
    turn = checks.maybe(turn, checks.number, "fitted: turn", "degrees")
    figure, across, along = _measured(garment, body, parts)
    heading = figure.turn if turn is None else turn
    made = round_limbs(_sized(garment, across, along, figure, heading), *surface_of(body))
    notes = [f"the garment is made {across:.3g} times as wide and {along:.3g} times as long, and turned by {round(heading)} "
             f"degrees, round {place(figure.centre)}"]
    if turn is None and not figure.faces:
        notes.append("the body has no feet that say which way it faces: if it is turned round, give the turn yourself")
    hung, moved = hung_clear(made, body, thickness)
    return replace(hung, fitted=True), (*notes, *moved)


def _measured(garment: Garment, body: Scene, parts: Sequence[str]) -> tuple[Figure, float, float]:
    """(measures of a body, times as wide and as long as it is drawn that a garment has to be for it)."""
    wide: float | None = None

    def person(x: np.ndarray, faces: np.ndarray) -> tuple[Figure, float, float]:
        nonlocal wide
        figure = measured(x, faces)
        across, along = _sizes(garment, figure)
        wide = across if wide is None else wide  # of the whole body, which comes first
        _refuse_uneven(figure, across, along)
        _refuse_low(figure, float(x[:, 1].min()), float(x[:, 1].max()))
        return figure, across, along

    try:
        return person(*surface_of(body))
    except SceneError as error:
        raise SceneError(f"{error}; {ways(body, parts, person, wide)}") from None


def _sizes(garment: Garment, figure: Figure) -> tuple[float, float]:
    """Times as wide and times as long as it is drawn that a garment has to be for a figure."""
    trunk = DRAWN_FOR.neck - DRAWN_FOR.crotch
    low, top = ((f(garment.positions[:, 1]) - DRAWN_FOR.crotch) / trunk for f in (np.min, np.max))
    here = (AT >= low) & (AT <= top)
    here |= ~here.any() & (np.abs(AT - (low + top) / 2) == np.abs(AT - (low + top) / 2).min())
    wider = figure.girths / DRAWN_FOR.girths
    return float(wider[here].max()), (figure.neck - figure.crotch) / trunk


def _refuse_low(figure: Figure, floor: float, top: float) -> None:
    """Refuses a neck lower down than any person's: of a body with gaps, as between its joints, or with parts left out."""
    if figure.neck - floor < LOW * (top - floor):
        raise SceneError(f"fitted: the body's neck would be at {figure.neck:.3g} m of {top:.3g} m, lower than any person's: "
                         "its surface has gaps there, or parts of it were left out")


def _refuse_uneven(figure: Figure, across: float, along: float) -> None:
    """Refuses a trunk whose width and length do not belong together: something else was measured, or more than the trunk."""
    if max(across / along, along / across) <= UNEVEN:
        return
    girths = ", ".join(f"{g:.3g}" for g in figure.girths)
    raise SceneError(f"fitted: the body's trunk would be from {figure.crotch:.3g} m (crotch) to {figure.neck:.3g} m (neck), "
                     f"round {place(figure.centre)}, with girths of {girths} m from below: {across:.3g} times as wide and "
                     f"{along:.3g} times as long as that of the figure that patterns are drawn for, as no person is")


def _sized(garment: Garment, across: float, along: float, figure: Figure, turn: float) -> Garment:
    """The garment, panel by panel, so many times as wide and as long, where it then hangs round a figure."""
    mesh, x = garment.mesh, garment.positions.copy()
    edges, uv, corners = face_edges(mesh.faces), np.array(mesh.uv), mesh.corner_uv
    label = components(mesh.vertex_count, edges[:, 0], edges[:, 1])
    for k in np.unique(label[mesh.faces]):
        rows, mine = np.flatnonzero(label == k), label[mesh.faces[:, 0]] == k
        places, flat = x[mesh.faces[mine]].reshape(-1, 3), corners[mine].reshape(-1, 2)
        up, way = _upward(places, flat)
        stretch = across * np.eye(2) + (along - across) * np.outer(up, up)
        if uv.ndim == 3:
            uv[mine] = uv[mine] @ stretch
        else:
            uv[rows] = uv[rows] @ stretch
        middle = (x[rows].min(axis=0) + x[rows].max(axis=0)) / 2
        off = x[rows] - middle
        there = [across * middle[0], figure.neck + along * (middle[1] - DRAWN_FOR.neck), across * middle[2]]
        x[rows] = there + across * off + (along - across) * np.outer(off @ way, way)
    x = replace(garment, positions=x).placed(turn, (figure.centre[0], 0.0, figure.centre[1])).positions
    made = TriMesh(x, mesh.faces, uv, mesh.groups, mesh.notes, mesh.texture, mesh.polygon, mesh.weights)
    return Garment(made, garment.seams)


def _upward(x: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The upward direction of a panel with corners x (n, 3) [m] and uv (n, 2) [m].

    Returns:
        (the direction (2,) in the pattern that points up, or the v axis if the panel lies; the same (3,) in space).
            A panel that is bent round a limb has the limb's direction, so that it stays round it.
    """
    linear = np.linalg.lstsq(np.column_stack([uv, np.ones(len(uv))]), x, rcond=None)[0][:2]
    if (tube := tube_of(x, uv)) is not None:
        way = tube[1][2]
        return linear @ way / np.linalg.norm(linear @ way), way
    rise = linear[:, 1]
    up = rise / np.linalg.norm(rise) if np.linalg.norm(rise) > UPRIGHT else np.array([0.0, 1.0])
    way = up @ linear
    return up, way / np.linalg.norm(way)
