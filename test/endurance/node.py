"""The node under disturbance, load and overload, measured from another process.

    python test/endurance/node.py [SECONDS]

runs the node for so many seconds (default: half an hour) with disturbances, and then shorter cases,
and prints what was measured:

disturbed  a change of a parameter every second; in each minute the process is stopped for 1.5 s, a
           publisher is silent for 3 s, and all stamps jump by an hour for 6 s
rates      age and jitter of the outputs, and processor time
overload   the process is stopped for 92 % of each 50 ms: what is shed, and when

Age is arrival minus stamp of ~/control_points, jitter the deviation of the time between two
arrivals from the period.
"""

import itertools
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

os.environ |= {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # a stopped process would keep shared memory locked
}
sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("endurance", "ros", "")]

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from node_harness import START, NodeProcess, Peer, write_params
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from soak import gripper

from dlo_sim.scene.loading import load_scene, scene_values
from dlo_sim.session import cdr

SECOND = 1_000_000_000
WRENCH, CONTROL_POINTS = "/dlo_sim/hand/wrench", "/dlo_sim/control_points"
POSES = {f"/dlo_sim/{end}/pose": end for end in ("start", "end")}
CHANGES = (
    {"damping.air_drag": 0.006},
    {"outputs.marker_rate": 20.0},
    {"accuracy.estimate": "off"},
    {"accuracy.estimate": "auto"},
    {"damping.air_drag": 0.005, "outputs.marker_rate": 30.0},
)


