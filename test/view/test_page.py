"""The page: its data, its functions in node, all of it in a browser without a display."""

import base64
import html
import json
import re
import shutil
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dlo_sim.view.page import page_data, thinned, write_page
from dlo_sim.view.run import TENSION, read_run

NODE = shutil.which("node")


@pytest.fixture(scope="module")
def page(made, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "run.html"
    write_page(read_run(made.bag, made.scene), path)
    return path


def table(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_data_in_the_page_is_the_run(made, page):
    text = page.read_text(encoding="utf-8")
    (found,) = re.findall(r'<script id="run" type="application/json">(.*?)</script>', text)
    data = json.loads(found)
    assert (data["points"], data["controls"]) == (60, 7)
    np.testing.assert_allclose(table(data["centerline"]), made.centerline.ravel(), atol=1e-6)
    np.testing.assert_allclose(table(data["frames"]), made.frames.ravel(), atol=1e-6)
    tension = data["colors"][0]
    assert tension["title"] == TENSION
    assert tension["high"] == pytest.approx(made.tension.max(), rel=1e-6)
    assert not re.search(r"(src|href)=|https?://(?!www\.w3\.org)", text), "it loads nothing"


def test_name_that_looks_like_markup_ends_nothing(made, tmp_path):
    run = read_run(made.recording)
    object.__setattr__(run, "name", "</script><b>$data")
    write_page(run, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    assert "<title>&lt;/script&gt;&lt;b&gt;$data</title>" in text


def test_long_runs_are_thinned(made):
    assert thinned(5, 9).tolist() == [0, 1, 2, 3, 4]
    kept = thinned(100_000, 600)
    assert (len(kept), kept[0], kept[-1]) == (600, 0, 99_999)
    assert len(table(page_data(read_run(made.recording))["time"])) == 21


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_functions_of_the_page(checkout, tmp_path):
    script = (checkout / "dlo_sim" / "view" / "page.js").read_text(encoding="utf-8")
    functions = script[: script.index("\nstart(document")]
    checks = """
    const camera = new Camera([1, 2, 3], 5);
    console.log(JSON.stringify({
      frames: [-1, 0, 0.5, 1.5, 2, 9].map((t) => frameAt([0, 1, 2], t)),
      between: between([0, 10, 2, 30, 4, 50], 2, 1, 0.5),
      last: between([0, 10, 2, 30, 4, 50], 2, 2, 0.5),
      color: colorOf([[0, 0, 0], [1, 0.5, 0]], 0.5),
      axes: axesOf([0, 0, Math.SQRT1_2, Math.SQRT1_2]).flat().map((v) => Math.round(v) + 0),
      round: [0.034, 0.7, 1, 24].map(round),
      middle: camera.project([1, 2, 3], 800, 400),
      above: camera.project([1, 2, 3.1], 800, 400),
      moved: [...moved([1, 0, 0, 0, 2, 0], [5, 6, 7, 0, 0, Math.SQRT1_2, Math.SQRT1_2])],
      hides: [[3, 3, 9], [3, 3, 4.9], [9, 9, 9], [3, 3, 5.05]].map((p) =>
        hides([[0, 0, 5], [10, 0, 5], [0, 10, 5]], p, 0.1)),
    }));
    """
    path = tmp_path / "checks.js"
    path.write_text(functions + checks, encoding="utf-8")
    done = subprocess.run([NODE, path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["frames"] == [[0, 0], [0, 0], [0, 0.5], [1, 0.5], [1, 1], [1, 1]]
    assert found["between"] == [3, 40] and found["last"] == [4, 50]
    assert found["color"] == "rgb(128,64,0)"
    assert found["axes"] == [0, 1, 0, -1, 0, 0, 0, 0, 1], "a quarter turn about z"
    assert found["round"] == pytest.approx([0.05, 1.0, 1.0, 50.0])
    assert found["middle"] == [400, 200, 5]
    assert found["above"][1] < 200, "up is up"
    assert found["moved"] == pytest.approx([5, 7, 7, 3, 6, 7])
    assert found["hides"] == [True, False, False, False], "what lies behind, by more than 0.1"


# ---- in a browser, which runs the page as a user's does, without a display -------------------

USER = (Path(__file__).parent / "page_user.js").read_text(encoding="utf-8")
# Before the page's own script: what the browser and the console complain about; and frames that
# come in the browser's virtual time, since those of its compositor come late on a busy machine.
LISTENER = """
<script>
  const complaints = [];
  const complain = (...given) => complaints.push(given.map(String).join(" "));
  console.error = console.warn = complain;
  window.addEventListener("error", (event) => complain(event.message));
  window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
</script>
"""


@cache
def chromium():
    """A browser that runs; None if there is none. On Ubuntu `chromium` may be a stub that only asks
    for its snap.
    """
    for path in filter(None, map(shutil.which, ("chromium", "google-chrome"))):
        with suppress(subprocess.TimeoutExpired, OSError):
            asked = subprocess.run([path, "--version"], capture_output=True, timeout=60)
            if asked.returncode == 0:
                return path
    return None


def in_browser(page, folder, *options):
    """stdout of a headless browser that opens a page; its console is in stderr. Skips the test
    where there is no browser.
    """
    if chromium() is None:
        pytest.skip("needs chromium")
    command = [
        *(chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"),
        *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
        *("--enable-logging=stderr", "--virtual-time-budget=4000", "--window-size=1100,1000"),
        f"--user-data-dir={folder / 'profile'}",
    ]
    done = subprocess.run(
        [*command, *options, page.as_uri()], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr, done.stderr
    return done.stdout


@pytest.mark.parametrize("kind", ["bag", "recording"])
def test_a_browser_shows_the_run_and_works_its_controls(kind, made, tmp_path):
    run = read_run(made.bag, made.scene) if kind == "bag" else read_run(made.recording)
    path = tmp_path / "page.html"
    write_page(run, path)
    text = path.read_text(encoding="utf-8")
    user = f'<pre id="found"></pre><script>{USER}</script>'
    text = text.replace("<head>", "<head>" + LISTENER).replace("</body>", user + "</body>")
    path.write_text(text, encoding="utf-8")
    (shown,) = re.findall(r'<pre id="found">(.*?)</pre>', in_browser(path, tmp_path, "--dump-dom"))
    found = json.loads(html.unescape(shown))
    assert found["complaints"] == []
    assert found["vivid"] > 200, "the cable is drawn in the colours of the tension"
    assert found["range"] == pytest.approx([0.0, 0.4], abs=1e-6)
    assert found["colors"] == [*run.colors, "one colour"]
    for legend, values in zip(found["legends"], run.colors.values(), strict=False):
        expected = [values.min(), values.max()]
        assert [float(text) for text in legend] == pytest.approx(expected, rel=6e-3, abs=1e-9)
    assert found["legends"][-1] is None
    assert found["home"] == "0.000 / 0.400 s"
    assert (found["three"], found["back"]) == ("0.060 / 0.400 s", "0.040 / 0.400 s")
    assert found["end"] == "0.400 / 0.400 s"
    pictures = found["pictures"]
    assert pictures.pop("reset") == pictures["one colour"]
    assert len(pictures) == len(set(pictures.values())) == 9, "what else a user does is seen"
    assert [clock for clock, _ in found["slid"]] == [f"{t:.3f} / 0.400 s" for t in (0.1, 0.2, 0.3)]
    assert len({mark for _, mark in found["slid"]}) == found["frames"] == 3
    assert 0.15 < float(found["clicked"].split()[0]) < 0.3
    assert [title for title, *_ in found["plots"]] == [curve.title for curve in run.plots]
    for (_, *drawn), curve in zip(found["plots"], run.plots, strict=True):
        assert drawn == [len(curve.time)] * len(curve.values)
    assert found["faulty"] is None
    assert found["playing"] == "Pause"
    assert found["played"] == ["0.400 / 0.400 s", "Play"], "it stops at the end"


def test_picture_of_the_page_as_it_is_written(page, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    path = tmp_path / "page.png"
    in_browser(page, tmp_path, f"--screenshot={path}")
    picture = np.round(255 * image.imread(path)[..., :3])
    assert picture.shape == (1000, 1100, 3)
    background = np.all(picture == (0xF6, 0xF7, 0xF9), axis=2)
    rows, columns = np.nonzero(background)
    view = picture[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert view.shape[0] == pytest.approx(480, abs=4) and view.shape[1] > 1000
    vivid = np.ptp(view, axis=2) > 60
    assert 200 < vivid.sum() < 0.1 * vivid.size, "a thin cable, its axes and its path"
    at = np.argwhere(vivid).mean(axis=0) / vivid.shape
    assert np.all((at > 0.2) & (at < 0.8)), "in the middle of the view"
    plots = picture[rows.max() + 100 :]
    assert np.ptp(plots, axis=2).max() > 60, "lines of the plots"
