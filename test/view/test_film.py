"""Films, stills and plots, without a display."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="needs matplotlib: pip install matplotlib")

from matplotlib.animation import FFMpegWriter
from PIL import Image

from dlo_sim.view.film import NoFilm, write_film, write_plots, write_still
from dlo_sim.view.run import Body, Run, read_run


def test_gif_runs_in_the_time_of_the_run(made, tmp_path):
    fractions = []
    write_film(read_run(made.bag, made.scene), tmp_path / "film", "gif", fractions.append)
    with Image.open(tmp_path / "film") as film:
        assert film.format == "GIF"
        assert film.n_frames == 4
        assert film.n_frames * film.info["duration"] == pytest.approx(400, abs=40)
    assert fractions[-1] == 1.0
    assert [path.name for path in tmp_path.iterdir()] == ["film"]


def test_mp4_without_ffmpeg_is_refused(made, tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(NoFilm, match="needs ffmpeg, which is not installed; install it, or make a"):
        write_film(read_run(made.recording), tmp_path / "film", "mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("write", [write_still, write_plots])
@pytest.mark.parametrize("scene", [True, False])
def test_stills_and_plots_are_pictures(made, tmp_path, write, scene):
    write(read_run(made.bag, made.scene if scene else None), tmp_path / "picture")
    with Image.open(tmp_path / "picture") as picture:
        assert picture.format == "PNG"
        assert len(picture.convert("RGB").getcolors(1_000_000)) > 50


def test_a_still_shows_obstacles_within_its_limits(made, tmp_path):
    """A table that is far larger than the cable hides none of it and does not leave the axes."""
    run = read_run(made.recording)
    table = Body(np.array([[[-9.0, -9, -0.1], [9, -9, -0.1], [0, 9, -0.1]]]), np.eye(7)[[6] * 21])
    grays = []
    for bodies in ((), (table,)):
        write_still(replace(run, bodies=bodies, looks=None), tmp_path / "picture")
        with Image.open(tmp_path / "picture") as picture:
            shown = np.array(picture.convert("RGB")).astype(int)
        edge = np.concatenate([shown[:40].reshape(-1, 3), shown[:, :12].reshape(-1, 3)])
        assert np.all(edge == 255), "nothing beyond the axes"
        grays.append(np.count_nonzero((np.ptp(shown, axis=2) < 4) & (shown[..., 0] < 240)))
    assert grays[1] > grays[0] + 5000


@pytest.mark.parametrize("write", [write_still, write_plots])
@pytest.mark.parametrize("scale", [1e-30, 1e30, 1e37])
def test_any_size_and_any_name_is_drawn(tmp_path, write, scale):
    """Forces at an end that is called as a formula that is none; a cable of no size or any."""
    line = scale * np.random.default_rng(1).normal(size=(2, 5, 3))
    values = {r"tension $\frac$": np.full((2, 5), scale)}
    forces = {r"$\frac$": np.full((2, 3), -3e38)}
    run = Run(r"$\frac$", np.array([0.0, 0.1]), line, line, values, reactions=forces)
    write(run, tmp_path / "picture")
    with Image.open(tmp_path / "picture") as picture:
        assert picture.format == "PNG"
