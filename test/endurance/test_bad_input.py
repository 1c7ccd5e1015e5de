"""Random invalid input: messages, parameters, bags and signals.

Nothing may raise, every output must be finite, and every refusal must be one printable line. Each
test runs a few examples; `pytest test/endurance --hypothesis-profile=long` runs thousands.
"""

import shutil

import numpy as np
import pytest
from bag_files import STORAGES, VALUES, messages, write_bag
from damage import REALS, damage_bag, damaged_message
from hypothesis import given, settings
from hypothesis import strategies as st
from marker_arrays import array, marker
from plans import still_plan

from dlo_sim.replay.bags import Bag, BagError
from dlo_sim.replay.replay import ReplayError, replay_bag
from dlo_sim.scene.description import PARAMETERS
from dlo_sim.scene.loading import scene_from_values
from dlo_sim.session import cdr
from dlo_sim.session.diagnostics import TopicRecord
from dlo_sim.session.plans import answer, request
from dlo_sim.session.session import Session, SessionStatus
from dlo_sim.session.time_base import SECOND
from dlo_sim.session.topics import PLAN

pytestmark = pytest.mark.slow

T0 = 1000 * SECOND
TICK = 5_000_000  # [ns]
SMALL = {
    "cable.length": 0.4,
    "cable.diameter": 0.01,
    "damping.stiffness": 0.05,
    "discretization.control_points": 6,
    "start.clamped": True,
    "start.pose_topic": "/pose",
    "rate": 20.0,  # low, because bit errors in stamps cause gaps of minutes
}
# Every kind of input.
ALL_INPUTS = {
    "cable.diameter": 0.01,
    "cable.youngs_modulus": 1e6,
    "damping.stiffness": 0.02,
    "discretization.control_points": 8,
    "integrator.step": 0.005,
    "start.clamped": True,
    "start.tangent": [1.0, 0.0, 0.0],
    "start.pose_topic": "/pose",
    "start.frame": "tool",
    "end.pose_topic": "/points",
    "end.pose_type": "two_points",
    "end.fixed": [True, True, True],
    "grasps.names": ["hand"],
    "grasps.hand.taken": False,
    "grasps.hand.at": 0.5,
    "grasps.hand.taken_topic": "/taken",
    "loads.names": ["tool", "force"],
    "loads.tool.topic": "/wrench",
    "loads.force.topic": "/force",
    "loads.force.type": "force",
    "loads.force.position": 0.5,
    "outputs.points": True,
    "outputs.capsules": 5,
    "outputs.tf": True,
    "forecast.processes": 1,
    "contact.markers": 3,
}


def check_line(text):
    assert len(text) < 2000 and text.isprintable(), repr(text[:500])


# ---------------------------------------------------------------------------------------- messages


