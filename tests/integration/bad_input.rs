//! Invalid input of the programs: an error of one line and exit code 1, or a reported skip. Never a panic, never an incomplete
//! city.

use anyhow::{Context, Result, ensure};
use insula_test_support::tier;
use insula_tests::programs::{ServerProcess, program, run};
use insula_tests::trials::{Test, Trials, WHOLE_CITY};
use insula_tests::{fixtures, tests};
use serde_json::{Value, json};
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};
use tempfile::TempDir;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        truncated_json_is_an_error,
        empty_cities_are_errors,
        faults_of_single_objects_are_skipped_and_reported,
        invalid_numbers_are_errors_or_skipped,
        dangling_references_in_obj_are_skipped_or_errors,
        a_full_disk_is_an_error,
        truncated_or_altered_archives_are_detected,
        intact_tiles_of_a_damaged_city_are_drawn,
        unusable_addresses_are_errors
    ]);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/cases/hostile");
    let is_absent = !folder.is_dir();
    let hostile = Test::new("small_files_that_ask_for_much_end", move || small_files_that_ask_for_much_end(&folder));
    trials.add([hostile.ignored_if(is_absent).in_turn(&WHOLE_CITY)]);
}

type Fault = fn(&mut Value);

/// Far longer than a bake of a small file takes on any machine.
const BAKE_PATIENCE: Duration = Duration::from_secs(600);

/// A temporary folder.
struct Bench {
    folder: TempDir,
}

