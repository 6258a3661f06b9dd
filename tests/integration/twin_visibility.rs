//! Visibility on a GPU gives the same bake as on the CPU, except for texels on edges.

use anyhow::{Context, Result};
use insula_bake::sample::{SampleSettings, VisibilityBackend};
use insula_bake::{BakeOptions, Silent};
use insula_protocol::blockmap::flag;
use insula_protocol::{BlockMap, TileId};
use insula_test_support::tier;
use insula_tests::baked::Baked;
use insula_tests::gpu::Gpu;
use insula_tests::trials::{Trials, WHOLE_CITY};
use insula_tests::{fixtures, gpu_tests};
use std::collections::BTreeMap;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(gpu_tests![gpu_and_cpu_visibility_give_the_same_bake].map(|test| test.in_turn(&WHOLE_CITY)));
}

/// Largest share of columns whose heights or flags differ.
const COLUMNS_OFF: f64 = 0.002;
/// Largest mean difference of the roofs' occlusion, of 63.
const OCCLUSION_OFF: f64 = 0.5;

fn gpu_and_cpu_visibility_give_the_same_bake(_: &Gpu) -> Result<()> {
    let folder = tempfile::tempdir().context("a folder")?;
    let maps = |visibility: VisibilityBackend| -> Result<BTreeMap<TileId, BlockMap>> {
        let sample = SampleSettings { visibility, ..SampleSettings::default() };
        let out = folder.path().join(format!("{visibility:?}").to_lowercase());
        let inputs = vec![fixtures::chiba_quarter()?];
        let cell_m = if tier::is_full() { 1.0 } else { 2.0 };
        let options = BakeOptions { inputs, out: out.clone(), cell_m, sample, meshes: false, ..BakeOptions::default() };
        insula_bake::bake(&options, &Silent)?;
        Baked::open(&out)?.leaves()
    };
    let (cpu, gpu) = (maps(VisibilityBackend::Cpu)?, maps(VisibilityBackend::Gpu)?);
    anyhow::ensure!(cpu.keys().eq(gpu.keys()), "other leaves");
    let (mut columns, mut off, mut occlusion) = (0u32, 0u32, 0u32);
    for (a, b) in cpu.values().zip(gpu.values()) {
        anyhow::ensure!((a.z_base_cells, a.z_shift) == (b.z_base_cells, b.z_shift), "{}: other heights", a.id);
        for i in (0..a.flags.len()).filter(|i| (a.flags[*i] | b.flags[*i]) & flag::OCCUPIED != 0) {
            columns += 1;
            let heights = |m: &BlockMap| (m.flags[i], m.z_min[i], m.z_max[i]);
            off += u32::from(heights(a) != heights(b));
            occlusion += u32::from(a.roof[i].ao().abs_diff(b.roof[i].ao()));
        }
    }
    let (off, occlusion) = (f64::from(off) / f64::from(columns), f64::from(occlusion) / f64::from(columns));
    println!("{columns} columns, {:.3}% differ, occlusion by {occlusion:.3} of 63", off * 100.0);
    anyhow::ensure!(columns > 1000, "only {columns} columns");
    anyhow::ensure!(off <= COLUMNS_OFF, "{:.3}% of the columns differ", off * 100.0);
    anyhow::ensure!(occlusion <= OCCLUSION_OFF, "the occlusion differs by {occlusion:.3} of 63");
    Ok(())
}
