"""Universal Scene Description, by usd-core: meshes with skins, blend shapes, moving transforms and points, and instances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import MeshError
from ..polygon import cut
from .motion import Motion, Part, Wanted, chosen_clips, chosen_parts, finite, mirrors, refuse_restless, shears, times
from .rest import lead
from .usd_mesh import Mesh, meshes_of

PLAIN = ("Sphere", "Cube", "Cylinder", "Capsule", "Cone", "Plane", "NurbsPatch", "BasisCurves", "NurbsCurves", "Points")


def read(path: Path, wanted: Wanted) -> Motion:
    """The parts of a stage, in its unit and with its axis up.

    Raises:
        MeshError: usd-core is not installed, the stage is damaged, or holds no mesh.
    """
    stage, UsdGeom, told = _opened(path)
    unit, notes = _unit(stage, UsdGeom)
    notes += told
    found = meshes_of(stage, notes)
    others = sorted({p.GetTypeName() for p in stage.Traverse() if p.GetTypeName() in PLAIN})
    if others:
        notes.append(f"only meshes are read: each {', '.join(others)} is left out")
    names = _names([mesh.path for mesh in found])
    take = chosen_parts(wanted.only, names, f"it has {len(list(stage.Traverse()))} prims")
    chosen_clips(wanted.clip, ())
    chosen = [(name, mesh) for name, mesh, taken in zip(names, found, take) if taken and mesh.has_faces]
    if not chosen:
        raise MeshError("has no mesh: no part has a face")
    rate, codes = stage.GetTimeCodesPerSecond(), _span(stage, [mesh for _, mesh in chosen])
    fps, t = None, np.array([stage.GetStartTimeCode() / rate])
    if wanted.moves and codes is not None:
        own = stage.GetFramesPerSecond() if stage.HasAuthoredMetadata("framesPerSecond") else rate
        fps = wanted.fps or own
        t = times(codes[0] / rate, codes[1] / rate, fps, sum(mesh.count for _, mesh in chosen))
    up = str(UsdGeom.GetStageUpAxis(stage)).lower()
    way = np.zeros(0) if wanted.rest is None or fps is None else lead(wanted.rest, fps)
    t = np.append(np.full(len(way), t[0]), t)
    for name, mesh in chosen:
        mesh.prepare(name, notes)
    rested = [mesh.begin_at_rest(t[0] * rate, way, "xyz".index(up)) for _, mesh in chosen] if len(way) else []
    refuse_restless(wanted, any(rested))
    parts = [_part(name, mesh, t, t * rate, UsdGeom) for name, mesh in chosen]
    return Motion(parts, fps, unit, up, (), (), tuple(notes))


def _opened(path: Path) -> tuple[Any, Any, list[str]]:
    """The stage, the module of its geometry, and warnings of USD, without those on the file's age: it is read."""
    try:
        from pxr import Tf, Usd, UsdGeom, UsdUtils  # type: ignore[import-not-found]
    except ImportError:
        raise MeshError("USD is read by the package usd-core: pip install 'taichi-cloth[usd]'") from None
    warned = UsdUtils.CoalescingDiagnosticDelegate()  # while it is there, nothing is printed
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        said = " ".join(str(error).split())
        raise MeshError(f"cannot be read: {said.rpartition(' : ')[2].strip(chr(39))[:300]}") from None
    if not stage:
        raise MeshError("cannot be read as USD")
    told = [" ".join(one.commentary.split()) for one in warned.TakeUncoalescedDiagnostics()
            if not one.sourceFunction.endswith("_CheckFileVersion")]
    return stage, UsdGeom, told


def _unit(stage: Any, UsdGeom: Any) -> tuple[float, list[str]]:
    """Metres of the stage's unit, and a note where it names none."""
    said = stage.GetRootLayer().pseudoRoot.GetInfo("metersPerUnit")
    try:
        unit = float(said)
    except (TypeError, ValueError):
        unit = float("nan")
    if not 0 < unit < float("inf"):
        raise MeshError(f"is in an unknown unit: metersPerUnit = {said!r}: it must be a positive number")
    if stage.GetRootLayer().pseudoRoot.HasInfo("metersPerUnit"):
        return unit, []
    return unit, [f"it names no unit: USD's own is taken, of {unit:g} m; scale={1 / unit:g} if it is in metres"]


def _names(paths: list[str]) -> list[str]:
    """The last words of the meshes' paths, as many as make them differ."""
    out = []
    for path in paths:
        words = path.strip("/").split("/")
        for k in range(1, len(words) + 1):
            tail = "/".join(words[-k:])
            if sum((p == path) or p.endswith("/" + tail) for p in paths) == 1:
                break
        out.append(tail)
    return out


def _span(stage: Any, meshes: list[Mesh]) -> tuple[float, float] | None:
    """First and last time code; None where nothing moves."""
    codes = sorted({code for mesh in meshes for code in mesh.codes()})
    if len(codes) < 2:
        return None
    if stage.HasAuthoredTimeCodeRange() and stage.GetStartTimeCode() < stage.GetEndTimeCode():
        return stage.GetStartTimeCode(), stage.GetEndTimeCode()
    return codes[0], codes[-1]


def _part(name: str, mesh: Mesh, t: np.ndarray, codes: np.ndarray, UsdGeom: Any) -> Part:
    """A mesh at times t [s], which are time codes of the stage."""
    counts, corners = mesh.topology(name, codes)
    x, turns = mesh.positions(name, codes)
    finite(name, x)
    if corners.min(initial=0) < 0 or corners.max(initial=-1) >= x.shape[1]:
        raise MeshError(f"part {name!r}: its faces name vertex {corners.max(initial=-1)}, and there are {x.shape[1]}")
    try:
        places, face = cut(x[0], corners, counts)
    except ValueError as error:
        raise MeshError(f"part {name!r}: {error}") from None
    kept = ~np.isin(face, mesh.holes())
    places, face = places[kept], face[kept]
    mirrored = mirrors(name, turns, t)
    if mesh.left_handed() != mirrored:
        places = places[:, [0, 2, 1]]
    return Part(name, x, corners[places], mesh.texture(corners, places), mesh.groups(face), mirrored, shears(turns))
