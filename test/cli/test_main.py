"""The command as a whole: subcommands, exit status, one line for what is refused."""

import os
import subprocess
import sys

import pytest

import dlo_sim
from dlo_sim.cli.main import SUBCOMMANDS, main
from dlo_sim.scene.description import markdown_table


def test_version(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"dlo_sim {dlo_sim.__version__}\n"


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_subcommand_has_help(name, capsys):
    try:
        status = main([name, "--help"])
    except SystemExit as end:
        status = end.code
    assert status == 0
    assert f"dlo_sim {name}" in capsys.readouterr().out


def test_module_runs_as_a_program(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "dlo_sim", "simulate", "nowhere.yaml", "--duration", "1"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("dlo_sim: error: nowhere.yaml: does not exist; give a scene")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_reader_that_goes_away_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "dlo_sim", "parameters"],
        stdout=writing,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


def test_defect_is_not_dressed_as_refused_input(monkeypatch):
    def broken(options):
        raise ValueError("a bug")

    monkeypatch.setattr("dlo_sim.cli.parameters.run", broken)
    with pytest.raises(ValueError, match="a bug"):
        main(["parameters"])


def test_node_passes_its_arguments_to_ros(monkeypatch):
    given = []
    monkeypatch.setattr("dlo_sim.ros.main.main", lambda arguments: given.append(arguments) or 0)
    assert main(["node", "--ros-args", "-p", "rate:=50.0"]) == 0
    assert main(["node"]) == 0
    assert given == [["--ros-args", "-p", "rate:=50.0"], []]


def test_parameters_prints_the_table(capsys):
    assert main(["parameters"]) == 0
    assert capsys.readouterr().out == markdown_table() + "\n"


def test_methods_are_listed_with_what_they_can_do(capsys):
    from dlo_sim.core.methods import METHODS

    assert main(["methods"]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split()[:4] == ["method", "order", "symmetric", "symplectic"]
    assert [line.split()[0] for line in lines] == list(METHODS)
    row = next(line for line in lines if line.startswith("forest_ruth")).split()
    assert row[1:7] == ["4", "yes", "yes", "no", "3", "1.5734"]


@pytest.mark.parametrize("arguments", [["methods"], ["parameters"]])
def test_a_full_disk_behind_stdout_is_one_line(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "dlo_sim", *arguments], stdout=full, stderr=subprocess.PIPE
        )
    assert done.returncode == 3
    line = done.stderr.decode()
    assert line.count("\n") == 1 and "standard output: No space left on device" in line


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "paper_wire", "--duration", "0.001", "--output", "loop/run.npz"],
        ["simulate", "loop.yaml", "--duration", "0.001"],
        ["view", "loop"],
        ["view", "loop/run.npz", "--output", "page.html"],
        ["demo", "--output", "loop/demo"],
        ["study", "paper", "--quick", "--output", "loop/study"],
        ["forecast", "hanging_cable", "--plan", "loop", "--output", "run.npz"],
        ["identify", "loop", "--scene", "hanging_cable", "--output", "loop/fitted.yaml"],
        ["tune", "loop.yaml", "--tolerance", "0.1", "--duration", "1", "--output", "tuned.yaml"],
        ["replay", "loop", "--params", "paper_wire", "--output", "loop/bag"],
    ],
)
@pytest.mark.parametrize("gone", [False, True])
def test_links_in_a_circle_and_a_folder_that_is_gone_are_one_line(
    arguments, gone, tmp_path, monkeypatch, capsys
):
    for name in ("loop", "loop.yaml"):
        (tmp_path / name).symlink_to(name)
    folder = tmp_path / "gone" if gone else tmp_path
    folder.mkdir(exist_ok=True)
    monkeypatch.chdir(folder)
    if gone:
        folder.rmdir()
    status = main(arguments)
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.startswith("dlo_sim: error: ") and err.count("\n") == 1
