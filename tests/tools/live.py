"""`ipslam live` beside another implementation of DDS: a simulated drive is published faster than it was driven.

    python tests/tools/live.py target/debug/ipslam

needs the package cyclonedds, and a program with the recorder. All of it is in a network of its own, where nobody else is.
"""

import bisect
import ctypes
import fcntl
import json
import math
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Times as fast as it was driven.
SPEED = 6.0
# Of the drive [s].
DURATION = 120
# Stamps of the log begin at 0.
FIRST_STAMP = 1_700_000_000
SMALL = ["--backend", "cpu", "--particles", "64", "--maps", "4"]
# Chance decides where so few particles end: two runs with other seeds are 0.26 m apart at most, and the motions of ten seconds
# differ by less than 0.03 m in all but one of twenty.
NEAR = 0.5
NEAR_MOTIONS = 0.06
# Of the gyroscope, which hangs upside down [rad/s].
BIAS = 0.02
# Of online poses to smoothed ones, and in the finished map.
NEAR_SMOOTHED = 0.3


def alone():
    """Moves this process to a network of its own, whose loopback has multicast."""
    new_user, new_network = 0x10000000, 0x40000000
    if ctypes.CDLL(None, use_errno=True).unshare(new_network | (new_user if os.getuid() else 0)) != 0:
        print(f"NOT TESTED: ipslam live, as there is no network of its own: {os.strerror(ctypes.get_errno())}")
        sys.exit(0)
    up, running, multicast, set_flags = 0x1, 0x40, 0x1000, 0x8914
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as some:
        fcntl.ioctl(some, set_flags, struct.pack("16sh14x", b"lo", up | running | multicast))


alone()
os.environ["CYCLONEDDS_URI"] = (
    '<General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>'
)

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402
from ros_messages import (  # noqa: E402
    DiagnosticArray,
    Empty,
    Header,
    Imu,
    LaserScan,
    MarkerArray,
    OccupancyGrid,
    Odometry,
    Pose,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    TFMessage,
    Time,
    TransformStamped,
    Twist,
    TwistWithCovariance,
    Vector3,
)

BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(10))
RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
LATCHED = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1)
)
ORIGIN = Vector3(0.0, 0.0, 0.0)


def stamp(seconds):
    return Time(FIRST_STAMP + math.floor(seconds), int((seconds % 1) * 1e9))


def seconds(time):
    return time.sec - FIRST_STAMP + time.nanosec / 1e9


def pose(x, y, heading):
    return Pose(Vector3(x, y, 0.0), Quaternion(0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)))


def plane(pose):
    return pose.position.x, pose.position.y, 2 * math.atan2(pose.orientation.z, pose.orientation.w)


def moved(a, b):
    """The pose b, which is seen from a."""
    return a[0] + math.cos(a[2]) * b[0] - math.sin(a[2]) * b[1], a[1] + math.sin(a[2]) * b[0] + math.cos(a[2]) * b[1], a[2] + b[2]


def read_log(path):
    """Stamps, and what is published then: a scan or the pose by odometry."""
    entries = []
    for line in path.read_text().splitlines():
        kind, *fields = line.split()
        if kind == "ODOM":
            entries.append((float(fields[6]), kind, tuple(map(float, fields[:3]))))
        elif kind == "ROBOTLASER1":
            count = int(fields[7])
            laser = (float(fields[1]), float(fields[3]), list(map(float, fields[8 : 8 + count])))
            entries.append((float(fields[-3]), kind, laser))
    return entries


def read_trajectory(path):
    rows = [list(map(float, line.split())) for line in path.read_text().splitlines() if not line.startswith("#")]
    return {round(t, 3): (x, y, 2 * math.atan2(z, w)) for t, x, y, _, _, _, z, w in rows}


def read_turn_rates(path):
    """The rate of rotation at any time, by true poses [rad/s]."""
    poses = sorted(read_trajectory(path).items())
    stamps = [stamp for stamp, _ in poses]

    def rate(when):
        after = min(max(bisect.bisect(stamps, when), 1), len(stamps) - 1)
        turn = poses[after][1][2] - poses[after - 1][1][2]
        return math.remainder(turn, math.tau) / (stamps[after] - stamps[after - 1])

    return rate


