"""Runs inside Blender: gives objects of a .blend caches of positions, as a modifier, and saves it under another name.

Arguments: the file, the one to write, and a JSON object: `folder` of the caches, beside the new file, and `caches` as
`caches.json` has them. Nothing of the package is imported here: the Python that runs this is Blender's.
"""

import json
import os
import sys

import bpy

OWN = "taichi_cloth"


def main(path: str, out: str, choices: str) -> None:
    """Opens, adds, saves."""
    wanted = json.loads(choices)
    bpy.context.preferences.filepaths.save_version = 0  # the second save would leave a copy of the first beside it
    with open(path, "rb") as file:
        compressed = file.read(7) != b"BLENDER"
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    made = [put(bpy.data.objects[c["object"]], c["before"], c["start"], c["scale"]) for c in wanted["caches"]]
    bpy.ops.wm.save_as_mainfile(filepath=out, compress=compressed, relative_remap=True, check_existing=False)
    for modifier, cache in zip(made, wanted["caches"]):  # now, as paths beside the new file
        modifier.filepath = f"//{wanted['folder']}/{cache['file']}"
    bpy.ops.wm.save_mainfile(compress=compressed, check_existing=False)


def put(item, before: str, start: float, scale: float):
    """The modifier of a cache, in place of one of an earlier bake."""
    old = item.modifiers.get(OWN)
    if old is not None:
        item.modifiers.remove(old)
    cache = item.modifiers.new(OWN, "MESH_CACHE")
    cache.cache_format, cache.interpolation, cache.frame_start, cache.frame_scale = "PC2", "LINEAR", start, scale
    item.modifiers.move(len(item.modifiers) - 1, item.modifiers.find(before) + 1)
    return cache


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1:])
    sys.stdout.flush()
    os._exit(0)  # Blender's own end may crash after all is written
