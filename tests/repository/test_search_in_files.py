"""The documentation's search works for pages that are opened from files."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "docs" / "javascripts" / "search_in_files.js"
PAGE = f"""<html><head><script>{SCRIPT.read_text()}</script></head><body><script>
  const worker = new Worker(new URL("worker.js", location));
  worker.addEventListener("message", ({{ data }}) => {{ document.title = data.answer; }});
  worker.postMessage({{ question: 20 }});
</script></body></html>"""
# As the theme's: it imports another script before it answers.
WORKER = """
addEventListener("message", async ({ data }) => {
  await importScripts("more.js");
  postMessage({ answer: "twice is " + twice(data.question) });
});
"""


@pytest.mark.browser
def test_a_worker_answers(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(PAGE)
    (tmp_path / "worker.js").write_text(WORKER)
    (tmp_path / "more.js").write_text("function twice(x) { return 2 * x; }")
    browser = shutil.which("chromium")
    assert browser is not None
    shown = subprocess.run(
        [browser, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage",
         "--virtual-time-budget=5000", "--dump-dom", (tmp_path / "page.html").as_uri()],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert re.findall("<title>(.*)</title>", shown.stdout) == ["twice is 40"]
