"""What a headless Chromium shows of a page."""

import html
import json
import shutil
from pathlib import Path
from typing import Any

from processes import ran

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
NO_BROWSER = "no chromium on the path: nothing here looked at the page as a browser shows it"
_OPTIONS = "--headless --no-sandbox --disable-gpu --disable-dev-shm-usage --no-first-run --dump-dom"
_COMPLAINTS = """<script>
const complaints = [];
addEventListener("error", event => complaints.push(event.message));
console.error = console.warn = (...words) => complaints.push(words.join(" "));
</script>"""
_HOST = """<body><iframe style="width: {width}px; height: 900px; border: 0"></iframe><script>
const frame = document.querySelector("iframe");
frame.onload = () => {{
  const of = frame.contentWindow, found = ({function})(of);
  const fetched = of.performance.getEntriesByType("resource").map(one => one.name);
  document.body.textContent = JSON.stringify([found, fetched, of.eval("complaints")]);
}};
frame.srcdoc = {page};
</script></body>"""


def shown(page: Path, width: int, function: str, scratch: Path) -> tuple[Any, list[str], list[str]]:
    """What a function of JavaScript finds in the window of a page so wide [px].

    And what the page has fetched and complained of.
    """
    assert CHROMIUM is not None
    content = json.dumps(_COMPLAINTS + page.read_text(encoding="utf-8")).replace("</", "<\\/")
    host = scratch / "host.html"
    host.write_text(_HOST.format(width=width, function=function, page=content), encoding="utf-8")
    profile = f"--user-data-dir={scratch / 'profile'}"
    done = ran(CHROMIUM, *_OPTIONS.split(), profile, host.resolve().as_uri(), timeout=120)
    text = done.stdout.partition("<body>")[2].partition("</body>")[0]
    assert text.startswith("["), done.stderr
    return tuple(json.loads(html.unescape(text)))
