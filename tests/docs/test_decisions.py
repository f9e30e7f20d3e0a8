"""Pages of docs/decisions/: each has question, choice, date and findings, and is listed in both indices under its title."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[2]
DECISIONS = sorted((ROOT / "docs/decisions").glob("[0-9]*.md"))
SHAPE = re.compile(r"# (.+)\n\n\*\*Question\.\*\* (.+?)\n\n\*\*Choice\.\*\* .+?\n\n"
                   r"\*\*Date\.\*\* \d{4}-\d\d-\d\d[^\n]*\n\n## Findings\n\n.+", re.DOTALL)


@pytest.mark.parametrize("page", DECISIONS, ids=lambda page: page.stem)
def test_a_decision_has_its_parts_and_is_listed(page):
    found = SHAPE.match(page.read_text())
    assert re.fullmatch(r"\d{3}-[a-z0-9-]+", page.stem) and found, f"{page.name}: title, Question, Choice, Date, Findings"
    title, question = (" ".join(part.split()) for part in found.groups())
    assert f"- [{page.stem[:3]} {title}](docs/decisions/{page.name})\n" in (ROOT / "DESIGN.md").read_text()
    assert f"| [{title}]({page.name}) | {question} |\n" in (page.parent / "index.md").read_text()


def test_numbers_of_decisions_are_unique():
    numbers = [page.name[:3] for page in DECISIONS]
    assert len(numbers) == len(set(numbers)) > 40
