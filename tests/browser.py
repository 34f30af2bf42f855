"""A page in a real browser, opened from disk with the network off."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

PATIENCE = 600_000  # on a busy machine a page may take minutes to be drawn [ms]

# Meshcat's page fetches each part of a scene from itself, and shows them as they come: the walk may
# be there before the camera stands in its place. In here is counted what is still to come.
_COUNT_PARTS = """{
    const { fetch } = window, { arrayBuffer } = Response.prototype;
    window.partsToCome = 0;
    window.fetch = (...wanted) => {
        window.partsToCome += 1;
        return fetch(...wanted);
    };
    Response.prototype.arrayBuffer = function () {
        const part = arrayBuffer.call(this);
        part.then(() => setTimeout(() => { window.partsToCome -= 1; }));
        return part;
    };
}"""
PLAYS = (
    "document.readyState === 'complete' && window.viewer && window.partsToCome === 0"
    " && viewer.animator.duration > 0"
)

NO_WEBGL = """{
    const { getContext } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function (kind, ...others) {
        return kind.includes("webgl") ? null : getContext.call(this, kind, ...others);
    };
}"""
FAILING_WEBGL = "HTMLCanvasElement.prototype.getContext = () => { throw new Error('no'); };"
NO_DECOMPRESSION = "delete window.DecompressionStream;"

in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium on the PATH")


@dataclass
class Opened:
    """A page, and what it said and asked for since it was opened."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def shot(self, **clip: float) -> np.ndarray:
        """What is seen of it: red, green, blue, 0 to 1, shape (rows, columns, 3)."""
        area = {"clip": clip} if clip else {}
        return imread(BytesIO(self.page.screenshot(**area)), format="png")[..., :3]


@contextmanager
def opened(
    address: str,
    *,
    width: int = 1000,
    height: int = 700,
    scheme: str = "light",
    offline: bool = True,
    lacking: str = "",
    scripts: bool = True,
) -> Iterator[Opened]:
    """A page in Chromium.

    Args:
        address: Its address.
        width: Of the window [pixel].
        height: Of the window [pixel].
        scheme: "light" or "dark".
        offline: Whether the network is off.
        lacking: A script that runs before the page's own, and takes something from the browser.
        scripts: Whether the browser runs scripts.
    """
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(
            executable_path=CHROMIUM, args=arguments, timeout=PATIENCE
        )
        context = browser.new_context(
            offline=offline,
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            java_script_enabled=scripts,
        )
        context.set_default_timeout(PATIENCE)
        context.add_init_script(_COUNT_PARTS)
        context.add_init_script(lacking)
        seen = Opened(context.new_page())
        seen.page.on("console", lambda message: seen.complaints.append(message.text))
        seen.page.on("pageerror", lambda error: seen.complaints.append(str(error)))
        inside = ("data:", "blob:", "about:")
        seen.page.on(
            "request",
            lambda request: (
                None if request.url.startswith(inside) else seen.requests.append(request.url)
            ),
        )
        seen.page.goto(address)
        yield seen
        browser.close()


def address(path: Path) -> str:
    """The address of a file."""
    return path.resolve().as_uri()
