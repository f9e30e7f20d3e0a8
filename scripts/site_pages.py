"""Tables of the docs that are taken from the code, and formulas of the site as MathML.

    python scripts/site_pages.py --write           # puts the tables of today's code into the pages
    python scripts/site_pages.py options           # prints a table

A table stands in its page between the lines `<!-- table: options -->` (or another name of `TABLES`) and
`<!-- end of table -->`, so that it can be read in a plain file. tests/docs/test_site.py checks that all are up to date. As a
hook of mkdocs it also turns formulas into MathML, which browsers draw by themselves: no script and no font is loaded.
"""

import argparse
import ast
import html
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).parents[1]
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
PLACE = re.compile(r"(<!-- table: (\w+) -->\n\n).*?(<!-- end of table -->)", re.DOTALL)
ARGUMENT = re.compile(r"^ {4}(\w[\w, ]*): (.*)$")


def on_page_markdown(markdown: str, **_: object) -> str:
    """A page with today's tables, without the lines that mark their places."""
    return PLACE.sub(lambda found: TABLES[found[2]](), markdown)


def on_page_content(content: str, **_: object) -> str:
    """Formulas as MathML."""
    return FORMULA.sub(_formula, content)


def filled(markdown: str) -> str:
    """A page with today's tables in their places."""
    return PLACE.sub(lambda found: f"{found[1]}{TABLES[found[2]]()}\n\n{found[3]}", markdown)


def with_tables() -> list[pathlib.Path]:
    """The pages that have tables."""
    return [page for page in sorted((ROOT / "docs").rglob("*.md")) if PLACE.search(page.read_text())]


def options() -> str:
    """A row for each option of `Simulation`: default, flag of `taichi-cloth run`, meaning."""
    _import_from_here()
    from taichi_cloth.options import Options

    rows = [[f"`{name}`", f"`{default!r}`", f"`{flag}`" if flag else "", meaning]
            for name, default, flag, meaning in Options.table()]
    return _table(("argument", "default", "flag", "meaning"), rows)


def commands() -> str:
    """Every command with its flags, as the parser has them."""
    _import_from_here()
    from taichi_cloth.app.cli import _parser

    actions = next(a for a in _parser()._actions if isinstance(a, argparse._SubParsersAction))
    out = []
    for choice in actions._choices_actions:
        parser = actions.choices[choice.dest]
        rows = [[f"`{_spelled(a)}`", _shown(a.default), str(a.help)] for a in parser._actions if a.dest != "help"]
        out.append(f"## taichi-cloth {choice.dest}\n\n{(choice.help or '').capitalize()}.\n\n"
                   + (_table(("argument", "default", "meaning"), rows) if rows else "It takes no arguments."))
    return "\n\n".join(out)


def scenes() -> str:
    """A row for each scene: what it shows, and the options that `--set` takes."""
    rows = []
    for path in sorted((ROOT / "scenes").glob("*.py")):
        tree = ast.parse(path.read_text())
        build = next(f for f in tree.body if isinstance(f, ast.FunctionDef) and f.name == "build")
        names = [a.arg for a in build.args.args]
        meaning = _arguments(ast.get_docstring(build) or "", "Args:")
        settings = "; ".join(f"`{n}={ast.unparse(d)}` {meaning.get(n, '').rstrip('.').replace(';', ',')}"
                             for n, d in zip(names, build.args.defaults))
        rows.append([f"`{path.stem}`", (ast.get_docstring(tree) or "").split("\n")[0], settings])
    return _table(("scene", "content", "options"), rows)


def record() -> str:
    """A row for each number that a step leaves in `Simulation.log` and in telemetry.jsonl."""
    node = _class("step/records", "StepRecord")
    meaning = _arguments(ast.get_docstring(node) or "", "Attributes:")
    names = [a.target.id for a in node.body if isinstance(a, ast.AnnAssign) and isinstance(a.target, ast.Name)]
    return _table(("name", "meaning"), [[f"`{name}`", meaning.get(name, "")] for name in names])


