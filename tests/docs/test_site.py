"""The site holds every page once, its links lead somewhere, its reference is what the code says."""

import re
import shutil
import sys
from collections import Counter
from pathlib import Path

import docs_reference
import pytest
import yaml
from forked import ended

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# what a browser loads by itself: a bench has no network
FETCHED = re.compile(
    r'<(?:script|img|iframe)[^>]+src="https?:[^"]+"|<link[^>]+stylesheet[^>]+//[^>]+>'
)
LINK = re.compile(r"\]\(([^)\s#]+)(?:#[^)]*)?\)")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with all pages, those that are made from the code too."""
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(DOCS, folder / "docs", ignore=shutil.ignore_patterns("reference"))
    shutil.copy(ROOT / "mkdocs.yml", folder)
    with pytest.MonkeyPatch.context() as patch:
        written = str(folder / "docs" / "reference")
        patch.setattr(sys, "argv", ["docs_reference.py", "--write", written])
        assert docs_reference.main() == 0
    return folder


def navigation(entry: object) -> Counter[str]:
    if isinstance(entry, str):
        return Counter([entry])
    children = entry.values() if isinstance(entry, dict) else entry
    assert not isinstance(children, str)
    return sum((navigation(child) for child in children), Counter())


def test_every_page_stands_in_the_navigation_once(site):
    nav = yaml.safe_load((site / "mkdocs.yml").read_text())["nav"]
    pages = [str(page.relative_to(site / "docs")) for page in (site / "docs").rglob("*.md")]
    assert navigation(nav) == Counter(pages)


def test_links_lead_to_files_that_exist(site):
    missing = [
        f"{page.name}: {target}"
        for page in (ROOT / "README.md", *sorted((site / "docs").rglob("*.md")))
        for target in LINK.findall(page.read_text())
        if "://" not in target and not (page.parent / target).exists()
    ]
    assert missing == []


def test_the_committed_reference_is_what_the_code_says(site):
    made, kept = (folder / "reference" / "profile.md" for folder in (site / "docs", DOCS))
    assert made.read_text() == kept.read_text()


def test_the_site_builds_without_a_warning_and_fetches_nothing(site):
    pytest.importorskip("zensical")
    done = ended([Path(sys.executable).with_name("zensical"), "build", "--strict"], cwd=site)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = list((site / "build" / "site").rglob("*.html"))
    assert len(pages) >= len(list((site / "docs").rglob("*.md")))
    fetched = {page.name: FETCHED.findall(page.read_text()) for page in pages}
    assert {name: found for name, found in fetched.items() if found} == {}
