//! What a test needs besides the library. A test that cannot run is shown as ignored, with the reason; where
//! `IPSLAM_REQUIRE` names what is missing, it fails.

use libtest_mimic::Trial;
use std::path::PathBuf;
use std::sync::LazyLock;

/// What a test needs.
#[allow(dead_code, reason = "not every binary has a test of each kind")]
#[derive(Clone, Copy, PartialEq)]
pub enum Needs {
    /// Nothing.
    Nothing,
    /// Real logs, in the folder `IPSLAM_DATA`.
    Data,
    /// Real logs, and minutes: run where `IPSLAM_REQUIRE` names `data`, or with `--include-ignored`.
    WholeLogs,
    /// A Python that can install packages.
    Python,
    /// Real logs and such a Python.
    DataAndPython,
}

/// A test that passes unless it panics.
pub fn trial(name: &str, needs: Needs, test: fn()) -> Trial {
    let run = move || {
        test();
        Ok(())
    };
    let is_required = |what: &str| std::env::var("IPSLAM_REQUIRE").is_ok_and(|required| required.contains(what));
    let (what, missing) = match needs {
        Needs::Nothing => ("", None),
        Needs::Data | Needs::WholeLogs => ("data", data_missing()),
        Needs::Python => ("python", python_missing()),
        Needs::DataAndPython => match data_missing() {
            None => ("python", python_missing()),
            missing => ("data", missing),
        },
    };
    match missing {
        Some(reason) if is_required(what) => Trial::test(name, move || Err(reason.into())),
        Some(_) => Trial::test(name, run).with_ignored_flag(true).with_kind(format!("no {what}")),
        None if needs == Needs::WholeLogs && !is_required("data") => {
            Trial::test(name, run).with_ignored_flag(true).with_kind("whole log, takes a minute")
        }
        None => Trial::test(name, run),
    }
}

/// The folder of real logs.
pub fn data_folder() -> PathBuf {
    std::env::var_os("IPSLAM_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from)
}

/// A real log; the test that asks for one needs [`Needs::Data`].
pub fn data(file: &str) -> PathBuf {
    let path = data_folder().join(file);
    assert!(path.is_file(), "{} is missing", path.display());
    path
}

fn data_missing() -> Option<String> {
    let folder = data_folder();
    let is_there = folder.join("csail/mit-csail.clf.gz").is_file();
    (!is_there).then(|| format!("{} holds no logs; set IPSLAM_DATA to their folder", folder.display()))
}

static PYTHON: LazyLock<Result<PathBuf, String>> = LazyLock::new(crate::python::environment);

/// A Python with packages; the test that asks for one needs [`Needs::Python`].
#[allow(dead_code, reason = "not every binary has such a test")]
pub fn python() -> PathBuf {
    PYTHON.clone().unwrap_or_else(|missing| panic!("{missing}"))
}

fn python_missing() -> Option<String> {
    PYTHON.as_ref().err().cloned()
}

/// The tests of a module, by what they need.
#[allow(unused_macros, reason = "not every binary lists its tests by this")]
macro_rules! trials {
    ($module:literal: $($needs:ident { $($test:ident),* $(,)? })*) => {
        /// The tests of this file.
        pub fn trials() -> Vec<libtest_mimic::Trial> {
            vec![$($(crate::needs::trial(
                concat!($module, "::", stringify!($test)),
                crate::needs::Needs::$needs,
                $test,
            ),)*)*]
        }
    };
}
#[allow(unused_imports, reason = "not every binary lists its tests by this")]
pub(crate) use trials;
