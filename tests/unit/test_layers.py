"""Imports go one way: rooms in a fixed order, and no circle among files, imports inside functions included."""

import ast
import pathlib

PACKAGE = pathlib.Path(__file__).parents[2] / "taichi_cloth"

ROOMS = ("colornames", "errors", "checks", "options", "scene", "io", "backend", "system", "forces", "contact", "solver",
         "step", "simulation", "garment", "output", "recording", "studies", "sweeps", "fitting", "live", "app", "__main__",
         "__init__")
NUMPY_ONLY = {"colornames", "errors", "checks", "options", "scene", "io", "backend.ordering", "backend.timing",
              "backend.placement", "backend.quota", "system.elements", "system.quantities", "step.ledger", "app.scenefile",
              "app.recorded",
              "app.studies", "app.flags", "app.look_flags", "app.cli", "app.dressing", "app.fitting", "app.looking",
              "app.sweeping", "app.blending", "app.taking", "app.viewing", "live.orders", "live.parameters", "live.server",
              "live.seen", "live.controls", "live.page", "live.pages", "live.link", "live.view", "app.runoptions",
              "app.interrupts", "garment.curves", "garment.pattern", "garment.garmentcode", "garment.svg",
              "garment.pathdata", "garment.shapes", "garment.styles", "garment.xmlfile", "garment.drawing", "garment.outlines",
              "garment.freesewing", "garment.stitch", "garment.worn", "garment.chains", "garment.cutpiece", "garment.dxf",
              "garment.dxffile", "garment.sheet", "garment.sidefile", "garment.figure", "app.patterns"}
OUTPUT_MAY = {"colornames", "errors", "checks", "io.blender", "io.blendfile", "io.npz", "io.jsonfile", "io.sequence",
              "scene.mesh", "scene.view", "scene.appearance", "backend.runtime", "backend.bvh", "backend.placement",
              "backend.fields", "backend.rows", "backend.ordering", "system.quantities"}


def name_of(path: pathlib.Path) -> str:
    """Dotted name of a module within the package; a folder's own file has the folder's name."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1]) if len(parts) > 1 and parts[-1] == "__init__" else ".".join(parts)


FILES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports(name: str) -> tuple[set[str], set[str]]:
    """(modules of the package, packages from outside) that a module imports, wherever in it."""
    path = FILES[name]
    folder = path.relative_to(PACKAGE).parent.parts
    inside, outside = set(), set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            outside |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            outside.add(node.module.split(".")[0])
        elif isinstance(node, ast.ImportFrom):
            base = [*folder[: len(folder) - node.level + 1], *(node.module.split(".") if node.module else [])]
            for alias in node.names:
                module = ".".join([*base, alias.name])
                target = module if module in FILES else ".".join(base)
                if target:  # else a name of the package itself, such as its version
                    inside.add(target)
    return inside, outside


GRAPH = {name: imports(name) for name in FILES}


def belongs(name: str, names) -> bool:
    """Whether a module is one of `names`, or in a room of one."""
    return any(name == other or name.startswith(other + ".") for other in names)


def test_rooms_are_in_order():
    assert len(FILES) > 100
    for name, (inside, outside) in GRAPH.items():
        room = name.split(".")[0]
        for target in inside:
            where = f"{name} imports {target}"
            other = target.split(".")[0]
            assert ROOMS.index(other) <= ROOMS.index(room), where
            assert room != "output" or other == "output" or target in OUTPUT_MAY, where
        assert not (belongs(name, NUMPY_ONLY) and "taichi" in outside), name


def test_no_circle_among_files():
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " imports ".join([*trail[trail.index(name):], name])
        if name not in done:
            for target in GRAPH[name][0]:
                visit(target, (*trail, name))
            done.add(name)

    for name in FILES:
        visit(name, ())
