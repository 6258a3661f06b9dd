//! The plugin for QGIS, as far as it needs no QGIS: its unit tests, which also run the program by the plugin's command lines. Without
//! Python, they are reported as ignored.

use super::scripts::passes_its_unit_tests;
use insula_tests::programs::{find_installed, program};
use insula_tests::trials::{Test, Trials};
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    let run = || {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client/qgis/tests");
        let server = program("insula-server")?;
        passes_its_unit_tests(&folder, &[("INSULA_SERVER", server.as_path())])
    };
    trials.add([Test::new("the_plugin_passes_its_tests", run).ignored_if(find_installed("python3").is_none())]);
}
