//! What needs no device: the kernels are valid WGSL, and what they share with the host lies alike on both sides.

use ipslam::evaluator::gpu::association::{Association, AssociationJob};
use ipslam::evaluator::gpu::kernels::{Kernel, Sharing};
use ipslam::evaluator::gpu::layout::{GROUP, Group, GroupBounds, Job, LIST_ROOM, ParticleMode, Phase};
use ipslam::evaluator::sighting::{LandmarkRow, SECTORS, Seen};
use ipslam::evaluator::tiles::Tile;
use ipslam::evaluator::{CONVERGED, MAX_STEP, MAX_TAIL, PRIOR_TAIL};
use ipslam::likelihood::ClusterParams;
use ipslam::random::Draw;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{Module, TypeInner};
use std::mem::offset_of;

fn validated(source: &str) -> Result<Module, String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|error| error.emit_to_string(source))?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::SUBGROUP);
    validator.validate(&module).map_err(|error| format!("{error:?}"))?;
    Ok(module)
}

fn sources() -> impl Iterator<Item = (Kernel, Sharing)> {
    Kernel::ALL.into_iter().flat_map(|kernel| Sharing::ALL.map(|sharing| (kernel, sharing)))
}

pub fn kernels_are_valid() {
    validated(&Association::source()).unwrap_or_else(|error| panic!("associate: {error}"));
    for (kernel, sharing) in sources() {
        let source = kernel.source(sharing);
        let module = validated(&source).unwrap_or_else(|error| panic!("{kernel:?}: {error}"));
        let [entry] = &module.entry_points[..] else { panic!("{kernel:?} has not one entry point") };
        assert_eq!((entry.name.as_str(), entry.workgroup_size), (kernel.name(), [64, 1, 1]));
        // A sum of a number and a vector of other length is not valid.
        let broken = source.replacen("[workgroup.x];", "[workgroup.x] + 1u;", 1);
        assert!(validated(&broken).is_err(), "{kernel:?}: a broken kernel passes");
    }
}

/// Name, offset and struct size on the host.
type Fields = (&'static str, usize, Vec<(&'static str, usize)>);

macro_rules! fields {
    ($kind:ident, $($field:ident),+) => {
        (stringify!($kind), size_of::<$kind>(), vec![$((stringify!($field), offset_of!($kind, $field))),+])
    };
}

pub fn structs_lie_alike_on_both_sides() {
    let structs: [Fields; 7] = [
        fields!(ClusterParams, along, half_length, across, log_peak),
        fields!(Tile, x, y, centre, radius, count),
        fields!(Group, first, count, first_slot, slot_count, mean, exact_first, prior, number),
        fields!(ParticleMode, information, log_posterior, state, drawn),
        fields!(GroupBounds, middle, half),
        fields!(
            Job,
            seed,
            step,
            draw,
            noise,
            prior_information,
            slack,
            spread,
            tile_count,
            log_outlier,
            from_own_pose,
            capture_sigma,
            is_heavy_tailed,
            padding0,
            padding1,
            padding2
        ),
        fields!(Phase, restart, may_step),
    ];
    for (kernel, sharing) in sources() {
        lie_alike(&structs, &kernel.source(sharing));
    }
    let structs: [Fields; 3] = [
        fields!(AssociationJob, sensor, min_range, seen_count, max_ranges),
        fields!(Seen, x, y, xx, xy, yy, log_null, padding),
        fields!(LandmarkRow, x, y, xx, xy, yy, log_detected, log_missed, padding, log_label),
    ];
    lie_alike(&structs, &Association::source());
}

fn lie_alike(structs: &[Fields], source: &str) {
    let module = validated(source).unwrap();
    for (name, size, fields) in structs {
        let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(*name));
        let (_, kind) = found.unwrap_or_else(|| panic!("no {name} in {source}"));
        let TypeInner::Struct { members, span } = &kind.inner else { panic!("{name} is no struct") };
        let members: Vec<(&str, usize)> =
            members.iter().map(|m| (m.name.as_deref().unwrap_or_default(), m.offset as usize)).collect();
        assert_eq!((members, *span as usize), (fields.clone(), *size), "{name}: WGSL and Rust");
    }
}

/// Numbers that are written down on both sides.
pub fn constants_are_the_same_on_both_sides() {
    let vector = |numbers: [f32; 3]| format!("vec3f({}, {}, {:?})", numbers[0], numbers[1], numbers[2]);
    let written = [
        (Kernel::Cull, format!("const LIST_ROOM = {LIST_ROOM}u;")),
        (Kernel::Draw, format!("const DRAW_PROPOSAL = {}u;", Draw::Proposal as u32)),
        (Kernel::Refine, format!("const MAX_STEP = {};", vector(MAX_STEP))),
        (Kernel::Refine, format!("const PRIOR_TAIL = {PRIOR_TAIL};")),
        (Kernel::Propagate, format!("const MAX_TAIL = {MAX_TAIL:?};")),
        (
            Kernel::Refine,
            format!("const CONVERGED = vec3f({:e}, {:e}, {:e});", CONVERGED[0], CONVERGED[1], CONVERGED[2]),
        ),
    ];
    for (kernel, text) in written {
        assert!(kernel.source(Sharing::Loads).contains(&text), "{kernel:?} has no {text}");
    }
    assert!(Association::source().contains(&format!("const SECTORS = {SECTORS}u;")));
    assert_eq!(GROUP, 64, "the lanes of a workgroup");
}
