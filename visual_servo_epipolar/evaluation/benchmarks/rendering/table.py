"""The document of the rendering benchmark as text."""

from collections.abc import Mapping
from typing import Any

STAGES = ('image', 'polygons', 'textures', 'edges', 'remap')


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: a row a camera."""
    lines = [
        f'Rendering, {document["images"]} images along an approach, processor time on one thread '
        f'[ms]: median (quartiles), OpenCV {document["opencv"]}',
        f'{"":<11}' + ''.join(f'{stage:>20}' for stage in STAGES) + f'{"image / remap":>20}',
    ]
    for camera in document['cameras']:
        width, height = camera['size']
        cells = [_cell(camera['ms'][stage], 1) for stage in STAGES] + [_cell(camera['ratio'], 2)]
        lines.append(f'{f"{width}x{height}":<11}' + ''.join(f'{cell:>20}' for cell in cells))
    for camera in document['cameras']:
        width, height = camera['size']
        shared, bare = (_cell(camera['ms'][name], 1) for name in ('shared', 'remap_passed'))
        lines.append(
            f'{width}x{height}, a second process draws half: {shared} ms pass an image, {bare} a '
            f'remap on one thread, {_cell(camera["shared_ratio"], 2)} times'
        )
    return '\n'.join(lines)


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    kinds = {'image': 'ratio', 'image by two processes': 'shared_ratio'}
    return {
        f'{"x".join(map(str, camera["size"]))} {kind} over remap': camera[name]['median']
        for camera in document['cameras']
        for kind, name in kinds.items()
    }


def _cell(of: Mapping[str, float], digits: int) -> str:
    median, low, high = (f'{of[name]:.{digits}f}' for name in ('median', 'low', 'high'))
    return f'{median} ({low}-{high})'
