"""What README and the documentation show runs, and prints what they say."""

import os
import re
from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from docs_snippets import ROOT, RUN, blocks, differs, results

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHOWN = [p for p in PAGES if any(b.is_run for b in blocks(p.read_text(encoding="utf-8")))]


@pytest.mark.parametrize("page", SHOWN, ids=lambda p: str(p.relative_to(ROOT)))
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of other packages
def test_page(page: Path, tmp_path: Path) -> None:
    for block, printed in results(page.read_text(encoding="utf-8"), tmp_path):
        found = differs(block.text, printed)
        assert found is None, f"{page.name}:{block.line}: {found}\n\n{printed}"
    plt.close("all")


def test_a_block_that_is_not_run_says_why() -> None:
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8")):
            if block.language in RUN and not block.title and not block.is_run:
                assert len(block.notes.split("not run:")[1].split()) > 3, (page.name, block.line)


def test_every_command_is_in_a_block_that_is_run_or_says_why() -> None:
    """A block without a language is no way around."""
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8")):
            if block.language not in RUN:
                shown = re.findall(r"^(?:[$>] )?trunnion .*$", block.text, re.MULTILINE)
                assert not shown or block.title, (page.name, block.line, shown)


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("a 1.23 b\n", "a  1.24 b\n", True),
        ("a 1.23 b\n", "a 1.27 b\n", False),
        ("5 rows\n", "6 rows\n", False),
        ("first\n...\nlast 2.0\n", "first\nx\ny\nlast 2.1\n", True),
        ("first\n...\n", "first\n", True),
        ("first\n", "first\nmore\n", False),
        ("first\n...\nother\n", "first\nlast\n", False),
    ],
)
def test_outputs_are_compared(expected: str, printed: str, same: bool) -> None:
    assert (differs(expected, printed) is None) is same


def test_files_stay_in_the_folder_of_the_page(tmp_path: Path) -> None:
    here = os.getcwd()
    page = (
        '```text title="a/b.txt"\nhello\n```\n\n```bash\ncat a/b.txt\n```\n\n```text\nhello\n```\n'
    )
    assert [printed for _, printed in results(page, tmp_path)] == ["hello\n"]
    assert os.getcwd() == here
