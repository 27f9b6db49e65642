"""Images that are the very same are counted; one grey level more in one pixel is another image."""

import numpy as np
import pytest

from visual_servo_epipolar.core.servo.admission import KEPT, Repetition

IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)


OTHER = IMAGE + (np.arange(48).reshape(6, 8) == 19).astype(np.uint8)  # one level in one pixel


@pytest.mark.parametrize(
    ('images', 'counts', 'backs'),
    [
        ([IMAGE, IMAGE.copy(), IMAGE.copy()], [0, 1, 2], [0, 1, 1]),
        # A few rows tell where it was seen before, all of them whether it is the last one.
        ([IMAGE, IMAGE, OTHER, IMAGE], [0, 1, 0, 0], [0, 1, 1, 1]),
        ([IMAGE, IMAGE[:3]], [0, 0], [0, 0]),  # of another size
        # An image that cannot be read is no repetition.
        ([IMAGE, None, None, IMAGE, None], [0, 0, 0, 0, 0], [0, 0, 0, 3, 0]),
    ],
)
def test_the_very_same_images_are_counted_and_known_again(images, counts, backs) -> None:
    repetition = Repetition()
    seen = [(repetition.see(image), repetition.back) for image in images]
    assert seen == list(zip(counts, backs, strict=True))


def test_an_image_is_known_again_for_as_long_as_it_is_kept() -> None:
    for others, back in ((KEPT - 1, KEPT), (KEPT, 0)):
        repetition = Repetition()
        repetition.see(IMAGE)
        for number in range(others):
            repetition.see(np.full((16, 16), number, np.uint8))
        repetition.see(IMAGE)
        assert repetition.back == back
