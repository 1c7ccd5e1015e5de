"""The page: its data, its functions in node, all of it in a browser without a display."""

import base64
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from dlo_sim.view.page import page_data, thinned, write_page
from dlo_sim.view.run import TENSION, read_run

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
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


IN_THE_BROWSER = """
<pre id="found"></pre>
<script>
  const id = (name) => document.getElementById(name), found = {};
  const press = (key) => document.dispatchEvent(new KeyboardEvent("keydown", {key}));
  const sum = () => {
    const c = id("view"), pixels = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
    return pixels.reduce((total, v, k) => (total + v * (k % 251 + 1)) % 1000000007, 0);
  };
  const pictures = [sum()];
  const look = (name, action) => {
    action();
    pictures.push(sum());
    found[name] = id("clock").textContent;
  };
  look("start", () => {});
  for (const n of [1, 2, 3]) press("ArrowRight");
  look("three", () => {});
  look("back", () => press("ArrowLeft"));
  look("end", () => press("End"));
  look("points", () => id("points").click());
  look("color", () => { id("color").value = 2; id("color").onchange(); });
  look("home", () => press("Home"));
  found.pictures = new Set(pictures).size;
  found.plots = document.querySelectorAll("#plots svg").length;
  found.legend = id("legend").hidden;
  press(" ");
  found.playing = id("play").textContent;
  setTimeout(() => {
    found.played = id("clock").textContent;
    id("found").textContent = JSON.stringify(found);
  }, 1500);
</script>
"""


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
def test_page_in_a_browser(page, tmp_path):
    text = page.read_text(encoding="utf-8").replace("</body>", IN_THE_BROWSER + "</body>")
    path = tmp_path / "page.html"
    path.write_text(text, encoding="utf-8")
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=4000",
    ]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    (shown,) = re.findall(r'<pre id="found">(.*?)</pre>', done.stdout)
    found = json.loads(shown)
    assert found["start"] == found["home"] == "0.000 / 0.400 s"
    assert (found["three"], found["back"]) == ("0.060 / 0.400 s", "0.040 / 0.400 s")
    assert found["end"] == "0.400 / 0.400 s"
    assert found["pictures"] == 7, "each of the actions changes the picture"
    assert (found["plots"], found["legend"]) == (6, True)
    assert found["playing"] == "Pause"
    assert float(found["played"].split()[0]) > 0.0
