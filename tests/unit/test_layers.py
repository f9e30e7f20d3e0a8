"""Imports go one way: a module imports only from rooms above its own."""

import ast
import pathlib

PACKAGE = pathlib.Path(__file__).parents[2] / "taichi_cloth"

ROOMS = [
    # description
    ["errors", "npz", "interrupts"], ["checks"], ["view"], ["mesh", "boxes"], ["shapes", "fabric", "intersections"],
    ["solids"], ["scene"], ["io"],
    ["ordering", "elements", "taichi_patches", "runtime", "timing"], ["quantities"], ["fields"], ["model", "team"],  # fields
    ["forces"], ["operator"], ["measure", "constraints"], ["ledger"], ["contact"], ["solver"], ["integrators"], ["stepper"],
    ["simulation"],
    ["output"], ["record", "playback"], ["report", "scenefile"], ["study", "verify"], ["resuming"], ["runner"],
    ["cli_recorded"], ["cli_study"], ["cli"],
    ["__main__", "__init__"],
]
ROOM = {name: k for k, names in enumerate(ROOMS) for name in names}
NUMPY_ONLY = {"errors", "checks", "npz", "view", "mesh", "shapes", "fabric", "solids", "boxes", "intersections", "scene",
              "io", "ordering", "elements", "quantities", "scenefile", "cli_recorded", "cli_study", "cli"}
OUTPUT_MAY = {"output", "errors", "checks", "npz", "view", "runtime"}


def imports(path: pathlib.Path):
    """(room of the importing module, room imported or external name) pairs."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = list(parts[: len(parts) - node.level])
            target = base + (node.module.split(".") if node.module else [])
            for name in [target[0]] if target else [a.name for a in node.names]:
                yield parts[0], name
        elif isinstance(node, ast.Import):
            yield from ((parts[0], "ext:" + a.name.split(".")[0]) for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield parts[0], "ext:" + node.module.split(".")[0]


def test_imports_go_one_way():
    files = sorted(PACKAGE.rglob("*.py"))
    assert len(files) > 25
    for path in files:
        for room, target in imports(path):
            where = f"{path.name} imports {target}"
            if target.startswith("ext:"):
                assert not (room in NUMPY_ONLY and target == "ext:taichi"), where
            elif target != "__version__":
                assert ROOM[target] < ROOM[room] or target == room, where
                assert room != "output" or target in OUTPUT_MAY, where
