"""What a session makes of the error estimate: diagnostics, warning with a cure, sparing it."""

from __future__ import annotations

import math

import pytest
from cables import merged
from fake_simulator import FakeSimulator
from session_bench import FREE, MS, SECOND, FakeEstimate

from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import drive
from dlo_sim.session.session import Session
from dlo_sim.simulation.report import DiscretizationError

T0 = 100 * SECOND


@pytest.fixture
def estimates(monkeypatch):
    """The estimates that sessions make."""
    made: list[FakeEstimate] = []

    def make(simulator, begins=False):
        made.append(FakeEstimate(simulator))
        return made[-1]

    monkeypatch.setattr(drive, "_estimate", make)
    return made


def session(live=True, **changes) -> Session:
    return Session(scene_from_values(merged(FREE, **changes)), FakeSimulator, live=live)


def found(one: Session) -> tuple[int, str, dict[str, str]]:
    """Level, message and values of the session's diagnostic status."""
    from rosbags.typesys import Stores, get_typestore

    from dlo_sim.session import cdr

    store = get_typestore(Stores.ROS2_JAZZY)
    array = store.deserialize_cdr(one.diagnostics(T0), cdr.DIAGNOSTIC_ARRAY)
    status = array.status[0]
    return status.level, status.message, {v.key: v.value for v in status.values}


@pytest.mark.parametrize(
    ("live", "setting", "expected"),
    [(True, "auto", True), (False, "auto", True), (False, "on", True), (True, "off", False)],
)
def test_every_session_estimates_its_error_unless_it_is_off(estimates, live, setting, expected):
    one = session(live, accuracy__estimate=setting)
    one.tick(T0)
    one.tick(T0 + 5 * MS)
    assert bool(estimates) is expected
    values = found(one)[2]
    assert values["error estimate [m]"] == ("3e-05" if expected else "off")
    assert ("space error [m]" in values) is expected


def test_what_the_model_does_not_show_is_a_warning_that_hides_no_other(estimates):
    one = session()
    one.tick(T0)
    assert found(one)[0] == 0
    one.simulator.warnings = ("terms.gravity: off",)
    level, message, values = found(one)
    assert (level, message, values["warnings"]) == (1, "terms.gravity: off", "terms.gravity: off")
    estimates[0].recent = DiscretizationError(1e-5, 4e-3)
    one.tick(T0 + 5 * MS)
    level, message, values = found(one)
    assert (level, values["warnings"]) == (1, "terms.gravity: off")
    assert "terms.gravity" not in message


@pytest.mark.parametrize(
    ("changes", "advised"),
    [
        ({}, True),
        ({"discretization__stretch": "span"}, False),
        ({"discretization__quadrature": "uniform", "discretization__samples": 101}, False),
        ({"discretization__control_points": 4}, False),
        ({"terms__bend": "off"}, False),
        ({"cable__axial_stiffness": 3.9}, False),
        ({"cable__axial_stiffness": 4.1}, True),
    ],
)
def test_a_thin_cable_is_advised_to_stretch_by_span(estimates, changes, advised):
    """Beyond EA h^2 / EI = 200; here h is 0.5 m."""
    thin = {"cable__axial_stiffness": 1e5, "cable__bending_stiffness": 5e-3} | changes
    one = session(cable__length=1.0, **thin)
    one.tick(T0)
    estimates[0].recent = DiscretizationError(1e-5, 4e-3)
    one.tick(T0 + 5 * MS)
    message = found(one)[1]
    assert "raise discretization.control_points to " in message
    assert ("discretization.stretch: span may do as well" in message) is advised


def test_excess_is_a_warning_while_it_lasts_and_an_event_once(estimates):
    one = session()
    one.tick(T0)
    assert found(one)[0] == 0
    estimates[0].recent = DiscretizationError(1e-5, 4e-3)
    for k in range(1, 4):
        one.tick(T0 + k * 5 * MS)
        level, message, values = found(one)
        assert level == 1
        assert "0.004 m exceeds accuracy.target 0.001 m" in message
        assert "raise discretization.control_points to 8" in message
        assert values["space error [m]"] == "0.004"
    assert one.journal.events["inaccurate"] == 1
    estimates[0].recent = DiscretizationError(0.0, 4e-4)
    one.tick(T0 + 30 * MS)
    assert found(one)[0] == 0
    estimates[0].recent = DiscretizationError(2e-3, 1e-4)
    one.tick(T0 + 35 * MS)
    assert "lower integrator.step to 0.00061 s" in found(one)[1]
    assert one.journal.events["inaccurate"] == 2


def test_unknown_error_is_told(estimates):
    one = session()
    one.tick(T0)
    estimates[0].recent = DiscretizationError(0.0, math.inf, "the finer run failed: why")
    one.tick(T0 + 5 * MS)
    level, message, values = found(one)
    assert level == 1
    assert "unknown: the finer run failed: why" in message
    assert values["space error [m]"] == "unknown"


def test_reset_and_changed_parameters_estimate_anew(estimates):
    one = session()
    one.tick(T0)
    one.reset()
    assert found(one)[2]["error estimate [m]"] == "off"
    one.tick(T0 + 5 * MS)
    one.reconfigure(one.scene.with_values({"discretization.control_points": 9}))
    assert len(estimates) == 3
    one.reconfigure(one.scene.with_values({"accuracy.estimate": "off"}))
    one.tick(T0 + 10 * MS)
    assert len(estimates) == 3
    assert found(one)[2]["error estimate [m]"] == "off"
