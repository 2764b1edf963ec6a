//! Grids from scans, the free area, and walls from grids.

use super::uniforms;
use ipslam::clustering::ClusteringConfig;
use ipslam::geometry::Pose;
use ipslam::grid::{Cell, FreeArea, GridBuilder, GridError, OccupancyGrid, RESOLUTION, drawn};
use ipslam::log::{LogEntry, LogSource as _};
use ipslam::map::clusters_of_grid;
use ipslam::ppca::Cluster;
use ipslam::scan::{Scan, ScanConfig};
use ipslam::simulate::{Simulation, Wall, building};
use nalgebra::{Point2, Vector2, distance};
use std::sync::LazyLock;

/// The built-in building as seen from the true poses of a drive, and these poses.
fn driven() -> (OccupancyGrid, Vec<Point2<f64>>) {
    let (mut builder, mut reading) = (GridBuilder::new(RESOLUTION), None);
    let (log, mut path) = (Simulation::building(3), Vec::new());
    for entry in log.open().unwrap() {
        match entry.unwrap() {
            LogEntry::Laser(sweep) => reading = Some(sweep),
            LogEntry::Truth { stamp, world_from_robot } => {
                let reading = reading.take().filter(|reading| reading.stamp == stamp).unwrap();
                let scan = Scan::from_reading(&reading, &ScanConfig::default());
                builder.add_scan(&scan, reading.robot_from_laser, world_from_robot);
                path.push(world_from_robot.position());
            }
            LogEntry::Odometry { .. } | LogEntry::Turn { .. } => {}
        }
    }
    assert!(path.len() > 1000, "{} scans", path.len());
    (builder.finish().unwrap(), path)
}

fn centres(grid: &OccupancyGrid, kind: Cell) -> Vec<Point2<f64>> {
    let all = (0..grid.height()).flat_map(|row| (0..grid.width()).map(move |column| (column.into(), row.into())));
    all.filter(|&(column, row)| grid.cell(column, row) == kind).map(|(c, r)| grid.centre(c, r)).collect()
}

/// Distance from a point to the nearest wall of the building.
fn wall_distance(point: Point2<f64>) -> f64 {
    static WALLS: LazyLock<Vec<Wall>> = LazyLock::new(|| building().walls);
    let to_wall = |a: Point2<f64>, b: Point2<f64>| {
        let along = b - a;
        let share = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        distance(&point, &(a + along * share))
    };
    WALLS.iter().map(|wall| to_wall(wall.a, wall.b)).fold(f64::INFINITY, f64::min)
}

fn share(points: &[Point2<f64>], holds: impl Fn(Point2<f64>) -> bool) -> f64 {
    points.iter().filter(|&&point| holds(point)).count() as f64 / points.len() as f64
}