class Run:
    """A node and a peer that publishes poses and wrenches to it, and notes what it answers.

    Attributes:
        arrivals: (arrival, stamp) [ns] of the control points. said: /diagnostics, (time [s],
            name -> key -> value). silent: topics not published. shift: added to the stamps [s].
    """

    def __init__(self, rate, n, poses=100.0, **values):
        scene = {
            "discretization.control_points": n,
            "rate": rate,
            "integrator.step": 1.0 / rate,
            "loads.names": ["hand"],
            "loads.hand.position": 0.5,
        }
        self.rate, self.poses = rate, poses
        self.arrivals, self.said, self.silent, self.shift = [], [], set(), 0.0
        self._folder, self._ended = tempfile.TemporaryDirectory(), False
        domain = 1 + next(DOMAINS) % 100
        self.peer = Peer(domain)
        changed = load_scene("two_grippers", scene | values)
        folder = Path(self._folder.name)
        params = write_params(folder, scene_values(changed))
        arguments = ["--ros-args", "--params-file", str(params)]
        self.node = NodeProcess(domain, folder / "log.txt", arguments)

    def __enter__(self):
        node = self.peer.node
        self._publishers = {
            topic: node.create_publisher(kind, topic, qos_profile_sensor_data)
            for topic, kind in {**dict.fromkeys(POSES, PoseStamped), WRENCH: WrenchStamped}.items()
        }
        deep = QoSProfile(depth=1000)
        node.create_subscription(PoseArray, CONTROL_POINTS, self._note, deep, raw=True)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._listen, deep)
        self._set = node.create_client(
            SetParametersAtomically, "/dlo_sim/set_parameters_atomically"
        )
        self.peer.watched = self.node
        heard = lambda: all(p.get_subscription_count() for p in self._publishers.values())  # noqa: E731
        self.peer.until(heard, "node", START)
        self.begin = time.time()
        threading.Thread(target=self._publish, daemon=True).start()
        return self

    def __exit__(self, *_):
        self._ended = True
        self.node.end()
        self.peer.close()
        self._folder.cleanup()

    @property
    def now(self):
        """Time [s] since the messages began."""
        return time.time() - self.begin

    def _publish(self):
        pose = cdr.StampedEncoder(cdr.POSE_STAMPED, "world")
        wrench = cdr.StampedEncoder(cdr.WRENCH_STAMPED, "world")
        for k in itertools.count():
            t = k / self.poses
            time.sleep(max(0.0, t - self.now))
            if self._ended:
                return
            stamp = round((self.begin + t + self.shift) * SECOND)
            for topic, publisher in self._publishers.items():
                if topic not in self.silent:
                    force = (0.0, 0.02 * np.sin(2.0 * np.pi * t), 0.0, 0.0, 0.0, 0.0)
                    turn = topic in POSES and pose.encode(stamp, gripper(POSES[topic], t))
                    publisher.publish(turn or wrench.encode(stamp, force))

    def _note(self, raw):
        seconds, nanoseconds = np.frombuffer(raw, "<i4", 2, 4).tolist()
        self.arrivals.append((time.time_ns(), seconds * SECOND + nanoseconds))

    def _listen(self, array):
        values = {s.name: {v.key: v.value for v in s.values} for s in array.status}
        self.said.append((self.now, values))

    def until(self, seconds):
        """Listen until a time [s] since the messages began."""
        self.peer.until(lambda: self.now >= seconds, "end", seconds + 60.0)

    def stop(self, seconds):
        """Stop the process for so long."""
        self.node.process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self.node.process.send_signal(signal.SIGCONT)

    def set(self, values):
        """Set parameters of the running node."""
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        self._set.call_async(SetParametersAtomically.Request(parameters=parameters))

    def counts(self, key, status="session"):
        """(time [s], value) of a counter in /diagnostics, whenever it changed."""
        found, last = [], 0
        for at, values in self.said:
            value = int(values.get(f"/dlo_sim: {status}", {}).get(key, last))
            if value != last:
                found.append((at, value))
            last = value
        return found

    def count(self, key, status="session"):
        """The last value of a counter."""
        return ([0] + [value for _, value in self.counts(key, status)])[-1]

    def look(self):
        """Processor time [s], resident memory [MB], open files and threads of the node."""
        place = Path(f"/proc/{self.node.process.pid}")
        fields = (place / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
        spent = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        memory = int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        counts = (len(os.listdir(place / name)) for name in ("fd", "task"))
        return np.array([spent, memory, *counts])

    def age(self):
        """Median and 99th percentile of the age, 99th percentile of the jitter [ms], without the
        first two seconds."""
        arrival, stamp = np.array(self.arrivals).T * 1e-6
        late = arrival > 1e3 * (self.begin + 2.0)
        arrival, stamp = arrival[late], stamp[late]
        jitter = np.abs(np.diff(arrival) - 1e3 / self.rate)
        return *np.percentile(arrival - stamp, [50.0, 99.0]), np.percentile(jitter, 99.0)


DOMAINS = itertools.count(os.getpid())


def disturbed(seconds):
    """Parameters, stops, silence and jumps of the stamps; prints what grew and what was refused."""
    with Run(200.0, 13) as run:
        first = None
        for second in range(1, round(seconds)):
            run.until(float(second))
            minute = second % 60 if seconds > 60.0 else second * 60 // round(seconds)
            run.set(CHANGES[second % len(CHANGES)])
            if minute == 20:
                run.stop(1.5)
            run.silent = {"/dlo_sim/end/pose"} if 36 <= minute < 39 else set()
            run.shift = 3600.0 if 48 <= minute < 54 else 0.0
            if second == round(seconds) // 5:
                first = run.look()
        grown = run.look() - first
        print(
            f"disturbed for {seconds:g} s: {grown[1]:+.2f} MB, files {grown[2]:+g}, threads "
            f"{grown[3]:+g} after a fifth; {run.count('messages refused')} messages refused, at "
            f"{[round(at) for at, _ in run.counts('messages refused')]} s; exit status "
            f"{run.node.stop()}"
        )


def rates(seconds):
    """Age, jitter and processor time of demanding cases."""
    print("\nrate [Hz] | n_u | age [ms] | 99 % | jitter 99 % | late ticks | share of a core")
    for rate, n, poses in ((1000.0, 13, 500.0), (200.0, 50, 100.0)):
        with Run(rate, n, poses) as run:
            run.until(1.0)
            before = run.look()[0]
            run.until(seconds)
            share, late = (
                (run.look()[0] - before) / (seconds - 1.0),
                run.count("late ticks", "node"),
            )
            age = " | ".join(f"{one:.2f}" for one in run.age())
            print(f"{rate:g} | {n} | {age} | {late} | {share:.2f}", flush=True)


def overload(begin, end, seconds):
    """Too little processor time for a while: when what was shed, and when it was taken up."""
    print("\ntime [s] | event | count so far")
    with Run(200.0, 50) as run:

        def starve():
            while run.now < end:
                run.stop(0.046)
                time.sleep(0.004)

        run.until(begin)
        threading.Thread(target=starve).start()
        run.until(seconds)
        for name in ("markers_spared", "estimate_spared", "time_skipped", "taken_up"):
            for at, count in run.counts(f"event {name}"):
                print(f"{at:.0f} | {name} | {count}")


if __name__ == "__main__":
    asked = float(sys.argv[1] if sys.argv[1:] else 1800.0)
    short = min(1.0, asked / 120.0)
    disturbed(asked)
    rates(max(8.0, 60.0 * short))
    overload(3.0, 3.0 + 20.0 * max(short, 0.45), 3.0 + 70.0 * max(short, 0.3))
