//! Tests that see the whole of Insula. `cargo test --profile ci -p insula-tests zoo::` runs one module.
//!
//! Without a graphics adapter, a browser or a virtual screen, the tests that need one are reported as ignored.

#![allow(clippy::unwrap_used, reason = "a test fails by a panic")]

// The targets of `fuzz_targets` say `libfuzzer_sys::fuzz_target!`.
extern crate self as libfuzzer_sys;

mod analyse;
mod bad_input;
mod bake_same_bytes;
mod browser;
mod carving;
mod changes;
mod command_line;
mod dependencies;
mod documents;
mod drape;
mod drawings;
mod faults;
mod fidelity;
mod file_safety;
mod fuzz_targets;
mod gaps;
mod load;
mod mesh;
mod mesh_cracks;
mod node_error;
mod office;
mod packets;
mod proposals;
mod python;
mod qgis;
mod random_commands;
mod scripts;
mod stream_server_restart;
mod stream_slow_link;
mod stream_sources;
mod structure;
mod synth;
mod thin;
mod tidy;
mod translucency;
mod twin_compose;
mod twin_hit_counts;
mod twin_landmark;
mod twin_mesh;
mod twin_occlusion;
mod twin_raycast;
mod twin_stone;
mod twin_visibility;
mod window;
mod zoo;

use insula_tests::trials::Trials;

/// Adds the tests of a module.
type Add = fn(&mut Trials);

/// Those that take longest come first, so that none is left over at the end.
const MODULES: [(&str, Add); 45] = [
    ("browser", browser::add),
    ("window", window::add),
    ("fidelity", fidelity::add),
    ("twin_raycast", twin_raycast::add),
    ("mesh_cracks", mesh_cracks::add),
    ("mesh", mesh::add),
    ("faults", faults::add),
    ("zoo", zoo::add),
    ("carving", carving::add),
    ("file_safety", file_safety::add),
    ("random_commands", random_commands::add),
    ("drawings", drawings::add),
    ("gaps", gaps::add),
    ("thin", thin::add),
    ("node_error", node_error::add),
    ("load", load::add),
    ("stream_slow_link", stream_slow_link::add),
    ("stream_server_restart", stream_server_restart::add),
    ("stream_sources", stream_sources::add),
    ("bad_input", bad_input::add),
    ("bake_same_bytes", bake_same_bytes::add),
    ("twin_compose", twin_compose::add),
    ("twin_hit_counts", twin_hit_counts::add),
    ("twin_landmark", twin_landmark::add),
    ("twin_mesh", twin_mesh::add),
    ("twin_occlusion", twin_occlusion::add),
    ("twin_stone", twin_stone::add),
    ("twin_visibility", twin_visibility::add),
    ("translucency", translucency::add),
    ("python", python::add),
    ("packets", packets::add),
    ("drape", drape::add),
    ("synth", synth::add),
    ("scripts", scripts::add),
    ("qgis", qgis::add),
    ("office", office::add),
    ("documents", documents::add),
    ("command_line", command_line::add),
    ("analyse", analyse::add),
    ("changes", changes::add),
    ("proposals", proposals::add),
    ("fuzz_targets", fuzz_targets::add),
    ("dependencies", dependencies::add),
    ("structure", structure::add),
    ("tidy", tidy::add),
];

fn main() {
    let mut trials = Trials::open();
    for (name, add) in MODULES {
        add(trials.module(name));
    }
    trials.run(|| {
        browser::close();
        window::close();
    })
}
