"""How plainly the project writes: words a sentence, "what" as a pronoun, openings such as "What is", by file.

    python scripts/prose.py                        # a row for each page of the docs
    python scripts/prose.py --code                 # a row for each package: its docstrings and comments together
    python scripts/prose.py --code --list          # and each sentence that counts as long, as an opening or for its "what"
    python scripts/prose.py docs/limits.md         # these files

A sentence ends with its paragraph, list item or quotation, or where a full stop, question mark or exclamation mark is followed
by a capital letter. Code blocks, tables, generated parts, headings and formulas on lines of their own are left out. Formulas
and code within a line count as one word each. "What" counts unless its sentence is a question or it is an argument's name;
"whatever" does not. An opening counts where a sentence begins with What, Where, Of, So, As or That: words that hide its
subject. A comment of several lines is a paragraph.
"""

import argparse
import ast
import io
import pathlib
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass

ROOT = pathlib.Path(__file__).parents[1]
LONG = 35  # words; sentences beyond are counted
SKIPPED = re.compile(r"^(```.*?^```|\$\$.*?\$\$|<!-- table.*?<!-- end of table -->|<!--.*?-->|"
                     r"\|.*?$|#.*?$|!\[.*?$|(?<=\n\n)    \S.*?$)", re.DOTALL | re.MULTILINE)
WHOLE = re.compile(r"``.*?``|`[^`\n]*`|\$[^$]*\$")  # one word each
LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
BLOCK = re.compile(r"\n\s*\n|\n\s*(?:[-*]|\d+\.)\s+|\n    (?=\w[\w, ]*: )|:\n(?=    )")  # items of lists and Google's sections
END = re.compile(r"(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)[\"')*]*\s+(?=[\"'(*]*[A-ZΔΦ])")
ORDERS = re.compile(r"#[:!\s]*(?:noqa(?:: [A-Z\d, ]+)?|type: ignore\S*)?")  # a comment's sign, and orders to linters in it
OPENS = re.compile(r"(?:What|Where|Of|So|As|That)\b")


@dataclass
class Measured:
    """Counts of one text.

    Attributes:
        words: in sentences; sentences: of them; long: those with more than `LONG` words; whats: uses of "what" outside
            questions; openings: sentences that begin with a pronoun or preposition in the place of a subject
    """

    words: int = 0
    sentences: int = 0
    long: int = 0
    whats: int = 0
    openings: int = 0

    def __add__(self, other: "Measured") -> "Measured":
        return Measured(*(a + b for a, b in zip(vars(self).values(), vars(other).values())))

    @property
    def mean(self) -> float:
        """Words a sentence."""
        return self.words / max(self.sentences, 1)

    @property
    def whats_per_thousand(self) -> float:
        """Uses of "what" per 1,000 words."""
        return 1000 * self.whats / max(self.words, 1)

    def row(self, name: str) -> str:
        """One line of the table."""
        n = max(self.sentences, 1)
        return (f"{name:44} {self.words:7} {self.mean:8.1f} {100 * self.long / n:8.0f} % {self.whats_per_thousand:7.1f}"
                f" {100 * self.openings / n:8.0f} %")


HEAD = f"{'':44} {'words':>7} {'mean':>8} {f'> {LONG}':>8}   {'what/k':>7} {'opening':>8}"


def sentences(text: str) -> list[str]:
    """The sentences of a page or docstring, without its code, tables and headings."""
    text = SKIPPED.sub("\n\n", text)
    text = WHOLE.sub("X", LINK.sub(r"\1", text))
    blocks = (" ".join(block.split()) for block in BLOCK.split(f"\n{text}"))
    return [sentence.strip("*_>- ") for block in blocks for sentence in END.split(block) if re.search(r"[a-z]", sentence)]


def measure(text: str) -> Measured:
    """Counts of a page or docstring."""
    out = Measured()
    for sentence in sentences(text):
        words = [word for word in sentence.split() if re.search(r"\w", word)]
        asks = sentence.endswith("?")
        out += Measured(len(words), 1, len(words) > LONG,
                        0 if asks else len(re.findall(r"\bwhat\b(?![:,])", sentence, re.IGNORECASE)),
                        not asks and bool(OPENS.match(sentence)))
    return out


def pages() -> list[pathlib.Path]:
    """Every page that readers see."""
    return [*(ROOT / name for name in ("README.md", "DESIGN.md", "CONTRIBUTING.md", "CHANGELOG.md")),
            *sorted((ROOT / "docs").rglob("*.md"))]


def prose_of(path: pathlib.Path) -> list[str]:
    """The docstrings and comments of a Python file."""
    text = path.read_text()
    return [*(ast.get_docstring(node) or "" for node in _documented(ast.parse(text))), *comments(text)]


def comments(text: str) -> list[str]:
    """The comments of Python code; one that goes on over lines of its own is one."""
    out: list[str] = []
    last = (-1, -1)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            alone = not token.line[:column].strip()
            words = ORDERS.sub("", token.string, count=1).strip()
            if alone and last == (row - 1, column):
                out[-1] += f" {words}"
            else:
                out.append(words)
            last = (row, column) if alone else (-1, -1)
    return out


def code(path: pathlib.Path) -> Measured:
    """Counts of the docstrings and comments of a Python file."""
    return sum(map(measure, prose_of(path)), Measured())


def _documented(node: ast.AST) -> Iterator[ast.Module | ast.ClassDef | ast.FunctionDef]:
    """A module, and the classes and functions in it; expressions are not looked through."""
    if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
        yield node
    for child in getattr(node, "body", []) if isinstance(node, ast.mod | ast.stmt) else []:
        yield from _documented(child)


def by_package() -> dict[str, list[pathlib.Path]]:
    """Package of taichi_cloth -> its files; modules beside the packages by their names."""
    package, out = ROOT / "taichi_cloth", {}
    for path in sorted(package.rglob("*.py")):
        inside = path.relative_to(package).parts
        out.setdefault(f"{inside[0]}/" if len(inside) > 1 else inside[0], []).append(path)
    return out


def faults(path: pathlib.Path) -> Iterator[str]:
    """The sentences of a file that count as long, as an opening or for a "what"."""
    for text in prose_of(path) if path.suffix == ".py" else [path.read_text()]:
        for sentence in sentences(text):
            found = measure(sentence)
            if found.long or found.whats or found.openings:
                yield sentence


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=pathlib.Path, help="pages or Python files (all pages)")
    parser.add_argument("--code", action="store_true", help="docstrings and comments of the package instead")
    parser.add_argument("--list", action="store_true", help="after its row, the sentences of a file that are not plain")
    args = parser.parse_args()
    if args.code:
        table = by_package()
    else:
        paths = [path.resolve() for path in args.paths] or pages()
        table = {str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path): [path] for path in paths}
    total = Measured()
    print(HEAD)
    for name, paths in table.items():
        found = sum((code(path) if path.suffix == ".py" else measure(path.read_text()) for path in paths), Measured())
        total += found
        print(found.row(name))
        for path in paths if args.list else []:
            print(*(f"    {path.name}: {sentence}" for sentence in faults(path)), sep="\n")
    print(total.row("all"))


if __name__ == "__main__":
    main()
