"""Drive a headless Chromium over a pipe by the DevTools protocol, without a package, a port or a network.

Tests of the HTML report look at its page in it. As a script, this module takes the pictures of a report that the
documentation shows, and with ``whole`` also pictures of whole pages and a PDF:
``python tests/support/chromium.py build/objects-hybrid/report.html docs/images``.
The README shows the first of them, taken of ``objects-best``, as ``report-best.png``.
"""

from __future__ import annotations

import base64
import fcntl
import io
import json
import os
import select
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_FROM_THE_TOP = "return {x: 0, y: 0, width: document.documentElement.clientWidth, height: HEIGHT}"
_WHOLE_PAGE = _FROM_THE_TOP.replace("HEIGHT", "document.documentElement.scrollHeight")
# The sections from FROM to TO, with their foldable parts opened.
_SECTIONS = """
  const shown = name => {
    const section = document.getElementById(name).closest('section')
    section.querySelectorAll(':scope > details').forEach(details => { details.open = true })
    return section
  }
  const box = name => shown(name).getBoundingClientRect()
  const [from, to] = [box(FROM), box(TO)]
  return {x: 0, y: from.top + scrollY, width: document.documentElement.clientWidth, height: to.bottom - from.top}
"""
PICTURES = (
    ("report", 1120, False, "screen", _FROM_THE_TOP.replace("HEIGHT", "950")),
    (
        "report-dark",
        1120,
        True,
        "screen",
        _SECTIONS.replace("FROM", "'over-time'").replace("TO", "'over-time'"),
    ),
    (
        "report-spikes",
        1120,
        False,
        "screen",
        _SECTIONS.replace("FROM", "'spikes'").replace("TO", "'spikes'"),
    ),
    (
        "report-potential",
        1120,
        False,
        "screen",
        _SECTIONS.replace("FROM", "'potential'").replace("TO", "'potential'"),
    ),
    ("report-phone", 360, True, "screen", _FROM_THE_TOP.replace("HEIGHT", "1400")),
    ("report-paper", 700, False, "print", "return {x: 0, y: 0, width: innerWidth, height: 990}"),
)
"""Rows of (file name, width in pixels, dark, medium, JavaScript that returns the rectangle)."""
WHOLE = (
    ("wide", 1280, False, "screen", _WHOLE_PAGE),
    ("narrow", 360, False, "screen", _WHOLE_PAGE),
)
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 120
"""Seconds to wait for an answer."""
Message = dict[str, Any]


def find_chromium() -> str | None:
    """Return the path of a Chromium, or None."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Chromium:
    """One tab of a browser at the other end of two pipes.

    Messages are JSON texts that end with a zero byte. ``events`` are the messages of the browser that answer no call,
    in order.
    """

    def __init__(self, send: int, receive: int) -> None:
        self._send = send
        self._receive = receive
        self._last_id = 0
        self._session: str | None = None
        self._unread = b""
        self.events: list[Message] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network", "Accessibility"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> Any:
        """Call a method and return its result."""
        self._last_id += 1
        message = {"id": self._last_id, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._last_id:
            self.events.append(answer)
        assert "error" not in answer, answer["error"]
        return answer["result"]

    def _read(self) -> Message:
        """Return the next message of the browser."""
        while b"\0" not in self._unread:
            assert select.select([self._receive], [], [], PATIENCE)[0], "Chromium does not answer"
            chunk = os.read(self._receive, 1 << 20)
            assert chunk, "Chromium went away"
            self._unread += chunk
        line, self._unread = self._unread.split(b"\0", 1)
        message: Message = json.loads(line)
        return message

    def open(
        self, page: Path, *, width: int = 1280, dark: bool = False, media: str = "screen"
    ) -> None:
        """Show a page on a screen of ``width`` pixels, or on another medium such as ``print``."""
        self.events.clear()
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=800,
            deviceScaleFactor=1,
            mobile=False,
        )
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.call("Emulation.setEmulatedMedia", media=media, features=features)
        self.call("Page.navigate", url=page.resolve().as_uri())
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(self._read())

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression on the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press and release a key; ``code`` is its virtual key code."""
        text = {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=code,
                **text,
            )

    def picture(self, clip: Message) -> bytes:
        """Return a PNG of the rectangle ``clip`` of the page: x, y, width, height."""
        screenshot = self.call(
            "Page.captureScreenshot",
            format="png",
            clip={**clip, "scale": 1},
            captureBeyondViewport=True,
        )
        return base64.b64decode(screenshot["data"])

    def pdf(self) -> bytes:
        """Return the page printed on A4 (paper is given in inches) as a PDF."""
        printed = self.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)
        return base64.b64decode(printed["data"])


@contextmanager
def started(path: str) -> Iterator[Chromium]:
    """Start a Chromium with a temporary profile, and kill it at the end."""
    to_browser, from_us = os.pipe()
    to_us, from_browser = os.pipe()
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        open(os.devnull, "wb") as nothing,
    ):
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        options += ["--no-first-run", "--remote-debugging-pipe"]
        # Chromium reads the protocol from descriptor 3 and writes it to 4. Our ends may have these very numbers, so that
        # moving one would close the other: they are duplicated to numbers from 64 on first.
        high = [
            (fcntl.fcntl(fd, fcntl.F_DUPFD, 64), place)
            for fd, place in ((to_browser, 3), (from_browser, 4))
        ]
        actions = [(os.POSIX_SPAWN_DUP2, nothing.fileno(), 2)]
        actions += [(os.POSIX_SPAWN_DUP2, fd, place) for fd, place in high]
        browser = os.posix_spawn(
            path,
            [path, *options, f"--user-data-dir={profile}"],
            os.environ,
            file_actions=actions,
            setsid=True,
        )
        for fd in (to_browser, from_browser, *(fd for fd, _ in high)):
            os.close(fd)
        try:
            yield Chromium(from_us, to_us)
        finally:
            os.killpg(browser, signal.SIGKILL)
            os.waitpid(browser, 0)
            os.close(from_us)
            os.close(to_us)


def main(page: Path, folder: Path, *, whole: bool) -> None:
    """Write the pictures of a report; with ``whole`` also whole pages and the printed report.

    Pictures have 96 colours, which keeps their files small.
    """
    from PIL import Image, ImageOps

    path = find_chromium()
    assert path, "no Chromium"
    folder.mkdir(parents=True, exist_ok=True)
    with started(path) as chromium:
        for name, width, dark, media, place in (*PICTURES, *(WHOLE if whole else ())):
            chromium.open(page, width=width, dark=dark, media=media)
            clip = chromium.evaluate(f"(() => {{ {place} }})()")
            picture = Image.open(io.BytesIO(chromium.picture(clip))).convert("RGB")
            if media == "print":
                picture = ImageOps.expand(picture, border=40, fill="white")
            picture.quantize(96, kmeans=3, dither=Image.Dither.NONE).save(
                folder / f"{name}.png", optimize=True
            )
        if whole:
            chromium.open(page, media="print")
            (folder / "report.pdf").write_bytes(chromium.pdf())


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), whole="whole" in sys.argv[3:])
