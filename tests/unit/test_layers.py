"""Imports go one way: rooms in a fixed order, and no circle among files, imports inside functions included."""

import ast
import functools
import pathlib
import re

ROOT = pathlib.Path(__file__).parents[2]
PACKAGE = ROOT / "taichi_cloth"

ROOMS = ("colornames", "renamed", "errors", "attributes", "keywords", "checks", "options", "scene", "io", "backend", "system",
         "forces", "contact", "solver", "tearing", "step", "simulation", "garment", "output", "recording", "studies", "sweeps",
         "fitting", "live", "app", "__main__", "__init__")
NUMPY_ONLY = {"attributes", "keywords", "colornames", "renamed", "errors", "checks", "options", "scene", "io",
              "backend.ordering", "backend.timing", "backend.placement", "backend.quota", "backend.compiler",
              "backend.interrupts",
              "system.elements", "system.quantities", "step.ledger", "app.scenefile", "app.recorded",
              "app.studies", "app.flags", "app.look_flags", "app.cli", "app.dressing", "app.fitting", "app.looking",
              "app.sweeping", "app.blending", "app.taking", "app.viewing", "live.orders", "live.parameters", "live.server",
              "live.seen", "live.controls", "live.page", "live.pages", "live.link", "live.view", "app.runoptions",
              "garment.curves", "garment.pattern", "garment.garmentcode", "garment.svg",
              "garment.pathdata", "garment.shapes", "garment.styles", "garment.xmlfile", "garment.drawing", "garment.outlines",
              "garment.freesewing", "garment.stitch", "garment.worn", "garment.chains", "garment.cutpiece", "garment.dxf",
              "garment.dxffile", "garment.sheet", "garment.sidefile", "garment.figure", "app.patterns"}
LANGUAGE = {"backend.language", "backend.taichi_patches"}  # importing them imports the compiler
OUTPUT_MAY = {"colornames", "renamed", "errors", "checks", "io.blender", "io.blendfile", "io.npz", "io.jsonfile",
              "io.sequence", "scene.mesh", "scene.boxes", "scene.closest", "scene.view", "scene.appearance", "backend.runtime",
              "backend.bvh",
              "backend.placement", "backend.fields", "backend.language", "backend.rows", "backend.ordering",
              "system.quantities"}


def name_of(path: pathlib.Path) -> str:
    """Dotted name of a module within the package; a folder's own file has the folder's name."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1]) if len(parts) > 1 and parts[-1] == "__init__" else ".".join(parts)


FILES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


@functools.cache  # read where a test asks, not in every process that collects it
def imports(name: str) -> set[str]:
    """Modules of the package that a module imports, wherever in it."""
    path = FILES[name]
    folder = path.relative_to(PACKAGE).parent.parts
    inside = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = [*folder[: len(folder) - node.level + 1], *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                module = ".".join([*base, alias.name])
                target = module if module in FILES else ".".join(base)
                if target:  # else a name of the package itself, such as its version
                    inside.add(target)
    return inside


def belongs(name: str, names) -> bool:
    """Whether a module is one of `names`, or in a room of one."""
    return any(name == other or name.startswith(other + ".") for other in names)


def test_rooms_are_in_order():
    assert len(FILES) > 100
    for name in FILES:
        inside = imports(name)
        room = name.split(".")[0]
        for target in inside:
            where = f"{name} imports {target}"
            other = target.split(".")[0]
            assert ROOMS.index(other) <= ROOMS.index(room), where
            assert room != "output" or other == "output" or target in OUTPUT_MAY, where
        assert not (belongs(name, NUMPY_ONLY) and inside & LANGUAGE), name


def test_no_circle_among_files():
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " imports ".join([*trail[trail.index(name):], name])
        if name not in done:
            for target in imports(name):
                visit(target, (*trail, name))
            done.add(name)

    for name in FILES:
        visit(name, ())


def test_the_compiler_is_imported_in_one_place():
    """Everything else has its language from `backend/language.py`, so that another compiler serves all of it."""
    for path in (path for folder in ("taichi_cloth", "scenes", "scripts", "tests") for path in (ROOT / folder).rglob("*.py")):
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if re.search(r"\b(taichi|taichi_forge|quadrants)\b", text) else ():
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [
                node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            found = {name.split(".")[0] for name in names} & {"taichi", "taichi_forge", "quadrants"}
            assert not found or path == PACKAGE / "backend" / "language.py", f"{path} imports {found}"
