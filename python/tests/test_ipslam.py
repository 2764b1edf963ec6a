"""The package as installed, on a simulated drive whose truth is known."""

import json
import math
import subprocess
import threading
import time

import ipslam
import numpy as np
import pytest
from conftest import PROGRAM


def relative(reference, poses):
    """Poses seen from the first of the reference."""
    x, y, heading = reference
    c, s = math.cos(heading), math.sin(heading)
    moved = poses[:, :2] - (x, y)
    return np.column_stack([moved @ np.array([[c, -s], [s, c]]), poses[:, 2] - heading])


def true_poses(drive):
    """Stamps, and poses seen from the first: the world's frame."""
    rows = np.loadtxt(drive / "truth.tum")
    headings = 2.0 * np.arctan2(rows[:, 6], rows[:, 7])
    poses = np.column_stack([rows[:, 1:3], headings])
    return rows[:, 0], relative(poses[0], poses)


def scans_of(log):
    return [reading for reading in log if isinstance(reading, ipslam.Scan)]


def add_scan(robot, scan):
    return robot.add(
        scan.stamp,
        scan.ranges,
        scan.angle_min,
        scan.angle_increment,
        scan.odom,
        range_max=scan.range_max,
        laser=scan.laser,
    )


@pytest.fixture(scope="module")
def mapped(log_path):
    slam = ipslam.Slam(maps=8, seed=3)
    slam.add_log(ipslam.read_log(log_path))
    return slam.finish()


def test_a_log_is_read(log_path):
    log = ipslam.read_log(log_path)
    readings = list(log)
    scans = scans_of(log)
    assert log.name and len(readings) > 2 * len(scans) - 3 and len(scans) == 301
    scan = scans[5]
    assert scan.ranges.dtype == np.float64 and scan.ranges.shape == (361,)
    assert scan.odom.shape == (3,) and scan.laser.shape == (3,)
    assert scan.angle_min == pytest.approx(-math.pi / 2) and scan.angle_increment == pytest.approx(math.radians(0.5))
    assert [scan.stamp for scan in scans] == sorted(scan.stamp for scan in scans)


