"""Pages stay readable: short sentences, "what" only in questions. `scripts/prose.py` counts, and is checked by hand here."""

import importlib.util
import pathlib
import re
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope="module")
def prose():
    spec = importlib.util.spec_from_file_location("prose", ROOT / "scripts/prose.py")
    module = sys.modules["prose"] = importlib.util.module_from_spec(spec)  # where dataclasses look
    spec.loader.exec_module(module)
    return module


TEXT = """# What is not counted

Cloth falls on a ball, with [friction](what.md) of .4 N. So it sticks! What holds it?
It keeps what it gets (see `what.py` and $x = 2 y$).

- One item
- Of two: this is the other.

| what | is in a table |

```
what is code
```

That is all
"""


def test_counts_are_those_by_hand(prose):
    assert prose.sentences(TEXT) == ["Cloth falls on a ball, with friction of .4 N.", "So it sticks!", "What holds it?",
                                     "It keeps what it gets (see X and X).", "One item", "Of two: this is the other.",
                                     "That is all"]
    found = prose.measure(TEXT)
    assert (found.words, found.sentences, found.whats, found.openings) == (10 + 3 + 3 + 9 + 2 + 6 + 3, 7, 1, 3)
    assert found.long == 0 and prose.measure("A " + "word " * 40 + "ends here. Short one.").long == 1
    assert prose.measure("A word.\n\nArgs:\n    x: of two words\n    y: what it is").words == 2 + 1 + 4 + 4


PAGES = [*sorted((ROOT / "docs").rglob("*.md")), *(ROOT / f"{name}.md" for name in
                                                   ("README", "DESIGN", "CONTRIBUTING", "CHANGELOG"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_plain(prose, page):
    """At most 22 words a sentence on average, and "what" twice outside questions, as in the title of another page."""
    found = prose.measure(page.read_text())
    assert found.mean <= 22, f"{found.mean:.1f} words a sentence, {found.long} sentences of more than {prose.LONG}"
    assert found.whats <= 2, f"{found.whats} times 'what' as a pronoun: name the thing"


def test_limits_are_read_in_three_minutes(prose):
    """At most 700 words; by scope, accuracy, contact and cost."""
    text = (ROOT / "docs" / "limits.md").read_text()
    assert len(text.split()) <= 700 and prose.measure(text).mean <= 20
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Scope", "Accuracy", "Contact", "Cost"]


def test_pages_together_are_plain(prose):
    total = sum((prose.measure(page.read_text()) for page in PAGES), prose.Measured())
    assert total.words > 40_000
    assert total.mean < 18 and total.openings < 0.06 * total.sentences


CODE = '''"""Springs of cloth. What is near?"""

K = 1.0  # N/m, of each
# Of two lines, with what
# they share.
FAR = 2.0  # noqa: E741  (that is all)


def pull(what):
    """Pulls what there is.

    Args:
        what: its name; see `what`.
    """
    return what  # a "#" no comment
'''


def test_docstrings_and_comments_are_counted_as_by_hand(prose, tmp_path):
    (tmp_path / "springs.py").write_text(CODE)
    assert prose.comments(CODE) == ["N/m, of each", "Of two lines, with what they share.", "(that is all)", 'a "#" no comment']
    found = prose.code(tmp_path / "springs.py")
    assert (found.words, found.sentences, found.whats, found.openings) == (3 + 3 + 4 + 1 + 5 + 3 + 7 + 3 + 3, 9, 2, 1)
    assert list(prose.faults(tmp_path / "springs.py")) == ["Pulls what there is.", "Of two lines, with what they share."]


def test_code_is_plain(prose):
    """In docstrings and comments "what" is an argument's name, and sentences are short and begin with their subject.

    `python scripts/prose.py --code --list` prints the sentences that count.
    """
    found = {package: sum(map(prose.code, paths), prose.Measured()) for package, paths in prose.by_package().items()}
    for package, m in found.items():
        assert m.whats <= 2 + m.words / 1000, f"{package}: {m.whats} times 'what' as a pronoun: name the thing"
        assert m.openings <= 2 + m.sentences / 100, f"{package}: {m.openings} sentences without a subject in front"
        assert m.mean <= 14, f"{package}: {m.mean:.1f} words a sentence"
    total = sum(found.values(), prose.Measured())
    assert total.words > 80_000 and total.mean <= 14 and total.whats_per_thousand <= 6


def test_the_changelog_is_by_release_and_short():
    """Dated releases with Added, Changed and Fixed in this order; at most 40 lines of changes, of 20 words on average."""
    releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)[1:]
    assert len(releases) > 1
    for text in releases:
        title = text.splitlines()[0]
        assert re.fullmatch(r"Unreleased|\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", title), title
        kinds = re.findall(r"^### (.*)$", text, re.MULTILINE)
        assert kinds == [kind for kind in ("Added", "Changed", "Fixed") if kind in kinds] != [], f"{title}: {kinds}"
        lines = re.findall(r"^- (.*(?:\n  .*)*)", text, re.MULTILINE)
        assert sum(len(line.split()) for line in lines) <= 20 * len(lines), f"{title}: {len(lines)}"
        assert sum(len(line.splitlines()) for line in lines) <= 40, title
