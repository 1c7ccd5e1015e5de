"""Files that mean harm: within bounds of time and memory, one line each, by every reader."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from dlo_sim.ros.arguments import read_arguments
from dlo_sim.scene.description import scene_parameters
from dlo_sim.scene.loading import load_scene, parse_assignment
from dlo_sim.scene.refusal import SceneError

# Nine lists of nine, each within the next: 607 bytes stand for 4e8 texts.
BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{to}: &{to} [{', '.join([f'*{of}'] * 9)}]\n"
    for of, to in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "alias '*a' is not supported": BOMB,
    "alias '*b' is not supported": "/**: {ros__parameters: {cable: &b {length: 1.0}, end: *b}}",
    "nests deeper than 32 levels": "/**: {ros__parameters: {a: " + "[" * 900 + "]" * 900 + "}}",
    "line 32: nests deeper": "\n".join(" " * level + "a:" for level in range(900)),
    "holds more than 1000000 bytes": "#" * 1_000_001,
}


def read_by_the_node(path: Path) -> None:
    with read_arguments(["--ros-args", "--params-file", str(path)]):
        pass


READERS = [load_scene, read_by_the_node]


@pytest.mark.parametrize("read", READERS)
@pytest.mark.parametrize("complaint", HOSTILE)
def test_hostile_files_are_refused_within_bounds(tmp_path, read, complaint):
    path = tmp_path / "scene.yaml"
    path.write_text(HOSTILE[complaint])
    with pytest.raises(SceneError) as refusal:
        read(path)
    message = str(refusal.value)
    assert message.startswith(f"{path}: ") and complaint in message and len(message) < 500


def test_keys_and_values_are_counted():
    with pytest.raises(SceneError, match="holds more than 20000 keys and values"):
        parse_assignment("gravity=[" + "1," * 20_000 + "1]")


@pytest.mark.parametrize("read", READERS)
def test_a_file_of_100_megabytes_is_not_read_to_its_end(tmp_path, read):
    path = tmp_path / "scene.yaml"
    with path.open("wb") as file:
        file.truncate(100_000_000)
    with pytest.raises(SceneError, match="holds more than 1000000 bytes"):
        read(path)


@pytest.mark.parametrize("command", ["simulate", "node"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_is_not_a_regular_file_is_refused_at_once(tmp_path, command, kind):
    path = tmp_path / "scene.yaml"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    arguments = [str(path), "--duration", "0.1"]
    if command == "node":
        pytest.importorskip("rclpy", reason="needs rclpy: pip install 'dlo_sim[ros]'")
        arguments = ["--ros-args", "--params-file", str(path)]
    done = subprocess.run(
        [sys.executable, "-m", "dlo_sim", command, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"{path}: is not a regular file" in line


def test_values_on_the_command_line_have_the_same_bounds():
    for value in ("[&a 1, *a]", "[" * 40 + "]" * 40):
        with pytest.raises(SceneError):
            parse_assignment(f"gravity={value}")
        given = ["--ros-args", "-p", f"gravity:={value}"]
        with pytest.raises(SceneError), read_arguments(given):
            pass


SCALARS = """.nan -.inf 1e400 0x""".split() + [
    *("9" * 5000, "0b", "._", "2020-13-45", "1:30:00", "!!binary $$$", "!!set {a, b}", "!!int abc"),
    *(
        "!!python/object/apply:os.system ['true']",
        "!!timestamp x",
        "!!omap [a: 1]",
        "!!float .",
        "!",
    ),
    *(
        '"\\ud800"',
        '"\\Uffffffff"',
        '"\\e[31m"',
        "|\n  text",
        "&a 1",
        "*a",
        "{a: 1, a: 2}",
        "[[1]]",
    ),
    *(
        "[1, .nan, x]",
        "[true, 1, 2.0]",
        "@x",
        "%x",
        "? [1]: 2",
        "a: b: c",
        "<<: {a: 1}",
        "\t1",
        "---",
    ),
    *("\ufeff", "\x7f", "x" * 3000, "!!merge <<", "=", "<<", "!<>", "!!null x", "...", "'", '"'),
]
KEYS = ["<<", "? a", "1", "true", "null", '"\\ud800"', "[1]", "{a: 1}", "!!int x", "loads.names"]
BYTES = [
    b"\t",
    b"\0",
    b"&a ",
    b"*a",
    b"<<: ",
    b": ",
    b"- ",
    b"[",
    b"{",
    b"}",
    b"\xff",
    b"\xef\xbb\xbf",
]
BYTES += [b"\r", b"!!", b"|", b"'", b'"', b"#", b"\n---\n", b"\n...\n", b"%YAML 9.9\n", b"\xc2\x85"]


def hostile_file(rng: random.Random, shipped: bytes) -> bytes:
    """A block of odd values, or a shipped scene, with some bytes changed."""
    keys = KEYS + [row.key for row in scene_parameters(("tip",))]
    lines = [f"    {rng.choice(keys)}: {rng.choice(SCALARS)}" for _ in range(rng.randint(1, 4))]
    block = "/**:\n  ros__parameters:\n" + "\n".join(lines) + "\n"
    data = bytearray(rng.choice([block.encode(), shipped]))
    for _ in range(rng.randrange(4)):
        at = rng.randrange(len(data))
        data[at : at + rng.randrange(4)] = rng.choice(BYTES)
    return bytes(data)


def test_whatever_a_file_holds_it_is_a_scene_or_one_line(tmp_path, checkout):
    rng = random.Random(13)
    shipped = (checkout / "config" / "two_grippers.yaml").read_bytes()
    path = tmp_path / "scene.yaml"
    refused = 0
    for _ in range(120):
        path.write_bytes(hostile_file(rng, shipped))
        for read in READERS:
            try:
                read(path)
            except SceneError as refusal:
                assert str(refusal).isprintable()
                refused += 1
    assert 120 < refused < 240
