"""``visual_servo report``, as it is met first: the wrong folder, a long note, packages of apt."""

from importlib import metadata

from browser import needs_browser, open_in_browser
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.commands.simulate import versions
from visual_servo_epipolar.report.page import Headline, Section, write_page

WIDE = """<script>addEventListener('load', () => {
  const page = document.documentElement;
  page.dataset.wide = page.scrollWidth > window.innerWidth;
});</script></main>"""


@pytest.mark.parametrize('command', ['report', 'replay'])
def test_of_a_folder_with_a_bag_in_it_the_bag_is_named(command, tmp_path, capsys) -> None:
    (tmp_path / 'bag').mkdir()  # as a demo that was interrupted leaves it
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    assert main([command, str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert f'not a bag, but a folder with one; give {tmp_path / "bag"}' in error


def test_versions_of_a_run_need_no_metadata_of_pip(monkeypatch) -> None:
    def nothing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, 'version', nothing)  # as of cv2 from apt
    assert {'numpy', 'OpenCV', 'Python', 'visual_servo_epipolar'} <= versions().keys()


@needs_browser
def test_long_notes_are_broken_into_lines(tmp_path) -> None:
    page = tmp_path / 'long.html'
    note = f'<pre>{"a note of many words " * 30}</pre>'
    write_page(page, 'title', Headline('Arrived', True, ''), [Section('Notes', note)])
    text = page.read_text(encoding='utf-8').replace('</main>', WIDE)
    start = text.index('<meta http-equiv="Content-Security-Policy"')
    page.write_text(text[:start] + text[text.index('>', start) + 1 :], encoding='utf-8')
    shown, _ = open_in_browser(page, tmp_path)
    assert 'data-wide="false"' in shown
