"""A scene's view and its cloths' appearance as arrays by name, and back: absent values are the usual ones, and take no
room."""

from collections.abc import Sequence

import numpy as np

from ..scene.appearance import WEAVES, Appearance, Texture, Weave
from ..scene.view import LIGHT, AnyCamera, CameraKeys, Color, View, camera_at, camera_of


def of_view(view: View, ground: float | None) -> dict[str, np.ndarray]:
    """`camera` (eye, target, fov, up; NaN if fitted), `camera_keys` (k, 11) with the times before, `ground`, `reach`, and
    `background`, `floor`, `light` if they are not as usual."""
    camera = view.camera
    out = {"camera": np.full(10, np.nan) if camera is None else camera_at(camera, 0.0).numbers,
           "ground": np.array(np.nan if ground is None else ground), "reach": np.array(view.reach)}
    if isinstance(camera, CameraKeys):
        out["camera_keys"] = np.column_stack([camera.times, camera.rows])
    if view.background != "sky":
        out["background"] = np.array(view.background)
    if view.floor is not None:
        out["floor"] = np.array(view.floor)
    if view.light != LIGHT:
        out["light"] = np.array(view.light)
    return out


def view_of(g: dict[str, np.ndarray]) -> View:
    """The view that `of_view` gave."""
    ground = float(g["ground"])
    camera: AnyCamera | None = None
    if "camera_keys" in g:
        camera = CameraKeys({float(row[0]): camera_of(row[1:]) for row in g["camera_keys"]})
    elif not np.isnan(g["camera"][0]):
        camera = camera_of(g["camera"])
    return View(camera, None if np.isnan(ground) else ground, float(g["reach"]),
                _word(g["floor"]) if "floor" in g else None, _word(g["background"]) if "background" in g else "sky",
                _word(g["light"]) if "light" in g else LIGHT)


def of_appearances(looks: Sequence[Appearance]) -> dict[str, np.ndarray]:
    """Arrays on the looks of cloths: `cloth_colors`, and others if the looks have more than colours.

    These are `cloth_backs` (NaN if left to the renderer), `cloth_finish` (squares or NaN, weave, its spacing [m], relief),
    `cloth_surface` (sheen, specular, roughness, hem [m], thickness [m], or NaN), `texture_K` and `texture_place_K` (size,
    origin or NaN, repeat).
    """
    out = {"cloth_colors": np.array([look.color or (np.nan,) * 3 for look in looks]).reshape(-1, 3)}
    for k, look in enumerate(looks):
        if look.texture is not None:
            t = look.texture
            nothing = (np.nan, np.nan)
            out[f"texture_{k}"] = t.image
            out[f"texture_place_{k}"] = np.array([*(t.size or nothing), *(t.origin or nothing), t.repeat])  # type: ignore[misc]
    if any(look.back is not None for look in looks):
        out["cloth_backs"] = np.array([look.back or (np.nan,) * 3 for look in looks])
    if any(look.squares is not None or look.weave is not None for look in looks):
        out["cloth_finish"] = np.array([_finish(look) for look in looks])
    if any(number is not None for look in looks for number in look.surface):
        out["cloth_surface"] = np.array([look.surface for look in looks], dtype=np.float64)
    return out


def image_uv(g: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Texture coordinates of images, and their unit on the cloth.

    Returns:
        (m, 3, 2) texture coordinates of faces' corners, the pattern's [m] if their cloth has no others; (c,) length of their
        unit on each cloth [m], in the mean over its area, NaN if they are the pattern's.
    """
    uv, units = g["uv"], np.full(len(g["cloth_names"]), np.nan)
    if "image_uv" not in g:
        return uv, units
    own = g["image_uv"]
    for k, (first, last) in enumerate(zip(g["cloth_faces"][:-1], g["cloth_faces"][1:])):
        pattern, image = (_area(a[first:last].astype(np.float64)) for a in (uv, own))
        if image > 0:
            units[k] = np.sqrt(pattern / image)
    return np.where(np.isnan(own), uv, own), units


def _area(corner: np.ndarray) -> float:
    """Area of triangles (m, 3, 2) together."""
    (a, b), (c, d) = np.moveaxis(corner[:, 1:] - corner[:, :1], 0, 2)
    return float(np.abs(a * d - b * c).sum() / 2)


def appearances_of(g: dict[str, np.ndarray]) -> list[Appearance]:
    """The appearances that `of_appearances` gave."""
    count = len(g["cloth_names"])
    backs = g.get("cloth_backs", np.full((count, 3), np.nan))
    finish = g.get("cloth_finish", np.tile([np.nan, 0, 0, 0], (count, 1)))
    surface = g.get("cloth_surface", np.full((count, 5), np.nan))
    out = []
    for k, (color, back, (squares, kind, spacing, relief)) in enumerate(zip(g["cloth_colors"], backs, finish)):
        weave = Weave(spacing, relief, WEAVES[int(kind) - 1]) if kind else None
        has_squares = None if np.isnan(squares) else bool(squares)
        numbers = (None if np.isnan(v) else float(v) for v in surface[k])
        out.append(Appearance(_color(color), _color(back), has_squares, _texture(g, k), weave, None, *numbers))
    return out


def _finish(look: Appearance) -> tuple[float, float, float, float]:
    w = look.weave
    weave = (WEAVES.index(w.kind) + 1, w.spacing, w.relief) if w else (0, 0.0, 0.0)
    return (np.nan if look.squares is None else float(look.squares), *weave)


def _texture(g: dict[str, np.ndarray], k: int) -> Texture | None:
    if f"texture_{k}" not in g:
        return None
    w, h, u, v, repeat = g[f"texture_place_{k}"].tolist()
    return Texture(g[f"texture_{k}"], None if np.isnan(w) else (w, h), None if np.isnan(u) else (u, v), bool(repeat))


def _color(numbers: np.ndarray) -> Color | None:
    if np.isnan(numbers).any():
        return None
    red, green, blue = numbers.tolist()
    return red, green, blue


def _word(array: np.ndarray) -> str | Color:
    """A word, or three numbers."""
    if array.dtype.kind == "U":
        return str(array)
    red, green, blue = array.tolist()
    return red, green, blue