class Robot:
    """Publishes what a robot does, and keeps what it gets."""

    def __init__(self, turn_rate=None):
        self.turn_rate = turn_rate
        self.participant = DomainParticipant(0)
        self.odometry = self.writer("odom", Odometry, RELIABLE)
        self.given = {}

    def writer(self, topic, kind, qos):
        return DataWriter(self.participant, Topic(self.participant, "rt/" + topic, kind), qos=qos)

    def reader(self, topic, kind, qos):
        return DataReader(self.participant, Topic(self.participant, "rt/" + topic, kind), qos=qos)

    def listen(self):
        topics = {
            "tf": (TFMessage, RELIABLE),
            "map": (OccupancyGrid, LATCHED),
            "pose": (PoseWithCovarianceStamped, RELIABLE),
            "walls": (MarkerArray, LATCHED),
            "diagnostics": (DiagnosticArray, RELIABLE),
        }
        self.readers = {name: self.reader(name, *how) for name, how in topics.items()}
        self.given = {name: [] for name in topics}

    def take(self):
        for name, reader in self.readers.items():
            self.given[name] += reader.take(100)

    def begin_to_scan(self):
        self.scans, self.fixed = self.writer("scan", LaserScan, BEST_EFFORT), self.writer("tf_static", TFMessage, LATCHED)
        self.imu = self.writer("imu/data", Imu, BEST_EFFORT)
        mounting = TransformStamped(Header(stamp(0), "base_link"), "laser", pose(0.1, 0.0, 0.0))
        upside_down = Pose(ORIGIN, Quaternion(1.0, 0.0, 0.0, 0.0))
        self.fixed.write(TFMessage([mounting, TransformStamped(Header(stamp(0), "base_link"), "imu", upside_down)]))
        writers = self.scans, self.fixed, self.odometry, self.imu
        wait_until("its topics are taken", lambda: all(writer.get_matched_subscriptions() for writer in writers))

    def drive(self, entries, meanwhile=lambda seconds: None):
        began, first = time.monotonic(), entries[0][0]
        for when, kind, what in entries:
            time.sleep(max(0.0, began + (when - first) / SPEED - time.monotonic()))
            if kind == "ODOM":
                twist = TwistWithCovariance(Twist(ORIGIN, ORIGIN), [0.0] * 36)
                by_odometry = PoseWithCovariance(pose(*what), [0.0] * 36)
                self.odometry.write(Odometry(Header(stamp(when), "odom"), "base_link", by_odometry, twist))
                # Fifty a second.
                for before in (0.08, 0.06, 0.04, 0.02, 0.0) if self.turn_rate else ():
                    rate, none = Vector3(0.0, 0.0, BIAS - self.turn_rate(when - before)), [0.0] * 9
                    upright = Quaternion(0.0, 0.0, 0.0, 1.0)
                    self.imu.write(Imu(Header(stamp(max(when - before, 0.0)), "imu"), upright, none, rate, none, ORIGIN, none))
            else:
                angle, step, ranges = what
                last = angle + step * (len(ranges) - 1)
                header = Header(stamp(when), "laser")
                self.scans.write(LaserScan(header, angle, last, step, 0.0, 0.2, 0.02, 80.0, ranges, []))
            self.take()
            meanwhile(when)

    def wait_for_pose(self, entries):
        """Waits for a pose at the end of the drive, whose last scan waits for odometry behind it."""

        def has_come():
            self.take()
            poses = self.given["pose"]
            return poses and seconds(poses[-1].header.stamp) > entries[-1][0] - 1.0

        wait_until("there is a pose at the end", has_come)


def wait_until(what, is_so, patience=20.0):
    until = time.monotonic() + patience
    while not is_so():
        assert time.monotonic() < until, f"not within {patience} s: {what}"
        time.sleep(0.02)


def ends_at_a_signal(live):
    live.send_signal(signal.SIGINT)
    assert live.wait(60) == 130, live.returncode


def apart(poses, others):
    """Largest distance of poses of the same stamps."""
    both = poses.keys() & others.keys()
    assert len(both) > 0.95 * len(poses), f"{len(both)} stamps of {len(poses)}"
    return max(math.dist(poses[stamp][:2], others[stamp][:2]) for stamp in both)


