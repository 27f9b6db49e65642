"""Texts of calibrations as documents: YAML, JSON, XML and camera_calibration's ost.txt."""

from collections.abc import Iterator
import json
import re
from typing import Any
from xml.etree import ElementTree

import yaml

DOCUMENTS = 100  # of a text that are looked at: a console prints one a message
OST_SECTION, OST_NUMBERS = re.compile(r'\[(.+)\]'), re.compile(r'[-+.\deE\s]+|.*\b(nan|inf)\b.*')
OST_KEYS = {
    'width': 'image_width',
    'height': 'image_height',
    'camera matrix': 'camera_matrix',
    'distortion': 'distortion_coefficients',
    'projection': 'projection_matrix',
}


class _Loader(yaml.SafeLoader):
    """Loader that takes what a tag marks for what it is: OpenCV's matrices are mappings."""


def _without_tag(loader: _Loader, tag: str, node: Any) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_multi_constructor('', _without_tag)


def documents(text: str) -> list[Any]:
    """
    Return the documents in a text, one for each ``---`` of YAML.

    Raises ValueError if it cannot be parsed.
    """
    start = text.lstrip()
    try:
        if start.startswith('<'):
            return [_of_xml(ElementTree.fromstring(start))]
        if re.search(r'^\[image\]', text, re.MULTILINE):
            return list(_of_ost(text))
        if start.startswith('{'):
            return [_of_json(start)]
        return list(_of_yaml(text))
    except ElementTree.ParseError as error:
        raise ValueError(f'camera file is not XML: {error}') from None
    except yaml.YAMLError as error:
        raise ValueError(f'camera file is not YAML: {_in_a_line(error)}') from None
    except ValueError:  # of a date, or a number of too many digits
        raise ValueError('camera file is not YAML: it has a value that cannot be read') from None
    except RecursionError:
        raise ValueError('camera file is nested too deeply') from None


def _of_json(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:  # YAML in one line begins like that, too
        return yaml.load(text, _Loader)


def _of_yaml(text: str) -> Iterator[Any]:
    """Yield documents; the last may be cut off, as where a console was interrupted."""
    lines = (line for line in text.splitlines(keepends=True) if not line.startswith('%'))
    chunks = re.split(r'^---(?:\s|$)', ''.join(lines), flags=re.MULTILINE)
    whole = [chunk for chunk in chunks if chunk.strip()][:DOCUMENTS] or ['']
    for index, chunk in enumerate(whole):
        try:
            document = yaml.load(chunk, _Loader)
        except yaml.YAMLError:
            if index == 0:
                raise
            return
        if document is not None or len(whole) == 1:
            yield document


def _of_xml(element: ElementTree.Element) -> Any:
    """Return an element as in OpenCV's FileStorage: children by name, or a text."""
    if len(element):
        return {child.tag: _of_xml(child) for child in element}
    return (element.text or '').strip().strip('"')


def _of_ost(text: str) -> Iterator[dict[str, Any]]:
    """Yield the cameras of an ost.txt, one for each section [image]."""
    for part in re.split(r'^\[image\]', text, flags=re.MULTILINE)[1:]:
        document: dict[str, Any] = {}
        key = ''
        for line in map(str.strip, part.splitlines()):
            if line.startswith('#') or OST_SECTION.fullmatch(line):
                key = ''
            elif line and OST_NUMBERS.fullmatch(line) and key:
                document[key] = f'{document.get(key, "")} {line}'.strip()
            elif line:
                key = OST_KEYS.get(line, '')
                if key:
                    document[key] = ''
        yield document


def _in_a_line(error: yaml.YAMLError) -> str:
    problem, mark = getattr(error, 'problem', None), getattr(error, 'problem_mark', None)
    where = '' if mark is None else f' in line {mark.line + 1}'
    return f'{problem or "it cannot be read"}{where}'
