"""What is found of an installation and of the environment of ROS."""

import pytest

from dlo_sim.doctor.findings import cache, installation, ros_environment


def test_this_installation_has_no_problem():
    levels = [finding.level for finding in installation()]
    assert len(levels) == 3 and "problem" not in levels


def test_machine_code_is_there_or_why_it_is_not(tmp_path):
    mine = tmp_path / "abc"
    assert cache(tmp_path, mine, "").level == "note"
    mine.mkdir()
    assert cache(tmp_path, mine, "").level == "note", "nothing in it"
    (mine / "methods").touch()
    assert cache(tmp_path, mine, "").level == "ok"
    assert cache(tmp_path / "not" / "yet", mine, "").level == "ok"
    untrusted = cache(tmp_path, mine, "others may write to it")
    assert untrusted.level == "problem" and "others may write" in untrusted.what


@pytest.mark.parametrize(
    ("variables", "levels", "what"),
    [
        ({}, ["ok"], "ROS_DOMAIN_ID is 0"),
        ({"ROS_DOMAIN_ID": "42"}, ["ok"], "ROS_DOMAIN_ID is 42"),
        ({"ROS_DOMAIN_ID": "102"}, ["note"], "ROS_DOMAIN_ID is 102"),
        ({"ROS_DOMAIN_ID": "233"}, ["problem"], "'233', which is not a domain"),
        ({"ROS_DOMAIN_ID": "left"}, ["problem"], "'left', which is not a domain"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
            ["ok", "problem"],
            "nodes cannot find each other",
        ),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "HERE"}, ["ok", "problem"], "'HERE', which ROS does"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, ["ok", "note"], "only nodes on this"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, ["ok"], "ROS_DOMAIN_ID is 0"),
        ({"ROS_LOCALHOST_ONLY": "1"}, ["ok", "note"], "only nodes on this machine"),
    ],
)
def test_what_variables_of_ros_do_to_nodes_is_named(variables, levels, what):
    found = list(ros_environment(variables))
    assert [finding.level for finding in found] == levels
    assert what in found[-1].what
    assert all(finding.cure for finding in found if finding.level != "ok")