#[test]
fn a_drive_shows_the_building() {
    let (grid, path) = driven();
    let (occupied, free) = (centres(&grid, Cell::Occupied), centres(&grid, Cell::Free));
    assert!(occupied.len() > 3000 && free.len() > 100_000, "{} occupied, {} free", occupied.len(), free.len());
    // A wall's cell and its neighbours: 5 cm wide, seen with 1 cm of noise.
    let near_wall = share(&occupied, |point| wall_distance(point) < 0.1);
    assert!(near_wall > 0.99, "{near_wall} of the occupied cells are at a wall");
    let moved = share(&occupied, |point| wall_distance(Point2::new(point.x + 0.5, point.y + 0.3)) < 0.1);
    assert!(moved < 0.5, "{moved} of the occupied cells would be at a wall half a metre off");
    assert!(share(&free, |point| wall_distance(point) > 0.02) > 0.98);
    for &place in &path {
        assert_eq!(grid.at(place), Cell::Free, "the robot drove through {place}");
    }
    assert_eq!(grid.at(Point2::new(1e4, 0.0)), Cell::Unknown);

    let area = FreeArea::from_grid(&grid, path.iter().copied()).unwrap();
    assert!(path.iter().all(|&place| area.contains(place)));
    let seen = free.len() as f64 * RESOLUTION * RESOLUTION;
    assert!((0.7..1.0).contains(&(area.area() / seen)), "{} m² of {seen} m²", area.area());
    let mut numbers = uniforms(5);
    for _ in 0..2000 {
        let place = area.sample([numbers.next().unwrap(), numbers.next().unwrap()]);
        assert!(area.contains(place) && wall_distance(place) > 1e-3 || grid.at(place) != Cell::Unknown, "{place}");
    }

    let walls = clusters_of_grid(&grid, &ClusteringConfig::default());
    assert!((50..1000).contains(&walls.len()), "{} clusters", walls.len());
    let ends: Vec<Point2<f64>> = walls.iter().flat_map(Cluster::endpoints).collect();
    let at_wall = share(&ends, |end| wall_distance(end) < 0.15);
    assert!(at_wall > 0.95, "{at_wall} of the ends are at a wall");
    let explained = share(&occupied, |point| walls.iter().any(|wall| on_wall(wall, point)));
    assert!(explained > 0.9, "the clusters explain {explained} of the occupied cells");
    // Two cells, to rounding.
    let thinnest = walls.iter().map(|wall| wall.across_variance.sqrt()).fold(f64::INFINITY, f64::min);
    assert!((thinnest - 0.1).abs() < 1e-9, "a wall is known to {thinnest} m");
}

/// Whether a point is as near to a wall as a cell is wide.
fn on_wall(wall: &Cluster, point: Point2<f64>) -> bool {
    let offset = point - wall.mean;
    let half = (3.0 * wall.along_variance).sqrt() + 0.1;
    offset.dot(&wall.direction).abs() < half && offset.dot(&wall.normal()).abs() < 0.1
}

/// One beam of 1 m along x, from a robot at (0.5, 0.5) cells.
#[test]
fn a_beam_frees_what_it_passes_and_occupies_its_end() {
    let scan = Scan { points: vec![Point2::new(0.4, 0.0)], no_return: 5, ..Scan::default() };
    let mut builder = GridBuilder::new(0.1);
    builder.add_scan(&scan, Pose::new(0.1, 0.0, 0.0), Pose::new(-0.05, 0.05, 0.0));
    let grid = builder.finish().unwrap();
    assert_eq!((grid.width(), grid.height()), (4, 1));
    assert_eq!(grid.cells(), [Cell::Free, Cell::Free, Cell::Free, Cell::Occupied]);
    assert_eq!(grid.world_from_grid(), Pose::IDENTITY);

    // Seen from two sides, growing to the left; three beams that pass outvote one that ends.
    let mut builder = GridBuilder::new(0.1);
    let along = |x: f64| Scan { points: vec![Point2::new(x, 0.0)], ..Scan::default() };
    let back = Pose::new(2.05, 0.05, std::f64::consts::PI);
    builder.add_scan(&along(0.5), Pose::IDENTITY, back);
    assert_eq!(centres(&builder_of(&[0.5]), Cell::Occupied).len(), 1);
    for _ in 0..4 {
        builder.add_scan(&along(3.0), Pose::IDENTITY, back);
    }
    let grid = builder.finish().unwrap();
    let occupied = centres(&grid, Cell::Occupied);
    assert!(occupied.len() == 1 && distance(&occupied[0], &Point2::new(-0.95, 0.05)) < 1e-9, "{occupied:?}");
}

/// A grid of one robot at the origin and beams of these lengths along x.
fn builder_of(lengths: &[f64]) -> OccupancyGrid {
    let mut builder = GridBuilder::new(0.1);
    let points = lengths.iter().map(|&x| Point2::new(x, 0.0)).collect();
    builder.add_scan(&Scan { points, ..Scan::default() }, Pose::IDENTITY, Pose::new(0.05, 0.05, 0.0));
    builder.finish().unwrap()
}

