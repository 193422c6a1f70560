"""Headless Chromium driven over a pipe by the DevTools protocol: no package, no port, no network.

As a script it takes the pictures of a report that the documentation shows, and, with ``whole``, whole pages:
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

_ALL = "return {x: 0, y: 0, width: document.documentElement.clientWidth, height: HEIGHT}"
_WHOLE = _ALL.replace("HEIGHT", "document.documentElement.scrollHeight")
_PART = """
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
    ("report", 1120, False, "screen", _ALL.replace("HEIGHT", "950")),
    (
        "report-dark",
        1120,
        True,
        "screen",
        _PART.replace("FROM", "'over-time'").replace("TO", "'over-time'"),
    ),
    (
        "report-spikes",
        1120,
        False,
        "screen",
        _PART.replace("FROM", "'spikes'").replace("TO", "'spikes'"),
    ),
    (
        "report-potential",
        1120,
        False,
        "screen",
        _PART.replace("FROM", "'potential'").replace("TO", "'potential'"),
    ),
    ("report-phone", 360, True, "screen", _ALL.replace("HEIGHT", "1400")),
    ("report-paper", 700, False, "print", "return {x: 0, y: 0, width: innerWidth, height: 990}"),
)
"""Name, width, dark, medium, and the JavaScript that finds the place."""
WHOLE = (("wide", 1280, False, "screen", _WHOLE), ("narrow", 360, False, "screen", _WHOLE))
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 120
"""Seconds until an answer is no longer waited for."""
Message = dict[str, Any]


def find_chromium() -> str | None:
    """Return the path of a Chromium, or None."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Chromium:
    """One tab. ``events`` are all that the browser told, in order."""

    def __init__(self, send: int, receive: int) -> None:
        self._send, self._receive = send, receive
        self._last, self._session, self._rest = 0, None, b""
        self.events: list[Message] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log", "Network", "Accessibility"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> Any:
        """Call a method and return its result."""
        self._last += 1
        message = {"id": self._last, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._last:
            self.events.append(answer)
        assert "error" not in answer, answer["error"]
        return answer["result"]

    def _read(self) -> Message:
        while b"\0" not in self._rest:
            assert select.select([self._receive], [], [], PATIENCE)[0], "Chromium does not answer"
            part = os.read(self._receive, 1 << 20)
            assert part, "Chromium went away"
            self._rest += part
        line, self._rest = self._rest.split(b"\0", 1)
        message: Message = json.loads(line)
        return message

    def open(
        self, page: Path, *, width: int = 1280, dark: bool = False, media: str = "screen"
    ) -> None:
        """Show a page as a screen of that width, or another medium, shows it."""
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
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def press(self, key: str, code: int) -> None:
        """Press a key and let it go."""
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
        found = self.call(
            "Page.captureScreenshot",
            format="png",
            clip={**clip, "scale": 1},
            captureBeyondViewport=True,
        )
        return base64.b64decode(found["data"])

    def pdf(self) -> bytes:
        """Return the page as it is printed."""
        return base64.b64decode(
            self.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)["data"]
        )


@contextmanager
def started(path: str) -> Iterator[Chromium]:
    """Start a Chromium with a profile of its own, and end it."""
    to_browser, from_us = os.pipe()
    to_us, from_browser = os.pipe()
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        open(os.devnull, "wb") as nothing,
    ):
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        options += ["--no-first-run", "--remote-debugging-pipe"]
        # The protocol is spoken on descriptors 3 and 4; ours go there by way of higher ones, for they may be these.
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
    """Write the pictures of a report in few colours; whole pages, too, and how it is printed, if asked for."""
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
