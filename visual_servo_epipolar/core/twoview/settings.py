"""Settings of perception: the estimator, and when an estimate is good enough to act on."""

from dataclasses import dataclass
from functools import cached_property

from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.core.twoview.registry import (
    DEFAULT_ESTIMATOR,
    ESTIMATORS,
    may_learn_focal,
)


@dataclass(frozen=True, kw_only=True)
class PerceptionSettings(Settings):
    """Settings of perception. Angles in rad, parallax and noise in px."""

    estimator: str = fixed(
        DEFAULT_ESTIMATOR,
        'Estimator: lmeds_8pt (the paper), soft_planar (tilt, roll and floor jitter found out) or '
        'one of another package',
    )
    seed: int = internal(0, 'Seed of the random subsets', low=0, high=2**31 - 1)
    focal_deviation: float = fixed(
        0.0,
        'Estimator soft_planar: deviation of the logarithm of the focal length in camera_info; 0 '
        'for a calibrated camera, 1 where it may be anything',
        low=0.0,
        high=3.0,
    )
    compensate_rotation: bool = internal(
        True, 'Whether laws may take D from features turned to the desired heading'
    )
    min_parallax: float = internal(
        2.5,
        'Parallax below which there is no baseline, at a noise of pixel_noise [px]',
        low=0.0,
        high=100.0,
    )
    min_features: int = internal(12, 'Features below which the servo holds', low=8, high=1000)
    keep_features: int = internal(
        30, 'Turns: features that no turn may take out of view', low=8, high=1000
    )
    min_confidence: float = internal(
        0.4, 'Confidence of the cheirality vote to be trusted, 0 to 1', low=0.0, high=1.0
    )
    max_deviation: float = internal(
        0.1, 'Standard deviation of a bearing above which it is not trusted [rad]', low=0, high=3
    )
    max_leap: float = internal(
        0.15,
        'Largest change of a bearing per frame; larger ones are accepted once three '
        'frames confirm them [rad]',
        low=0.0,
        high=4.0,
    )
    min_spread: float = internal(
        0.03, 'Least spread of the features that agree [rad]', low=0.0, high=1.0
    )
    pixel_noise: float = internal(
        0.3, 'Prior noise of tracked coordinates [px]', low=0.01, high=10
    )
    readout: float = setting(
        0.0,
        'Rolling shutter: time from the first row to the last, negative if the last one is read '
        'first; 0 = global shutter. Estimated while turning [s]',
        low=-0.1,
        high=0.1,
    )
    camera_tilt: float = fixed(
        0.0, 'Tilt of the camera, down positive, as configured [rad]', low=-0.8, high=0.8
    )
    camera_roll: float = fixed(
        0.0, 'Roll of the camera, clockwise, as configured [rad]', low=-0.8, high=0.8
    )
    camera_tilt_deviation: float = fixed(
        0.26, 'Deviation of that tilt, estimated while driving [rad]', low=0.0017, high=0.5
    )
    camera_roll_deviation: float = fixed(
        0.09, 'Deviation of that roll, estimated while driving [rad]', low=0.0017, high=0.5
    )
    floor_jitter: float = internal(
        0.0017, 'Deviation of tilt and of roll by the floor, view by view [rad]', low=0, high=0.1
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            ESTIMATORS[self.estimator]  # a broken one is refused here, not at the first image
        except KeyError:
            raise ValueError(
                f'estimator must be one of {", ".join(ESTIMATORS)}, got {self.estimator!r}'
            ) from None
        if not self.calibrated and not may_learn_focal(self.estimator):
            raise ValueError(
                f'focal_deviation must be 0 with estimator {self.estimator}, which does not learn '
                f'the focal length, got {self.focal_deviation:g}; {DEFAULT_ESTIMATOR} does: '
                'set estimator to it, or focal_deviation to 0.0'
            )

    @cached_property
    def mount(self) -> Attitude:
        """What is known of the camera's attitude before anything is seen."""
        return Attitude(
            self.camera_tilt,
            self.camera_roll,
            self.camera_tilt_deviation,
            self.camera_roll_deviation,
            self.floor_jitter,
        )

    @property
    def mount_yaw(self) -> float:
        """Yaw of the camera on the base, to the left, as configured [rad]; 0 where none is."""
        return 0.0

    @property
    def calibrated(self) -> bool:
        """Whether the camera matrix is taken as it comes."""
        return self.focal_deviation == 0.0

    @property
    def compensates(self) -> bool:
        """Whether D is taken from features turned to the desired heading."""
        return self.compensate_rotation
