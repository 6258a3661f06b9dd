//! What is summed for each vertex over all directions, and the occlusion that follows from it (Mischitelli 2007, 3.4).

use crate::prepared::PreparedScene;
use crate::{Occlusion, UNIT, ViewPair};
use glam::{DVec3, IVec3};

/// Binary digits of a cosine.
pub(crate) const COSINE_BITS: u32 = 16;

/// Sums over the directions that a vertex faces. They are whole numbers, so that their order does not matter.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct VertexSum {
    /// Cosines of the visible directions; 2^[`COSINE_BITS`] is 1.
    pub(crate) visible: u32,
    /// Cosines of all.
    pub(crate) all: u32,
}

#[derive(Debug, Default)]
pub(crate) struct OcclusionSums {
    pub(crate) shares: Vec<VertexSum>,
    /// Sums of the visible directions, weighted by cosines; empty unless they are wanted.
    pub(crate) bent: Vec<[i32; 3]>,
}

impl OcclusionSums {
    /// Zeros for a number of vertices.
    pub(crate) fn new(vertices: usize, has_bent: bool) -> Self {
        Self { shares: vec![VertexSum::default(); vertices], bent: vec![[0; 3]; if has_bent { vertices } else { 0 }] }
    }

    /// Adds a test of a vertex. `facing` is the product of normal and direction, `cosine` what it weighs.
    #[inline(always)]
    pub(crate) fn add(&mut self, vertex: usize, facing: i32, cosine: u32, is_visible: bool, pair: ViewPair) {
        let sum = &mut self.shares[vertex];
        sum.all += cosine;
        sum.visible += if is_visible { cosine } else { 0 };
        if let Some(bent) = self.bent.get_mut(vertex).filter(|_| is_visible) {
            let weighted = IVec3::from(pair.axes[2]) * cosine as i32 * facing.signum();
            *bent = (IVec3::from(*bent) + (weighted >> COSINE_BITS)).to_array();
        }
    }

    /// The sums of both.
    pub(crate) fn merge(mut self, other: Self) -> Self {
        for (sum, more) in self.shares.iter_mut().zip(other.shares) {
            sum.visible += more.visible;
            sum.all += more.all;
        }
        for (bent, more) in self.bent.iter_mut().zip(other.bent) {
            *bent = (IVec3::from(*bent) + IVec3::from(more)).to_array();
        }
        self
    }

    pub(crate) fn finish(&self, scene: &PreparedScene, has_bent: bool) -> Occlusion {
        let share =
            |sum: &VertexSum| if sum.all == 0 { 1.0 } else { (f64::from(sum.visible) / f64::from(sum.all)) as f32 };
        let unit = |sum: &[i32; 3], normal: &[i32; 3]| {
            let normal = DVec3::from(normal.map(f64::from)) / UNIT;
            DVec3::from(sum.map(f64::from)).try_normalize().unwrap_or(normal).as_vec3().to_array()
        };
        Occlusion {
            share: self.shares.iter().map(share).collect(),
            bent_normals: has_bent.then(|| self.bent.iter().zip(&scene.normals).map(|(sum, n)| unit(sum, n)).collect()),
        }
    }
}
