"""MuJoCo beside `study contact`: a made-up interpreter instead of one that has it."""

import csv
import sys

import pytest

from dlo_sim.batch.workers import HERE
from dlo_sim.studies import PeerError, Request, contact_peers
from dlo_sim.studies.contact_peers import Peer, compare, find
from dlo_sim.studies.report import Report

# Says that it has MuJoCo 4, and answers jobs of rods with 1 % more than the exact energy; hinges
# with a coarse step fail.
MADE_UP = """
import json, sys
if sys.argv[1] == "-c":
    assert "import mujoco" in sys.argv[2]
    print("a banner", "4.0.0", sep="\\n")
    sys.exit()
assert sys.argv[1].endswith("contact_mujoco.py")
for job in json.load(sys.stdin):
    energy = 0.5 * (job["force"][0] - job["friction"] * job["gravity"]) ** 2
    failed = job["model"] == "hinges" and job["step"] > 9e-3
    print(json.dumps({
        "version": "4.0.0", "values": [1.01 * energy], "seconds": [job["n"] / 10.0],
        "message": "unstable" if failed else "",
    }))
"""


@pytest.fixture
def python(tmp_path):
    path = tmp_path / "python"
    path.write_text(f"#!{sys.executable}\n{MADE_UP}")
    path.chmod(0o755)
    return str(path)


def test_errors_and_run_times_stand_beside_ours(tmp_path, python, monkeypatch):
    peers = find([python])
    assert peers == [Peer(python, "4.0.0")] and peers[0].models == ("flex", "hinges")
    assert Peer(python, "3.17.0").models == ("composite",)
    rods = contact_peers.all_tests()[:1]
    monkeypatch.setattr(contact_peers, "all_tests", lambda: rods)
    report = Report(Request(tmp_path / "out", True, "dlo_sim", HERE), "title", {})
    verdicts = compare(report, peers, True)
    with (tmp_path / "out" / "contact_peers.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["simulator"] for row in rows] == ["MuJoCo 4.0.0, flex", "MuJoCo 4.0.0, hinges"]
    for row in rows:
        assert float(row["error [%]"]) == pytest.approx(1.0, rel=1e-9)
        assert float(row["run time [ms]"]) == pytest.approx(600.0)  # two links, three forces
        ratio = 600.0 / float(row["its run time [ms]"])
        assert float(row["times faster"]) == pytest.approx(ratio, rel=1e-9)
        assert float(row["its error [%]"]) < 1.0
    assert "at 1.00%" in verdicts["sliding rod, the faster cable of MuJoCo takes times as long"]
    assert (tmp_path / "out" / "contact_peers_cost.png").is_file()
    report.outcome(verdicts)
    text = (tmp_path / "out" / "report.md").read_text()
    assert "MuJoCo 4.0.0, hinges on sliding rod: 1 of 5 settings are unstable or refused" in text


def test_an_interpreter_without_mujoco_is_refused(tmp_path):
    bare = tmp_path / "bare"
    bare.write_text(f"#!{sys.executable}\nraise ModuleNotFoundError('no mujoco')\n")
    bare.chmod(0o755)
    with pytest.raises(PeerError, match=f"--peers {bare}: it cannot import mujoco .*no mujoco"):
        find([str(bare)])
    with pytest.raises(PeerError, match="--peers missing: .*; name a Python interpreter"):
        find(["missing"])
