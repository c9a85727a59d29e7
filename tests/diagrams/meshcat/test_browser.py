"""A replay as a browser shows it. Needs Chromium: `pytest -m browser`."""

import itertools
import re
import shutil
import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.meshcat import PLAYBACK_SPEED, write_movie, write_replay
from proxops.systems.common import InputError

pytestmark = pytest.mark.browser

WIDTH, HEIGHT = 960, 640
# The panel's height at most.
PANEL = 120
# The body is grey: its channels lie near each other, and it is brighter than space.
GREY_SPREAD, GREY_LEAST = 0.12, 0.2
FLAGS = [
    "--headless=new",
    # Draws WebGL on the processor, so that no graphics card is needed.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # Chromium's sandbox does not start for root, as whom containers run.
    "--no-sandbox",
    "--disable-gpu-sandbox",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    # The page has to do without a network.
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--v=0",
    f"--window-size={WIDTH},{HEIGHT}",
]


def browser() -> str:
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        pytest.fail(f"this test needs one of {', '.join(names)} on the PATH; install Chromium")
    return found


def photograph(
    page: Path, picture: Path, profile: Path, seconds: float, virtual: bool = True
) -> str:
    """Takes a picture of the page after so many seconds; returns the log.

    They pass as fast as the machine can if they are virtual.
    """
    wait = "virtual-time-budget" if virtual else "timeout"
    done = subprocess.run(
        [
            browser(),
            *FLAGS,
            f"--user-data-dir={profile}",
            f"--{wait}={seconds * 1e3:.0f}",
            f"--screenshot={picture}",
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=240,
        check=False,
    )
    assert picture.is_file(), done.stderr
    return done.stderr


def channels(image: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Red, green and blue, with the panel blacked out: its dots have the scene's colours."""
    scene = image.copy()
    scene[HEIGHT - PANEL :] = 0.0
    return scene[:, :, 0], scene[:, :, 1], scene[:, :, 2]


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray, str]:
    """Pictures (H, W, 3) in [0, 1] early and late in the replay, and what the console said."""
    folder = tmp_path_factory.mktemp("browser")
    page = folder / "replay.html"
    write_replay(synthetic_log(), page)
    images, said = [], ""
    for seconds in (8.0, 20.0):
        picture = folder / f"{seconds:.0f}.png"
        said += photograph(page, picture, folder / "profile", seconds)
        images.append(imread(picture)[:, :, :3])
    return images[0], images[1], said


def complaints(log: str) -> list[str]:
    """Returns what the page wrote on its console at any level, without the graphics driver's notes.

    Chromium logs each as `[…:INFO:CONSOLE:12] "message", source: …`, errors too.
    """
    lines = [line for line in log.splitlines() if "CONSOLE" in line]
    return [line for line in lines if not re.search(r"GL Driver Message|GPU stall", line)]


def test_console_has_no_errors(shown: tuple[np.ndarray, np.ndarray, str]) -> None:
    assert complaints(shown[2]) == []


def test_path_grows_while_it_plays(shown: tuple[np.ndarray, np.ndarray, str]) -> None:
    def coloured(image: np.ndarray) -> tuple[int, int]:
        red, green, blue = channels(image)
        policy = (red > 0.6) & (green > 0.3) & (green < 0.75) & (blue < 0.3) & (red - green > 0.2)
        mpc = (blue > 0.7) & (red < 0.45) & (green > 0.3)
        return int(policy.sum()), int(mpc.sum())

    early, late = (coloured(image) for image in shown[:2])
    assert late[0] > 1.5 * early[0] > 0
    assert late[1] > 1.5 * early[1]
    assert late[1] > 50


def icons(image: np.ndarray) -> list[int]:
    """Pixels of lidar returns, thrust and goal."""
    red, green, blue = channels(image)
    returns = (red > 0.6) & (green < 0.4) & (blue < 0.55) & (red - green > 0.35)
    thrust = (red > 0.5) & (green > 0.8 * red) & (green < 1.05 * red) & (blue < 0.6 * red)
    goal = (green > 0.4) & (red < 0.65 * green) & (blue < 0.75 * green)
    return [int(mask.sum()) for mask in (returns, thrust, goal)]


def test_returns_thrust_and_goal_are_seen(shown: tuple[np.ndarray, np.ndarray, str]) -> None:
    assert min(icons(shown[0])) > 20


def with_script(page: str, script: str) -> str:
    """The page with a script at its end, which is told when the flight is there."""
    waiting = (
        "(function wait() {"
        f"if (viewer.animator.duration > 0) {{ {script} }} else requestAnimationFrame(wait)"
        "})()"
    )
    head, end, tail = page.rpartition("</body>")
    return f"{head}<script>{waiting}</script>{end}{tail}"


@pytest.fixture(scope="module")
def filtered(tmp_path_factory: pytest.TempPathFactory) -> tuple[FlightLog, str]:
    """A flight of 90 minutes in which runtime assurance steps in now and then, and its page."""
    log = synthetic_log(540)
    changes = np.where(np.arange(541) % 50 < 20, 0.5, 0.0)
    log = FlightLog(log.dataset.assign(intervention=("time", changes)), log.body)
    path = tmp_path_factory.mktemp("browser") / "replay.html"
    write_replay(log, path)
    return log, path.read_text(encoding="utf-8")


@pytest.mark.parametrize("row", [210, 540])
def test_numbers_are_those_of_the_log(
    filtered: tuple[FlightLog, str], tmp_path: Path, row: int
) -> None:
    log, plain = filtered
    data = log.dataset.isel(time=row)
    script = (
        "const slider = document.getElementById('time');"
        "viewer.animator.pause();"
        "slider.max = viewer.animator.duration;"
        f"slider.value = {float(data['time']) / PLAYBACK_SPEED + 0.01}; slider.oninput();"
        "const names = ['clock', 'range', 'speed', 'thrust', 'who'];"
        "const said = () => names.map(name => document.getElementById(name).textContent);"
        "const soon = requestAnimationFrame;"
        "soon(() => soon(() => console.log(said().join('|'))));"
    )
    page = tmp_path / "replay.html"
    page.write_text(with_script(plain, script))
    said = photograph(page, tmp_path / "1.png", tmp_path / "profile", 12.0)
    (line,) = complaints(said)
    (told,) = re.findall(r'"(.*\|.*)"', line)
    clock, away, speed, thrust, who = told.split("|")
    seconds = int(data["time"])
    assert clock == f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    number, unit = away.split()
    distance = float(np.linalg.norm((data["state"] - data["target"]).values[:3]))
    assert float(number) * {"m": 1.0, "km": 1e3}[unit] == pytest.approx(distance, abs=51.0)
    velocity = np.linalg.norm(data["state"].values[3:])
    assert float(speed.split()[0]) == pytest.approx(velocity, abs=0.006)
    force = 0.0 if row == 540 else np.linalg.norm(data["force"].values)
    assert float(thrust.split()[0]) == pytest.approx(force, abs=0.006)
    # At the end whoever flew last: the policy, in row 539.
    assert who == {210: "safety filter", 540: "policy"}[row]


@pytest.mark.parametrize("ending", ["webp", "gif"])
def test_a_film_shows_the_flight(tmp_path: Path, ending: str) -> None:
    """The path grows from frame to frame, and the numbers below change."""
    path = tmp_path / f"flight.{ending}"
    write_movie(synthetic_log(), path, seconds=1.0, frames_per_second=4.0, width=480)
    with Image.open(path) as film:
        assert film.size == (480, 300)
        frames = []
        for k in range(4):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB"), dtype=float) / 255.0)
    grey = (np.ptp(frames[-1], axis=2) < GREY_SPREAD) & (frames[-1].mean(axis=2) > GREY_LEAST)
    assert grey[:270].mean() > 0.1
    flown = [
        np.count_nonzero((f[:270, :, 0] > 0.4) & (f[:270, :, 0] - f[:270, :, 2] > 0.2))
        for f in frames
    ]
    assert flown[-1] > 2 * flown[0]
    numbers = [frame[275:] for frame in frames]
    assert all(np.abs(one - other).max() > 0.3 for one, other in itertools.pairwise(numbers))


def test_a_film_for_players(tmp_path: Path) -> None:
    """It is read back by the program that wrote it; its height is made even."""
    path = tmp_path / "flight.mp4"
    write_movie(synthetic_log(), path, seconds=1.0, frames_per_second=4.0, width=488)
    read = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    shown = subprocess.run(read, capture_output=True, check=True).stdout
    frames = np.frombuffer(shown, dtype=np.uint8).reshape(4, 306, 488, 3)
    assert np.abs(frames[0].astype(float) - frames[-1]).max() > 100.0


def test_films_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InputError, match=r"pip install 'proxops\[movie\]'"):
        write_movie(synthetic_log(), tmp_path / "flight.mp4")
