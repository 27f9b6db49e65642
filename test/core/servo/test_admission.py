"""Images that are the very same are counted; one grey level more in one pixel is another image."""

import numpy as np

from visual_servo_epipolar.core.servo.admission import KEPT, Repetition

IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)


def test_the_very_same_images_in_a_row_are_counted() -> None:
    repetition = Repetition()
    assert [repetition.see(IMAGE.copy()) for _ in range(4)] == [0, 1, 2, 3]


def test_any_other_image_begins_anew() -> None:
    repetition = Repetition()
    repetition.see(IMAGE)
    repetition.see(IMAGE)
    other = IMAGE.copy()
    other[2, 3] += 1
    assert repetition.see(other) == 0
    assert repetition.see(IMAGE) == 0


def test_an_image_that_cannot_be_read_is_no_repetition() -> None:
    repetition = Repetition()
    repetition.see(IMAGE)
    assert [repetition.see(None), repetition.see(None), repetition.see(IMAGE)] == [0, 0, 0]


def test_an_image_of_another_size_is_another() -> None:
    repetition = Repetition()
    repetition.see(IMAGE)
    assert repetition.see(IMAGE[:3]) == 0


def test_an_image_of_another_time_is_known_again() -> None:
    repetition = Repetition()
    backs = []
    for shade in (1, 2, 2, 3, 1, 4):
        repetition.see(np.full((16, 16), shade, np.uint8))
        backs.append(repetition.back)
    assert backs == [0, 0, 1, 0, 4, 0]


def test_an_image_is_known_again_for_as_long_as_it_is_kept() -> None:
    for others, back in ((KEPT - 1, KEPT), (KEPT, 0)):
        repetition = Repetition()
        repetition.see(IMAGE)
        for number in range(others):
            repetition.see(np.full((16, 16), number, np.uint8))
        repetition.see(IMAGE)
        assert repetition.back == back


def test_images_that_cannot_be_read_are_not_known_again() -> None:
    repetition = Repetition()
    for image in (None, IMAGE, None, IMAGE[:3], None):
        repetition.see(image)
        assert repetition.back == 0
