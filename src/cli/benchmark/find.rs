//! The logs of a folder and of those below it, each with what is known of its true path.

use anyhow::Context as _;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const LOGS: [&str; 5] = [".clf", ".log", ".mcap", ".db3", ".bag"];
const RELATIONS: [&str; 2] = ["relations", "relations.txt"];
const REFERENCES: [&str; 2] = ["xyt", "tum"];

/// A log, and its relations, a reference, or both.
#[derive(Debug, PartialEq)]
pub struct Log {
    pub path: PathBuf,
    pub name: String,
    pub relations: Option<PathBuf>,
    pub reference: Option<PathBuf>,
}

/// Those with a truth beside them, and how many have none.
pub fn logs(folder: &Path) -> anyhow::Result<(Vec<Log>, usize)> {
    let (mut logs, mut without, mut names) = (Vec::new(), 0, BTreeSet::new());
    let cannot = || format!("{}: cannot be listed", folder.display());
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let entry = entry.with_context(cannot)?;
        // A link could lead round in a circle.
        if entry.file_type().with_context(cannot)?.is_dir() {
            let (below, too) = self::logs(&entry.path())?;
            logs.extend(below);
            without += too;
        } else {
            names.extend(entry.file_name().into_string());
        }
    }
    for file in &names {
        let unpacked = file.strip_suffix(".gz").unwrap_or(file);
        let Some(name) = LOGS.iter().find_map(|ending| unpacked.strip_suffix(ending)) else { continue };
        let beside = |is_truth: &dyn Fn(&str) -> bool| truth(name, &names, is_truth).map(|file| folder.join(file));
        let relations = beside(&|rest| RELATIONS.contains(&rest));
        let reference = beside(&|rest| REFERENCES.contains(&rest.rsplit('.').next().unwrap_or(rest)));
        if relations.is_none() && reference.is_none() {
            without += 1;
            continue;
        }
        logs.push(Log { path: folder.join(file), name: name.to_owned(), relations, reference });
    }
    logs.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((logs, without))
}

/// The file named like the log, or like its name up to a hyphen, the longer the better, and then as asked for.
fn truth<'a>(name: &str, names: &'a BTreeSet<String>, is_truth: &dyn Fn(&str) -> bool) -> Option<&'a String> {
    let hyphens = name.rmatch_indices('-').map(|(end, _)| &name[..end]);
    std::iter::once(name).chain(hyphens).find_map(|stem| {
        names.iter().find(|file| {
            let rest = file.strip_prefix(stem).and_then(|rest| rest.strip_prefix('.'));
            rest.is_some_and(|rest| is_truth(rest.strip_suffix(".gz").unwrap_or(rest)))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_is_named_like_its_log() {
        let place = tempfile::tempdir().unwrap();
        std::fs::create_dir(place.path().join("below")).unwrap();
        for file in [
            "intel-910.clf.gz",
            "intel-910.relations.gz",
            "intel-dense.log",
            "intel.relations.txt",
            "intel.gmapping.xyt.gz",
            "other.clf",
            "intelligent.relations",
            "below/a.b.bag",
            "below/a.b.truth.tum",
            "below/a.relations",
        ] {
            std::fs::write(place.path().join(file), "").unwrap();
        }
        let path = |name: &str| Some(place.path().join(name));
        let log = |file: &str, name: &str, relations: Option<PathBuf>, reference: Option<PathBuf>| Log {
            path: place.path().join(file),
            name: name.to_owned(),
            relations,
            reference,
        };
        let expected = [
            log("below/a.b.bag", "a.b", None, path("below/a.b.truth.tum")),
            log("intel-910.clf.gz", "intel-910", path("intel-910.relations.gz"), path("intel.gmapping.xyt.gz")),
            log("intel-dense.log", "intel-dense", path("intel.relations.txt"), path("intel.gmapping.xyt.gz")),
        ];
        let (found, without) = logs(place.path()).unwrap();
        assert_eq!((&found[..], without), (&expected[..], 1));
        assert!(logs(&place.path().join("none")).unwrap_err().to_string().contains("none: cannot be listed"));
    }
}