/// One beam that comes from far away may be anything; three of them are a wall.
#[test]
fn a_grid_reaches_to_what_is_well_seen() {
    let width = |beams: usize, range: f64| {
        let mut points = vec![Point2::new(1.0, 0.0)];
        points.extend((0..beams).map(|beam| Point2::new(range, 0.2 * beam as f64)));
        let mut builder = GridBuilder::new(0.1);
        builder.add_scan(&Scan { points, ..Scan::default() }, Pose::IDENTITY, Pose::new(0.05, 0.05, 0.0));
        builder.finish().unwrap().width()
    };
    assert_eq!([0, 1, 2, 3].map(|beams| width(beams, 500.0)), [11, 11, 11, 5001]);
    // Longer than any grid is wide.
    assert_eq!(width(3, 5000.0), 11);
}

#[test]
fn what_is_absurd_makes_no_grid() {
    let far = Scan { points: vec![Point2::new(1.0, 0.0)], ..Scan::default() };
    let mut builder = GridBuilder::new(0.05);
    builder.add_scan(&far, Pose::IDENTITY, Pose::IDENTITY);
    builder.add_scan(&far, Pose::IDENTITY, Pose::new(1e6, 1e6, 0.0));
    builder.add_scan(&far, Pose::IDENTITY, Pose::IDENTITY);
    let error = builder.finish().unwrap_err();
    assert!(
        matches!(error, GridError::TooLarge { .. }) && error.to_string().contains("1000001 x 1000000 m"),
        "{error}"
    );

    let nothing = Scan { points: vec![Point2::new(f64::NAN, 0.0)], ..Scan::default() };
    let mut builder = GridBuilder::new(0.05);
    builder.add_scan(&nothing, Pose::IDENTITY, Pose::IDENTITY);
    assert_eq!(builder.finish().unwrap().cells(), [Cell::Unknown], "where the robot was");
    let mut builder = GridBuilder::new(0.05);
    builder.add_scan(&far, Pose::IDENTITY, Pose { x: f64::NAN, ..Pose::IDENTITY });
    builder.add_scan(&far, Pose::IDENTITY, Pose::new(1e300, 0.0, 0.0));
    assert!(matches!(builder.finish(), Err(GridError::Empty)));

    let cells = |count| vec![Cell::Free; count];
    for (resolution, width, height, count) in
        [(0.0, 1, 1, 1), (f64::NAN, 1, 1, 1), (0.1, 2, 2, 3), (0.1, 0, 1, 0), (0.1, u32::MAX, u32::MAX, 1)]
    {
        let made = OccupancyGrid::new(resolution, Pose::IDENTITY, width, height, cells(count));
        assert!(made.is_err(), "{width} x {height} cells of {resolution} m");
    }
    assert!(OccupancyGrid::new(0.1, Pose { y: f64::INFINITY, ..Pose::IDENTITY }, 1, 1, cells(1)).is_err());
    assert!(OccupancyGrid::new(0.1, Pose::IDENTITY, 1, 1, cells(1)).is_ok());
}

/// A grid of 0.25 m cells from rows of text, the upper one first: `.` free, `#` occupied, blank unknown.
fn sketch(rows: &[&str], world_from_grid: Pose) -> OccupancyGrid {
    let cell = |letter| match letter {
        '.' => Cell::Free,
        '#' => Cell::Occupied,
        _ => Cell::Unknown,
    };
    let cells = rows.iter().rev().flat_map(|row| row.chars().map(cell)).collect();
    OccupancyGrid::new(0.25, world_from_grid, rows[0].len() as u32, rows.len() as u32, cells).unwrap()
}

