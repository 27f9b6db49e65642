"""The matchers by the names that settings give them."""

from typing import Protocol, runtime_checkable

from visual_servo_epipolar.core.registry import Registry
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.onnx import ONNX
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT

MATCHERS: Registry[Matcher] = Registry(
    'visual_servo_epipolar.matchers', {'sift': SIFT, 'onnx': ONNX}, Matcher
)


@runtime_checkable
class Loadable(Protocol):
    """Matcher that is made from a file: a network."""

    def loaded(self, path: str) -> Matcher:
        """Return the matcher by the file ``path``; ValueError if it is none of its kind."""


def matcher_of(name: str, model: str = '') -> Matcher:
    """
    Return the matcher ``name`` by the file ``model``, or raise ValueError.

    Those that are made from a file need one, the others take none.
    """
    try:
        matcher = MATCHERS[name]
    except KeyError:
        raise ValueError(f'matcher must be one of {", ".join(MATCHERS)}, got {name!r}') from None
    if isinstance(matcher, Loadable):
        if not model:
            raise ValueError(
                f'matcher {name} needs a network, got no matcher_model; name its file, or take '
                'another matcher'
            )
        return matcher.loaded(model)
    if model:
        raise ValueError(
            f'matcher_model must be empty for the matcher {name}, which has none, got {model!r}; '
            'choose the matcher onnx'
        )
    return matcher
