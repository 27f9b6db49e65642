"""Video on the page of a run: inside where it is small, beside where it is not."""

import os
from pathlib import Path
from urllib.parse import quote

import cv2

from visual_servo_epipolar.report.page import film, linked_film, paragraph

EMBEDDED_BYTES = 8_000_000  # largest video that a page holds; a mail takes about 20 MB
MIME = {'.mp4': 'video/mp4', '.webm': 'video/webm'}
IN_BROWSERS = ('h264', 'avc1', 'VP80', 'VP90', 'vp09', 'AV01', 'av01')  # as OpenCV names them


def shown_video(video: Path, page: Path) -> str:
    """Return ``video`` as HTML for ``page``, or a sentence where no browser plays it."""
    codec, size = codec_of(video), video.stat().st_size
    if codec not in IN_BROWSERS:
        return paragraph(
            f'{video.name} ({codec or "unknown codec"}) plays in no browser: open it in a video '
            'player, or drive again where PyAV is installed.'
        )
    if size <= EMBEDDED_BYTES:
        caption = f'The whole run, {size / 1e6:.1f} MB inside this page.'
        return film(video.read_bytes(), MIME[video.suffix], caption)
    link = Path(os.path.relpath(video, page.parent)).as_posix()
    caption = f'The whole run, {size / 1e6:.1f} MB, not inside this page: it is loaded from {link}'
    return linked_film(quote(link), caption)


def codec_of(video: Path) -> str:
    """Return the four letters of the codec of a video; empty if it cannot be read."""
    capture = cv2.VideoCapture(str(video))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) if capture.isOpened() else 0
    capture.release()
    letters = max(code, 0).to_bytes(4, 'little')
    return letters.decode('ascii', 'replace').strip('\0')