def test_a_drive_is_mapped_near_the_truth(drive, mapped):
    stamps, truth = true_poses(drive)
    found = mapped.trajectory
    assert found.shape[1] == 4 and np.isfinite(found).all()
    # Of the readings of a stamp the last one, the scan.
    at = np.searchsorted(found[:, 0], stamps + 1e-6) - 1
    np.testing.assert_allclose(found[at, 0], stamps, atol=1e-6)
    apart = np.linalg.norm(found[at, 1:3] - truth[:, :2], axis=1)
    assert apart.mean() < 0.3, apart.mean()
    scores = ipslam.evaluate(found, reference=drive / "truth.tum")
    assert scores["unmatched"] == 0 and scores["ate"]["rmse"] < 0.1, scores
    # By hand: alignment by singular values (Kabsch), and the root of the mean square.
    a, b = found[at, 1:3], truth[:, :2]
    u, _, vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    rmse = np.sqrt((((a - a.mean(0)) @ turn - (b - b.mean(0))) ** 2).sum(1).mean())
    assert scores["ate"]["rmse"] == pytest.approx(rmse, rel=0.02)
    wrong = found.copy()
    wrong[len(wrong) // 2 :, 1] += 1.0
    assert ipslam.evaluate(wrong, reference=drive / "truth.tum")["ate"]["rmse"] > 0.1


def test_every_pose_has_a_covariance(mapped):
    count = len(mapped.poses)
    assert mapped.covariances.shape == (count, 3, 3) and mapped.relied_on.shape == (count,)
    assert mapped.relied_on.all() and mapped.poses.shape == (count, 4)
    eigenvalues = np.linalg.eigvalsh(mapped.covariances)
    assert (eigenvalues > 0).all() and (eigenvalues < 1).all()


def test_a_map_is_a_structured_array_and_a_file(mapped, tmp_path):
    clusters = mapped.map.clusters
    assert clusters.shape == (len(mapped.map),) and len(mapped.map) > 10
    assert clusters["mean"].shape == (len(clusters), 2)
    np.testing.assert_allclose(np.linalg.norm(clusters["direction"], axis=1), 1.0, atol=1e-9)
    assert (clusters["std_along"] >= clusters["std_across"]).all() and (clusters["count"] > 0).all()
    path = tmp_path / "map.json"
    mapped.map.write(path)
    written = json.loads(path.read_text())["clusters"]
    np.testing.assert_allclose(clusters["mean"], [cluster["mean"] for cluster in written], atol=1e-6)
    np.testing.assert_allclose(clusters["std_along"], [cluster["std_along"] for cluster in written], rtol=1e-5)
    again = ipslam.Map.read(path)
    assert len(again) == len(clusters) and again.free_area == pytest.approx(mapped.map.free_area) and again.free_area > 20


def test_reading_by_reading_gives_the_same_as_the_log(log_path, mapped):
    slam = ipslam.Slam({"maps": 8, "particles": 8}, seed=3)
    steps = []
    for reading in ipslam.read_log(log_path):
        if isinstance(reading, ipslam.Odometry):
            assert slam.add_odometry(reading.stamp, reading.odom).particles is None
        else:
            steps.append(add_scan(slam, reading))
    np.testing.assert_array_equal(slam.finish().trajectory, mapped.trajectory)
    taken = [step for step in steps if step.particles is not None]
    assert 20 < len(taken) < len(steps)
    for step in taken:
        assert step.particles.shape == (8, 4) and step.particles[:, 3].sum() == pytest.approx(1.0)
        assert step.effective_sample_size == pytest.approx(1.0 / (step.particles[:, 3] ** 2).sum())
        assert step.pose.shape == (3,) and step.covariance.shape == (3, 3) and step.relied_on


def test_the_robot_is_found_in_the_map(log_path, mapped):
    scans = scans_of(ipslam.read_log(log_path))
    robot = ipslam.Localization(mapped.map, start=(0.0, 0.0, 0.0), start_spread=(0.3, 0.1))
    steps = [add_scan(robot, scan) for scan in scans]
    assert steps[-1].relied_on and not steps[0].relied_on
    found = robot.finish()
    assert len(found.trajectory) == found.relied_on.sum() > 100
    assert ipslam.evaluate(found.trajectory, reference=mapped.trajectory)["rpe_1_s"]["translation"]["rmse"] < 0.1


def test_points_on_two_walls_are_two_clusters():
    along = np.linspace(0.0, 3.0, 60)
    points = np.concatenate([np.column_stack([along, np.zeros(60)]), np.column_stack([np.full(60, 5.0), along])])
    clusters = ipslam.cluster(points)
    assert sorted(clusters["count"]) == [60, 60]
    order = np.argsort(clusters["mean"][:, 0])
    np.testing.assert_allclose(clusters["mean"][order], [[1.5, 0.0], [5.0, 1.5]], atol=1e-6)
    np.testing.assert_allclose(clusters["std_along"], along.std(), rtol=0.02)


def test_errors_name_the_argument(tmp_path, mapped):
    slam = ipslam.Slam(maps=2)
    good = {"stamp": 0.0, "ranges": [1.0, 2.0], "angle_min": 0.0, "angle_increment": 0.1, "odom": (0, 0, 0)}
    slam.add(**good)
    cases = [
        ({"ranges": []}, "ranges"),
        ({"ranges": [[1.0]]}, "ranges"),
        ({"ranges": "far"}, "ranges"),
        ({"stamp": math.nan}, "stamp"),
        ({"angle_increment": 0.0}, "angle_increment"),
        ({"odom": (0, 0)}, "odom"),
        ({"range_max": -1.0}, "range_max"),
        ({"laser": (math.inf, 0, 0)}, "laser"),
    ]
    for change, name in cases:
        with pytest.raises((ValueError, TypeError), match=name):
            slam.add(**{**good, **change})
    for arguments, words in [
        ({"maps": 0}, "maps"),
        ({"maps": 4, "particles": 6}, "particles"),
        ({"config": {"filter": {"temper": -1.0}}}, "filter.temper is -1"),
        ({"config": {"filter": {"tamper": 1.0}}}, "tamper"),
        ({"config": {"scan": [1]}}, "config.scan is a list"),
    ]:
        with pytest.raises(ValueError, match=words) as error:
            ipslam.Slam(**arguments)
        assert "--" not in str(error.value)
    with pytest.raises(FileNotFoundError, match="missing.log"):
        ipslam.read_log(tmp_path / "missing.log")
    (tmp_path / "photo.jpg").write_bytes(b"\xff\xd8\xff\xe0" + b"\x80" * 4096)
    with pytest.raises(ValueError, match="photo.jpg"):
        list(ipslam.read_log(tmp_path / "photo.jpg"))
    with pytest.raises(ValueError, match="reference or relations"):
        ipslam.evaluate(mapped.trajectory)
    with pytest.raises(ValueError, match="trajectory has 3 columns"):
        ipslam.evaluate(mapped.trajectory[:, :3], reference=mapped.trajectory)
    with pytest.raises(ValueError, match="points has 3 columns"):
        ipslam.cluster(np.zeros((4, 3)))
    with pytest.raises(ValueError, match="start_spread"):
        ipslam.Localization(mapped.map, start=(0, 0, 0), start_spread=(-1, 0))


def test_other_threads_go_on_meanwhile(log_path):
    ticks = []
    slam = ipslam.Slam(maps=32)
    thread = threading.Thread(target=slam.add_log, args=(ipslam.read_log(log_path),))
    thread.start()
    while thread.is_alive():
        ticks.append(time.perf_counter())
        time.sleep(0.001)
    assert len(ticks) > 50 and np.diff(ticks).max() < 0.5


def test_the_program_and_run_write_the_same(log_path, tmp_path):
    summary = ipslam.run(log_path, tmp_path / "called", maps=4, max_scans=40)
    assert summary["beams"]["scans"] == 40 and summary["configuration"]["maps"] == 4
    words = [PROGRAM, "run", log_path, "--out", tmp_path / "started", "--maps", "4", "--max-scans", "40"]
    subprocess.run(words, check=True, capture_output=True)
    for name in ["trajectory.tum", "poses.csv", "map.json"]:
        assert (tmp_path / "called" / name).read_bytes() == (tmp_path / "started" / name).read_bytes()
    # Once more in the same process.
    ipslam.run(log_path, tmp_path / "again", max_scans=5, maps=2)
    with pytest.raises(RuntimeError, match="--force"):
        ipslam.run(log_path, tmp_path / "again", max_scans=6, maps=2, force=False)
    assert ipslam.run(log_path, tmp_path / "again", max_scans=6, maps=2, force=True)["beams"]["scans"] == 6
    with pytest.raises(RuntimeError, match="missing.log"):
        ipslam.run("missing.log", tmp_path / "none")
    with pytest.raises(RuntimeError, match="--speed"):
        ipslam.run(log_path, tmp_path / "none", speed=3)
    wrong = subprocess.run([PROGRAM, "walk"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "walk" in wrong.stderr
    # The program has `live`; there is no such domain.
    alone = subprocess.run([PROGRAM, "live", "--domain", "300"], capture_output=True, text=True)
    assert alone.returncode == 2 and "no domain of DDS" in alone.stderr
    version = subprocess.run([PROGRAM, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.strip() == f"ipslam {ipslam.__version__}"