def motions_apart(poses, others):
    """How far the motions of ten seconds are apart, in all but one of twenty."""

    def motion(path, stamp):
        (x, y, heading), (to_x, to_y, _) = path[stamp], path[round(stamp + 10, 3)]
        ahead, left, sine, cosine = to_x - x, to_y - y, math.sin(heading), math.cos(heading)
        return cosine * ahead + sine * left, cosine * left - sine * ahead

    both = [stamp for stamp in poses.keys() & others.keys() if round(stamp + 10, 3) in poses.keys() & others.keys()]
    distances = sorted(math.dist(motion(poses, stamp), motion(others, stamp)) for stamp in both)
    assert len(distances) > 100, distances
    return distances[len(distances) * 19 // 20]


def cells_of(picture):
    """Free and occupied cells of a PGM file."""
    cells = picture.read_bytes()
    return cells.count(254), cells.count(0)


def check_given(robot, by_live, entries):
    """What a drive gave others is near what was found in the end."""
    poses = {round(seconds(given.header.stamp), 3): plane(given.pose.pose) for given in robot.given["pose"]}
    scans = sum(kind != "ODOM" for _, kind, _ in entries)
    assert len(poses) > 0.9 * scans, f"{len(poses)} poses of {scans} scans"
    assert all(given.header.frame_id == "map" and given.pose.covariance[0] > 0 for given in robot.given["pose"])
    assert apart(poses, by_live) < NEAR, apart(poses, by_live)

    by_odometry = {round(when, 3): what for when, kind, what in entries if kind == "ODOM"}
    transforms = [transform for given in robot.given["tf"] for transform in given.transforms]
    assert {(given.header.frame_id, given.child_frame_id) for given in transforms} == {("map", "odom")}
    # It is said to hold until the next message comes, and is of the last scans that the filter took in.
    corrected = {}
    for transform in transforms:
        sent = round(seconds(transform.header.stamp) - 0.2, 3)
        if sent in by_odometry:
            corrected[sent] = moved(plane(transform.transform), by_odometry[sent])
    assert len(corrected) > 0.8 * len(by_odometry), f"{len(corrected)} transforms"
    both = corrected.keys() & by_live.keys()
    off = sorted(math.dist(corrected[when][:2], by_live[when][:2]) for when in both)[len(both) * 9 // 10]
    # The odometry begins there.
    start = (-9.5, -6.6, 0.0)
    raw = max(math.dist(moved(start, by_odometry[when])[:2], by_live[when][:2]) for when in both)
    print(f"by map -> odom {off:.3f} m off, by odometry alone {raw:.2f} m")
    assert off < NEAR_SMOOTHED < raw


def main():
    program = Path(sys.argv[1]).absolute()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        began = time.monotonic()
        simulate = ["simulate", "--out", ".", "--beams", "181", "--duration", str(DURATION)]
        subprocess.run([program, *simulate], check=True, stdout=subprocess.DEVNULL)
        log = Path("building-seed1.log")
        entries = read_log(log)
        map_live(program, log, entries)
        print(f"mapped after {time.monotonic() - began:.1f} s")
        localise_live(program, entries)
        print(f"ipslam live: mapped and localised, in {time.monotonic() - began:.1f} s")


def start(program, name, options):
    said = open(f"{name}.txt", "w")
    # A shell may have started this with SIGINT ignored, and a signal that is ignored at the start stays ignored.
    live = subprocess.Popen(
        [program, "live", "--out", name, *options],
        stderr=said,
        stdout=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    return live, lambda: Path(f"{name}.txt").read_text()


def map_live(program, log, entries):
    live, said = start(program, "live", [*SMALL, "--record", "live.rrd"])
    try:
        robot = Robot(read_turn_rates(log.with_suffix(".truth.tum")))
        subprocess.run([program, "run", log, "--out", "run", *SMALL], check=True, capture_output=True)
        hint = "no scan on /scan for 5 s; topics that are there: /odom (nav_msgs/msg/Odometry)"
        wait_until("it says what it lacks", lambda: hint in said())
        robot.listen()
        robot.begin_to_scan()
        robot.drive(entries[:-10])
        # Who comes late gets the map too, and who asks for it gets it in files.
        late = robot.reader("map", OccupancyGrid, LATCHED)
        wait_until("a late reader gets the map", lambda: late.read(1))
        asks = robot.writer("save_map", Empty, RELIABLE)
        wait_until("requests to save are taken", asks.get_matched_subscriptions)
        asks.write(Empty(0))
        robot.drive(entries[-10:])
        wait_until("the map is saved", lambda: "the map so far is in" in said())
        assert json.loads(Path("live/saved/map.json").read_text())["clusters"] and not Path("live/summary.json").exists()
        robot.wait_for_pose(entries)
        ends_at_a_signal(live)
    finally:
        live.kill()
        print(said())

    [summary, of_run] = [json.loads(Path(f"{name}/summary.json").read_text()) for name in ("live", "run")]
    scans = sum(kind != "ODOM" for _, kind, _ in entries)
    # A machine that is busy with other things may drop some.
    [taken, dropped] = [summary["beams"][name] for name in ("scans", "scans_dropped")]
    print(f"{taken} scans taken and {dropped} dropped of {scans}")
    assert taken + dropped >= 0.98 * scans and dropped < 0.05 * scans

    by_run = read_trajectory(Path("run/trajectory.tum"))
    by_live = {round(t - FIRST_STAMP, 3): pose for t, pose in read_trajectory(Path("live/trajectory.tum")).items()}
    # Between scans the one has the headings of the gyroscope, and the other those of the odometry.
    stamps = {round(when, 3) for when, kind, _ in entries if kind != "ODOM"}
    [live_at_scans, run_at_scans] = [{when: by[when] for when in stamps & by.keys()} for by in (by_live, by_run)]
    motions = motions_apart(live_at_scans, run_at_scans)
    print(f"trajectories are {apart(by_live, by_run):.3f} m apart at most, motions {motions:.3f} m")
    assert apart(by_live, by_run) < NEAR and motions < NEAR_MOTIONS
    # One that is 3 % too long would not do.
    longer = {when: (1.03 * x, 1.03 * y, heading) for when, (x, y, heading) in live_at_scans.items()}
    assert motions_apart(longer, run_at_scans) > NEAR_MOTIONS

    [walls, expected] = [found["map"]["clusters"] for found in (summary, of_run)]
    print(f"{walls} walls, {expected} by run")
    assert abs(walls - expected) <= 0.1 * expected, (walls, expected)
    assert summary["verdict"] == of_run["verdict"] == "consistent"

    # A scan and odometry of the same stamp are two readings.
    gyro = summary["gyro"]
    print(f"gyroscope: {gyro}")
    assert gyro["measured"] > 0.9 * (taken + len(entries) - scans), gyro
    assert gyro["believed"] > 0.5 * gyro["measured"] and abs(gyro["bias"] + BIAS) < 0.01, gyro
    replayed = subprocess.run([program, "replay", "live.rrd", "--verify"], check=True, capture_output=True, text=True)
    assert "identical bit for bit" in replayed.stdout, replayed.stdout

    check_given(robot, by_live, entries)
    grid, (free, occupied) = robot.given["map"][-1], cells_of(Path("run/map.pgm"))
    assert grid.header.frame_id == "map" and len(grid.data) == grid.info.width * grid.info.height
    assert abs(grid.data.count(0) - free) < 0.1 * free, (grid.data.count(0), free)
    assert abs(grid.data.count(100) - occupied) < 0.3 * occupied, (grid.data.count(100), occupied)
    assert len(robot.given["map"]) > 2, "the map was not shown while it grew"
    [marker] = robot.given["walls"][-1].markers
    [status] = robot.given["diagnostics"][-1].status
    assert (status.level == 0 and status.message == "consistent") or "scans dropped" in status.message, status
    # Not yet smoothed, which joins and leaves out some; both are sent once a second.
    shown, counted = len(marker.points) / 2, int(next(value.value for value in status.values if value.key == "walls"))
    assert expected / 2 < shown < 3 * expected and abs(shown - counted) < 0.2 * counted, (shown, counted, expected)


def localise_live(program, entries):
    live, said = start(program, "located", ["--map", "live/map.json", "--backend", "cpu", "--particles", "5000"])
    by_live = {round(t - FIRST_STAMP, 3): pose for t, pose in read_trajectory(Path("live/trajectory.tum")).items()}
    entries = [entry for entry in entries if 30 <= entry[0] < 70]
    try:
        robot = Robot()
        robot.listen()
        says = robot.writer("initialpose", PoseWithCovarianceStamped, RELIABLE)
        placed = []

        def place(when):
            # As soon as it can be heard.
            if not placed and says.get_matched_subscriptions():
                placed.append(when)
                covariance = [0.0] * 36
                covariance[0] = covariance[7] = 0.25
                covariance[35] = 0.07
                said_pose = PoseWithCovariance(pose(*by_live[round(when, 3)]), covariance)
                says.write(PoseWithCovarianceStamped(Header(stamp(when), "map"), said_pose))

        robot.begin_to_scan()
        robot.drive(entries, place)
        robot.wait_for_pose(entries)
        ends_at_a_signal(live)
    finally:
        live.kill()
        print(said())
    assert placed, "no initial pose was asked for"
    poses = {round(seconds(given.header.stamp), 3): plane(given.pose.pose) for given in robot.given["pose"]}
    print(f"placed at {placed[0]} s, located at {min(poses)} s, {apart(poses, by_live):.3f} m off at most")
    assert len(poses) > 0.3 * sum(kind != "ODOM" for _, kind, _ in entries), len(poses)
    assert apart(poses, by_live) < NEAR_SMOOTHED
    assert robot.given["tf"] and len(robot.given["map"]) == 1
    [status] = robot.given["diagnostics"][-1].status
    assert status.level == 0 or "scans dropped" in status.message, status
    summary = json.loads(Path("located/summary.json").read_text())
    assert summary["located_share"] > 0.3, summary


main()