def valid_messages(kind):
    """Topic -> function that makes a valid message with a stamp [ns]."""
    pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
    wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "tool")
    force = cdr.StampedEncoder(cdr.VECTOR3_STAMPED, "world")
    points = cdr.PoseArrayEncoder("world", 2)
    points.rows[:, :3] = (0.79, 0.0, 0.0), (0.81, 0.0, 0.0)
    seen = cdr.PoseArrayEncoder("world", 9)
    seen.rows[:, 0] = np.linspace(0.0, 0.8, 9)

    def measured(stamp_ns):
        if kind == "point_cloud":
            return cdr.encode_point_cloud(stamp_ns, "world", "xyz", seen.rows[:, :3])
        return seen.encode(stamp_ns)

    def plan(stamp_ns):
        return still_plan((100_000_000, 500_000_000), stamp_ns, "world")

    def obstacles(stamp_ns):
        place = (0.4, 0.1 * np.sin(stamp_ns * 2e-9), -0.2)
        gone = marker(1, place, (0.1,) * 3, action=cdr.DELETE)
        return array(stamp_ns, marker(stamp_ns // TICK % 3, place, (0.1,) * 3, cdr.SPHERE), gone)

    return {
        "/dlo_sim/obstacles": obstacles,
        "/pose": lambda t: pose.encode(t, (0.0, 0.02 * np.sin(t * 3e-9), 0.0, 0, 0, 0, 1)),
        "/points": points.encode,
        "/wrench": lambda t: wrench.encode(t, (0.01, 0.0, 0.02, 0.0, 0.0, 0.0)),
        "/force": lambda t: force.encode(t, (0.0, 0.01, 0.0)),
        "/taken": lambda t: b"\0\1\0\0" + bytes([t // TICK % 2]),
        "/dlo_sim/measured": measured,
        PLAN: plan,
    }


class World:
    """A session with a simulated clock, and messages for it."""

    def __init__(self, kind):
        self.now = T0
        scene = scene_from_values({**ALL_INPUTS, "measured.type": kind})
        self.session = Session(scene, live=True)
        self.plans = TopicRecord(PLAN)
        self.made = valid_messages(kind)

    def send(self, rng):
        """Send a message, three in four of them damaged, and check what a refusal says."""
        topic = rng.choice(list(self.made))
        raw = self.made[topic](self.now - rng.choice((0, 0, TICK, -TICK)))
        if rng.random() < 0.75:
            raw = damaged_message(rng, raw)
        record = self.plans if topic == PLAN else self.session.journal.topics[topic]
        refused = record.refusals
        if topic == PLAN:
            refusal = answer(request(self.session, raw, self.now)).refused
            if refusal is not None:
                self.plans.refuse(*refusal)
        else:
            self.session.receive(topic, raw, self.now)
        if record.refusals > refused:
            check_line(record.last_refusal)

    def tick(self):
        """Advance the clock by a tick and check that the outputs are finite."""
        self.now += TICK
        self.session.tick(self.now)
        if self.session.status is SessionStatus.FAILED:
            self.session.reset()
        for message in self.session.messages():
            numbers = {cdr.POSE_ARRAY: 56 * 8, cdr.WRENCH_STAMPED: 48}.get(message.type, 0)
            tail = message.data[len(message.data) - numbers :]
            assert np.isfinite(np.frombuffer(tail, "<f8")).all(), message.topic
        if self.now % SECOND == 0:
            self.session.diagnostics(self.now)


@given(st.sampled_from(("point_cloud", "pose_array")), st.randoms(use_true_random=False))
def test_no_message_makes_a_session_raise_or_publish_nonsense(kind, rng):
    world = World(kind)
    for _ in range(100):
        world.send(rng)
        if rng.random() < 0.2:
            world.tick()


@pytest.mark.parametrize("kind", ["point_cloud", "pose_array"])
def test_valid_messages_are_used_after_invalid_ones(kind):
    world = World(kind)

    @settings(max_examples=1, derandomize=True)
    @given(st.randoms(use_true_random=False))
    def disturb(rng):
        for _ in range(300):
            world.send(rng)
            world.tick()

    disturb()
    assert world.session.journal.refused.total() > 50
    world.session.reset()
    good = [topic for topic in world.made if topic in ("/pose", "/points", "/wrench")]
    records = [world.session.journal.topics[topic] for topic in good]
    for number in range(300):
        if number == 200:  # messages from before the reset may wait for a second
            before = [record.refusals for record in records]
        world.tick()
        for topic in good:
            world.session.receive(topic, world.made[topic](world.now), world.now)
    assert world.session.status is SessionStatus.RUNNING
    assert [record.refusals for record in records] == before, [r.last_refusal for r in records]


# -------------------------------------------------------------------------------------- parameters

WRONG = st.sampled_from(
    (*REALS, -1, 2**70, "", "x" * 999, True, [], [1.0] * 3, {}, None, "\n")  # of another type
)


def values_of(row):
    """Values for a parameter: three in four of its type, valid or not."""
    low = row.low or 0
    if row.choices:
        one = st.sampled_from(row.choices)
    elif row.element_kind == "bool":
        one = st.booleans()
    elif row.element_kind == "string":
        one = st.sampled_from(("", "start", "/x", "a b", "tip"))
    elif row.element_kind == "integer":
        one = st.sampled_from((low, -3)) | st.integers(4, 40)
    else:
        one = st.just(low) | st.floats(-6, 6).map(lambda power: 10.0**power)
    if row.is_array:
        one = st.lists(one, min_size=row.length or 0, max_size=(row.length or 3) + 1)
    return st.integers(0, 3).flatmap(lambda kind: WRONG if kind == 0 else one)


PARAMETER_SETS = st.lists(
    st.lists(st.sampled_from(PARAMETERS), min_size=1, max_size=4, unique_by=lambda row: row.key)
    .map(lambda rows: {row.key: values_of(row) for row in rows})
    .flatmap(st.fixed_dictionaries),
    min_size=1,
    max_size=5,
)


@given(PARAMETER_SETS)
def test_any_parameters_are_taken_or_refused_in_one_line(changes):
    session, now = Session(scene_from_values({**SMALL, "start.pose_topic": ""})), T0
    for values in changes:
        try:
            session.reconfigure(session.scene.with_values(values))
        except ValueError as refusal:
            check_line(str(refusal))
            continue
        for _ in range(5):
            now += TICK
            session.tick(now)


# --------------------------------------------------------------------------------- bags and signals


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Bags of both kinds with poses of a gripper and wrenches for 1.5 s."""
    folder = tmp_path_factory.mktemp("bags")
    for storage in STORAGES:
        write_bag(folder / storage, messages(), storage=storage)
    return folder


@given(st.sampled_from(STORAGES), st.randoms(use_true_random=False))
def test_a_damaged_bag_is_replayed_or_refused_in_one_line(bags, tmp_path_factory, storage, rng):
    path = tmp_path_factory.mktemp("damaged") / "bag"
    shutil.copytree(bags / storage, path)
    for _ in range(rng.choice((1, 1, 3))):
        damage_bag(rng, path)
    try:
        damage = Bag(path).damage
        assert len(damage) < 500 and "\n" not in damage
        replay_bag(path, scene_from_values({**VALUES, "rate": SMALL["rate"]}), None)
    except (BagError, ReplayError) as refusal:
        check_line(str(refusal))
    shutil.rmtree(path)
