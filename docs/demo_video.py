"""Makes demo.webp of a video: `python demo_video.py demo_out/video.mp4 [TARGET.webp]`."""

from pathlib import Path
import sys

import cv2
import numpy as np
from PIL import Image

WIDTH, FRAMES, FRAME_MS, LAST_MS = 560, 26, 250, 2500
QUALITY = 60  # of WebP


def frames(video: Path) -> list[Image.Image]:
    """Return so many frames of a video, from the first to the last, made smaller."""
    capture = cv2.VideoCapture(str(video))
    count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    wanted = set(np.linspace(0, count - 1, FRAMES).round().astype(int).tolist())
    found = []
    for number in range(count):
        ok, image = capture.read()
        if ok and number in wanted:
            height = round(image.shape[0] * WIDTH / image.shape[1])
            small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
            found.append(Image.fromarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB)))
    return found


def main() -> None:
    """Write the moving picture, for README.md."""
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).with_name('demo.webp')
    images = frames(Path(sys.argv[1]))
    if not images:
        sys.exit(f'{sys.argv[1]}: no video that can be read; make one with visual_servo demo')
    first, *others = images
    times = [FRAME_MS] * len(others) + [LAST_MS]
    first.save(target, save_all=True, append_images=others, duration=times, quality=QUALITY)


if __name__ == '__main__':
    main()
