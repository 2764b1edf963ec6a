//! The kernels: each is a file of `shaders/`, put together with the shared pieces that it uses.

/// A kernel, named as its twin on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Draws poses from the motion.
    Propagate,
    /// Makes candidate lists.
    Cull,
    /// Takes one Gauss-Newton step.
    Refine,
    /// Draws poses around the top of the posterior.
    Draw,
    /// Sums up the log-likelihood.
    Weigh,
}

macro_rules! piece {
    ($name:literal) => {
        include_str!(concat!("../../../shaders/", $name, ".wgsl"))
    };
}

const LAYOUT: &str = piece!("shared/layout");
const MATH: &str = piece!("shared/math");
const RANDOM: &str = piece!("shared/random");
const EVALUATE: &str = piece!("shared/evaluate");
const LIKELIEST_CLUSTER: &str = piece!("shared/likeliest_cluster");
const LIKELIEST_DENSITY: &str = piece!("shared/likeliest_density");
const BROADCAST: &str = piece!("shared/broadcast");
const CHOLESKY: &str = piece!("shared/cholesky");

/// How the lanes of a workgroup read the clusters that all of them evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sharing {
    /// Each loads all: best where loads are cached.
    Loads,
    /// Each loads a few and broadcasts them to the others; needs subgroups of eight lanes or more.
    Broadcasts,
}

impl Sharing {
    /// Both ways.
    pub const ALL: [Self; 2] = [Self::Loads, Self::Broadcasts];

    fn evaluate(self) -> &'static [&'static str] {
        match self {
            Self::Loads => &[piece!("shared/evaluate_by_loads")],
            Self::Broadcasts => &[BROADCAST, piece!("shared/evaluate_by_broadcasts")],
        }
    }

    fn enlist(self) -> &'static [&'static str] {
        match self {
            Self::Loads => &[piece!("shared/enlist_by_loads")],
            Self::Broadcasts => &[BROADCAST, piece!("shared/enlist_by_broadcasts")],
        }
    }
}

impl Kernel {
    /// Every kernel, in the order of declaration.
    pub const ALL: [Self; 5] = [Self::Propagate, Self::Cull, Self::Refine, Self::Draw, Self::Weigh];

    /// The entry point.
    pub fn name(self) -> &'static str {
        match self {
            Self::Propagate => "propagate",
            Self::Cull => "cull",
            Self::Refine => "refine",
            Self::Draw => "draw",
            Self::Weigh => "weigh",
        }
    }

    /// The whole text.
    pub fn source(self, sharing: Sharing) -> String {
        let (evaluate, enlist) = (sharing.evaluate(), sharing.enlist());
        let pieces: [&[&str]; 3] = match self {
            Self::Propagate => [&[LAYOUT, MATH, RANDOM], &[], &[piece!("propagate")]],
            Self::Cull => [&[LAYOUT, MATH], enlist, &[piece!("cull")]],
            Self::Refine => [&[LAYOUT, MATH, EVALUATE, LIKELIEST_CLUSTER], evaluate, &[CHOLESKY, piece!("refine")]],
            Self::Draw => [&[LAYOUT, MATH, RANDOM, CHOLESKY], &[], &[piece!("draw")]],
            Self::Weigh => [&[LAYOUT, MATH, EVALUATE, LIKELIEST_DENSITY], evaluate, &[piece!("weigh")]],
        };
        pieces.concat().join("\n")
    }
}
