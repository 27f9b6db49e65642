"""Settings of the tracker."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of


@dataclass(frozen=True, kw_only=True)
class TrackerSettings(Settings):
    """How many features, how carefully they are tracked, when they are given up."""

    GONE: ClassVar[Mapping[str, Any]] = {'passing_features': 0, 'auxiliary_features': 0}

    max_features: int = setting(
        60,
        'Features tracked at a time in 640x480 and larger images; more of the smaller ones of '
        'smaller images, in the same time',
        low=8,
        high=1000,
    )
    min_features: int = setting(
        40, 'Features, of so many, below which the image is matched anew', low=1, high=1000
    )
    rematch_period: int = internal(
        11, 'Fewest frames between two whole-image matches', low=1, high=10000
    )
    window: int = internal(21, 'Side of the Lucas-Kanade window [px]', low=5, high=101)
    levels: int = internal(4, 'Pyramid levels above the full image', low=0, high=8)
    forward_backward: float = internal(
        1.0, 'Largest forward-backward distance [px]', low=0.01, high=20.0
    )
    anchor_period: int = internal(
        1, 'Frames between two alignments with the desired image; 0 = never', low=0, high=1000
    )
    anchor_iterations: int = internal(4, 'Iterations of an alignment', low=1, high=50)
    min_correlation: float = internal(
        0.85, 'Correlation with the desired patch to be kept', low=0.0, high=1.0
    )
    candidates: int = internal(240, 'Candidate features that can be reacquired', low=8, high=5000)
    search_per_frame: int = internal(
        8, 'Most lost features looked for in one frame', low=0, high=200
    )
    stitch_band: float = setting(
        0.0,
        'Images of 360 deg from two lenses: angle from where these meet, at 90 deg to either '
        'side, within which features are not gone by; 0 = none [deg]',
        low=0.0,
        high=60.0,
    )
    matcher: str = fixed(
        'sift',
        'Matcher of whole images with the photograph: sift, onnx, or one of another package',
    )
    matcher_model: str = fixed(
        '', 'ONNX file of keypoints and descriptors, for the matcher onnx', path=True
    )
    overlay: bool = setting(True, 'Publish the image with features drawn on it')

    def __post_init__(self) -> None:
        super().__post_init__()
        matcher_of(self.matcher, self.matcher_model)  # refused here, not at the first image
        if self.min_features > self.max_features:
            raise ValueError(
                f'min_features must not exceed max_features, got {self.min_features} and '
                f'{self.max_features}'
            )
