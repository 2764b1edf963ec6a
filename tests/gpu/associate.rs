//! The set likelihood of detections: GPU against CPU, and both against an enumeration of all assignments in f64.

use crate::assignments::{Frame, TOLERANCE};
use ipslam::evaluator::Evaluator;
use ipslam::evaluator::cpu::associate_all;
use ipslam::evaluator::gpu::GpuEvaluator;
use ipslam::gpu::device::Adapter;

pub fn detections_are_associated_alike(adapter: &Adapter) {
    let mut gpu = GpuEvaluator::new(adapter).unwrap();
    let mut worst = [0.0_f64; 2];
    // The largest first: what its buffers still hold must not show in what comes later.
    for frame in Frame::all().iter().rev() {
        let [on_gpu, on_cpu] =
            [gpu.associate(&frame.sighting(), &frame.poses).unwrap(), associate_all(&frame.sighting(), &frame.poses)];
        assert_eq!((on_gpu.len(), on_cpu.len()), (frame.poses.len(), frame.poses.len()));
        for ((gpu, cpu), slow) in on_gpu.iter().zip(&on_cpu).zip(frame.slow()) {
            let [gpu, cpu] = [*gpu, *cpu].map(f64::from);
            assert!(gpu.is_finite(), "a particle was left out");
            worst = [worst[0].max((gpu - cpu).abs()), worst[1].max((gpu - slow).abs())];
        }
    }
    println!("worst difference, GPU and CPU: {:.1e}; GPU and f64: {:.1e}", worst[0], worst[1]);
    assert!(worst.iter().all(|&difference| difference < TOLERANCE), "{worst:?}");

    // What differs is found out.
    let frame = Frame::random(6, 4, 5, 1, 40);
    let expected = frame.slow();
    let changes: [fn(&mut Frame); 4] = [
        |f| f.seen[0].x += 0.01,
        |f| f.landmarks[0][0].yy *= 1.1,
        |f| f.landmarks[0][0].log_label[0] -= 0.1,
        |f| f.horizon.max_ranges = [0.0; _],
    ];
    for (number, change) in changes.into_iter().enumerate() {
        let mut changed = frame.clone();
        change(&mut changed);
        let found = gpu.associate(&changed.sighting(), &frame.poses).unwrap();
        let worst = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
        assert!(worst > 3.0 * TOLERANCE, "change {number}: {worst:e}");
    }
}
