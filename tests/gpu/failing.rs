//! What has to fail: comparisons when a kernel is wrong, and calls when a device is gone.

use crate::consistency::{
    Found, compare_advanced, compare_draws, compare_lists, compare_propagated, compare_refined, compare_weighed, how,
};
use crate::worlds::{configs, random};
use ipslam::evaluator::Evaluator;
use ipslam::evaluator::cpu::CpuEvaluator;
use ipslam::evaluator::failover::Failover;
use ipslam::evaluator::gpu::GpuEvaluator;
use ipslam::evaluator::gpu::kernels::{Kernel, Sharing};
use ipslam::geometry::Pose;
use ipslam::gpu::DeviceError;
use ipslam::gpu::device::{Adapter, adapters, find};

/// A wrong kernel: what is replaced by what, and the comparison that has to see it.
struct Wrong {
    kernel: Kernel,
    what: &'static str,
    from: &'static str,
    to: &'static str,
    seen_by: fn(&mut GpuEvaluator) -> Found,
}

const WRONG: [Wrong; 19] = [
    Wrong {
        kernel: Kernel::Propagate,
        what: "another multiplier of the random numbers",
        from: "0xD2511F53u",
        to: "0xD2511F51u",
        seen_by: |gpu| compare_propagated(gpu),
    },
    Wrong {
        kernel: Kernel::Propagate,
        what: "a turn the other way",
        from: "pose.x + turn.y * motion.x - turn.x * motion.y",
        to: "pose.x + turn.y * motion.x + turn.x * motion.y",
        seen_by: |gpu| compare_propagated(gpu),
    },
    Wrong {
        kernel: Kernel::Propagate,
        what: "a motion that starts from nowhere",
        from: "mean = moved(poses[particle].xyz, group.mean)",
        to: "mean = moved(vec3f(), group.mean)",
        seen_by: |gpu| compare_advanced(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "thick walls as likely in their middle as thin ones",
        from: "across.w + ln(thinner)",
        to: "across.w",
        seen_by: |gpu| compare_advanced(gpu),
    },
    Wrong {
        kernel: Kernel::Cull,
        what: "lists of walls as they are where they are thick",
        from: "if !is_thick {",
        to: "if true {",
        seen_by: |gpu| compare_advanced(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "thin walls where they ought to be as they are",
        from: "length(across.xy)), 1.0)",
        to: "length(across.xy)), 1e9)",
        seen_by: |gpu| compare_advanced(gpu),
    },
    Wrong {
        kernel: Kernel::Refine,
        what: "walls as they are where they ought to be thick",
        from: "if !is_thick {",
        to: "if true {",
        seen_by: |gpu| compare_refined(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "a swapped sign",
        from: "fma(-across, across,",
        to: "fma(across, across,",
        seen_by: |gpu| compare_weighed(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "the last point dropped",
        from: "< vec4u(tile_count)",
        to: "< vec4u(tile_count - 1u)",
        seen_by: |gpu| compare_weighed(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "the first cluster skipped",
        from: "return List(start + 1u, count, false);",
        to: "return List(start + 2u, max(count, 1u) - 1u, false);",
        seen_by: |gpu| compare_weighed(gpu),
    },
    Wrong {
        kernel: Kernel::Weigh,
        what: "the last lane's share forgotten",
        from: "other < 64u; other += mine.width",
        to: "other < 64u - mine.width; other += mine.width",
        seen_by: |gpu| compare_weighed(gpu),
    },
    Wrong {
        kernel: Kernel::Cull,
        what: "circles that are too small",
        from: "+ length(half.xy) + length(centre) * half.z + ROUNDING",
        to: "* 0.7",
        seen_by: |gpu| compare_lists(gpu),
    },
    Wrong {
        kernel: Kernel::Cull,
        what: "headings that do not wrap",
        from: "vec3f(pose.xy - origin.xy, wrap(pose.z - origin.z))",
        to: "vec3f(pose.xy - origin.xy, 0.0)",
        seen_by: |gpu| compare_lists(gpu),
    },
    Wrong {
        kernel: Kernel::Refine,
        what: "a gradient with a wrong lever",
        from: "b * (x - robot.pose.x) - a * (y - robot.pose.y)",
        to: "b * (x - robot.pose.x) + a * (y - robot.pose.y)",
        seen_by: |gpu| compare_refined(gpu),
    },
    Wrong {
        kernel: Kernel::Refine,
        what: "a prior that pulls the other way",
        from: "-weight * vec3f(cos * pull.x",
        to: "weight * vec3f(cos * pull.x",
        seen_by: |gpu| compare_refined(gpu),
    },
    Wrong {
        kernel: Kernel::Refine,
        what: "a prior whose weight does not fall",
        from: "let weight = 1.0 / tail;",
        to: "let weight = 1.0;",
        seen_by: |gpu| compare_refined(gpu),
    },
    Wrong {
        kernel: Kernel::Propagate,
        what: "tails that are not heavy",
        from: "job.is_heavy_tailed == 1u",
        to: "job.is_heavy_tailed == 2u",
        seen_by: |gpu| compare_propagated(gpu),
    },
    Wrong {
        kernel: Kernel::Refine,
        what: "one step too few",
        from: "state = select(CLIMBING, LAST_EVALUATION",
        to: "state = select(LAST_EVALUATION, LAST_EVALUATION",
        seen_by: |gpu| compare_refined(gpu),
    },
    Wrong {
        kernel: Kernel::Draw,
        what: "draws that are a little too wide",
        from: "normals * job.spread",
        to: "normals * job.spread * 1.01",
        seen_by: |gpu| compare_draws(gpu),
    },
];

pub fn wrong_kernels_are_found_out(adapter: &Adapter) {
    for Wrong { kernel, what, from, to, seen_by } in WRONG {
        let replaced = |of: Kernel, sharing: Sharing| {
            let source = of.source(sharing);
            if of == kernel { source.replace(from, to) } else { source }
        };
        for sharing in Sharing::ALL {
            assert_ne!(replaced(kernel, sharing), kernel.source(sharing), "{kernel:?} has no {from}");
        }
        let mut gpu = GpuEvaluator::with_sources(adapter, replaced).unwrap();
        let found = seen_by(&mut gpu);
        let wrong = found.wrong.unwrap_or_else(|| panic!("{kernel:?} with {what} goes unnoticed: {:?}", found.worst));
        println!("{kernel:?} with {what}: {wrong}");
    }
}

pub fn a_kernel_that_is_no_wgsl_is_an_error(adapter: &Adapter) {
    let error = GpuEvaluator::with_sources(adapter, |_, _| "fn".to_owned()).unwrap_err();
    assert!(matches!(error, DeviceError::DeviceFailed { .. }), "{error}");
}

pub fn a_lost_device_is_an_error_and_the_cpu_takes_over(adapter: &Adapter) {
    let world = random(31, configs()[0], Pose::new(1.0, 2.0, 0.5), 40, 30);
    let starts = [world.start()];
    let how = how(&starts, world.poses.len(), 6);
    let mut gpu = GpuEvaluator::new(adapter).unwrap();
    gpu.propagate(&world.scene(), &how).unwrap();
    gpu.destroy();
    let error = gpu.propagate(&world.scene(), &how).unwrap_err();
    println!("{error}");
    assert!(matches!(&error, DeviceError::DeviceFailed { device, .. } if *device == adapter.name), "{error}");
    assert!(gpu.weigh(&world.scene(), &world.local_poses()).is_err());

    let mut failover = Failover::new(Some(Box::new(gpu)));
    let proposals = failover.propagate(&world.scene(), &how);
    assert!(failover.failure().is_some());
    assert_eq!(proposals, CpuEvaluator.propagate(&world.scene(), &how).unwrap());
}

pub fn an_unknown_adapter_is_an_error(_: &Adapter) {
    let error = find(Some("no such thing")).unwrap_err().to_string();
    let names = adapters().into_iter().map(|adapter| adapter.name);
    assert!(error.contains("no such thing") && names.into_iter().all(|name| error.contains(&name)), "{error}");
}
