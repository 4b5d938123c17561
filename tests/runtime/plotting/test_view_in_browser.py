"""Pages in a browser: as high as their frame, drawn by WebGL, and without it."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import gyrospark as gs
from processes import ROOT

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")

SIZES = [(1300, 800), (700, 560), (390, 600)]
#: Reports heights, errors, and how many of the pixels that WebGL drew are not the background's.
PROBE = """<script>
const errors = [];
addEventListener("error", (event) => errors.push(event.message));
const frame = requestAnimationFrame;
let count = 0;
window.requestAnimationFrame = (act) => frame((now) => {  // after the page has drawn
  act(now);
  if (++count % 20 === 3) measure();
});
function measure() {
  const below = document.querySelector(".below"), copy = document.createElement("canvas");
  let seen = -1;
  if (below && !below.hidden) {
    Object.assign(copy, { width: below.width, height: below.height });
    const pen = copy.getContext("2d");
    pen.drawImage(below, 0, 0);
    const { data } = pen.getImageData(0, 0, copy.width, copy.height), first = data.slice(0, 3);
    seen = 0;
    for (let i = 0; i < data.length; i += 4)
      seen += first.some((x, k) => Math.abs(x - data[i + k]) > 40);
  }
  const root = document.scrollingElement;
  parent.postMessage({ scroll: root.scrollHeight, inner: innerHeight, across: root.scrollWidth,
    width: innerWidth, errors, seen, stage: document.getElementById("stage").clientHeight }, "*");
}
</script>"""


def framed(page: str, folder: Path, *flags: str) -> list[dict]:
    """Return what the probe reports of a page in frames of the sizes."""
    probed = page.replace("<head>", f"<head>{PROBE}", 1)
    frames = "".join(f'<iframe style="border:0;width:{w}px;height:{h}px" name="{i}" '
                     f'srcdoc="{html.escape(probed)}"></iframe>'
                     for i, (w, h) in enumerate(SIZES))
    host = folder / "host.html"
    host.write_text(f"""<!doctype html><title>none</title>{frames}<pre id="found"></pre><script>
const found = [];
addEventListener("message", ({{ data, source }}) => {{
  const frames = [...document.querySelectorAll("iframe")];
  found[frames.findIndex((frame) => frame.contentWindow === source)] = data;
  document.getElementById("found").textContent = JSON.stringify(found);
}});</script>""", encoding="utf-8")
    done = subprocess.run(
        [CHROMIUM, "--headless=new", "--no-sandbox", "--window-size=1400,2200", *flags,
         "--virtual-time-budget=10000", "--dump-dom", host.as_uri()],
        check=True, capture_output=True, text=True, timeout=200)
    found = json.loads(html.unescape(re.search(r'<pre id="found">(.*?)</pre>', done.stdout)[1]))
    assert len(found) == len(SIZES)
    return found


@pytest.fixture(scope="module")
def page():
    model = gs.models.double_top()
    step = gs.stepper("G-L", 3, system=model.system)
    run = step.integrate(model.q0, model.p0, dt=model.dt, steps=40, parameters=model.parameters)
    return run.view().page


@pytest.mark.parametrize("name", ["view", "heavy_top", "double_pendulum"])
def test_a_page_is_as_high_as_its_frame_and_drawn_by_webgl(page, name, tmp_path):
    if name != "view":
        page = (ROOT / "docs" / "_static" / f"{name}.html").read_text(encoding="utf-8")
    for found in framed(page, tmp_path, "--enable-unsafe-swiftshader"):
        assert found["errors"] == []
        assert found["scroll"] <= found["inner"], found
        assert found["across"] <= found["width"], found
        assert found["stage"] >= 0.3 * found["inner"], found
        assert found["seen"] > 500, found


def test_without_webgl_a_page_is_drawn_as_well(page, tmp_path):
    for found in framed(page, tmp_path, "--disable-gpu", "--disable-3d-apis"):
        assert found["errors"] == []
        assert found["seen"] == -1
