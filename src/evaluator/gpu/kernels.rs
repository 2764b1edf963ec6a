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
const LOOK: &str = piece!("shared/look");
const LIKELIEST_CLUSTER: &str = piece!("shared/likeliest_cluster");
const LIKELIEST_DENSITY: &str = piece!("shared/likeliest_density");
const TOLD: &str = piece!("shared/told");
const CHOLESKY: &str = piece!("shared/cholesky");

/// How lanes that look through the same clusters come by them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Together {
    /// Each loads all: best where loads are cached.
    Loads,
    /// Each loads a few and tells the others; needs subgroups of eight lanes or more.
    Broadcasts,
}

impl Together {
    /// Both ways.
    pub const ALL: [Self; 2] = [Self::Loads, Self::Broadcasts];

    fn look(self) -> &'static [&'static str] {
        match self {
            Self::Loads => &[piece!("shared/together_by_loads")],
            Self::Broadcasts => &[TOLD, piece!("shared/together_by_broadcasts")],
        }
    }

    fn enlist(self) -> &'static [&'static str] {
        match self {
            Self::Loads => &[piece!("shared/enlist_by_loads")],
            Self::Broadcasts => &[TOLD, piece!("shared/enlist_by_broadcasts")],
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
    pub fn source(self, together: Together) -> String {
        let (look, enlist) = (together.look(), together.enlist());
        let pieces: [&[&str]; 3] = match self {
            Self::Propagate => [&[LAYOUT, MATH, RANDOM], &[], &[piece!("propagate")]],
            Self::Cull => [&[LAYOUT, MATH], enlist, &[piece!("cull")]],
            Self::Refine => [&[LAYOUT, MATH, LOOK, LIKELIEST_CLUSTER], look, &[CHOLESKY, piece!("refine")]],
            Self::Draw => [&[LAYOUT, MATH, RANDOM, CHOLESKY], &[], &[piece!("draw")]],
            Self::Weigh => [&[LAYOUT, MATH, LOOK, LIKELIEST_DENSITY], look, &[piece!("weigh")]],
        };
        pieces.concat().join("\n")
    }
}