def names() -> str:
    """A row for each public name: the first line of its docstring, or the comment on it."""
    _import_from_here()
    from taichi_cloth import _WHERE

    return _table(("name", "meaning"), [[f"`tc.{name}`", _first_line(where, name)] for name, where in _WHERE.items()])


def deprecations() -> str:
    """A row for each old name that is still read: whose it is, and its new name."""
    _import_from_here()
    from taichi_cloth.renamed import RENAMED

    rows = [[f"`{owner}`", f"`{old}`", f"`{new}`"] for owner, pairs in RENAMED.items() for old, new in pairs.items()]
    return _table(("class", "old name", "new name"), rows)


TABLES = {"options": options, "commands": commands, "scenes": scenes, "record": record, "names": names,
          "deprecations": deprecations}


def _class(module: str, name: str) -> ast.ClassDef:
    tree = ast.parse((ROOT / "taichi_cloth" / f"{module}.py").read_text())
    return next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)


def _first_line(module: str, name: str) -> str:
    """First paragraph of the docstring of a class or function of a module; of a value, the comment above it."""
    path = ROOT / "taichi_cloth" / module.replace(".", "/")
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text()
    for node in ast.parse(text).body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name == name:
            return (ast.get_docstring(node) or "").split("\n\n")[0].replace("\n", " ")
        if isinstance(node, ast.ImportFrom) and name in [alias.asname or alias.name for alias in node.names]:
            inside = module if path.is_dir() else module.rpartition(".")[0]
            return _first_line(f"{inside}.{node.module}", name)
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == name:
            return text.split("\n")[node.lineno - 2].removeprefix("# ")
    raise LookupError(f"{name} is not in {path}")


def _arguments(docstring: str, section: str = "Args:") -> dict[str, str]:
    """Name -> text of a section of a docstring; names that share a line share its text."""
    out: dict[str, str] = {}
    lines = docstring.split("\n")
    names: list[str] = []
    for text in lines[lines.index(section) + 1:]:
        if text and not text.startswith(" "):
            break
        starts = ARGUMENT.match(text)
        if starts:
            names = []
            for part in _parts(f"{starts[1]}: {starts[2]}"):
                names = [n.strip() for n in part[0].split(",")]
                out.update(dict.fromkeys(names, part[1]))
        elif text.strip():
            out.update({name: f"{out[name]} {text.strip()}" for name in names})
    return out


def _parts(line: str) -> list[tuple[str, str]]:
    """(names, text) of a line such as "iterations: of all solves; least: the smallest" with one or more of them."""
    pieces = re.split(r"; (?=[a-z_]+: )", line)
    return [tuple(piece.split(": ", 1)) for piece in pieces]  # type: ignore[misc]


def _import_from_here() -> None:
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))


def _spelled(action: argparse.Action) -> str:
    """An argument as it is typed."""
    if not action.option_strings:
        return action.dest if action.metavar is None else str(action.metavar)
    takes = "" if action.nargs == 0 else f" {action.metavar or action.dest.upper()}"
    return action.option_strings[-1] + takes


def _shown(default: object) -> str:
    if default in (None, False, "", [], 0):
        return ""
    return "x".join(map(str, default)) if isinstance(default, tuple) else f"`{default}`"


def _table(head: tuple[str, ...], rows: list[list[str]]) -> str:
    lines = [list(head), ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _formula(found: re.Match) -> str:
    from latex2mathml.converter import convert

    tex = html.unescape(found[2])
    made = convert(tex, display="block" if found[1] == "div" else "inline")
    if "\\" in html.unescape(re.sub(r"<[^>]*>", "", made)):
        raise ValueError(f"no MathML for {tex!r}: {made}")
    return f'<{found[1]} class="formula">{made}</{found[1]}>'


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        for page in with_tables():
            page.write_text(filled(page.read_text()))
    else:
        for name in sys.argv[1:] or TABLES:
            print(TABLES[name](), end="\n\n")
