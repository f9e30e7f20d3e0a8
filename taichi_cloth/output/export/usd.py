"""Universal Scene Description: a mesh a piece with time samples. Text (.usda) is written here, .usdc by usd-core."""

import pathlib
import re

import numpy as np

from ...errors import OutputError
from ..folder import write_whole, written_aside
from ..recording import Recording
from . import Fields


def write(recording: Recording, folder: pathlib.Path, fields: Fields, format: str) -> list[pathlib.Path]:
    """`cloth.usda`, or `cloth.usdc` where the package usd-core (extra `usd`) is installed."""
    text = stage(recording)
    if format == "usda":
        write_whole(folder / "cloth.usda", text.encode())
        return [folder / "cloth.usda"]
    try:
        from pxr import Sdf, Tf  # type: ignore[import-not-found]
    except ImportError:
        raise OutputError("usdc needs the package usd-core: pip install 'taichi-cloth[usd]', or export usda, which every "
                          "reader of usdc takes too") from None
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    with written_aside(folder / "cloth.usdc", ".partial.usdc") as aside:  # its kind goes by its name
        try:
            whole = layer.Export(str(aside))
        except Tf.ErrorException as error:
            raise OSError(" ".join(str(error).split())[:300]) from None
        if not whole:
            raise OSError("usd-core could not write it")
    return [folder / "cloth.usdc"]


def stage(recording: Recording) -> str:
    """The text of a stage: y up, metres, one mesh a piece of cloth, points and velocities by frame, uv on corners."""
    g, numbers = recording.geometry, recording.frames()
    frames = {k: recording.frame(k) for k in numbers}
    fps = float(recording.manifest.get("fps", 24.0))
    lines = ["#usda 1.0", "(", '    defaultPrim = "cloth"', "    metersPerUnit = 1", f"    startTimeCode = {numbers[0]}",
             f"    endTimeCode = {numbers[-1]}", f"    timeCodesPerSecond = {fps:g}", f"    framesPerSecond = {fps:g}",
             '    upAxis = "Y"', ")", "", 'def Xform "cloth"', "{"]
    names: set[str] = set()
    pieces = zip(g["cloth_names"], g["cloth_start"][:-1], g["cloth_start"][1:], g["cloth_faces"][:-1], g["cloth_faces"][1:])
    for name, first, last, first_face, last_face in pieces:
        faces = g["faces"][first_face:last_face] - first
        unique = re.sub(r"\W", "_", f"_{name}" if str(name)[:1].isdigit() else str(name), flags=re.ASCII) or "piece"
        while unique in names:
            unique += "_"
        names.add(unique)
        x = {k: f["x"][first:last] for k, f in frames.items()}
        lines += [f'    def Mesh "{unique}"', "    {", '        uniform token subdivisionScheme = "none"',
                  "        bool doubleSided = 1",
                  f"        int[] faceVertexCounts = [{', '.join(['3'] * len(faces))}]",
                  f"        int[] faceVertexIndices = [{', '.join(map(str, faces.ravel().tolist()))}]",
                  f"        texCoord2f[] primvars:st = {_tuples(g['uv'][first_face:last_face].reshape(-1, 2))} (",
                  '            interpolation = "faceVarying"', "        )"]
        for attribute, kind, values in (
                ("points", "point3f[]", x),
                ("velocities", "vector3f[]", {k: f["v"][first:last] for k, f in frames.items()}),
                ("extent", "float3[]", {k: np.stack([p.min(axis=0), p.max(axis=0)]) for k, p in x.items()})):
            lines += [f"        {kind} {attribute}.timeSamples = {{",
                      *(f"            {k}: {_tuples(v)}," for k, v in values.items()), "        }"]
        lines.append("    }")
    return "\n".join([*lines, "}", ""])


def _tuples(rows: np.ndarray) -> str:
    """(k, d) numbers as USD writes them, with the digits that float32 needs."""
    return "[" + ", ".join("(" + ", ".join(f"{v:.9g}" for v in row) + ")" for row in rows.tolist()) + "]"
