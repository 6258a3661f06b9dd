//! What the bake sees on a graphics device is what it sees on the processor: the same columns, within texels on edges.

use anyhow::{Context, Result};
use insula_bake::{
    BakeOptions, Silent,
    sample::{SampleSettings, Visibility},
};
use insula_protocol::{BlockMap, TileId, blockmap::flag};
use insula_tests::{baked::Baked, fixtures, gpu::Gpu, trials::Trials};
use std::collections::BTreeMap;

/// Share of columns whose heights or kind may differ.
const COLUMNS_OFF: f64 = 0.002;
/// Mean difference of the roofs' occlusion, of 63.
const OCCLUSION_OFF: f64 = 0.5;

fn main() {
    Trials::open().on_gpu("device_and_processor_see_the_same", device_and_processor_see_the_same).run()
}

fn device_and_processor_see_the_same(_: &Gpu) -> Result<()> {
    let folder = tempfile::tempdir().context("a folder")?;
    let maps = |visibility: Visibility| -> Result<BTreeMap<TileId, BlockMap>> {
        let sample = SampleSettings { visibility, ..SampleSettings::default() };
        let out = folder.path().join(format!("{visibility:?}").to_lowercase());
        let inputs = vec![fixtures::chiba_quarter()?];
        insula_bake::bake(&BakeOptions { inputs, out: out.clone(), sample, ..BakeOptions::default() }, &Silent)?;
        Baked::open(&out)?.leaves()
    };
    let (cpu, gpu) = (maps(Visibility::Cpu)?, maps(Visibility::Gpu)?);
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
