"""Flags for the look of pictures, read into `output.look.Look`."""

import argparse
from collections.abc import Callable

from .flags import number_of


def look_flags(parser: argparse.ArgumentParser) -> None:
    """Flags of `look_of`."""
    add = parser.add_argument
    add("--quality", default="fast", help="fast, standard or high: shadow map, or traced shadows and ambient occlusion")
    add("--heat", metavar="NAME", help="colour by stretch, shear, bend, speed, contact, crease, limit or seam")
    add("--range", type=_range, metavar="LOW:HIGH", help="of the heat map's scale")
    add("--wire", action="store_true", help="draw the triangles' edges")
    add("--caption", default="", metavar="TEXT", help="in which {t} and {frame} are the time and the frame")
    add("--camera", type=_camera, metavar="EYE:TARGET[:FOV]",
        help='such as "1,1,2:0,0.5,0:35"; keys by time [s]: "0@1,1,2:0,0.5,0; 2@-1,1,2:0,0.5,0"; front, back, left or right '
             '(+z, -z, -x, +x) fits all frames from there; where absent, the scene\'s, or one that fits them')
    add("--orbit", type=number_of, default=0.0, metavar="DEG", help="degrees that the camera goes round in a second")
    add("--follow", action="store_true", help="the camera moves with the cloth")
    add("--background", metavar="COLOR", help="sky, transparent, or a colour: crimson, #dc143c")
    add("--floor", metavar="KIND", help="checker, plain, shadow (nothing but shadows), none, or a colour")
    add("--light", type=_light, metavar="NAME", help="day, studio, sun or soft; X,Y,Z is the day with light from there")
    add("--aperture", type=number_of, default=0.0, metavar="M", help="diameter of the lens [m]: blurs cloth out of focus")
    add("--focus", type=number_of, metavar="M", help="distance that is sharp [m]; the middle of the cloth where absent")
    add("--color", action="append", default=[], metavar="[CLOTH=]COLOR", help="of all cloths or of one")
    add("--back", action="append", default=[], metavar="[CLOTH=]COLOR", help="of the other side")
    add("--texture", action="append", default=[], metavar="[CLOTH=]FILE[@SIZE]",
        help="an image on the pattern, over all of it or repeated every SIZE, such as plaid.png@0.2 or @0.2x0.3 [m]")
    add("--weave", action="append", default=[], metavar="[CLOTH=]SPACING[:KIND]",
        help="threads that show, so far apart [m]; plain or twill")
    add("--sheen", action="append", default=[], metavar="[CLOTH=]PART", help="light along outlines, as of velvet (0.1)")
    add("--specular", action="append", default=[], metavar="[CLOTH=]PART[:ROUGHNESS]",
        help="light in a highlight, 0 to 1 (0.015), and how wide that is, 0.1 to 1 (0.6): satin is 0.2:0.35")
    add("--hem", action="append", default=[], metavar="[CLOTH=]WIDTH", help="a hem along borders that are not sewn [m]")
    add("--thickness", action="append", default=[], metavar="[CLOTH=]M", help="with which cloth is drawn [m]")
    add("--no-squares", action="store_true", help="draw no squares on the cloth")
    add("--smooth", type=int, default=0, metavar="N", help="halve the triangles' edges N times, for round outlines (0 to 3)")
    add("--bits", type=int, default=8, metavar="N", help="of a number in the PNG: 8 or 16")


def frame_flags(parser: argparse.ArgumentParser) -> None:
    """Flags for the frames that are drawn, and for the passes written beside each picture."""
    add = parser.add_argument
    add("--frames", default="", metavar="FIRST:LAST[:STEP]", help="draw these only, such as 10:60:5 or 0,12,40:50")
    add("--passes", default="", metavar="NAMES", help="also depth, normal, id of each pixel, with commas between")
    add("--pass-format", default="npy", metavar="KIND", help="npy, a file a pass, or exr, one with the linear light (npy)")


def passes_of(args: argparse.Namespace) -> tuple[tuple[str, ...], str]:
    """Names of passes, and their format, as `recording.drawing.Extras` takes them; checked."""
    names = tuple(name.strip() for name in args.passes.split(",")) if args.passes else ()
    if names or args.pass_format != "npy":
        from ..recording.drawing import Extras

        Extras(names, args.pass_format)
    return names, args.pass_format


def look_of(args: argparse.Namespace) -> dict:
    """Arguments of `output.look.Look` but for the heat map, whose name and range are under "heat"."""
    from .. import checks
    from ..output.look import Look
    from ..system.quantities import QUANTITIES

    if args.heat:
        checks.choice("quantity", args.heat, QUANTITIES)
    names = ("quality", "wire", "caption", "orbit", "follow", "background", "floor", "light", "aperture", "focus", "smooth",
             "bits")
    look = {**{name: getattr(args, name) for name in names}, "shutter": getattr(args, "shutter", 0.0),
            "camera": _cameras(args.camera), "cloths": _cloths(args)}
    Look(**look)  # a wrong value is an error before anything runs
    return {**look, "heat": (args.heat, args.range) if args.heat else None}


