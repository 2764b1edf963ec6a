"""2-D laser SLAM whose map is a few hundred Gaussian line clusters.

Lengths are in metres, angles in radians (counter-clockwise from the x axis), times in seconds. The world's origin is the
robot's pose at the first scan: x ahead, y to its left. A pose is ``(x, y, heading)``. Work is done without the GIL.
"""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, TypeAlias, final

import numpy as np
import numpy.typing as npt

_Array: TypeAlias = npt.NDArray[np.float64]
_Path: TypeAlias = str | PathLike[str]
_Config: TypeAlias = str | Mapping[str, Any]
_Pose: TypeAlias = Sequence[float] | _Array

__all__ = [
    "Localization",
    "Log",
    "Map",
    "Odometry",
    "Result",
    "Scan",
    "Slam",
    "Step",
    "__version__",
    "_main",
    "cluster",
    "evaluate",
    "read_log",
    "run",
]

__version__: str

def read_log(
    path: _Path,
    *,
    scan_topic: str | Sequence[str] | None = None,
    odom_topic: str | None = None,
    imu: str | None = None,
    fov: float | None = None,
) -> Log:
    """Open a log: a CARMEN log, plain or gzip, or a ROS bag.

    Parameters
    ----------
    path
        The file, or the folder of a bag.
    scan_topic, odom_topic
        Topics of a bag, where it has several.
    imu
        Topic of the inertial sensor of a bag, whose gyroscope measures turns, or "none"; by default the first whose mounting is known.
    fov
        Field of view of a laser whose log holds only ranges (FLASER).

    Raises
    ------
    FileNotFoundError, OSError
        There is no such file, or it cannot be read.
    ValueError
        It is no log, or has several topics of a kind.
    """

@final
class Log:
    """A log that can be read from its start any number of times: iterate over it."""

    @property
    def name(self) -> str: ...
    def __iter__(self) -> Iterator[Scan | Odometry]: ...

@final
class Scan:
    """One sweep of the laser."""

    @property
    def stamp(self) -> float: ...
    @property
    def ranges(self) -> _Array:
        """One range a beam, as recorded: may hold nan, inf and negative values."""
    @property
    def angle_min(self) -> float: ...
    @property
    def angle_increment(self) -> float: ...
    @property
    def range_max(self) -> float:
        """Ranges at or above it are no return; inf where that is not known."""
    @property
    def odom(self) -> _Array:
        """Pose of the robot by odometry, shape (3,)."""
    @property
    def laser(self) -> _Array:
        """Pose of the laser on the robot, shape (3,)."""

@final
class Odometry:
    """Where odometry believes the robot to be."""

    @property
    def stamp(self) -> float: ...
    @property
    def odom(self) -> _Array:
        """Shape (3,)."""

@final
class Step:
    """What a filter made of one reading."""

    @property
    def stamp(self) -> float | None: ...
    @property
    def pose(self) -> _Array | None:
        """Pose of the robot in the world, shape (3,); None before the first scan."""
    @property
    def covariance(self) -> _Array | None:
        """Of (x, y, heading) by the world's axes, shape (3, 3): how well the pose is known in the map around the robot."""
    @property
    def relied_on(self) -> bool:
        """Whether the pose can be relied on: in a known map, whether the robot is located."""
    @property
    def effective_sample_size(self) -> float | None:
        """1 to the number of particles; None where the robot had not moved enough for a step of the filter."""
    @property
    def particles(self) -> _Array | None:
        """x, y, heading and weight of each, before resampling, shape (M, 4); None as above."""

@final
class Result:
    """What a filter found."""

    @property
    def trajectory(self) -> _Array:
        """t, x, y and heading at every reading that can be relied on, shape (N, 4)."""
    @property
    def poses(self) -> _Array:
        """The same at every reading, in the order of the log; nan where there is none yet."""
    @property
    def covariances(self) -> _Array:
        """Of each of ``poses``, shape (N, 3, 3), as ``Step.covariance``."""
    @property
    def relied_on(self) -> npt.NDArray[np.bool_]:
        """Of each of ``poses``, shape (N,)."""
    @property
    def map(self) -> Map: ...

@final
class Map:
    """A map of line clusters, with the area where a robot can be."""

    @staticmethod
    def read(path: _Path) -> Map:
        """Read ``map.json``, or the YAML file of an occupancy grid (ROS map_server)."""
    def write(self, path: _Path) -> None:
        """Write ``map.json``."""
    @property
    def clusters(self) -> npt.NDArray[np.void]:
        """Structured array of the fields ``mean`` (2), ``direction`` (2), ``std_along``, ``std_across``, ``count``.

        A wall ends at ``mean ± sqrt(3) * std_along * direction``.
        """
    @property
    def free_area(self) -> float:
        """Square metres where a robot can be; 0 where the map does not tell."""
    def __len__(self) -> int: ...

