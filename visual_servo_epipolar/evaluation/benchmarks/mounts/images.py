"""The bench of mounts on rendered images, through the real tracker: it takes half an hour."""

from collections.abc import Callable, Mapping
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.mounts import table as text
from visual_servo_epipolar.evaluation.benchmarks.mounts.benchmark import measured
from visual_servo_epipolar.evaluation.benchmarks.mounts.cells import on_images

STARTS, QUICK_STARTS = 10, 1


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive mounts and image sizes on images from the same starts."""
    starts = QUICK_STARTS if quick else STARTS
    return measured(on_images(quick=quick), 'images', starts, seed=seed, say=say)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown."""
    return text.table(document)