impl Bench {
    fn new() -> Result<Self> {
        Ok(Self { folder: tempfile::tempdir()? })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<PathBuf> {
        let path = self.path(name);
        fs::write(&path, bytes).with_context(|| name.to_owned())?;
        Ok(path)
    }

    /// Bakes `input` to `city`, with a report.
    fn bake(&self, input: &Path) -> Result<Output> {
        let [out, report] = ["city", "report.json"].map(|name| self.path(name));
        run(Command::new(program("insula-server")?)
            .arg("bake")
            .arg(input)
            .arg("--out")
            .arg(out)
            .arg("--report")
            .arg(report))
    }

    /// Asserts that a bake fails and leaves no city. Returns the error.
    fn bake_fails(&self, what: &str, input: &Path) -> Result<String> {
        let line = fails(what, &self.bake(input)?)?;
        ensure!(!self.path("city").exists(), "{what}: an incomplete city is left");
        Ok(line)
    }

    /// Asserts that a bake succeeds, reports a skip, and makes a valid city. Returns the report.
    fn bake_skips(&self, what: &str, input: &Path) -> Result<Value> {
        let output = self.bake(input)?;
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        ensure!(output.status.success(), "{what}: {error}");
        ensure!(!error.contains("panicked"), "{what}: {error}");
        let verified = run(Command::new(program("insula-server")?).arg("verify").arg(self.path("city")))?;
        ensure!(verified.status.success(), "{what}: the city is not whole");
        let report = serde_json::from_slice(&fs::read(self.path("report.json"))?)?;
        every_object_is_accounted_for(&report).context(what.to_owned())?;
        Ok(report)
    }
}

/// Asserts that each source's objects are kept, merged, replaced by a finer level, without geometry or skipped.
fn every_object_is_accounted_for(report: &Value) -> Result<()> {
    for source in report["read"]["sources"].as_array().context("no sources")? {
        let number = |key: &str| source[key].as_u64().with_context(|| format!("no {key}"));
        let mut known = number("objects")? + number("coarser_left_out")? + number("without_geometry")?;
        for faults in ["merged", "skipped"] {
            let faults = source[faults].as_object().context("no reasons")?;
            known += faults.values().filter_map(|fault| fault["count"].as_u64()).sum::<u64>();
        }
        ensure!(number("found")? == known, "{known} objects are accounted for in {source}");
    }
    Ok(())
}

/// Bakes of the files that are kept beside the workspace, and of the tilesets in its folders, succeed or fail with an error.
fn small_files_that_ask_for_much_end(folder: &Path) -> Result<()> {
    let mut inputs: Vec<PathBuf> = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    inputs.iter_mut().filter(|input| input.is_dir()).for_each(|input| input.push("tileset.json"));
    inputs.retain(|input| input.extension().is_some_and(|extension| extension != "md"));
    ensure!(!inputs.is_empty(), "{}: it has no inputs", folder.display());
    for input in inputs {
        let what = input.display().to_string();
        let bench = Bench::new()?;
        let log = bench.path("log");
        let mut command = Command::new(program("insula-server")?);
        command.arg("bake").arg(&input).arg("--out").arg(bench.path("city"));
        let mut bake = command.stdout(Stdio::null()).stderr(fs::File::create(&log)?).spawn()?;
        let begin = Instant::now();
        let status = loop {
            if let Some(status) = bake.try_wait()? {
                break status;
            }
            if begin.elapsed() > BAKE_PATIENCE {
                bake.kill()?;
                bake.wait()?;
                anyhow::bail!("{what}: the bake does not end");
            }
            sleep(Duration::from_millis(20));
        };
        let error = fs::read_to_string(&log)?;
        let has_reason = error.lines().any(|line| line.starts_with("error: ") && line.len() > 20);
        let has_failed = matches!(status.code(), Some(1..=3)) && has_reason && !error.contains("panicked");
        ensure!(status.success() || has_failed, "{what}: {:?}: {error}", status.code());
    }
    Ok(())
}

/// Asserts exit code 1 and one line on standard error. Returns the line.
fn fails(what: &str, output: &Output) -> Result<String> {
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    ensure!(output.status.code() == Some(1), "{what}: {:?}: {error}", output.status);
    ensure!(!error.contains("panicked"), "{what}: {error}");
    let lines: Vec<&str> = error.lines().filter(|line| line.starts_with("error: ")).collect();
    ensure!(lines.len() == 1 && lines[0].len() > 20, "{what}: not one line that says what is wrong: {error:?}");
    // A slow bake also says how far it is.
    let is_other = |line: &&str| !["error: ", "baking: "].iter().any(|start| line.starts_with(start));
    let others = error.lines().filter(|line| !line.trim().is_empty()).filter(is_other).count();
    ensure!(others == 0, "{what}: more than one line: {error:?}");
    Ok(lines[0].to_owned())
}

/// Whether the report mentions that something was skipped.
fn reports_skips(report: &Value) -> bool {
    let text = report.to_string();
    text.contains("skipped") && (has_positive(report, "skipped") || has_positive(report, "count"))
}

/// Whether any key that contains `word` has a positive number, or a list or object that is not empty.
fn has_positive(value: &Value, word: &str) -> bool {
    match value {
        Value::Object(map) => map.iter().any(|(key, value)| {
            let more = value.as_u64().is_some_and(|n| n > 0)
                || value.as_array().is_some_and(|list| !list.is_empty())
                || value.as_object().is_some_and(|map| !map.is_empty());
            (key.contains(word) && more) || has_positive(value, word)
        }),
        Value::Array(list) => list.iter().any(|value| has_positive(value, word)),
        _ => false,
    }
}

fn truncated_json_is_an_error() -> Result<()> {
    let whole = fixtures::city_json(3).to_string();
    for share in [0.0, 0.1, 0.5, 0.9, 0.999] {
        let bench = Bench::new()?;
        let input = bench.write("town.city.json", &whole[..(whole.len() as f64 * share) as usize])?;
        let line = bench.bake_fails(&format!("JSON cut at {share}"), &input)?;
        ensure!(line.contains("town.city.json"), "{line}");
    }
    Ok(())
}

fn empty_cities_are_errors() -> Result<()> {
    let nothing = json!({ "type": "CityJSON", "version": "2.0", "CityObjects": {}, "vertices": [],
        "transform": { "scale": [1.0, 1.0, 1.0], "translate": [0.0, 0.0, 0.0] } });
    let bench = Bench::new()?;
    bench.bake_fails("no objects", &bench.write("empty.city.json", nothing.to_string())?)?;
    bench.bake_fails("an empty OBJ", &bench.write("empty.obj", "# nothing\n")?)?;
    bench.bake_fails("an empty sequence", &bench.write("empty.city.jsonl", "")?)?;
    bench.bake_fails("an empty folder", bench.folder.path().join("none").as_path())?;
    bench.bake_fails("some other file", &bench.write("a.city.json", "{\"type\":\"FeatureCollection\"}")?)?;
    bench.bake_fails("an image as a city", &bench.write("b.city.json", [0x89, b'P', b'N', b'G', 0xff, 0xfe])?)?;
    Ok(())
}

fn faults_of_single_objects_are_skipped_and_reported() -> Result<()> {
    let faults: [(&str, Fault); 5] = [
        ("an index out of range", |geometry| geometry["boundaries"][0][1][0][2] = json!(4_000_000)),
        ("a negative index", |geometry| geometry["boundaries"][0][1][0][2] = json!(-1)),
        ("a degenerate polygon", |geometry| geometry["boundaries"][0][1][0] = json!([4, 4, 4, 4])),
        ("a polygon of two corners", |geometry| geometry["boundaries"][0][1][0] = json!([4, 5])),
        ("a polygon of nothing", |geometry| geometry["boundaries"][0][1] = json!([])),
    ];
    for (what, fault) in faults {
        let mut town = fixtures::city_json(3);
        fault(&mut town["CityObjects"]["house-0"]["geometry"][0]);
        let bench = Bench::new()?;
        let report = bench.bake_skips(what, &bench.write("town.city.json", town.to_string())?)?;
        ensure!(reports_skips(&report), "{what}: the report does not mention it: {report}");
    }
    Ok(())
}

fn invalid_numbers_are_errors_or_skipped() -> Result<()> {
    let bench = Bench::new()?;
    // 1e300 as translation and as scale. NaN is not valid JSON.
    let mut town = fixtures::city_json(3);
    town["transform"]["translate"][0] = json!(1e300);
    bench.bake_fails("a translation of 1e300", &bench.write("a.city.json", town.to_string())?)?;
    let mut town = fixtures::city_json(3);
    town["transform"]["scale"][2] = json!(1e300);
    bench.bake_fails("a scale of 1e300", &bench.write("b.city.json", town.to_string())?)?;
    let text = fixtures::city_json(3).to_string().replace("0.001", "NaN");
    bench.bake_fails("NaN in JSON", &bench.write("c.city.json", text)?)?;
    let house = "v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 9\n";
    for number in ["nan", "inf", "1e300", "-1e39"] {
        let bench = Bench::new()?;
        let text = format!("{house}v {number} 5 5\nf 1 2 3\nf 1 3 4\nf 1 2 5\n");
        let report = bench.bake_skips(number, &bench.write("house.obj", text)?)?;
        ensure!(reports_skips(&report), "{number}: the report does not mention it: {report}");
    }
    Ok(())
}

fn dangling_references_in_obj_are_skipped_or_errors() -> Result<()> {
    let house = "v 0 0 0\nv 20 0 0\nv 20 20 0\nv 0 20 9\nf 1 2 3\nf 1 3 4\n";
    for (what, more) in [("a face out of range", "f 1 2 9999\n"), ("a face that counts back too far", "f -1 -2 -99\n")]
    {
        let bench = Bench::new()?;
        let output = bench.bake(&bench.write("house.obj", format!("{house}{more}"))?)?;
        // Either the face is skipped and reported, or the file is an error.
        if output.status.success() {
            let report: Value = serde_json::from_slice(&fs::read(bench.path("report.json"))?)?;
            ensure!(reports_skips(&report), "{what}: the report does not mention it: {report}");
        } else {
            fails(what, &output)?;
            ensure!(!bench.path("city").exists(), "{what}: an incomplete city is left");
        }
    }
    let bench = Bench::new()?;
    bench.write("house.mtl", "newmtl a\nKd 1 0 0\nmap_Kd gone.jpg\nnewmtl b\nmap_Kd broken.jpg\n")?;
    bench.write("broken.jpg", [0xff, 0xd8, 0xff, 0xe0, 1, 2, 3])?;
    let text = format!(
        "mtllib house.mtl\nmtllib gone.mtl\nusemtl a\n{house}usemtl b\nvt 0 0\nf 1/1 2/1 4/1\nusemtl c\nf 2 3 4\n"
    );
    let report = bench.bake_skips("missing textures", &bench.write("house.obj", text)?)?.to_string();
    ensure!(
        report.contains("gone.jpg") && report.contains("broken.jpg"),
        "the report names no missing texture: {report}"
    );
    Ok(())
}

fn a_full_disk_is_an_error() -> Result<()> {
    let bench = Bench::new()?;
    let input = fixtures::write_city_json(bench.folder.path(), 14)?;
    // From the first files of a bake to its last.
    let limits: &[u32] = if tier::is_full() { &[1, 8, 24, 64] } else { &[1, 64] };
    for kilobytes in limits {
        // With SIGXFSZ ignored, a limit on file sizes fails writes as a full disk does.
        let script = format!("trap '' XFSZ; ulimit -f {kilobytes}; exec \"$0\" bake \"$1\" --out \"$2\"");
        let output = run(Command::new("bash")
            .args(["-c", &script])
            .arg(program("insula-server")?)
            .arg(&input)
            .arg(bench.path("city")))?;
        let what = format!("files of at most {kilobytes} KiB");
        let line = fails(&what, &output)?;
        ensure!(line.contains("disk"), "{what}: {line}");
        let is_kept = bench.path("city.partial/packs").exists();
        ensure!(line.contains("--resume") == is_kept, "{what}: {line}");
        ensure!(is_kept || !bench.path("city.partial").exists(), "{what}: an empty scratch folder is left");
        ensure!(!bench.path("city").exists(), "{what}: an incomplete city is left");
    }
    let out = bench.path("no-folder/city");
    fs::write(bench.path("no-folder"), "a file")?;
    let output = run(Command::new(program("insula-server")?).arg("bake").arg(&input).arg("--out").arg(out))?;
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    ensure!(output.status.code() == Some(2) && error.contains("cannot be created in"), "{error}");
    Ok(())
}

fn town(bench: &Bench) -> Result<PathBuf> {
    let input = fixtures::write_city_json(bench.folder.path(), 8)?;
    let output = bench.bake(&input)?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(bench.path("city"))
}

fn truncated_or_altered_archives_are_detected() -> Result<()> {
    let bench = Bench::new()?;
    let city = town(&bench)?;
    let verify = |what: &str| -> Result<Output> {
        let output = run(Command::new(program("insula-server")?).arg("verify").arg(&city))?;
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        ensure!(!error.contains("panicked"), "{what}: {error}");
        Ok(output)
    };
    ensure!(verify("an intact city")?.status.success(), "an intact city is reported as damaged");
    for name in ["blockmaps.pmtiles", "subtrees.pmtiles", "city.json"] {
        let path = city.join(name);
        let whole = fs::read(&path)?;
        for share in [0.0, 0.02, 0.5, 0.95] {
            fs::write(&path, &whole[..(whole.len() as f64 * share) as usize])?;
            let what = format!("{name} cut at {share}");
            ensure!(verify(&what)?.status.code() == Some(1), "{what} is not detected");
            let served =
                run(Command::new(program("insula-server")?).arg("serve").arg(&city).args(["--listen", "127.0.0.1:0"]));
            // If the directories are intact, the server starts: only `verify` finds the truncation. Then it has to be killed.
            if let Ok(served) = served {
                fails(&what, &served)?;
            }
        }
        fs::write(&path, &whole)?;
    }
    let path = city.join("blockmaps.pmtiles");
    let whole = fs::read(&path)?;
    // Offset and length of the tile data in the header of PMTiles v3. Some bytes before it are not used.
    let number = |at: usize| whole[at..at + 8].iter().rev().fold(0, |n, b| n << 8 | usize::from(*b));
    let (start, length) = (number(56), number(64));
    for share in [0.3, 0.6, 0.9] {
        let mut altered = whole.clone();
        altered[start + (length as f64 * share) as usize] ^= 0x20;
        fs::write(&path, &altered)?;
        let output = verify("a flipped bit")?;
        ensure!(output.status.code() == Some(1), "a flipped bit at {share} is not detected");
    }
    Ok(())
}

fn intact_tiles_of_a_damaged_city_are_drawn() -> Result<()> {
    let bench = Bench::new()?;
    let city = town(&bench)?;
    let path = city.join("blockmaps.pmtiles");
    let mut bytes = fs::read(&path)?;
    let at = bytes.len() - 40;
    bytes[at] ^= 0x20;
    fs::write(&path, &bytes)?;
    let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let camera = json!({ "position": [84140.0, 446900.0, 120.0], "target": [84140.0, 447140.0, 0.0],
        "up": [0, 0, 1], "fov_y_deg": 60 });
    let camera = bench.write("camera.json", camera.to_string())?;
    let output = snapshot(&bench, &format!("http://{}", server.address), &camera, PATIENCE)?;
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    ensure!(output.status.success(), "{told}");
    let written = bench.path("a.png").display().to_string();
    ensure!(told.starts_with(&format!("wrote {written} (160 x 90 pixels, ")) && told.lines().count() == 1, "{told:?}");
    ensure!(output.stdout.is_empty(), "{:?}", output.stdout);
    let report: Value = serde_json::from_slice(&fs::read(bench.path("view.json"))?)?;
    ensure!(report["tiles"]["blockmaps"].as_u64() > Some(0), "{report}");
    Ok(())
}

/// Seconds after which a client gives up a server: one that responds, and one that does not.
const PATIENCE: &str = "60";
const IMPATIENCE: &str = "1";

fn snapshot(bench: &Bench, url: &str, camera: &Path, timeout: &str) -> Result<Output> {
    run(Command::new(program("insula")?)
        .args(["snapshot", "--adapter", "cpu", "--timeout", timeout, "--size", "160x90", "--server", url, "--camera"])
        .arg(camera)
        .arg("--out")
        .arg(bench.path("a.png"))
        .arg("--report")
        .arg(bench.path("view.json")))
}

fn unusable_addresses_are_errors() -> Result<()> {
    let bench = Bench::new()?;
    let camera = bench.write("camera.json", r#"{"position":[0,0,9],"target":[9,9,0],"up":[0,0,1],"fov_y_deg":60}"#)?;
    // Nothing listens on a port that was just closed.
    let free = TcpListener::bind("127.0.0.1:0")?.local_addr()?;
    fails("nothing listens", &snapshot(&bench, &format!("http://{free}"), &camera, IMPATIENCE)?)?;
    fails("no such host", &snapshot(&bench, "http://no-such-host.invalid:7700", &camera, IMPATIENCE)?)?;
    // Listens, but does not respond.
    let mute = TcpListener::bind("127.0.0.1:0")?;
    fails("no response", &snapshot(&bench, &format!("http://{}", mute.local_addr()?), &camera, IMPATIENCE)?)?;
    let city = town(&bench)?;
    let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
    fails(
        "no such city",
        &snapshot(&bench, &format!("http://{}/v1/cities/atlantis", server.address), &camera, IMPATIENCE)?,
    )?;
    let broken = bench.write("broken.json", "{\"position\":[0,0")?;
    let output = snapshot(&bench, &format!("http://{}", server.address), &broken, IMPATIENCE)?;
    ensure!(output.status.code() == Some(2) && output.stderr.starts_with(b"error: "), "a camera cut short: {output:?}");
    let taken = run(Command::new(program("insula-server")?)
        .arg("serve")
        .arg(&city)
        .args(["--listen", &server.address.to_string()]))?;
    let line = fails("a port in use", &taken)?;
    ensure!(line.contains(&server.address.to_string()), "{line}");
    ensure!(!bench.path("a.png").exists(), "an image was written");
    Ok(())
}
