"""Writes bags of ROS 2 (MCAP, SQLite) and ROS 1 (MCAP, .bag) for tests/formats/mcap.rs, with writers that know nothing of ipslam.

    write_bags.py spec SPEC.json            the bags that a JSON file describes
    write_bags.py carmen LOG.gz COUNT DIR   the first COUNT FLASER messages of a CARMEN log, in several ways

Needs `rosbags` (messages to CDR, and whole bag folders) and `mcap` (files).
"""

import gzip
import json
import math
import sys
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import Reader as FolderReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as FolderWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
STORE1 = get_typestore(Stores.ROS1_NOETIC)
STORE1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage"))
T1 = STORE1.types
COMPRESSION = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


def header(stamp, frame):
    time = T["builtin_interfaces/msg/Time"](sec=stamp[0], nanosec=stamp[1])
    return T["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def quaternion(roll, pitch, yaw):
    """Rz(yaw) Ry(pitch) Rx(roll), as x y z w."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2), math.cos(a / 2)) for a in (roll, pitch, yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def scan(m):
    step, ranges = float(m["angle_step"]), np.array([float(r) for r in m["ranges"]], dtype=np.float32)
    return T["sensor_msgs/msg/LaserScan"](
        header=header(m["stamp"], m["frame"]),
        angle_min=float(m["angle_min"]),
        angle_max=float(m["angle_min"]) + step * (len(ranges) - 1),
        angle_increment=step,
        time_increment=0.0,
        scan_time=0.2,
        range_min=float(m["range_min"]),
        range_max=float(m["range_max"]),
        ranges=ranges,
        intensities=np.full(len(ranges), 7, dtype=np.float32),
    )


def odometry(m):
    x, y, yaw = (float(v) for v in m["pose"])
    vector, covariance = T["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0), np.full(36, 5.0)
    pose = T["geometry_msgs/msg/Pose"](
        position=T["geometry_msgs/msg/Point"](x, y, 9.0),
        orientation=T["geometry_msgs/msg/Quaternion"](*m.get("quaternion", quaternion(0, 0, yaw))),
    )
    return T["nav_msgs/msg/Odometry"](
        header=header(m["stamp"], m["frame"]),
        child_frame_id=m["child"],
        pose=T["geometry_msgs/msg/PoseWithCovariance"](pose, covariance),
        twist=T["geometry_msgs/msg/TwistWithCovariance"](T["geometry_msgs/msg/Twist"](vector, vector), covariance),
    )


def imu(m):
    vector, covariance = T["geometry_msgs/msg/Vector3"], np.full(9, 5.0)
    measured = np.full(9, float(m.get("covariance", 0.01)))
    return T["sensor_msgs/msg/Imu"](
        header=header(m["stamp"], m["frame"]),
        orientation=T["geometry_msgs/msg/Quaternion"](0.5, 0.5, 0.5, 0.5),
        orientation_covariance=covariance,
        angular_velocity=vector(*(float(v) for v in m["rates"])),
        angular_velocity_covariance=measured,
        linear_acceleration=vector(1.0, 2.0, 9.8),
        linear_acceleration_covariance=covariance,
    )


def transforms(m):
    def stamped(t):
        transform = T["geometry_msgs/msg/Transform"](
            translation=T["geometry_msgs/msg/Vector3"](*(float(v) for v in t["xyz"])),
            rotation=T["geometry_msgs/msg/Quaternion"](*quaternion(*(float(v) for v in t["rpy"]))),
        )
        return T["geometry_msgs/msg/TransformStamped"](header(t["stamp"], t["frame"]), t["child"], transform)

    return T["tf2_msgs/msg/TFMessage"]([stamped(t) for t in m["transforms"]])


KINDS = {
    "scan": ("sensor_msgs/msg/LaserScan", scan),
    "odometry": ("nav_msgs/msg/Odometry", odometry),
    "imu": ("sensor_msgs/msg/Imu", imu),
    "tf": ("tf2_msgs/msg/TFMessage", transforms),
}


def encoded(m, little_endian, ros1=False):
    """Type, encoding and bytes of a message."""
    if m["kind"] == "raw":
        return m["schema"], m["encoding"], bytes.fromhex(m["data"])
    name, make = KINDS[m["kind"]]
    if ros1:
        data = STORE.cdr_to_ros1(STORE.serialize_cdr(make(m), name), name)
        return name.replace("/msg/", "/"), "ros1", bytes(data)
    return name, "cdr", bytes(STORE.serialize_cdr(make(m), name, little_endian=little_endian))


def write_file(bag):
    with open(bag["path"], "wb") as out:
        writer = Writer(
            out,
            chunk_size=bag.get("chunk_size", 1 << 16),
            compression=COMPRESSION[bag.get("compression", "none")],
            use_chunking=bag.get("chunked", True),
            enable_crcs=bag.get("checksums", True),
        )
        ros1 = bag.get("ros1", False)
        writer.start(profile="ros1" if ros1 else "ros2", library="test")
        schemas, channels = {}, {}
        for log_time, m in enumerate(bag["messages"]):
            name, encoding, data = encoded(m, bag.get("little_endian", True), ros1)
            if name not in schemas:
                schemas[name] = writer.register_schema(name, "ros1msg" if ros1 else "ros2msg", b"# not read")
            if m["topic"] not in channels:
                channels[m["topic"]] = writer.register_channel(m["topic"], encoding, schemas[name])
            writer.add_message(channels[m["topic"]], log_time, data, log_time)
        writer.finish()


def write_folder(bag, storage):
    with FolderWriter(bag["path"], version=9, storage_plugin=storage) as writer:
        connections = {}
        for log_time, m in enumerate(bag["messages"]):
            name, _, data = encoded(m, True)
            if m["topic"] not in connections:
                connections[m["topic"]] = writer.add_connection(m["topic"], name, typestore=STORE)
            writer.write(connections[m["topic"]], log_time, data)


def write_split(bag):
    """A bag in three files, as a recorder leaves it that starts a new one now and then."""
    folder = Path(bag["path"])
    folder.mkdir()
    # By their names they are in another order.
    names, messages = ["part_9.mcap", "part_10.mcap", "part_11.mcap"], bag["messages"]
    third = -(-len(messages) // 3)
    topics, files = {}, []
    for i, name in enumerate(names):
        part = messages[i * third : (i + 1) * third]
        write_file({**bag, "path": folder / name, "messages": part})
        files.append({"path": name, "message_count": len(part)})
        for m in part:
            topics.setdefault(m["topic"], [encoded(m, True)[0], 0])[1] += 1
    time, span = {"nanoseconds_since_epoch": 0}, {"nanoseconds": len(messages)}
    kinds = [
        {"topic_metadata": {"name": name, "type": kind, "serialization_format": "cdr", "offered_qos_profiles": ""},
         "message_count": count}
        for name, (kind, count) in topics.items()
    ]  # fmt: skip
    (folder / "metadata.yaml").write_text(json.dumps({"rosbag2_bagfile_information": {
        "version": 5, "storage_identifier": "mcap", "duration": span, "starting_time": time,
        "message_count": len(messages), "topics_with_message_count": kinds, "compression_format": "",
        "compression_mode": "", "relative_file_paths": names, "files": files,
    }}, indent=2))  # fmt: skip
    with FolderReader(folder) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == len(messages)


def as_ros1(value):
    """The same message of ROS 1, whose headers count."""
    if not hasattr(value, "__dataclass_fields__"):
        return [as_ros1(item) for item in value] if isinstance(value, list) else value
    fields = {name: as_ros1(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    if value.__msgtype__ == "std_msgs/msg/Header":
        fields["seq"] = 7
    return T1[value.__msgtype__](**fields)


def write_ros1(bag):
    writer, connections = BagWriter(bag["path"]), {}
    if bag["compression"] != "none":
        writer.set_compression(BagWriter.CompressionFormat[bag["compression"].upper()])
    with writer:
        for log_time, m in enumerate(bag["messages"]):
            name, make = KINDS[m["kind"]]
            if m["topic"] not in connections:
                connections[m["topic"]] = writer.add_connection(m["topic"], name, typestore=STORE1)
            data = bytes(STORE1.serialize_ros1(as_ros1(make(m)), name))
            writer.write(connections[m["topic"]], log_time, data)


def write(bag):
    match bag.get("storage", "file"):
        case "ros1":
            write_ros1(bag)
        case "file":
            write_file(bag)
        case "folder":
            write_folder(bag, StoragePlugin.MCAP)
        case "split":
            write_split(bag)
        case "sqlite":
            write_folder(bag, StoragePlugin.SQLITE3)


STATIC = {
    "kind": "tf",
    "topic": "/tf_static",
    "transforms": [
        {"stamp": [0, 0], "frame": "base_link", "child": "laser", "xyz": [0.2, -0.05, 0.3], "rpy": [0, 0, 0.1]},
        {"stamp": [0, 0], "frame": "base_footprint", "child": "base_link", "xyz": [0.1, 0, 0.05], "rpy": [0, 0, 0]},
    ],
}


def carmen(log, count, folder):
    scans, odometries, moving = [], [], []
    with gzip.open(log, "rt") as lines:
        for line in lines:
            words = line.split()
            if not words or words[0] != "FLASER" or len(scans) == count:
                continue
            beams = int(words[1])
            x, y, yaw = (float(word) for word in words[beams + 5 : beams + 8])
            nanoseconds = round(float(words[beams + 8]) * 1e9)
            stamp = [nanoseconds // 10**9, nanoseconds % 10**9]
            scans.append({
                "kind": "scan", "topic": "/scan", "stamp": stamp, "frame": "laser", "angle_min": -math.pi / 2,
                "angle_step": math.radians(0.5), "range_min": 0.0, "range_max": 81.0, "ranges": words[2 : beams + 2],
            })  # fmt: skip
            odometries.append({
                "kind": "odometry", "topic": "/odom", "stamp": stamp, "frame": "odom", "child": "base_footprint",
                "pose": [x, y, yaw],
            })  # fmt: skip
            moving.append({
                "kind": "tf", "topic": "/tf", "transforms": [
                    {"stamp": stamp, "frame": "map", "child": "odom", "xyz": [1, 2, 3], "rpy": [0, 0, 1]},
                    {"stamp": stamp, "frame": "odom", "child": "base_footprint", "xyz": [x, y, 0], "rpy": [0, 0, yaw]},
                ],
            })  # fmt: skip
    # A scan is recorded after the odometry of the sweep behind it.
    by_odometry, by_transforms = [STATIC], []
    for i, (s, o, t) in enumerate(zip(scans, odometries, moving)):
        by_odometry += [o] + ([scans[i - 1]] if i else [])
        by_transforms += [s, t]
    by_odometry.append(scans[-1])
    by_transforms.append(STATIC)
    for compression in COMPRESSION:
        write({"path": folder / f"{compression}.mcap", "compression": compression, "messages": by_odometry})
    write({"path": folder / "unchunked.mcap", "chunked": False, "messages": by_odometry})
    write({"path": folder / "transforms.mcap", "little_endian": False, "messages": by_transforms})
    write({"path": folder / "folder", "storage": "folder", "messages": by_transforms})
    write({"path": folder / "split", "storage": "split", "messages": by_odometry})
    write({"path": folder / "sqlite", "storage": "sqlite", "messages": by_odometry})
    for compression in ["none", "lz4", "bz2"]:
        path = folder / f"ros1_{compression}.bag"
        write({"path": path, "storage": "ros1", "compression": compression, "messages": by_odometry})
    write({"path": folder / "ros1_tf.bag", "storage": "ros1", "compression": "none", "messages": by_transforms})


match sys.argv[1:]:
    case ["spec", path]:
        for bag in json.loads(Path(path).read_text()):
            write(bag)
    case ["carmen", log, count, folder]:
        carmen(log, int(count), Path(folder))
    case _:
        sys.exit(__doc__)
