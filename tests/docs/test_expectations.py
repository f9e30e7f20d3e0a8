"""Every row of docs/expectations.md names what is there: commands that are taken, on runs that rows above make, and names."""

import ast
import inspect
import pathlib
import re
import shlex

import pytest

import taichi_cloth as tc

PAGE = pathlib.Path(__file__).parents[2] / "docs/expectations.md"
ROWS = [[cell.strip() for cell in line.strip("|\n ").split(" | ")] for line in PAGE.read_text().splitlines()
        if line.startswith("| ") and not line.startswith(("| you expect", "|---"))]
WRONG = ("run hagn",)  # shown for their error


def codes():
    """(what is expected, code in quotes) of all rows, in order."""
    return [(want, code) for want, how in ROWS for code in re.findall(r"`([^`]+)`", how)]


def test_commands_are_taken_on_runs_that_rows_above_make(capsys):
    from taichi_cloth.app import scenefile
    from taichi_cloth.app.cli import _parser

    there, seen = set(), set()
    for want, code in codes():
        words = shlex.split(code)
        if words[0] == "printf":
            there.add(words[-1])
        if words[0] != "taichi-cloth":
            continue
        seen.add(words[1])
        try:
            args = _parser().parse_args(words[1:])
        except SystemExit:
            pytest.fail(f"{want}: {code}: {capsys.readouterr().err}")
        needs = [args.run] if hasattr(args, "run") and isinstance(args.run, str) else list(getattr(args, "runs", []))
        needs += [args.data] if hasattr(args, "data") else []
        assert set(needs) <= there, f"{want}: {code}: nothing above makes {needs}"
        if " ".join(words[1:]) not in WRONG and hasattr(args, "scene"):
            scenefile.read(args.scene)
        if getattr(args, "out", None):
            there.add(args.out)
    assert {"run", "render", "export", "blend", "report", "why", "study", "diff", "compare", "sweep", "fit", "fabrics"} <= seen


def test_names_are_there():
    """`tc.x`, `scene.x` and `sim.x`, and arguments by name in calls of them."""
    owners = {"tc": tc, "scene": tc.Scene, "sim": tc.Simulation}
    found = 0
    for want, code in codes():
        if not re.match(r"(with )?(tc|scene|sim)\.", code):
            continue
        for node in ast.walk(ast.parse(code + " pass" if code.startswith("with") else code)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in owners:
                assert hasattr(owners[node.value.id], node.attr), f"{want}: {code}"
                found += 1
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
                known = inspect.signature(getattr(owners[node.func.value.id], node.func.attr)).parameters
                assert {k.arg for k in node.keywords} <= set(known), f"{want}: {code}"
    assert found > 12
    assert "denim" in tc.fabrics
