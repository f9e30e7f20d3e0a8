"""Universal Scene Description: meshes with time samples, materials, a camera. Text (.usda) is written here, .usdc by usd-core.

The stage's structure is the same text for both; `values` are its samples at the frames.
"""

import pathlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...errors import OutputError
from ..camera import frame as camera_axes
from ..folder import write_whole, written_aside
from ..png import encode_png
from .shot import ASPECT, Mesh, Shot, unique

WIDTH = 0.36  # width of the camera's film in tenths of a metre, the unit of USD's cameras: 36 mm
ROOT, OWN = "scene", ("camera", "materials")  # names of prims that are no meshes
Samples = list[np.ndarray]
Images = dict[str, pathlib.Path]  # by prim
Attribute = tuple[str, str, str, Samples]  # type, name, metadata, one value or one a frame


def needed(format: str) -> None:
    """Looks for usd-core where the format needs it.

    Raises:
        OutputError: it is not installed.
    """
    if format == "usdc":
        try:
            from pxr import Sdf, Vt  # type: ignore[import-not-found]  # noqa: F401
        except ImportError:
            raise OutputError("usdc needs the package usd-core: pip install 'taichi-cloth[usd]', or export usda, which every "
                              "reader of usdc takes too") from None


def write(shot: Shot, path: pathlib.Path, format: str) -> list[pathlib.Path]:
    """One .usda, or one .usdc where the package usd-core (extra `usd`) is installed; and the images of prints."""
    paths = unique([*OWN, *(identifier(mesh.name) for mesh in shot.meshes)])[len(OWN):]
    images: Images = {}
    for name, mesh in zip(paths, shot.meshes):
        if mesh.printed is not None:
            images[name] = path.with_name(f"{identifier(path.stem)}_{name}.png")
            write_whole(images[name], encode_png(mesh.printed.image))
    with written_aside(path, f".partial.{format}") as aside:  # its kind goes by its name
        if format == "usda":
            with open(aside, "w", encoding="utf-8") as file:
                file.writelines(line + "\n" for line in stage(shot, paths, images, samples=True))
        else:
            _write_crate(shot, paths, images, aside)
    return [path, *images.values()]


def _write_crate(shot: Shot, paths: list[str], images: Images, file: pathlib.Path) -> None:
    from pxr import Sdf, Tf, Vt

    arrays = {"point3f[]": Vt.Vec3fArray, "vector3f[]": Vt.Vec3fArray, "float3[]": Vt.Vec3fArray, "normal3f[]": Vt.Vec3fArray,
              "int[]": Vt.IntArray, "texCoord2f[]": Vt.Vec2fArray}
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString("\n".join(stage(shot, paths, images, samples=False)))
    for name, mesh in zip(paths, shot.meshes):
        for kind, attribute, _, values in attributes(shot, mesh):
            if len(values) > 1 or mesh.moves and attribute in SAMPLED:
                for number, value in zip(shot.numbers, values):
                    layer.SetTimeSample(f"/{ROOT}/{name}.{attribute}", float(number), arrays[kind].FromNumpy(value))
    try:
        whole = layer.Export(str(file))
    except Tf.ErrorException as error:
        raise OSError(" ".join(str(error).split())[:300]) from None
    if not whole:
        raise OSError("usd-core could not write it")


SAMPLED = ("points", "velocities", "extent", "normals")  # of moving meshes


def attributes(shot: Shot, mesh: Mesh) -> list[Attribute]:
    """Samples of a mesh's prim, besides constants."""
    count = range(len(mesh.surfaces))
    steps = range(len(mesh.x))
    smooth = [mesh.normal_of_vertex(k) for k in count]
    vertex = all(s is not None for s in smooth)

    def normals(k: int) -> np.ndarray:
        surface, of = k if len(smooth) > 1 else 0, mesh.surface(k).normal_of.ravel()
        return mesh.normals(k)[smooth[surface] if vertex else of]

    out: list[Attribute] = [
        ("int[]", "faceVertexCounts", "", [np.full(len(mesh.surface(k).faces), 3, dtype=np.int32) for k in count]),
        ("int[]", "faceVertexIndices", "", [mesh.surface(k).faces.ravel() for k in count]),
        ("point3f[]", "points", "", mesh.x),
        ("float3[]", "extent", "", [np.stack([x.min(axis=0), x.max(axis=0)]) for x in mesh.x]),
        ("normal3f[]", "normals", "vertex" if vertex else "faceVarying", [normals(k) for k in steps])]
    if mesh.v:
        out.append(("vector3f[]", "velocities", "", mesh.v))
    if mesh.surface(0).uv is not None:
        uvs = [mesh.surface(k).uv for k in count]
        out.append(("texCoord2f[]", "primvars:st", "faceVarying", [uv.reshape(-1, 2) for uv in uvs if uv is not None]))
    return out


def stage(shot: Shot, paths: list[str], images: Images, samples: bool) -> Iterator[str]:
    """The lines of a stage with images beside it: y up, metres; changes from frame to frame only with `samples`."""
    first, last = shot.numbers[0], shot.numbers[-1]
    yield from ("#usda 1.0", "(", f'    defaultPrim = "{ROOT}"', f"    endTimeCode = {last}",
                f"    framesPerSecond = {shot.fps:g}", "    metersPerUnit = 1", f"    startTimeCode = {first}",
                f"    timeCodesPerSecond = {shot.fps:.17g}", '    upAxis = "Y"', ")", "",
                f'def Xform "{ROOT}" (', '    kind = "component"', ")", "{")
    for name, mesh in zip(paths, shot.meshes):
        yield from _mesh(shot, name, mesh, samples)
    yield from _camera(shot)
    yield '    def Scope "materials"'
    yield "    {"
    for name, mesh in zip(paths, shot.meshes):
        yield from _material(name, mesh, images)
    yield "    }"
    yield "}"


