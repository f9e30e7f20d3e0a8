"""Finish of a cloth's surface besides its colour: squares, an image, threads. Compiled only where something has them."""

from ..backend.language import ti
from .objects import CHECK, FIRST, HEM, LEVELS, ORIGIN, RELIEF, SIZE, SPACING, TEXTURE, WEAVE
from .surroundings import soft_checker

ROUND, EDGE, SEWN, STITCH, LAYERS = 0.7, 0.18, 0.78, 0.4, 0.08  # a hem's tilt, where, its seam, stitches; parts of it
SLOPE = 0.75  # how much threads tilt the normal at their rim
FINE, GONE = 3.0, 1.2  # pixels from thread to thread at which threads are drawn in full, and no longer


@ti.func
def squared(base, uv, footprint, side, objects: ti.template(), o):
    """The colour with every other square darker; footprint [m]: the covered part of the pattern."""
    return base * (1.0 - objects[o, CHECK] * soft_checker(uv / side, footprint / side))


@ti.func
def printed(base, uv, footprint, objects: ti.template(), o, texels: ti.template(), levels: ti.template(),
            decode: ti.template()):
    """The colour under an image; footprint [m]: the part of the pattern that a sample covers."""
    out = base
    size = ti.Vector([objects[o, SIZE], objects[o, SIZE + 1]])
    s = (uv - ti.Vector([objects[o, ORIGIN], objects[o, ORIGIN + 1]])) / size
    first, most = ti.cast(objects[o, FIRST], int), objects[o, LEVELS] - 1
    texel = ti.min(size[0] / levels[first, 1], size[1] / levels[first, 2])
    lod = ti.min(ti.max(ti.log(ti.max(footprint / texel, 1e-6)) * 1.442695, 0.0), most)
    low = ti.cast(ti.floor(lod), int)
    high = ti.min(low + 1, ti.cast(most, int))
    once = objects[o, TEXTURE] > 1.5
    a, b = (filtered(s, once, texels, levels, decode, first + low), filtered(s, once, texels, levels, decode, first + high))
    rgba = a + (lod - low) * (b - a)
    out = base * (1 - rgba[3]) + ti.Vector([rgba[0], rgba[1], rgba[2]])
    return out


@ti.func
def filtered(s, once, texels: ti.template(), levels: ti.template(), decode: ti.template(), level):
    """Linear RGBA of a level at s, between four texels; nothing beyond the edges of an image that is there once."""
    start, w, h = levels[level, 0], levels[level, 1], levels[level, 2]
    x, y = s[0] * w - 0.5, (1 - s[1]) * h - 0.5
    i, j = ti.cast(ti.floor(x), int), ti.cast(ti.floor(y), int)
    out = ti.Vector([0.0, 0.0, 0.0, 0.0])
    for k in range(4):
        c, r = i + k % 2, j + k // 2
        part = (1 - ti.abs(x - c)) * (1 - ti.abs(y - r))
        if not once or (0 <= c and c < w and 0 <= r and r < h):
            code = texels[start + (r % h + h) % h * w + (c % w + w) % w]
            out += part * ti.Vector([decode[code & 255], decode[(code >> 8) & 255], decode[(code >> 16) & 255],
                                     ti.cast((code >> 24) & 255, ti.f32) / 255.0])
    return out


@ti.func
def threads(uv, footprint, objects: ti.template(), o):
    """(tilt along u, tilt along v, shade) of a weave; footprint [m]: the part of the pattern that a pixel covers."""
    spacing = objects[o, SPACING]
    i, j = ti.cast(ti.floor(uv[0] / spacing), int), ti.cast(ti.floor(uv[1] / spacing), int)
    x, y = uv[0] / spacing - i, uv[1] / spacing - j
    across, along, warp = 2 * x - 1, 2 * y - 1, (i + j) & 1  # warp threads run along v
    if warp == 0:
        across, along = 2 * y - 1, 2 * x - 1
    if objects[o, WEAVE] > 1.5:
        phase = (i + j) & 3
        warp = phase // 2
        across, along = 2 * x - 1, (phase - 2) + y - 1
        if warp == 0:
            across, along = 2 * y - 1, phase + x - 1
    shown = ti.min(ti.max((spacing / footprint - GONE) / (FINE - GONE), 0.0), 1.0) * objects[o, RELIEF]
    round_, arch = across * ti.abs(across), along ** 3
    shade = 1 - ti.min(0.45 * shown, 0.9) * (0.6 * across ** 4 + 0.4 * along ** 4)
    tilt = SLOPE * shown * ti.Vector([round_, 0.7 * arch])
    if warp == 0:
        tilt = ti.Vector([tilt[1], tilt[0]])
    return tilt[0], tilt[1], shade


@ti.func
def darkened(s):
    """Integral up to a place s of a hem of the shade along its inner edge, which grows over EDGE / 2 up to 1 at s = 1."""
    into = ti.min(ti.max(s - 1 + EDGE / 2, 0.0), EDGE / 2)
    return into * into / EDGE


@ti.func
def hemmed(uv, footprint, borders: ti.template(), f, objects: ti.template(), o):
    """(tilt along u, tilt along v, shade) of cloth that is turned over and sewn along a border; footprint: as `threads`."""
    width, away, along = objects[o, HEM], 1e9, 0.0
    out = ti.Vector([0.0, 0.0])
    for k in ti.static(range(2)):
        a = ti.Vector([borders[f, 4 * k], borders[f, 4 * k + 1]])
        way = ti.Vector([borders[f, 4 * k + 2], borders[f, 4 * k + 3]]) - a
        t = ti.min(ti.max((uv - a).dot(way) / ti.max(way.dot(way), 1e-30), 0.0), 1.0)
        to = uv - a - t * way
        if to.norm() < away:
            away, along, out = to.norm(), (uv - a).dot(way.normalized(1e-12)), -to.normalized(1e-12)
    s, pixel = away / width, footprint / width
    shown = ti.min(ti.max((1 / pixel - GONE) / (FINE - GONE), 0.0), 1.0)
    tilt, shade = 0.0, 1.0
    if s < 1 + pixel / 2:
        inside = ti.min((1 - s) / pixel + 0.5, 1.0)  # part of the pixel
        tilt = shown * inside * ROUND * (ti.max(1 - s / EDGE, 0.0) - ti.max(1 - ti.abs(1 - s) / EDGE, 0.0))
        beat = along / (STITCH * width)
        line = ti.max(1 - ti.abs(s - SEWN) / (EDGE / 3 + pixel), 0.0) * ti.cast(beat - ti.floor(beat) < 0.7, ti.f32)
        step = (darkened(s + pixel / 2) - darkened(s - pixel / 2)) / pixel
        shade = 1 - shown * (LAYERS * inside + (1 - LAYERS) * ti.max(0.3 * line, 0.35 * step))
    return tilt * out[0], tilt * out[1], shade
