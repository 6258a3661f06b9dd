//! The structure of the code: import directions, names, lengths. See docs/architecture.md, "Invariants".

use insula_tests::source_code::{
    CrateModules, function_lengths, is_test, tracked_files, type_definitions, without_inline_tests,
};
use insula_tests::tests;
use insula_tests::trials::Trials;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        modules_import_without_circles, only_stream_fetches, only_render_and_ui_name_wgpu,
        viewer_knows_no_clock_thread_or_file, bakes_use_portable_functions, functions_are_short_enough_to_read,
        no_file_is_included_by_path, files_are_written_and_removed_by_few, type_names_have_one_definition
    ]);
}

/// Folders of the crates' sources.
const CRATES: [&str; 30] = [
    "protocol/src", "protocol/archive/src", "protocol/objects/src", "shaders/src", "client/viewer/src", "client/src",
    "client/web/src", "client/web/gpu/src", "client/web/host/src", "client/web/meshes/src", "client/web/objects/src",
    "server/analysis/src", "server/bake/src", "server/draw/src", "server/dress/src", "server/export/src",
    "server/occlusion/src", "server/place/src", "server/readers/city/src", "server/readers/ground/src",
    "server/readers/map/src", "server/readers/scene/src", "server/roam/src", "server/scratch/src",
    "server/simplify/src", "server/source/src", "server/visibility/src", "server/src", "tests/harness",
    "tests/support/src",
];
const MAX_RUST_FUNCTION: usize = 80;
const MAX_WGSL_FUNCTION: usize = 90;
/// Most type names with more than one definition.
const MAX_SHARED_NAMES: usize = 5;

fn modules_import_without_circles() {
    let files = tracked_files().unwrap();
    let mut circles = Vec::new();
    for source in CRATES {
        let modules = CrateModules::new(&files, source);
        assert!(modules.len() > 1, "{source} has {} modules", modules.len());
        let circle = modules.import_circle().unwrap();
        circles.extend(circle.map(|circle| format!("{source}: {}", circle.join(" -> "))));
    }
    assert!(circles.is_empty(), "import circles: {circles:#?}");
}

/// Asserts that, below `source`, only files that start with one of `allowed` contain one of `words` in their code.
fn assert_only(source: &str, words: &[&str], allowed: &[&str]) {
    let files = tracked_files().unwrap();
    let outside = files.iter().filter(|(name, _)| name.starts_with(source) && name.ends_with(".rs") && !is_test(name));
    for (name, text) in outside.filter(|(name, _)| !allowed.iter().any(|prefix| name.starts_with(prefix))) {
        for line in without_inline_tests(text).lines().filter(|line| !line.trim_start().starts_with("//")) {
            for word in words {
                assert!(!line.contains(word), "{name} must not name {word}: {line}");
            }
        }
    }
}

/// Files are replaced by `archive/new_file`, and removed by those that keep lists or markers of their own. A new place needs a reason, and a
/// case in `file_safety`.
fn files_are_written_and_removed_by_few() {
    let words = [
        "fs::write(", " File::create(", "(File::create(", "fs::File::create(", "fs::rename(", "remove_dir_all(",
        "remove_file(", "remove_dir(",
    ];
    let of_archive = ["new_file.rs", "owned.rs", "disk_cache.rs"].map(|file| format!("protocol/archive/src/{file}"));
    let of_server = ["commands/site_folder.rs"].map(|file| format!("server/src/{file}"));
    let of_bake = ["write/files.rs", "write/ownership.rs", "write/scratch_folder.rs", "pipeline/steps/work.rs"];
    // Files in scratch folders, which are checked before.
    let of_scratch = [
        "scene/", "write/", "read/part.rs", "pipeline/steps/generated.rs", "pipeline/steps/region_file.rs",
        "pipeline/steps/scan.rs", "pipeline/steps/shuffle.rs",
    ];
    let of_bake = of_bake.iter().chain(&of_scratch).map(|file| format!("server/bake/src/{file}"));
    // It removes only temporary files that this process created.
    let of_bake = of_bake.chain(["server/dress/src/map_store/", "server/source/src/temporary.rs"].map(str::to_owned));
    // A folder of its own within that of a tileset.
    let of_export = ["server/export/src/tiles3d/write.rs".to_owned()];
    // Build scripts, and the host tool that makes the files of the page.
    let of_client =
        ["client/src/ui/settings.rs", "client/build.rs", "server/build.rs", "client/web/"].map(str::to_owned);
    let allowed: Vec<String> =
        of_archive.into_iter().chain(of_server).chain(of_bake).chain(of_export).chain(of_client).collect();
    let allowed: Vec<&str> = allowed.iter().map(String::as_str).collect();
    for source in ["protocol/", "server/", "client/"] {
        assert_only(source, &words, &allowed);
    }
}

