"""Makes a film of a flight: Chromium draws the frames of its replay, Pillow or ffmpeg writes."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat.replay import replay_page
from proxops.systems.common import InputError, needed, write_whole

# Endings of the files that can be written.
_SUFFIXES = (".webp", ".gif", ".mp4")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless=new",
    # Draws WebGL on the processor, so that no graphics card is needed.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # Chromium's sandbox does not start for root, as whom containers run.
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--hide-scrollbars",
    # The page has to do without a network.
    "--host-resolver-rules=MAP * ~NOTFOUND",
    # Time passes as fast as the machine can draw; the page needs less than a second of it.
    "--virtual-time-budget=20000",
    "--dump-dom",
)
# Seconds after which a browser that does not answer is stopped.
_PATIENCE = 900.0
# What is written below the picture, of the panel's numbers.
_NUMBERS = ("clock", "range", "speed", "clearance", "who")
# A frame is drawn larger, and then made smaller, so that edges are smooth.
_FINER = 2
_SCRIPT = """
<script>
(function wait() {
  if (!(viewer.animator.duration > 0)) return setTimeout(wait, 40);
  const film = FILM, animator = viewer.animator, screen = viewer.renderer.domElement;
  document.getElementById("panel").style.display = "none";
  animator.pause();
  viewer.set_3d_pane_size(film.width * film.finer, film.height * film.finer);
  const canvas = document.createElement("canvas"), draw = canvas.getContext("2d");
  canvas.width = film.width; canvas.height = film.height;
  const frames = [];
  let k = 0;
  // Each frame in a task of its own, so that the page stays alive.
  (function shoot() {
    if (k > 0) {
      viewer.show_numbers();
      viewer.render();
      draw.drawImage(screen, 0, 0, film.width, film.height);
      draw.font = "13px system-ui, sans-serif";
      let x = 12;
      for (const part of document.querySelectorAll("#panel > div:first-of-type > span")) {
        const value = part.querySelector("b"), name = part.querySelector("small");
        for (const [text, colour] of [
          [name.textContent, "#99a0ae"], [value.textContent, value.style.color || "#ffffff"]
        ]) {
          if (!NUMBERS.includes(value.id)) continue;
          draw.fillStyle = colour;
          draw.fillText(text, x, film.height - 12);
          x += draw.measureText(text).width + (colour === "#99a0ae" ? 5 : 14);
        }
      }
      frames.push(canvas.toDataURL("image/jpeg", 0.92));
    }
    if (k < film.times.length) {
      const slider = document.getElementById("time");
      slider.max = animator.duration;
      slider.value = film.times[k++] * animator.duration;
      slider.oninput();
      setTimeout(shoot, 40);
    } else document.body.append(frames.join(" "));
  })();
})();
</script>
"""


def write_movie(
    log: FlightLog,
    path: str | Path,
    *,
    seconds: float = 10.0,
    frames_per_second: float = 10.0,
    width: int = 640,
) -> None:
    """Writes a film of a whole flight. WebP and GIF play again and again.

    Args:
      log: the log of the flight.
      path: of a WebP (small), a GIF (large, shown everywhere) or an MP4 (takes the extra `movie`),
        by its ending.
      seconds: length of the film.
      frames_per_second: that many frames in each.
      width: of the picture, in pixels; its height is five eighths of that.

    Raises:
      InputError: the path has another ending, the folder cannot be written, there is no Chromium on
        this machine, it shows no flight, or the extra is not installed.
    """
    path = Path(path)
    check_film(path)
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        raise InputError(
            f"a film is drawn by Chromium, which is not on the PATH as {', '.join(_BROWSERS)}: "
            "install it, such as by `apt install chromium`"
        )
    count = max(round(seconds * frames_per_second), 2)
    film = {
        "width": width,
        "height": width * 5 // 8,
        "finer": _FINER,
        "times": [k / (count - 1) for k in range(count)],
    }
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "film.html"
        script = _SCRIPT.replace("FILM", json.dumps(film)).replace("NUMBERS", json.dumps(_NUMBERS))
        page.write_text(replay_page(log, script), encoding="utf-8")
        size = f"--window-size={width * _FINER},{film['height'] * _FINER}"
        drawn = subprocess.run(
            [browser, *_FLAGS, size, f"--user-data-dir={folder}/profile", page.as_uri()],
            capture_output=True,
            text=True,
            timeout=_PATIENCE,
            check=False,
        )
    frames = re.findall(r"data:image/jpeg;base64,([\w+/=]+)", drawn.stdout)
    if len(frames) != count:
        raise InputError(
            f"{browser} drew {len(frames)} of {count} frames: {drawn.stderr.strip()[-500:]}"
        )
    write_frames([base64.b64decode(each) for each in frames], path, frames_per_second)


def check_film(path: Path) -> None:
    """Raises what `write_frames` would, before frames are drawn, which takes a minute.

    Raises:
      InputError: the path has another ending than that of a film, or the extra is not installed.
    """
    if path.suffix not in _SUFFIXES:
        raise InputError(f"{path}: a film is a {', '.join(_SUFFIXES[:-1])} or {_SUFFIXES[-1]} file")
    if path.suffix == ".mp4":
        needed("imageio_ffmpeg", "movie")


def write_frames(frames: list[bytes], path: Path, frames_per_second: float) -> None:
    """Writes JPEGs of one size as a film.

    Raises:
      InputError: see `check_film`; or the folder cannot be written.
    """
    check_film(path)
    write = _write_mp4 if path.suffix == ".mp4" else _write_pictures
    write(frames, path, frames_per_second)


def _write_mp4(frames: list[bytes], path: Path, frames_per_second: float) -> None:
    """Writes JPEGs as a film that browsers and slides play."""
    ffmpeg = needed("imageio_ffmpeg", "movie").get_ffmpeg_exe()
    # Players need a yellow, a blue and a red for every four pixels, so even sizes.
    even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
    coded = ["-c:v", "libx264", "-movflags", "+faststart", "-f", "mp4", "-y"]
    read = ["-f", "image2pipe", "-c:v", "mjpeg", "-framerate", str(frames_per_second), "-i", "-"]

    def write(name: Path) -> None:
        command = [ffmpeg, "-loglevel", "error", *read, *even, *coded, str(name)]
        ran = subprocess.run(command, input=b"".join(frames), capture_output=True, check=False)
        if ran.returncode:
            raise InputError(f"{path}: ffmpeg failed: {ran.stderr.decode(errors='replace')[-500:]}")

    write_whole(path, write)


def _write_pictures(frames: list[bytes], path: Path, frames_per_second: float) -> None:
    """Writes JPEGs as an animated picture."""
    from PIL import Image  # Only films need it.

    first, *others = (Image.open(io.BytesIO(each)) for each in frames)
    options = {"quality": 60, "method": 4} if path.suffix == ".webp" else {"optimize": True}

    def write(name: Path) -> None:
        first.save(
            name,
            format=path.suffix[1:],
            save_all=True,
            append_images=others,
            duration=round(1e3 / frames_per_second),
            loop=0,
            **options,
        )

    write_whole(path, write)
