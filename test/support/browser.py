"""A real browser, headless, that opens pages of ours; it fetches nothing for itself."""

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import os
from pathlib import Path
from queue import Empty, SimpleQueue
import shutil
import signal
import subprocess
from threading import Thread

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


class _Listener(BaseHTTPRequestHandler):
    """Serves one page, and takes the one document that the page posts."""

    server: '_Server'

    def do_GET(self) -> None:
        body = self.server.page.encode() if self.path == '/' else b''
        self.send_response(200)
        self.send_header('Content-Type', 'text/html; charset=utf-8')
        self.send_header('Content-Length', str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_POST(self) -> None:
        self.server.answers.put(self.rfile.read(int(self.headers['Content-Length'])).decode())
        self.send_response(204)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, page: str) -> None:
        super().__init__(('127.0.0.1', 0), _Listener)
        self.page, self.answers = page, SimpleQueue[str]()


def ask_browser(page: str, folder: Path) -> str:
    """
    Return what a page posts to '/' when it has done its work, in real time.

    Virtual time, as in ``open_in_browser``, does not wait for the decoder of a video.
    """
    flags = [flag for flag in FLAGS if not flag.startswith('--virtual-time')]
    server = _Server(page)
    thread = Thread(target=server.serve_forever)
    thread.start()
    url = f'http://127.0.0.1:{server.server_port}/'
    command = [str(BROWSER), *flags, f'--user-data-dir={folder / "profile"}', url]
    quiet = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
    with subprocess.Popen(command, start_new_session=True, **quiet) as browser:
        try:
            return server.answers.get(timeout=PATIENCE_S)
        except Empty:
            pytest.fail(f'the browser posted nothing within {PATIENCE_S:g} s')
        finally:
            os.killpg(browser.pid, signal.SIGTERM)
            server.shutdown()
            thread.join()
            server.server_close()
