//! Occupancy grids: which cells of a raster a robot's laser saw free, and which occupied.
//!
//! The filter's map is clusters; a grid is what other programs read, what shows free space, and what a
//! map drawn elsewhere comes as. In: scans with poses ([`GridBuilder`]), or a file. Out: an [`OccupancyGrid`], from it
//! the [`FreeArea`] where a robot can be, and the walls as line clusters . The way back is [`drawn()`].

use crate::geometry::Pose;
use nalgebra::Point2;

mod builder;
mod drawn;
mod free;

pub use builder::GridBuilder;
pub use drawn::drawn;
pub use free::FreeArea;

/// Side of a cell where nothing else is asked for \[m\].
pub const RESOLUTION: f64 = 0.05;
/// Most cells of a grid: half a kilometre square of 5 cm cells.
pub const MOST_CELLS: u64 = 100_000_000;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Cell {
    /// Not observed, or not clearly.
    #[default]
    Unknown,
    /// Nothing is there.
    Free,
    /// A wall, or another thing that a beam ends at.
    Occupied,
}

/// A raster of square cells, row by row from the lower left.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyGrid {
    resolution: f64,
    world_from_grid: Pose,
    width: u32,
    height: u32,
    cells: Vec<Cell>,
}

/// Why there is no grid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// It would have too many cells.
    #[error(
        "a grid of {width:.0} x {height:.0} m in cells of {resolution} m has more than {MOST_CELLS} cells; choose larger \
         cells (--cell-size), or look for poses and ranges that are far off"
    )]
    TooLarge {
        /// Width \[m\].
        width: f64,
        /// Height \[m\].
        height: f64,
        /// Side of a cell \[m\].
        resolution: f64,
    },
    /// Nothing was seen or is to be drawn.
    #[error("there is nothing to make a grid of: no scan with a finite pose, or no wall and no free area")]
    Empty,
    /// Its numbers do not fit each other.
    #[error("no grid: {0}")]
    Invalid(String),
}

impl OccupancyGrid {
    /// A grid of `width` x `height` cells of side `resolution` \[m\], given row by row from the lower left, whose lower
    /// left corner is the pose `world_from_grid`.
    ///
    /// # Errors
    /// There are too many cells or none, more or fewer than `width` x `height`, or a number is not finite.
    pub fn new(
        resolution: f64,
        world_from_grid: Pose,
        width: u32,
        height: u32,
        cells: Vec<Cell>,
    ) -> Result<Self, GridError> {
        let invalid = |reason: String| Err(GridError::Invalid(reason));
        if !(1e-6..=1e6).contains(&resolution) {
            return invalid(format!("its cells are {resolution} m wide, but have to be 0.000001 to 1000000 m"));
        }
        if !world_from_grid.is_finite() {
            return invalid("its origin is not finite".to_owned());
        }
        let count = u64::from(width) * u64::from(height);
        if count > MOST_CELLS {
            let [width, height] = [width, height].map(|side| f64::from(side) * resolution);
            return Err(GridError::TooLarge { width, height, resolution });
        }
        if count == 0 || count != cells.len() as u64 {
            return invalid(format!("it has {} cells, but is {width} x {height}", cells.len()));
        }
        Ok(Self { resolution, world_from_grid, width, height, cells })
    }

    /// Side of a cell \[m\].
    pub fn resolution(&self) -> f64 {
        self.resolution
    }

    /// The lower left corner of the grid, rows running along its heading.
    pub fn world_from_grid(&self) -> Pose {
        self.world_from_grid
    }

    /// Cells in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All cells, row by row from the lower left.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// A cell by its column and row, from the lower left; outside of the grid all is unknown.
    pub fn cell(&self, column: i64, row: i64) -> Cell {
        let inside = (0..i64::from(self.width)).contains(&column) && (0..i64::from(self.height)).contains(&row);
        if inside { self.cells[row as usize * self.width as usize + column as usize] } else { Cell::Unknown }
    }

    /// This grid, and where it knows nothing what another one knows: as large as both together, in cells of this one.
    ///
    /// # Errors
    /// It would have too many cells.
    pub fn over(&self, other: &Self) -> Result<Self, GridError> {
        let grid_from_other = self.world_from_grid.inverse() * other.world_from_grid;
        let [width, height] = [other.width, other.height].map(|side| f64::from(side) * other.resolution);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let corners = corners.map(|[x, y]| grid_from_other * Point2::new(x, y) / self.resolution);
        // Rounded, as the corner of a grid that is made alike may lie an inch of a cell off.
        let low = corners.iter().fold(Point2::origin(), |low, corner| low.inf(&corner.map(f64::round)));
        let size = Point2::new(f64::from(self.width), f64::from(self.height));
        let high = corners.iter().fold(size, |high, corner| high.sup(&corner.map(f64::round)));
        let size = high - low;
        if size.x * size.y > MOST_CELLS as f64 {
            let [width, height] = [size.x, size.y].map(|side| side * self.resolution);
            return Err(GridError::TooLarge { width, height, resolution: self.resolution });
        }
        let (columns, rows) = (low.x as i64..high.x as i64, low.y as i64..high.y as i64);
        let cell = |column, row| match self.cell(column, row) {
            Cell::Unknown => other.at(self.centre(column, row)),
            known => known,
        };
        let cells = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        let corner = self.world_from_grid * Pose::new(low.x * self.resolution, low.y * self.resolution, 0.0);
        let cells = cells.map(|(column, row)| cell(column, row)).collect();
        Self::new(self.resolution, corner, size.x as u32, size.y as u32, cells)
    }

    /// The cell at a point of the world.
    pub fn at(&self, point: Point2<f64>) -> Cell {
        let point = self.world_from_grid.inverse() * point / self.resolution;
        self.cell(point.x.floor() as i64, point.y.floor() as i64)
    }

    /// The middle of a cell, in the world's frame \[m\].
    pub fn centre(&self, column: i64, row: i64) -> Point2<f64> {
        self.world_from_grid * (Point2::new(column as f64 + 0.5, row as f64 + 0.5) * self.resolution)
    }

    /// Columns and rows of all cells of a kind.
    pub(crate) fn places(&self, kind: Cell) -> impl Iterator<Item = [i64; 2]> + '_ {
        let width = self.width as usize;
        let found = self.cells.iter().enumerate().filter(move |(_, cell)| **cell == kind);
        found.map(move |(index, _)| [(index % width) as i64, (index / width) as i64])
    }
}
