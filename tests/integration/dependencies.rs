//! Dependencies between the packages of the workspace, and libraries that a package must not use. See docs/architecture.md.

use insula_tests::tests;
use insula_tests::trials::Trials;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        packages_depend_only_on_those_below_them,
        optional_parts_are_optional_dependencies,
        packages_do_not_use_banned_libraries,
        programs_and_tests_have_the_same_features
    ]);
}

/// The output of `cargo metadata`.
struct Workspace {
    metadata: Value,
}

/// The target triple of this machine.
fn host() -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("-vV").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().find_map(|line| line.strip_prefix("host: ")).unwrap().to_owned()
}

/// A dependency as its package declares it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Declared {
    name: String,
    optional: bool,
}

impl Workspace {
    fn load() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        // Dependencies of other platforms may not have been downloaded.
        let output = Command::new(env!("CARGO"))
            .args(["metadata", "--format-version", "1", "--offline", "--locked", "--filter-platform", &host()])
            .current_dir(root)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Self { metadata: serde_json::from_slice(&output.stdout).unwrap() }
    }

    fn packages(&self) -> impl Iterator<Item = &Value> {
        self.metadata["packages"].as_array().unwrap().iter()
    }

    fn package(&self, name: &str) -> &Value {
        self.packages().find(|p| p["name"] == name).unwrap_or_else(|| panic!("no package {name}"))
    }

    /// The normal dependencies that `package` declares.
    fn declared(&self, package: &str) -> BTreeSet<Declared> {
        let dependencies = self.package(package)["dependencies"].as_array().unwrap().iter();
        let normal = dependencies.filter(|d| d["kind"].is_null());
        normal
            .map(|d| Declared { name: d["name"].as_str().unwrap().into(), optional: d["optional"].as_bool().unwrap() })
            .collect()
    }

    fn insula_dependencies(&self, package: &str) -> Vec<String> {
        self.declared(package).into_iter().map(|d| d.name).filter(|name| name.starts_with("insula-")).collect()
    }

    fn default_features(&self, package: &str) -> BTreeSet<String> {
        let features = &self.package(package)["features"];
        let mut reached = BTreeSet::new();
        let mut open = vec!["default".to_owned()];
        while let Some(feature) = open.pop() {
            if reached.insert(feature.clone()) {
                let next = features[&feature].as_array().into_iter().flatten();
                open.extend(next.map(|f| f.as_str().unwrap().to_owned()));
            }
        }
        reached
    }

    /// Names of all packages that `package` depends on, directly or not, by normal dependencies.
    fn closure(&self, package: &str) -> BTreeSet<String> {
        let nodes = self.metadata["resolve"]["nodes"].as_array().unwrap();
        let by_id: BTreeMap<&str, &Value> = nodes.iter().map(|n| (n["id"].as_str().unwrap(), n)).collect();
        let name: BTreeMap<&str, &str> =
            self.packages().map(|p| (p["id"].as_str().unwrap(), p["name"].as_str().unwrap())).collect();
        let mut open = vec![self.package(package)["id"].as_str().unwrap()];
        let mut reached = BTreeSet::new();
        while let Some(id) = open.pop() {
            for dep in by_id[id]["deps"].as_array().unwrap() {
                let kinds = dep["dep_kinds"].as_array().unwrap();
                let next = dep["pkg"].as_str().unwrap();
                if kinds.iter().any(|k| k["kind"].is_null()) && reached.insert(next) {
                    open.push(next);
                }
            }
        }
        reached.into_iter().map(|id| name[id].to_owned()).collect()
    }
}

/// The packages of the workspace that each may depend on.
const ALLOWED: [(&str, &[&str]); 29] = [
    ("insula-protocol", &[]),
    ("insula-archive", &["insula-protocol"]),
    ("insula-command-line", &["insula-protocol", "insula-archive"]),
    ("insula-shaders", &["insula-protocol"]),
    ("insula-objects", &["insula-protocol"]),
    (
        "insula-bake",
        &[
            "insula-protocol", "insula-archive", "insula-objects", "insula-occlusion", "insula-shaders",
            "insula-viewer", "insula-visibility", "insula-source", "insula-place", "insula-dress", "insula-scratch",
            "insula-simplify", "insula-read-city", "insula-read-ground", "insula-read-map", "insula-read-scene",
        ],
    ),
    ("insula-source", &["insula-protocol", "insula-archive", "insula-objects"]),
    ("insula-place", &["insula-source", "insula-archive"]),
    ("insula-dress", &["insula-protocol", "insula-source"]),
    ("insula-scratch", &["insula-protocol"]),
    ("insula-simplify", &["insula-protocol", "insula-dress"]),
    ("insula-read-city", &["insula-source", "insula-place", "insula-dress"]),
    ("insula-read-ground", &["insula-source", "insula-place", "insula-dress", "insula-protocol", "insula-roam"]),
    ("insula-read-map", &["insula-source", "insula-place", "insula-dress"]),
    ("insula-read-scene", &["insula-source", "insula-dress", "insula-simplify"]),
    ("insula-export", &["insula-protocol", "insula-archive", "insula-objects", "insula-roam", "insula-shaders"]),
    (
        "insula-draw",
        &["insula-protocol", "insula-archive", "insula-objects", "insula-export", "insula-roam", "insula-shaders"],
    ),
    ("insula-analysis", &["insula-protocol", "insula-objects", "insula-export", "insula-viewer"]),
    ("insula-occlusion", &["insula-shaders"]),
    ("insula-roam", &[]),
    ("insula-visibility", &["insula-protocol"]),
    (
        "insula-server",
        &[
            "insula-protocol", "insula-archive", "insula-command-line", "insula-objects", "insula-analysis",
            "insula-bake", "insula-draw", "insula-export", "insula-occlusion", "insula-simplify", "insula-source",
        ],
    ),
    ("insula-viewer", &["insula-protocol", "insula-archive", "insula-objects", "insula-shaders"]),
    ("insula-web-host", &["insula-protocol", "insula-objects", "insula-shaders", "insula-viewer"]),
    ("insula-web-gpu", &["insula-shaders", "insula-viewer", "insula-web-host"]),
    ("insula-web-meshes", &["insula-protocol", "insula-viewer", "insula-web-host"]),
    ("insula-web-objects", &["insula-archive", "insula-objects", "insula-viewer", "insula-web-host"]),
    ("insula-web", &["insula-protocol", "insula-archive", "insula-shaders", "insula-viewer", "insula-web-host"]),
    (
        "insula-client",
        &[
            "insula-protocol", "insula-archive", "insula-command-line", "insula-objects", "insula-shaders",
            "insula-viewer", "insula-server", "insula-analysis", "insula-bake", "insula-draw", "insula-export",
        ],
    ),
];

