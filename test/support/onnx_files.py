"""Files of small networks, written without the package onnx: convolutions over cells of pixels."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

FLOAT, INT64, OPSET, IR = 1, 7, 16, 8
INTS = 7  # type of an attribute


def cells(
    path: Path,
    kernels: Mapping[str, np.ndarray],
    side: int = 8,
    shape: tuple[int, int] | None = None,
) -> Path:
    """
    Write a network whose outputs are convolutions of cells, (C, side, side) each, by name.

    With a ``shape`` it takes only images of so many rows and columns of cells.
    """
    graph = _text(2, 'cells') + _field(11, _value('image', [1, 1, 'height', 'width']))
    for name, kernel in kernels.items():
        made = name if shape is None else f'{name}_free'
        attributes = _ints('kernel_shape', [side, side]) + _ints('strides', [side, side])
        inputs = _text(1, 'image') + _text(1, f'{name}_kernel')
        graph += _field(
            1, inputs + _text(2, made) + _text(3, made) + _text(4, 'Conv') + attributes
        )
        graph += _field(5, _tensor(f'{name}_kernel', kernel[:, None]))
        if shape is not None:
            inputs = _text(1, made) + _text(1, f'{name}_shape')
            graph += _field(1, inputs + _text(2, name) + _text(3, name) + _text(4, 'Reshape'))
            graph += _field(5, _whole(f'{name}_shape', [1, len(kernel), *shape]))
        graph += _field(12, _value(name, [1, len(kernel), 'rows', 'columns']))
    opset = _field(8, _text(1, '') + _number(2, OPSET))
    path.write_bytes(_number(1, IR) + _field(7, graph) + opset)
    return path


def _varint(value: int) -> bytes:
    low, high = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _varint(high) if high else bytes([low])


def _number(tag: int, value: int) -> bytes:
    return _varint(tag << 3) + _varint(value)


def _field(tag: int, content: bytes) -> bytes:
    return _varint(tag << 3 | 2) + _varint(len(content)) + content


def _text(tag: int, content: str) -> bytes:
    return _field(tag, content.encode())


def _ints(name: str, values: list[int]) -> bytes:
    numbers = b''.join(_number(8, value) for value in values)
    return _field(5, _text(1, name) + numbers + _number(20, INTS))


def _tensor(name: str, values: np.ndarray) -> bytes:
    sides = b''.join(_number(1, side) for side in values.shape)
    return sides + _number(2, FLOAT) + _text(8, name) + _field(9, values.astype('<f4').tobytes())


def _whole(name: str, values: list[int]) -> bytes:
    content = np.array(values, '<i8').tobytes()
    return _number(1, len(values)) + _number(2, INT64) + _text(8, name) + _field(9, content)


def _value(name: str, sides: list[int | str]) -> bytes:
    parts = (_text(2, it) if isinstance(it, str) else _number(1, it) for it in sides)
    shape = b''.join(_field(1, part) for part in parts)
    return _text(1, name) + _field(2, _field(1, _number(1, FLOAT) + _field(2, shape)))