def _cameras(keys: list[tuple[float | None, tuple]] | str | None):
    """A camera, cameras by time, or a side."""
    from ..scene.view import Camera

    if not keys or isinstance(keys, str):
        return keys or None
    if keys[0][0] is None:
        return Camera(*keys[0][1])
    return {t: Camera(*numbers) for t, numbers in keys}


def _cloths(args: argparse.Namespace) -> dict:
    """Appearances by cloth, "" for all."""
    from ..scene.appearance import Appearance

    said: dict[str, dict] = {"": {"squares": False}} if args.no_squares else {}
    for flag, read in PARTS.items():
        for text in getattr(args, flag):
            name, equals, value = text.partition("=")
            said.setdefault(name if equals else "", {}).update(read(flag, value if equals else text))
    return {name: Appearance(**parts) for name, parts in said.items()}


def _word(flag: str, text: str) -> dict:
    return {flag: text}


def _number(flag: str, text: str) -> dict:
    from ..errors import SceneError

    try:
        return {flag: number_of(text)}
    except argparse.ArgumentTypeError:
        raise SceneError(f"--{flag} {text!r}: needs a number") from None


def _specular(flag: str, text: str) -> dict:
    part, colon, roughness = text.partition(":")
    return _number(flag, part) | ({"roughness": _number(flag, roughness)[flag]} if colon else {})


def _texture(flag: str, text: str) -> dict:
    from ..errors import SceneError
    from ..scene.appearance import Texture

    file, at, size = text.rpartition("@")
    if not at:
        return {flag: Texture(text)}  # type: ignore[arg-type]
    try:
        numbers = tuple(number_of(part) for part in size.split("x"))
    except argparse.ArgumentTypeError:
        numbers = ()
    if len(numbers) not in (1, 2):
        raise SceneError(f"--texture {text!r}: after @ it needs WIDTH or WIDTHxHEIGHT [m], such as plaid.png@0.2x0.3")
    return {flag: Texture(file, numbers[0] if len(numbers) == 1 else numbers)}  # type: ignore[arg-type]


def _weave(flag: str, text: str) -> dict:
    from ..errors import SceneError
    from ..scene.appearance import Weave

    spacing, colon, kind = text.partition(":")
    try:
        return {flag: Weave(number_of(spacing), 1.0, kind if colon else "plain")}
    except argparse.ArgumentTypeError:
        raise SceneError(f"--weave {text!r}: needs SPACING [m] or SPACING:KIND, such as 0.002:twill") from None


# how flags of a cloth are read: arguments of an appearance
PARTS: dict[str, Callable[[str, str], dict]] = {
    "color": _word, "back": _word, "texture": _texture, "weave": _weave, "sheen": _number, "specular": _specular,
    "hem": _number, "thickness": _number}


def _range(text: str) -> tuple[float, float]:
    low, colon, high = text.partition(":")
    if not colon or not number_of(low) < number_of(high):
        raise argparse.ArgumentTypeError(f"{text!r}: needs LOW:HIGH, such as 0.9:1.1")
    return number_of(low), number_of(high)


def _light(text: str) -> str | tuple[float, ...]:
    """A name, which is checked with the rest of the look, or a direction."""
    if text.isalpha():
        return text
    numbers = tuple(number_of(v) for v in text.split(","))
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"{text!r}: needs X,Y,Z, such as 0.5,0.8,0.5")
    return numbers


def _camera(text: str) -> list[tuple[float | None, tuple]] | str:
    """(time or None, (eye, target[, fov])) of each key, or the name of a side."""
    from ..output.camera import SIDES

    if text in SIDES:
        return text
    out: list[tuple[float | None, tuple]] = []
    for key in text.split(";"):
        time, at, place = key.strip().rpartition("@")
        parts = place.split(":")
        if len(parts) not in (2, 3) or any(len(p.split(",")) != 3 for p in parts[:2]):
            raise argparse.ArgumentTypeError(f"{text!r}: needs {', '.join(SIDES)}, or EYE:TARGET or EYE:TARGET:FOV, such as "
                                             '"1,1,2:0,0.5,0:35"; keys by time are "0@EYE:TARGET; 2@EYE:TARGET"')
        points = [tuple(number_of(v) for v in part.split(",")) for part in parts[:2]]
        out.append((number_of(time) if at else None, (*points, *(number_of(v) for v in parts[2:]))))
    if len(out) > 1 and any(t is None for t, _ in out):
        raise argparse.ArgumentTypeError(f'{text!r}: each key needs its time [s]: "0@EYE:TARGET; 2@EYE:TARGET"')
    return out