fn packages_depend_only_on_those_below_them() {
    let workspace = Workspace::load();
    for (package, below) in ALLOWED {
        for found in workspace.insula_dependencies(package) {
            assert!(below.contains(&found.as_str()), "{package} must not depend on {found}");
        }
    }
    let members = workspace.packages().filter(|p| p["source"].is_null()).map(|p| p["name"].as_str().unwrap());
    let tests = ["insula-tests", "insula-measure", "insula-test-support"];
    for member in members.filter(|name| !tests.contains(name)) {
        assert!(ALLOWED.iter().any(|(package, _)| *package == member), "{member} is not in the table above");
    }
}

/// What packages must build without.
const OPTIONAL: [(&str, &[&str]); 6] = [
    (
        "insula-server",
        &["insula-analysis", "insula-bake", "insula-draw", "insula-occlusion", "insula-simplify", "insula-source"],
    ),
    ("insula-occlusion", &["insula-shaders"]),
    ("insula-client", &["insula-server", "insula-bake", "insula-draw", "insula-export", "insula-analysis"]),
    ("insula-archive", &["blake3", "moka", "tokio"]),
    ("insula-shaders", &["wgpu"]),
    ("insula-viewer", &["wgpu"]),
];

fn optional_parts_are_optional_dependencies() {
    let workspace = Workspace::load();
    for (package, optional) in OPTIONAL {
        for name in optional {
            let found = workspace.declared(package).into_iter().find(|d| d.name == *name);
            assert!(found.is_some_and(|d| d.optional), "{package} must build without {name}");
        }
    }
    for (package, feature, is_default) in [
        ("insula-server", "bake", true),
        ("insula-client", "embedded", true),
        ("insula-archive", "block-cache", false),
        ("insula-shaders", "gpu", false),
        ("insula-viewer", "gpu", false),
    ] {
        assert_eq!(workspace.default_features(package).contains(feature), is_default, "{package}: {feature}");
    }
}

fn packages_do_not_use_banned_libraries() {
    let workspace = Workspace::load();
    let network: &[&str] = &["axum", "hyper", "reqwest", "tower", "tower-http"];
    let graphics: &[&str] = &["wgpu", "winit", "egui"];
    let declared = |package: &str| workspace.declared(package).into_iter().map(|d| d.name).collect();
    let check = |package: &str, found: BTreeSet<String>, banned: &[&[&str]]| {
        for name in banned.concat() {
            assert!(!found.contains(name), "{package} must not use {name}");
        }
    };
    let all_below = workspace.closure("insula-protocol");
    check("insula-protocol", all_below, &[network, graphics, &["tokio", "tracing", "rayon"]]);
    for (package, banned) in [
        ("insula-archive", &[network, graphics, &["object_store", "pmtiles", "tracing", "rayon"]][..]),
        ("insula-shaders", &[network, &["tokio", "winit", "egui"]]),
        ("insula-viewer", &[network, &["winit", "egui", "tokio", "clap", "rayon", "directories", "pollster"]]),
        ("insula-bake", &[network, graphics, &["tokio", "clap"]]),
        ("insula-occlusion", &[network, graphics, &["tokio", "tracing", "clap", "insula-bake"]]),
        ("insula-server", &[graphics]),
        ("insula-client", &[&["axum", "pmtiles"]]),
    ] {
        check(package, declared(package), banned);
    }
}

/// Features of each dependency of a selection of packages.
fn features(selection: &[&str]) -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--prefix", "none", "--format", "{p}|{f}|"])
        .args(selection)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut found: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        if let [package, features, ..] = line.split('|').collect::<Vec<_>>()[..] {
            found.entry(package.to_owned()).or_default().insert(features.to_owned());
        }
    }
    found
}

/// For each set of features, a dependency and everything above it is compiled again. Tests therefore ask for no feature
/// that the programs do not have.
fn programs_and_tests_have_the_same_features() {
    let of_tests = features(&["--workspace", "--edges", "normal,build,dev"]);
    let of_programs = features(&["-p", "insula-client", "-p", "insula-server", "--edges", "normal,build"]);
    assert!(of_programs.len() > 300, "only {} dependencies", of_programs.len());
    for (package, features) in of_programs {
        let shared = &of_tests[&package];
        assert!(features.is_subset(shared), "{package} is compiled again for tests: {features:?}, {shared:?}");
    }
}
