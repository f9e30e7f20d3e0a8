"""What mkdocs asks for while it builds the site: tables taken from the code, and formulas as MathML.

A page names a table by a line `<!-- table: options -->` (or commands, scenes, record). Formulas are turned into MathML, which
browsers draw by themselves: no script and no font is loaded. Listed as a hook in mkdocs.yml; run by itself it prints the
tables.
"""

import argparse
import ast
import html
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).parents[1]
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
PLACE = re.compile(r"<!-- table: (\w+) -->")
ARGUMENT = re.compile(r"^ {4}(\w[\w, ]*): (.*)$")


def on_page_markdown(markdown: str, **_: object) -> str:
    """Puts the tables where a page names them."""
    return PLACE.sub(lambda found: TABLES[found[1]](), markdown)


def on_page_content(content: str, **_: object) -> str:
    """Formulas as MathML."""
    return FORMULA.sub(_formula, content)


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
    return _table(("scene", "what it shows", "options"), rows)


def record() -> str:
    """A row for each number that a step leaves in `Simulation.log` and in telemetry.jsonl."""
    node = _class("step/stepper", "StepRecord")
    meaning = _arguments(ast.get_docstring(node) or "", "Attributes:")
    names = [a.target.id for a in node.body if isinstance(a, ast.AnnAssign) and isinstance(a.target, ast.Name)]
    return _table(("name", "meaning"), [[f"`{name}`", meaning.get(name, "")] for name in names])


TABLES = {"options": options, "commands": commands, "scenes": scenes, "record": record}


def _class(module: str, name: str) -> ast.ClassDef:
    tree = ast.parse((ROOT / "taichi_cloth" / f"{module}.py").read_text())
    return next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)


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
    for name in sys.argv[1:] or TABLES:
        print(TABLES[name](), end="\n\n")