/// What the upper one knows counts; elsewhere the lower one shows, wherever it lies.
#[test]
fn one_grid_lies_over_another() {
    let lower = sketch(&["....", "#..#"], Pose::new(1.0, 0.0, 0.0));
    let at = |grid: &OccupancyGrid, x: f64, y: f64| grid.at(Point2::new(x, y));
    let apart = sketch(&[" #", ". "], Pose::IDENTITY).over(&lower).unwrap();
    assert_eq!((apart.width(), apart.height(), apart.world_from_grid()), (8, 2, Pose::IDENTITY));
    let cells = [(0.1, 0.1), (0.4, 0.4), (0.4, 0.1), (0.7, 0.1), (1.1, 0.1), (1.4, 0.1), (1.9, 0.1)];
    use Cell::{Free, Occupied, Unknown};
    assert_eq!(cells.map(|(x, y)| at(&apart, x, y)), [Free, Occupied, Unknown, Unknown, Occupied, Free, Occupied]);
    let overlapping = sketch(&["##", " ."], Pose::new(1.0, 0.0, 0.0)).over(&lower).unwrap();
    let cells = [(1.1, 0.4), (1.1, 0.1), (1.4, 0.1), (1.6, 0.4), (1.9, 0.1)];
    assert_eq!(cells.map(|(x, y)| at(&overlapping, x, y)), [Occupied, Occupied, Free, Free, Occupied]);
    // A quarter turn: its rows run up, from x = 0.5 to the left.
    let turned = sketch(&["....", "#..#"], Pose::new(0.5, 0.0, std::f64::consts::FRAC_PI_2));
    let both = sketch(&["  ", "  "], Pose::IDENTITY).over(&turned).unwrap();
    assert_eq!((both.width(), both.height()), (2, 4));
    assert_eq!([(0.4, 0.1), (0.4, 0.4), (0.1, 0.1)].map(|(x, y)| at(&both, x, y)), [Occupied, Free, Free]);
    let far = sketch(&["."], Pose::new(1e6, 1e6, 0.0));
    assert!(matches!(lower.over(&far), Err(GridError::TooLarge { .. })));
}

const TWO_ROOMS: [&str; 5] = ["....#....", "....#....", "..#.#....", "....#....", "   .#...."];

#[test]
fn the_free_area_is_where_the_robot_drove() {
    let world_from_grid = Pose::new(10.0, -5.0, 0.7);
    let grid = sketch(&TWO_ROOMS, world_from_grid);
    let at = |column: f64, row: f64| world_from_grid * Point2::new(0.25 * column, 0.25 * row);
    let cells = |area: &FreeArea| (area.area() / 0.0625).round() as u32;
    // The left room has 16 free cells, the right one 20.
    let left = FreeArea::from_grid(&grid, [at(0.5, 4.5)]).unwrap();
    let right = FreeArea::from_grid(&grid, [at(8.5, 4.5)]).unwrap();
    let largest = FreeArea::from_grid(&grid, []).unwrap();
    assert_eq!((cells(&left), cells(&right)), (16, 20));
    assert_eq!(largest, right);
    assert_eq!(FreeArea::from_grid(&grid, [at(-3.0, 1.0)]).unwrap(), largest, "driven outside of the grid");
    assert_eq!(left.rows()[2], [[0, 2], [3, 4]]);
    for (column, row, free) in
        [(0.5, 4.5, true), (2.5, 2.5, false), (3.5, 0.5, true), (0.5, 0.5, false), (8.5, 1.0, false)]
    {
        assert_eq!(left.contains(at(column, row)), free, "{column} {row}");
    }
    for (column, row) in [(-0.1, 1.0), (1.0, -0.1), (1.0, 5.1), (4.1, 1.0), (f64::NAN, 1.0)] {
        assert!(!left.contains(at(column, row)), "{column} {row}");
    }
    // A door that was open for the robot joins the rooms.
    assert_eq!(cells(&FreeArea::from_grid(&grid, [at(4.5, 1.5)]).unwrap()), 37);
    assert!(FreeArea::from_grid(&sketch(&["## "], Pose::IDENTITY), []).is_none());
}

/// Cells of 5 cm: a quarter of a metre is free with a speck in it, but not with a wall.
#[test]
fn a_speck_is_no_wall() {
    let of_25 = |occupied: usize, unknown: usize| {
        let mut cells = vec![Cell::Free; 25];
        cells[..occupied].fill(Cell::Occupied);
        cells[occupied..occupied + unknown].fill(Cell::Unknown);
        FreeArea::from_grid(&OccupancyGrid::new(0.05, Pose::IDENTITY, 5, 5, cells).unwrap(), []).is_some()
    };
    assert_eq!([of_25(0, 0), of_25(2, 0), of_25(5, 0), of_25(0, 12), of_25(0, 13)], [true, true, false, true, false]);
}

