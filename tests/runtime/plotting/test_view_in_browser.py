"""Pages in a browser are as high as their frame, and are drawn by WebGL or without it."""

from __future__ import annotations

import html
import http.server
import json
import queue
import shutil
import subprocess
import threading
import time
from pathlib import Path

import pytest

import systems

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
    """Return the reports of the probe on a page in frames of these sizes, in at most a minute."""
    probed = page.replace("<head>", f"<head>{PROBE}", 1)
    frames = "".join(f'<iframe style="border:0;width:{w}px;height:{h}px" '
                     f'srcdoc="{html.escape(probed)}"></iframe>' for w, h in SIZES)
    host = f"""<!doctype html>{frames}<script>
const found = [], frames = [...document.querySelectorAll("iframe")];
addEventListener("message", ({{ data, source }}) => {{
  found[frames.findIndex((frame) => frame.contentWindow === source)] = data;
  fetch("/found", {{ method: "POST", body: JSON.stringify(found) }});
}});</script>""".encode()
    reports: queue.Queue[list] = queue.Queue()

    class Answer(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.answer(host)

        def do_POST(self):
            reports.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.answer(b"")

        def answer(self, content):
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = subprocess.Popen(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--window-size=1400,2200", *flags,
             f"--user-data-dir={folder / 'browser'}", f"http://127.0.0.1:{server.server_port}/"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            end, latest = time.monotonic() + 60, []
            while time.monotonic() < end and not (len(latest) == len(SIZES) and all(
                    report and not 0 <= report["seen"] <= 500 for report in latest)):
                latest = reports.get(timeout=60)
        finally:
            browser.kill()
            browser.wait()
            server.shutdown()
    return latest


@pytest.fixture(scope="module")
def page():
    return systems.run("double_top", systems.stepper("double_top"), 40).show().page


def test_a_page_is_as_high_as_its_frame_and_drawn_by_webgl(page, tmp_path):
    reports = framed(page, tmp_path, "--enable-unsafe-swiftshader")
    assert len(reports) == len(SIZES)
    for report in reports:
        assert report["errors"] == []
        assert report["scroll"] <= report["inner"], report
        assert report["across"] <= report["width"], report
        assert report["stage"] >= 0.3 * report["inner"], report
        assert report["seen"] > 500, report


def test_without_webgl_a_page_has_its_chart_and_a_sentence(page, tmp_path):
    reports = framed(page, tmp_path, "--disable-gpu", "--disable-3d-apis")
    assert len(reports) == len(SIZES)
    for report in reports:
        assert report["errors"] == []
        assert report["seen"] == -1
