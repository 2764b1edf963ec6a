//! The Python package `ipslam`: the library on numpy arrays. What each function means to Python is told in `ipslam.pyi`.

use pyo3::prelude::*;

mod arrays;
mod errors;
mod evaluate;
mod filters;
mod log;
mod map;
mod program;

/// 2-D laser SLAM whose map is a few hundred Gaussian line clusters: metres, radians, seconds; poses are (x, y, heading).
#[pymodule(name = "ipslam")]
mod module {
    #[pymodule_export]
    use super::evaluate::{cluster, evaluate};
    #[pymodule_export]
    use super::filters::localization::Localization;
    #[pymodule_export]
    use super::filters::result::Result;
    #[pymodule_export]
    use super::filters::slam::Slam;
    #[pymodule_export]
    use super::filters::step::Step;
    #[pymodule_export]
    use super::log::{Log, Odometry, Scan, read_log};
    #[pymodule_export]
    use super::map::Map;
    #[pymodule_export]
    use super::program::{main, run};

    #[pymodule_init]
    fn init(module: &super::Bound<'_, super::PyModule>) -> super::PyResult<()> {
        use super::PyModuleMethods as _;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