#[test]
fn samples_are_uniform() {
    let area = FreeArea::from_grid(&sketch(&TWO_ROOMS, Pose::new(3.0, 4.0, -2.0)), []).unwrap();
    let grid_from_world = area.world_from_grid().inverse();
    let (mut numbers, draws) = (uniforms(11), 20_000);
    // Each of the 20 cells in quarters.
    let mut counts = std::collections::BTreeMap::new();
    for _ in 0..draws {
        let place = area.sample([numbers.next().unwrap(), numbers.next().unwrap()]);
        assert!(area.contains(place), "{place}");
        let quarter = grid_from_world * place / (area.cell_size() / 2.0);
        *counts.entry((quarter.x.floor() as i64, quarter.y.floor() as i64)).or_insert(0_u32) += 1;
    }
    assert_eq!(counts.len(), 80);
    let chi2 = |counts: &[f64]| {
        let expected = counts.iter().sum::<f64>() / counts.len() as f64;
        counts.iter().map(|count| (count - expected).powi(2) / expected).sum::<f64>()
    };
    let mut counts: Vec<f64> = counts.into_values().map(f64::from).collect();
    // The 0.1 % and 99.9 % points of χ² with 79 degrees of freedom.
    assert!((47.0..=124.0).contains(&chi2(&counts)), "χ² is {}", chi2(&counts));
    counts.iter_mut().step_by(2).for_each(|count| *count *= 1.2);
    assert!(chi2(&counts) > 124.0, "a tenth more in every other cell would not be noticed: {}", chi2(&counts));
    // So are the ends of the interval, but for rounding.
    let ends = [1e-9, 1.0 - 1e-9];
    for u in ends.iter().flat_map(|&a| ends.map(|b| [a, b])) {
        assert!(area.contains(area.sample(u)), "{u:?}");
    }
}

#[test]
fn a_map_is_drawn_and_read_back() {
    let (grid, path) = driven();
    let walls = clusters_of_grid(&grid, &ClusteringConfig::default());
    let free = FreeArea::from_grid(&grid, path.iter().copied());
    let again = drawn(&walls, free.as_ref(), 0.1).unwrap();
    let occupied = centres(&again, Cell::Occupied);
    assert!(occupied.len() > 1000 && share(&occupied, |point| wall_distance(point) < 0.2) > 0.95);
    assert!(path.iter().filter(|&&place| again.at(place) == Cell::Free).count() as f64 > 0.99 * path.len() as f64);
    let area = centres(&again, Cell::Free).len() as f64 * 0.01;
    let expected = free.unwrap().area();
    assert!((area - expected).abs() < 0.1 * expected, "{area} m² are drawn of {expected} m²");

    // A wall from (0, 0) to (1, 0) in cells of 0.25 m, with a margin of two.
    let wall = super::wall::wall([0.1, 0.1], [0.9, 0.1], 0.01, 10.0);
    let one = drawn(&[wall], None, 0.25).unwrap();
    assert_eq!((one.width(), one.height(), one.world_from_grid()), (8, 5, Pose::new(-0.5, -0.5, 0.0)));
    let places: Vec<Point2<f64>> = centres(&one, Cell::Occupied);
    assert_eq!(places, [0.125, 0.375, 0.625, 0.875].map(|x| Point2::new(x, 0.125)));
    assert!(matches!(drawn(&[], None, 0.1), Err(GridError::Empty)));
    let endless = Cluster { along_variance: f64::INFINITY, ..wall };
    assert!(matches!(drawn(&[endless], None, 0.1), Err(GridError::Empty)));
    let long = Cluster { along_variance: 1e12, across_variance: 1e12, direction: Vector2::new(0.6, 0.8), ..wall };
    assert!(matches!(drawn(&[long], None, 0.1), Err(GridError::TooLarge { .. })));
}