def _mesh(shot: Shot, name: str, mesh: Mesh, samples: bool) -> Iterator[str]:
    yield from (f'    def Mesh "{name}" (', '        prepend apiSchemas = ["MaterialBindingAPI"]',
                f"        displayName = {_string(mesh.name)}", "    )", "    {",
                "        uniform bool doubleSided = 1",
                f"        rel material:binding = </{ROOT}/materials/{name}>",
                f"        color3f[] primvars:displayColor = [{_tuple(mesh.color)}] (",
                '            interpolation = "constant"', "        )",
                '        uniform token subdivisionScheme = "none"')
    for kind, attribute, interpolation, values in attributes(shot, mesh):
        meta = f' (\n            interpolation = "{interpolation}"\n        )' if interpolation else ""
        if len(values) == 1 and not (mesh.moves and attribute in SAMPLED):
            yield f"        {kind} {attribute} = {_array(values[0])}{meta}"
            continue
        yield f"        {kind} {attribute}{meta}"
        if samples:
            yield f"        {kind} {attribute}.timeSamples = {{"
            for number, value in zip(shot.numbers, values):
                yield f"            {number}: {_array(value)},"
            yield "        }"
    yield from ("    }", "")


def _camera(shot: Shot) -> Iterator[str]:
    """With a film of 36 mm by 16:9; its matrix has the axes as rows."""
    matrices, focals = [], []
    for camera in shot.cameras:
        axes = camera_axes(camera)
        rows = [*(_tuple((*axis, 0.0)) for axis in axes.axes), _tuple((*axes.eye, 1.0))]
        matrices.append(f"( {', '.join(rows)} )")
        focals.append(f"{axes.focal * WIDTH / ASPECT:.9g}")
    near, far = shot.clipping
    yield from ('    def Camera "camera"', "    {", f"        float2 clippingRange = ({near:.6g}, {far:.6g})",
                f"        float horizontalAperture = {WIDTH:.9g}", f"        float verticalAperture = {WIDTH / ASPECT:.9g}")
    for kind, name, values in (("float", "focalLength", focals), ("matrix4d", "xformOp:transform", matrices)):
        if len(values) == 1:
            yield f"        {kind} {name} = {values[0]}"
        else:
            yield f"        {kind} {name}.timeSamples = {{"
            yield from (f"            {number}: {value}," for number, value in zip(shot.numbers, values))
            yield "        }"
    yield from ('        uniform token[] xformOpOrder = ["xformOp:transform"]', "    }", "")


def _material(name: str, mesh: Mesh, images: Images) -> Iterator[str]:
    own = f"/{ROOT}/materials/{name}"
    surface, color = f"{own}/surface", f"inputs:diffuseColor = {_tuple(mesh.color)}"
    if mesh.printed is not None:
        color = f"inputs:diffuseColor.connect = <{own}/image.outputs:rgb>"
    yield from (f'        def Material "{name}"', "        {",
                f"            token outputs:surface.connect = <{surface}.outputs:surface>", "",
                '            def Shader "surface"', "            {",
                '                uniform token info:id = "UsdPreviewSurface"',
                f"                color3f {color}",
                "                float inputs:roughness = 0.8", "                token outputs:surface", "            }")
    if mesh.printed is not None:
        wrap = "repeat" if mesh.printed.repeats else "clamp"
        yield from ('            def Shader "image"', "            {",
                    '                uniform token info:id = "UsdUVTexture"',
                    f"                asset inputs:file = @./{images[name].name}@",
                    '                token inputs:sourceColorSpace = "sRGB"',
                    f"                float2 inputs:st.connect = <{own}/place.outputs:result>",
                    f'                token inputs:wrapS = "{wrap}"', f'                token inputs:wrapT = "{wrap}"',
                    "                float3 outputs:rgb", "            }",
                    '            def Shader "place"', "            {",
                    '                uniform token info:id = "UsdPrimvarReader_float2"',
                    '                string inputs:varname = "st"', "                float2 outputs:result", "            }")
    yield "        }"


def identifier(name: str) -> str:
    """A name that USD takes."""
    return re.sub(r"\W", "_", f"_{name}" if name[:1].isdigit() else name, flags=re.ASCII) or "piece"


def _array(rows: np.ndarray) -> str:
    """Numbers (k,) or (k, d) as USD writes them, with the digits that float32 needs."""
    if rows.ndim == 1:
        return f"[{', '.join(map(str, rows.tolist()))}]"
    row = "(" + ", ".join(["%.9g"] * rows.shape[1]) + ")"
    return "[" + ", ".join([row % tuple(values) for values in rows.tolist()]) + "]"


def _tuple(values: Any) -> str:
    return "(" + ", ".join(f"{v:.9g}" for v in values) + ")"


def _string(text: str) -> str:
    """A text as USD quotes it."""
    clean = "".join(c if c.isprintable() else " " for c in text)
    return '"' + clean.replace("\\", "\\\\").replace('"', '\\"') + '"'
