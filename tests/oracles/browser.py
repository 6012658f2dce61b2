"""A real browser for tests: Debian's chromium without a window, controlled by the DevTools protocol over two pipes.

No driver, port or library is needed: a command is a line of JSON that ends with a zero byte, on descriptor 3 of
the browser; answers and events come back on 4 (chromium's --remote-debugging-pipe). Where no chromium is installed,
`find` says so, and the tests that ask for the fixture `browser` are skipped.
"""

import base64
import io
import json
import os
import selectors
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--force-color-profile=srgb", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
    "--disable-quic", "--enable-unsafe-swiftshader", "--remote-debugging-pipe",
)  # fmt: skip
KEYS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Enter": 13, "Tab": 9, "Home": 36, "End": 35}
SHIFT = 8
PATIENCE = 60.0  # seconds


def find():
    """The browser's program, or None."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One chromium. `open` gives pages; a `with` block ends it."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="glossbench-browser-", ignore_cleanup_errors=True)
        from_us, self._out = os.pipe()
        self._in, to_us = os.pipe()

        def descriptors():  # in the browser's process: 3 to read, 4 to write; first out of each other's way
            read, write = (os.dup(fd) for fd in (from_us, to_us))
            read, write = (os.dup2(fd, n, inheritable=True) for fd, n in ((read, 33), (write, 34)))
            os.dup2(read, 3, inheritable=True)
            os.dup2(write, 4, inheritable=True)

        self.process = subprocess.Popen(
            [find(), *FLAGS, f"--user-data-dir={self.folder.name}"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=descriptors, close_fds=False,
        )  # fmt: skip
        os.close(from_us)
        os.close(to_us)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._in, selectors.EVENT_READ)
        self._buffer, self._count = b"", 0
        self.events = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self._out)
        os.close(self._in)
        self._selector.close()
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()

    def send(self, method, session=None, **parameters):
        """The result of a command; events that come before it are kept."""
        self._count += 1
        number = self._count
        command = {"id": number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        data = json.dumps(command).encode() + b"\0"
        while data:
            data = data[os.write(self._out, data) :]
        until = time.monotonic() + PATIENCE
        while True:
            message = self._message(until, method)
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]
            self.events.append(message)

    def _message(self, until, waiting_for):
        while b"\0" not in self._buffer:
            if not self._selector.select(max(0.0, until - time.monotonic())):
                raise TimeoutError(f"no answer to {waiting_for} in {PATIENCE:.0f} s")
            data = os.read(self._in, 1 << 20)
            if not data:
                raise RuntimeError(f"the browser has ended (waiting for {waiting_for})")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(line)

    def open(self, path, width=1400, height=1000, **how):
        """A page of a file, loaded."""
        return Page(self, Path(path), width, height, **how)


class Page:
    """A tab. Positions are CSS pixels of the window, from the top left."""

    def __init__(self, browser, path, width, height, dark=False, fragment="", query="", script=""):
        self.browser = browser
        target = browser.send("Target.createTarget", url="about:blank")["targetId"]
        self.target = target
        self.session = browser.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.send(f"{domain}.enable")
        self.resize(width, height)
        colours = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.send("Emulation.setEmulatedMedia", features=colours)
        self.send("Emulation.setFocusEmulationEnabled", enabled=True)
        if script:
            self.send("Page.addScriptToEvaluateOnNewDocument", source=script)
        self.send("Page.navigate", url=f"{path.resolve().as_uri()}{query}{fragment}")
        drawn = "document.readyState === 'complete' && !document.querySelector('[aria-busy]')"
        self.wait(f"{drawn} && location.href !== 'about:blank'")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.browser.send("Target.closeTarget", targetId=self.target)

    def send(self, method, **parameters):
        return self.browser.send(method, self.session, **parameters)

    def resize(self, width, height):
        """Another window; below 600 pixels it is a phone's."""
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self.send("Emulation.setTouchEmulationEnabled", enabled=width < 600)

    def do(self, expression):
        """The value of a JavaScript expression, awaited; what it throws is raised."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise RuntimeError(details.get("exception", {}).get("description") or details["text"])
        return answer["result"].get("value")

    def wait(self, expression, seconds=PATIENCE):
        """Until an expression is true."""
        until = time.monotonic() + seconds
        while not self.do(f"!!({expression})"):
            if time.monotonic() > until:
                where = self.do("location.href")
                raise TimeoutError(f"not true after {seconds} s: {expression}; at {where}, {self.complaints()}")
            time.sleep(0.05)

    def key(self, key, shift=False):
        """A key goes down and up, wherever the focus is."""
        modifiers = SHIFT if shift else 0
        code = KEYS.get(key) or (ord(key.upper()) if key.isalnum() else 0)
        text = {"text": key} if len(key) == 1 else {"text": "\r"} if key == "Enter" else {}
        shared = {"key": key, "windowsVirtualKeyCode": code, "modifiers": modifiers}
        self.send("Input.dispatchKeyEvent", type="keyDown", **shared, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", **shared)

    def mouse(self, kind, x, y, **more):
        """mouseMoved, mousePressed, mouseReleased or mouseWheel (deltaX, deltaY)."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def click(self, x, y, shift=False):
        self.drag((x, y), (x, y), shift=shift)

    def drag(self, start, end, shift=False):
        """Press, move in four steps, let go."""
        more = {"button": "left", "clickCount": 1, "modifiers": SHIFT if shift else 0}
        self.mouse("mouseMoved", *start)
        self.mouse("mousePressed", *start, buttons=1, **more)
        for t in (0.25, 0.5, 0.75, 1.0) if start != end else ():
            x, y = (a + t * (b - a) for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", x, y, button="left", buttons=1, modifiers=more["modifiers"])
        self.mouse("mouseReleased", *end, **more)

    def touch(self, kind, *points):
        """touchStart, touchMove or touchEnd: where the fingers are on the screen, all of them."""
        touches = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        self.send("Input.dispatchTouchEvent", type=kind, touchPoints=touches)

    def click_on(self, selector):
        """A click on the middle of the element, once it lies still in the window with nothing before it."""
        x, y, width, height = self.box(selector, uncovered=True)
        self.click(x + width / 2, y + height / 2)

    def show(self, selector):
        """Scroll an element into sight: far from there, a page does not lay out its tables."""
        at = f"document.querySelector({json.dumps(selector)}).scrollIntoView()"
        self.do(f"{at}, new Promise((then) => requestAnimationFrame(() => requestAnimationFrame(then)))")

    def box(self, selector, uncovered=False):
        """x, y, width, height of an element in the window, after it was brought there and the page has come to rest."""
        look = """new Promise((done, fail) => {
            const until = performance.now() + PATIENCE;
            let last, frames = 0;
            const look = () => {
                const element = document.querySelector(SELECTOR);
                element.scrollIntoView({block: 'nearest'});
                const {x, y, width, height} = element.getBoundingClientRect();
                const now = [x, y, width, height];
                frames = now.join() === last ? frames + 1 : 0;
                last = now.join();
                const isHit = element.contains(document.elementFromPoint(x + width / 2, y + height / 2));
                if (frames > 2 && (isHit || !UNCOVERED)) done(now);
                else if (performance.now() > until) fail(new Error(`${SELECTOR} moves, or is hidden: ${last}`));
                else requestAnimationFrame(look);
            };
            look();
        })"""
        named = {"SELECTOR": json.dumps(selector), "UNCOVERED": json.dumps(uncovered), "PATIENCE": PATIENCE * 500}
        for name, value in named.items():
            look = look.replace(name, str(value))
        return self.do(look)

    def text(self, selector):
        """The text of the first such element, as it is shown."""
        return self.do(f"document.querySelector({json.dumps(selector)}).innerText")

    def pixels(self, selector=None):
        """What is on the screen, (H, W, 3) of 8 bits: the window, or an element in it."""
        self.do("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        clip = {}
        if selector:
            x, y, width, height = self.box(selector)
            page = self.do("[scrollX, scrollY]")
            x, y, width, height = map(round, (x + page[0], y + page[1], width, height))  # as the browser draws it
            clip = {"clip": {"x": x, "y": y, "width": width, "height": height, "scale": 1}}
        return self._image("Page.captureScreenshot", **clip)

    def whole(self):
        """The whole page, (H, W, 3)."""
        return self._image("Page.captureScreenshot", captureBeyondViewport=True)

    def _image(self, method, **how):
        data = self.send(method, format="png", **how)["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def complaints(self):
        """Errors and warnings that the page left: uncaught exceptions, the console, what the policy refused."""
        self.do("1")
        found = []
        for event in self.browser.events:
            if event.get("sessionId") != self.session:
                continue
            parameters = event["params"]
            match event["method"]:
                case "Runtime.exceptionThrown":
                    details = parameters["exceptionDetails"]
                    found.append(details.get("exception", {}).get("description") or details["text"])
                case "Runtime.consoleAPICalled" if parameters["type"] in ("error", "warning", "assert"):
                    found.append(" ".join(str(each.get("value")) for each in parameters["args"]))
                case "Log.entryAdded" if parameters["entry"]["level"] in ("error", "warning"):
                    found.append(parameters["entry"]["text"])
        return found
