"""One picture of every scene, in one contact sheet with captions.

    python scripts/make_gallery.py --to docs/gallery.png --set bunny_drape:mesh=bunny.obj
"""

import argparse
import pathlib

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.output.look import Look
from taichi_cloth.output.picture import Artist, contact_sheet
from taichi_cloth.output.png import encode_png
from taichi_cloth.recording import record

SKIPPED = ("hang_mesh",)  # needs a file
FINEST = 0xFE  # bits of a colour that are kept: nobody sees the last one, and the file is a quarter smaller without
WHEN = {"swing": 0.55, "explicit_vs_implicit": 0.4, "flag": 0.8, "incline": 0.6, "trampoline": 0.3, "funnel": 0.6,
        "tablecloth_pull": 0.55, "tear": 0.28, "rip_seam": 0.75, "balloon": 0.68, "knot": 0.5}  # part of the duration


def picture(name: str, settings: dict, size: tuple[int, int], quality: str):
    """The scene at its most telling moment."""
    scene = scenefile.read(name)
    plan = dict(scene.run)
    duration, fps = plan.pop("duration") * WHEN.get(name, 1.0), plan.pop("fps")
    sim = tc.Simulation(scene.make(settings), **plan)
    sim.run(duration, fps)
    frame = record.frame(sim)
    look = Look(quality=quality, caption=name)
    image = Artist(record.geometry(sim), size, look, lambda: [frame], lambda: [frame]).draw(frame)
    sim.close()
    return image


def main() -> None:
    """Runs the scenes and writes the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--to", default="gallery.png")
    parser.add_argument("--scenes", nargs="*", help="names; all but those that need a file where left out")
    parser.add_argument("--size", type=int, nargs=2, default=(360, 270), help="of one picture")
    parser.add_argument("--columns", type=int, default=4)
    parser.add_argument("--quality", default="high")
    parser.add_argument("--set", action="append", default=[], metavar="SCENE:NAME=VALUE", help="an option of a scene")
    args = parser.parse_args()
    settings: dict[str, dict] = {}
    for item in args.set:
        scene, _, option = item.partition(":")
        name, _, value = option.partition("=")
        settings.setdefault(scene, {})[name] = value
    images = []
    for name in args.scenes or [n for n in scenefile.available() if n not in SKIPPED or n in settings]:
        images.append(picture(name, settings.get(name, {}), tuple(args.size), args.quality))
        print(name, flush=True)
    file = pathlib.Path(args.to)
    file.parent.mkdir(parents=True, exist_ok=True)
    sheet = contact_sheet(images, min(args.columns, len(images))) & FINEST
    file.write_bytes(encode_png(sheet, 9))
    print(f"{len(images)} pictures, {file.stat().st_size / 1e3:.0f} kB: {file}")


if __name__ == "__main__":
    main()