@final
class Slam:
    """Mapping: IPSLAM, one reading at a time.

    Parameters
    ----------
    config
        Any part of the configuration, as a dict or as TOML: ``{"scan": {"max_range": 20.0}}``.
    maps, particles, seed
        In place of the configuration's. ``particles`` is a multiple of ``maps``, and as many where only these are given.

    Raises
    ------
    ValueError
        A key that is unknown, or a value that cannot be.

    Notes
    -----
    Readings are kept until the object goes: ``finish`` matches every scan to the finished map.
    """

    def __new__(
        cls,
        config: _Config | None = None,
        *,
        maps: int | None = None,
        particles: int | None = None,
        seed: int | None = None,
    ) -> Slam: ...
    def add(
        self,
        stamp: float,
        ranges: npt.ArrayLike,
        angle_min: float,
        angle_increment: float,
        odom: _Pose,
        *,
        range_max: float = ...,
        laser: _Pose = ...,
    ) -> Step:
        """Take in a sweep of the laser.

        Parameters
        ----------
        stamp
            Seconds; readings come in the order of time.
        ranges
            One range a beam, shape (N,). nan and negative ones are no measurement, inf no return.
        angle_min, angle_increment
            Angle of the first beam in the laser's frame, and from one to the next (below 0: clockwise).
        odom
            Pose of the robot by odometry, in its own drifting frame.
        range_max
            Ranges at or above it are no return.
        laser
            Pose of the laser on the robot; (0, 0, 0) without.

        Raises
        ------
        ValueError
            ``ranges`` is empty, or a number that has to be finite is not.
        """
    def add_odometry(self, stamp: float, odom: _Pose) -> Step:
        """Take in odometry between sweeps. It can be left out."""
    def add_log(self, log: Log) -> None:
        """Take in a whole log."""
    def finish(self) -> Result:
        """Smooth what was found so far: every scan and the map are fitted to each other. More readings may follow."""

@final
class Localization:
    """The robot in a map that is known.

    Parameters
    ----------
    map
        One that tells where a robot can be.
    start
        Pose of the robot at first; without it, the robot may be anywhere.
    start_spread
        Standard deviations of its position and heading: 0.5 m and 0.26 rad.
    config
        Any part of the configuration, as a dict or as TOML.

    Raises
    ------
    ValueError
        The map has no wall or no free area, or a value of ``config`` cannot be.
    """

    def __new__(
        cls,
        map: Map,
        *,
        start: _Pose | None = None,
        start_spread: Sequence[float] = ...,
        config: _Config | None = None,
    ) -> Localization: ...
    def add(
        self,
        stamp: float,
        ranges: npt.ArrayLike,
        angle_min: float,
        angle_increment: float,
        odom: _Pose,
        *,
        range_max: float = ...,
        laser: _Pose = ...,
    ) -> Step:
        """Take in a sweep of the laser, as :meth:`Slam.add`."""
    def add_odometry(self, stamp: float, odom: _Pose) -> Step:
        """Take in odometry between sweeps. It can be left out."""
    def add_log(self, log: Log) -> None:
        """Take in a whole log."""
    def finish(self) -> Result:
        """What was found so far, with the map that is known. More readings may follow."""

def cluster(points: npt.ArrayLike, config: _Config | None = None) -> npt.NDArray[np.void]:
    """Cluster the points of one scan into lines.

    Parameters
    ----------
    points
        Shape (N, 2), any frame, in the order of the beams.
    config
        Its section ``clustering`` counts.

    Returns
    -------
    numpy.ndarray
        Structured, as :attr:`Map.clusters`, in the frame of the points.
    """

def evaluate(
    trajectory: npt.ArrayLike | _Path,
    *,
    reference: npt.ArrayLike | _Path | None = None,
    relations: _Path | None = None,
) -> dict[str, Any]:
    """Score a trajectory against reference poses, relations of the SLAM benchmark, or both.

    Parameters
    ----------
    trajectory, reference
        Arrays of t, x, y, heading, shape (N, 4), or files (TUM, or t x y theta).
    relations
        File of relations (t1 t2 x y z roll pitch yaw).

    Returns
    -------
    dict
        With a reference: ``poses``, ``unmatched``, ``ate`` (after rigid alignment), ``rpe_1_s`` and ``rpe_10_m``. With
        relations: ``relations``, ``unmatched_relations``, ``all``, ``local`` (at most 10 s apart) and ``loop``. Errors have
        ``count``, ``mean``, ``std``, ``rmse``, ``median`` and ``max``; those of poses by ``translation`` and ``rotation``.
    """

def run(log: _Path, out: _Path, **options: Any) -> dict[str, Any]:
    """Map a log as the command ``ipslam run LOG --out OUT`` does, with all its files; prints what the command prints.

    Parameters
    ----------
    **options
        Options of the command: ``maps=64``, ``seed=2``, ``config="my.toml"``; ``force=True`` replaces a run in that folder.

    Returns
    -------
    dict
        ``summary.json``.

    Raises
    ------
    RuntimeError
        What the command would have told.
    """

def _main() -> int:
    """Run the command line of ``sys.argv`` and return its exit code."""
