"""How plainly the project writes: words a sentence, "what" as a pronoun, openings such as "What is", by file.

    python scripts/prose.py                        # a row for each page of the docs
    python scripts/prose.py --docstrings           # a row for each package, its docstrings together
    python scripts/prose.py docs/limits.md         # these files

A sentence ends with its paragraph, list item or quotation, or where a full stop, question mark or exclamation mark is followed
by a capital letter. Code blocks, tables, generated parts, headings and formulas on lines of their own are left out. Formulas
and code within a line count as one word each. "What" counts unless its sentence is a question; "whatever" does not. An opening
counts where a sentence begins with What, Where, Of, So, As or That: words that hide its subject.
"""

import argparse
import ast
import pathlib
import re
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
                        0 if asks else len(re.findall(r"\bwhat\b", sentence, re.IGNORECASE)),
                        not asks and bool(OPENS.match(sentence)))
    return out


def pages() -> list[pathlib.Path]:
    """Every page that readers see."""
    return [*(ROOT / name for name in ("README.md", "DESIGN.md", "CONTRIBUTING.md", "CHANGELOG.md")),
            *sorted((ROOT / "docs").rglob("*.md"))]


def docstrings(path: pathlib.Path) -> Measured:
    """Counts of all docstrings of a Python file."""
    return sum((measure(ast.get_docstring(node) or "") for node in _documented(ast.parse(path.read_text()))), Measured())


def _documented(node: ast.AST) -> Iterator[ast.Module | ast.ClassDef | ast.FunctionDef]:
    """A module, and the classes and functions in it; expressions are not looked through."""
    if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
        yield node
    for child in getattr(node, "body", []) if isinstance(node, ast.mod | ast.stmt) else []:
        yield from _documented(child)


def by_package() -> dict[str, Measured]:
    """Package of taichi_cloth -> counts of the docstrings of its files."""
    package, out = ROOT / "taichi_cloth", {}
    for path in sorted(package.rglob("*.py")):
        inside = path.relative_to(package).parts
        name = f"{inside[0]}/" if len(inside) > 1 else inside[0]
        out[name] = out.get(name, Measured()) + docstrings(path)
    return out


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=pathlib.Path, help="pages or Python files (all pages)")
    parser.add_argument("--docstrings", action="store_true", help="docstrings of the package instead")
    args = parser.parse_args()
    if args.docstrings:
        table = by_package()
    else:
        paths = [path.resolve() for path in args.paths] or pages()
        table = {str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path):
                 docstrings(path) if path.suffix == ".py" else measure(path.read_text()) for path in paths}
    print(HEAD)
    for name, found in table.items():
        print(found.row(name))
    print(sum(table.values(), Measured()).row("all"))


if __name__ == "__main__":
    main()
