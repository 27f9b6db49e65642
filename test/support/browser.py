"""A real browser, headless, that opens pages of ours; it fetches nothing for itself."""

from pathlib import Path
import shutil
import subprocess

import pytest

BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
FLAGS = (
    *('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run'),
    *('--disable-background-networking', '--disable-component-update', '--disable-sync'),
    *('--disable-dev-shm-usage', '--enable-logging=stderr', '--virtual-time-budget=10000'),
)
PATIENCE_S = 60.0
needs_browser = pytest.mark.skipif(
    BROWSER is None, reason=f'none of {", ".join(BROWSERS)} is installed'
)


def open_in_browser(page: Path, folder: Path) -> tuple[str, str]:
    """Return the document as the browser has it in the end, and what it logged."""
    ended = subprocess.run(
        [
            str(BROWSER),
            *FLAGS,
            f'--user-data-dir={folder / "profile"}',
            '--dump-dom',
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    return ended.stdout, ended.stderr
