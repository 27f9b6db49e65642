from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import visual_servo_epipolar

ROOT = Path(__file__).parents[2]
VERSION = visual_servo_epipolar.__version__


def setup_says(option: str) -> str:
    ran = subprocess.run(
        [sys.executable, 'setup.py', '--quiet', option],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return ran.stdout.strip()


def test_package_xml_and_setup_py_carry_the_version_and_the_name_of_the_package() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.findtext('version') == VERSION == setup_says('--version')
    assert package.findtext('name') == 'visual_servo_epipolar' == setup_says('--name')
    assert f'\nversion: {VERSION}\n' in (ROOT / 'CITATION.cff').read_text()
    assert re.fullmatch(r'\d+\.\d+\.\d+', VERSION)  # catkin takes no other form


def test_package_xml_and_setup_py_agree_on_the_licence() -> None:
    package = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert package.findtext('license') == 'Apache-2.0' == setup_says('--license')


def test_the_change_log_is_open_or_knows_the_version() -> None:
    text = (ROOT / 'CHANGELOG.rst').read_text()
    headings = re.findall(r'^(Forthcoming|\d+\.\d+\.\d+) ?.*\n-+$', text, re.M)
    assert {'Forthcoming', VERSION} & set(headings)


def test_what_setup_py_promises_is_what_the_oldest_versions_are_tested_on() -> None:
    tested = dict(
        line.partition('#')[0].strip().split('==')
        for line in (ROOT / 'constraints-oldest.txt').read_text().splitlines()
        if '==' in line
    )
    text = (ROOT / 'setup.py').read_text()
    promised = dict(re.findall(r"'([\w-]+)(?:\[\w+\])?>=([\d.]+)", text))
    assert promised.keys() >= {'numpy', 'opencv-python-headless', 'matplotlib', 'PyYAML'}
    assert promised == {name: tested[name] for name in promised}
