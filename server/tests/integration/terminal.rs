//! What the program prints of a city that somebody else made.

use insula_protocol::manifest::Attribution;
use insula_protocol::text::printable;
use insula_test_support::small_city;
use std::fs;
use std::process::Command;

/// Sets the title of a terminal, clears it, and writes backwards.
const EVIL: &str = "x\u{1b}]0;evil\u{7}\u{1b}[2J\u{9b}31m\u{202e}\r\n0 faults";

#[test]
fn texts_of_cities_control_no_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("city");
    small_city::write_city(&city, "two");
    let mut manifest = small_city::manifest("two");
    (manifest.title, manifest.crs) = (EVIL.into(), Some(EVIL.into()));
    manifest.attribution = vec![Attribution { text: EVIL.into(), licence: Some(EVIL.into()), url: Some(EVIL.into()) }];
    fs::write(city.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let broken = folder.path().join("broken");
    small_city::write_city(&broken, "two");
    let text = fs::read_to_string(broken.join("city.json")).unwrap();
    let unknown = serde_json::to_string(EVIL).unwrap();
    fs::write(broken.join("city.json"), text.replacen("\"depth\"", &unknown, 1)).unwrap();
    let missing = folder.path().join(EVIL);
    let run = |arguments: &[&std::ffi::OsStr]| {
        let output = Command::new(env!("CARGO_BIN_EXE_insula-server")).args(arguments).output().unwrap();
        for text in [&output.stdout, &output.stderr].map(|bytes| String::from_utf8(bytes.clone()).unwrap()) {
            text.lines().for_each(|line| assert_eq!(printable(line), line, "{arguments:?}"));
        }
        String::from_utf8(output.stdout).unwrap()
    };
    for path in [&city, &broken, &missing].map(|path| path.as_os_str()) {
        run(&["inspect".as_ref(), path]);
        run(&["verify".as_ref(), path]);
        run(&["serve".as_ref(), path, EVIL.as_ref(), "--listen".as_ref(), EVIL.as_ref()]);
    }
    let table = run(&["inspect".as_ref(), city.as_os_str()]);
    assert!(table.contains(&*printable(EVIL)), "{table}");
    let json = run(&["inspect".as_ref(), city.as_os_str(), "--json".as_ref()]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(json.to_string().contains(&serde_json::to_string(EVIL).unwrap()), "{json}");
}