fn only_stream_fetches() {
    assert_only("client/src/", &["reqwest::", "TcpStream", "UdpSocket"], &["client/src/stream/"]);
    // The server fetches through object_store, whose HTTP client is configured there.
    // City files on web servers come through `fetch`.
    assert_only("server/src/", &["reqwest::"], &["server/src/store/same_host.rs", "server/src/commands/addresses.rs"]);
}

fn only_render_and_ui_name_wgpu() {
    assert_only(
        "client/",
        &["wgpu::", "egui_wgpu"],
        &["client/src/render/", "client/src/ui/", "client/viewer/src/render/gpu.rs", "client/web/gpu/src/canvas.rs"],
    );
    assert_only("shaders/src/", &["wgpu::"], &["shaders/src/gpu/"]);
    assert_only("server/", &["wgpu::"], &[]);
}

fn viewer_knows_no_clock_thread_or_file() {
    let banned = ["std::time::Instant", "SystemTime", "std::thread", "std::fs", "tokio::", "RandomState"];
    assert_only("client/viewer/", &banned, &[]);
    assert_only("protocol/src/", &banned, &[]);
}

/// Sines and logarithms of C libraries differ in the last bit between machines, those of the crate `libm` do not.
fn bakes_use_portable_functions() {
    let of_one = "sin cos tan sin_cos asin acos atan sinh cosh tanh exp exp2 exp_m1 ln ln_1p log10 log2 cbrt";
    let mut calls: Vec<String> = of_one.split(' ').map(|function| format!(".{function}()")).collect();
    calls.extend(["powf", "atan2", "hypot", "log"].map(|function| format!(".{function}(")));
    calls.extend(["f32::sin", "f64::sin", "f32::cos", "f64::cos", "f64::hypot", "from_angle"].map(str::to_owned));
    let calls: Vec<&str> = calls.iter().map(String::as_str).collect();
    let of_server = ["bake", "dress", "occlusion", "place", "readers", "simplify", "source", "visibility"];
    for source in of_server.map(|name| format!("server/{name}/")).iter().map(String::as_str).chain(["protocol/src/"]) {
        // A number that counts operations passes on all functions of its trait, and its user calls none of these.
        assert_only(source, &calls, &["server/dress/src/counted_float.rs"]);
    }
}

fn functions_are_short_enough_to_read() {
    for (name, text) in tracked_files().unwrap() {
        let limit = match name.rsplit('.').next() {
            Some("rs") => MAX_RUST_FUNCTION,
            Some("wgsl") => MAX_WGSL_FUNCTION,
            _ => continue,
        };
        for (function, lines) in function_lengths(&text) {
            assert!(lines <= limit, "{name}: {function} has {lines} lines, {limit} are allowed");
        }
    }
}

fn no_file_is_included_by_path() {
    let attribute = concat!("#[pa", "th");
    // Fuzz targets are programs, which no crate can share.
    let is_checked = |name: &str| name.ends_with(".rs") && name != "tests/integration/fuzz_targets.rs";
    for (name, text) in tracked_files().unwrap().into_iter().filter(|(name, _)| is_checked(name)) {
        assert!(!text.contains(attribute), "{name} includes a file of another crate; share it through a crate");
    }
}

/// Folders of readers and writers. Each has the words of its format (node, class, column), which no other module sees.
const FORMATS: [&str; 19] = [
    "server/readers/city/src/cityjson/", "server/readers/city/src/citygml/", "server/place/src/crs/",
    "server/readers/scene/src/gltf/", "server/readers/scene/src/i3s/", "server/readers/scene/src/mesh_file/",
    "server/readers/map/src/osm/", "server/place/src/placement/", "server/readers/ground/src/raster/",
    "server/dress/src/roof/", "server/readers/scene/src/tiles3d/", "server/readers/map/src/vector/",
    "server/export/src/boxes/", "server/export/src/cityjson/", "server/export/src/geometry.rs",
    "server/export/src/glb/", "server/export/src/raster/", "server/export/src/table/", "server/export/src/tiles3d/",
];

fn type_names_have_one_definition() {
    let mut files = tracked_files().unwrap();
    files.retain(|name, _| !FORMATS.iter().any(|folder| name.starts_with(folder)));
    let shared: Vec<_> = type_definitions(&files).into_iter().filter(|(_, at)| at.len() > 1).collect();
    for (name, files) in &shared {
        println!("{name}: {}", files.join(", "));
    }
    assert!(shared.len() <= MAX_SHARED_NAMES, "{} type names have several definitions", shared.len());
}
