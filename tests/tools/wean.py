"""Map and drives of Wean Hall, from the text formats of their instruct.txt to formats that ipslam reads.

    python3 wean.py FOLDER OUT

FOLDER holds wean.dat.gz and robotdata*.log.gz. To OUT go wean.yaml and wean.pgm (the map, as of ROS's map_server) and
robotdata*.clf (CARMEN). Centimetres become metres. Nothing but Python's own library is needed.
"""

import gzip
import pathlib
import sys

# Occupied from, and free up to, which probability.
OCCUPIED, FREE = 0.65, 0.196


def map_server(source, out):
    """The map: rows of the file run along its x, columns along y."""
    lines = gzip.open(source, "rt")
    resolution = None
    for line in lines:
        words = line.split()
        if words and words[0].endswith("->resolution"):
            resolution = float(words[1]) / 100
        if words and words[0].startswith("global_map"):
            width, height = int(words[1]), int(words[2])
            break
    rows = [[float(word) for word in line.split()] for line in lines if line.strip()]
    assert len(rows) == width and all(len(row) == height for row in rows), "the map is not whole"

    def shade(probability):
        if probability < 0:
            return 205
        return 0 if probability > OCCUPIED else 254 if probability < FREE else 205

    # The file tells how free a cell is, not how occupied: its corridors are ones.
    pixels = bytes(shade(p if p < 0 else 1 - p) for y in reversed(range(height)) for p in (row[y] for row in rows))
    out.with_suffix(".pgm").write_bytes(b"P5\n%d %d\n255\n" % (width, height) + pixels)
    out.write_text(
        f"image: {out.stem}.pgm\nmode: trinary\nresolution: {resolution}\norigin: [0.0, 0.0, 0.0]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED}\nfree_thresh: {FREE}\n"
    )


def carmen(source, out):
    """A drive: O lines to ODOM, L lines to FLASER. 8183 cm and up are no return, as 81.83 m in CARMEN."""
    with open(out, "w") as log:
        log.write("PARAM robot_front_laser_max 81.83\n")
        for line in gzip.open(source, "rt"):
            kind, *words = line.split()
            numbers = [float(word) for word in words]
            if kind == "O":
                x, y, theta, stamp = numbers
                log.write(f"ODOM {x / 100:.6f} {y / 100:.6f} {theta:.6f} 0 0 0 {stamp:.6f} wean {stamp:.6f}\n")
            elif kind == "L":
                x, y, theta, laser_x, laser_y, laser_theta, *ranges, stamp = numbers
                assert len(ranges) == 180, f"{len(ranges)} ranges"
                ranges = " ".join(f"{r / 100:.2f}" for r in ranges)
                poses = f"{laser_x / 100:.6f} {laser_y / 100:.6f} {laser_theta:.6f} {x / 100:.6f} {y / 100:.6f} {theta:.6f}"
                log.write(f"FLASER 180 {ranges} {poses} {stamp:.6f} wean {stamp:.6f}\n")


def main():
    folder, out = map(pathlib.Path, sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    map_server(folder / "wean.dat.gz", out / "wean.yaml")
    drives = sorted(folder.glob("robotdata*.log.gz"))
    assert drives, f"no robotdata*.log.gz in {folder}"
    for drive in drives:
        carmen(drive, out / drive.name.replace(".log.gz", ".clf"))


if __name__ == "__main__":
    main()
