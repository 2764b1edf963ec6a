//! `ipslam replay` of a recording of objects.

use super::recording::refuse_input;
use super::replay::ReplayArgs;
use super::say::{print_line, say};
use super::semantic::{Output, Score, Task, verdict};
use anyhow::ensure;
use ipslam::record::rerun::semantic::{Recorded, RecordedMapping, record_beside};
use ipslam::semantic::SemanticMap;
use serde_json::json;

/// Maps the objects of a recording again.
pub fn replay_mapping<W: Output + Recorded>(
    args: &ReplayArgs,
    recorded: RecordedMapping<W>,
) -> anyhow::Result<Vec<anyhow::Error>> {
    let shown = args.recording.display();
    let store = recorded.store();
    ensure!(args.truth.is_empty(), "--relations and --reference score what `ipslam run` recorded");
    let config = args.config.over_semantic(recorded.config)?;
    let mut outputs = args.out.open(&format!("{}-replayed", store.name()))?;
    args.threads.start()?;
    if args.verify && store.version != env!("CARGO_PKG_VERSION") {
        say!("{shown} was recorded by version {}: another version may differ", store.version);
    }
    let record = args.record.clone().or_else(|| (!args.verify).then(|| outputs.path("replay.rrd")));
    if let Some(path) = &record {
        refuse_input(path, Some(&args.recording))?;
    }
    let name = &store.info.log;
    let task = Task::<W> { name, recording: &recorded.recording, objects: recorded.objects(), config };
    let (found, seconds) = task.map()?;
    task.write(&found, seconds, &Score::default(), &mut outputs)?;
    if let Some(path) = &record {
        outputs.note(record_beside(&recorded, path, task.mapping(&found)));
    }
    let first_difference = first_difference(&recorded, &found);
    if args.verify {
        verify(&recorded, &found, first_difference)?;
        let (keyframes, sweeps) = (found.history.candidates.len(), found.history.sweeps.len());
        print_line!("identical bit for bit: {keyframes} keyframes of the forward pass, {sweeps} sweeps and the result");
        outputs.finish();
        return Ok(std::mem::take(&mut outputs.errors));
    }

    let distances = recorded.poses.iter().zip(&found.keyframes);
    let distances = distances.map(|(was, is)| W::apart(*was, is.pose).0);
    let apart = distances.fold(0.0, f64::max);
    let comparison = json!({
        "recorded": { "settings": recorded.config, "landmarks": recorded.result.landmarks, "objective": recorded.result.objective },
        "replayed": { "settings": config, "landmarks": found.landmarks.len(), "objective": found.objective, "verdict": verdict(&found) },
        "first_step_that_differs": first_difference,
        "trajectories_apart_m": { "max": apart },
    });
    outputs.write("comparison.json", format!("{comparison:#}\n").as_bytes());
    if args.json {
        print_line!("{comparison:#}");
    } else {
        print_line!("{:<34} {:>16} {:>16}", "", "recorded", "replayed");
        print_line!("{:<34} {:>16} {:>16}", "landmarks", recorded.result.landmarks, found.landmarks.len());
        print_line!("{:<34} {:>16.1} {:>16.1}", "objective [nats]", recorded.result.objective, found.objective);
        match first_difference {
            Some(step) => print_line!("{:<34} {step}", "first step that differs"),
            None => print_line!("every step is the same, to the last bit"),
        }
        print_line!("{:<34} {apart:.4} at most", "trajectories apart [m]");
    }
    if let Some(path) = record {
        say!("both side by side: {}", path.display());
    }
    outputs.finish();
    Ok(std::mem::take(&mut outputs.errors))
}

/// The first keyframe of the forward pass, or sweep after it, that is not the same.
fn first_difference<W: Recorded>(recorded: &RecordedMapping<W>, found: &SemanticMap<W>) -> Option<usize> {
    let (was, is) = (&recorded.checksums, found.history.checksums());
    let shorter = (was.len() != is.len()).then_some(was.len().min(is.len()));
    was.iter().zip(&is).position(|(was, is)| was != is).or(shorter)
}

/// Whether the replay is the recorded mapping to the last bit.
fn verify<W: Recorded>(
    recorded: &RecordedMapping<W>,
    found: &SemanticMap<W>,
    first_difference: Option<usize>,
) -> anyhow::Result<()> {
    let keyframes = found.history.candidates.len();
    if let Some(step) = first_difference {
        match step.checked_sub(keyframes) {
            None => anyhow::bail!("step {step}: the hypotheses of the forward pass differ"),
            Some(sweep) => anyhow::bail!("step {step}: sweep {sweep} differs in path, landmarks or objective"),
        }
    }
    ensure!(
        found.checksum() == recorded.result.checksum,
        "all steps are the same, but the result differs: weights or covariances"
    );
    Ok(())
}
