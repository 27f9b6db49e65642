"""Every relative link of the pages leads to a file, and to a heading in it."""

from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[2]
README = ROOT / 'README.md'
PAGES = [README, *sorted({*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')} - {README})]
CODE_BLOCK = re.compile(r'^ *```.*?^ *```', re.M | re.S)
LINK = re.compile(r'\]\(([^)\s]+)\)')


def links(page: Path) -> list[str]:
    text = CODE_BLOCK.sub('', page.read_text(encoding='utf-8'))
    return [link for link in LINK.findall(text) if '://' not in link]


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    text = CODE_BLOCK.sub('', page.read_text(encoding='utf-8'))
    titles = re.findall(r'^#+ (.+)$', text, re.M)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        path, _, anchor = link.partition('#')
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), f'{page.name} links to {link}, which is not there'
        if anchor:
            assert anchor in anchors(target), f'{page.name} links to {link}: no such heading'


def test_every_page_can_be_reached_from_the_readme() -> None:
    reached, new = set(), {PAGES[0].resolve()}
    while new:
        reached |= new
        targets = {
            (page.parent / link.partition('#')[0]).resolve()
            for page in new
            for link in links(page)
        }
        new = {target for target in targets if target.suffix == '.md'} - reached
    assert {page.resolve() for page in PAGES} <= reached


def test_pictures_are_small_enough_for_a_page() -> None:
    kinds = {'.png', '.jpg', '.gif', '.webp'}
    sizes = [file.stat().st_size for file in (ROOT / 'docs').rglob('*.*') if file.suffix in kinds]
    assert max(sizes) < 1_000_000
    assert sum(sizes) < 8_000_000


def test_the_pages_are_short_enough_to_be_read() -> None:
    words = {
        page.relative_to(ROOT).as_posix(): len(page.read_text(encoding='utf-8').split())
        for page in PAGES
    }
    assert words['README.md'] <= 1200
    assert words['docs/results.md'] <= 5800
    assert sum(number for name, number in words.items() if name.startswith('docs')) <= 42_000
