//! `bake` and `inspect` of files in a bucket: the same city as from a folder.

use insula_test_support::http::{self, Request};
use std::fs;
use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Answers what an object store does for one bucket whose objects are the files of a folder: sizes, ranges and one list.
struct FakeBucket {
    folder: PathBuf,
    /// Where objects with `moved` in their names are said to be.
    elsewhere: SocketAddr,
}

impl FakeBucket {
    fn start(folder: &Path, elsewhere: SocketAddr) -> SocketAddr {
        let bucket = Self { folder: folder.to_owned(), elsewhere };
        http::serve(move |request, stream| bucket.answer(request, stream))
    }

    /// Answers a request; `None` if it cannot.
    fn answer(&self, request: &Request, stream: &mut TcpStream) -> Option<()> {
        let (line, target) = (request.head.first()?, request.target());
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let name = path.trim_start_matches('/').strip_prefix("town").unwrap_or("none").trim_start_matches('/');
        if line.contains("moved") {
            let place = format!("Location: http://{}/stolen", self.elsewhere);
            return write!(stream, "HTTP/1.1 307 Moved\r\n{place}\r\nContent-Length: 0\r\n\r\n").ok();
        }
        let head = "Last-Modified: Fri, 27 Nov 2026 00:00:00 GMT\r\nETag: \"1\"\r\nContent-Length";
        if query.contains("list-type=2") {
            let body = self.list();
            return write!(stream, "HTTP/1.1 200 OK\r\n{head}: {}\r\n\r\n{body}", body.len()).ok();
        }
        let Ok(bytes) = fs::read(self.folder.join(name)) else {
            return write!(stream, "HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n").ok();
        };
        if line.starts_with("HEAD") {
            return write!(stream, "HTTP/1.1 200 OK\r\n{head}: {}\r\n\r\n", bytes.len()).ok();
        }
        let range = request
            .head
            .iter()
            .find_map(|line| line.to_ascii_lowercase().strip_prefix("range: bytes=").map(str::to_owned));
        let (start, last) =
            range?.split_once('-').map(|(a, b)| (a.parse::<usize>().unwrap(), b.parse::<usize>().unwrap()))?;
        let part = &bytes[start..bytes.len().min(last + 1)];
        let place = format!("bytes {start}-{}/{}", start + part.len() - 1, bytes.len());
        write!(stream, "HTTP/1.1 206 Partial Content\r\nContent-Range: {place}\r\n{head}: {}\r\n\r\n", part.len())
            .ok()?;
        stream.write_all(part).ok()
    }

    /// A list of all objects below `in`, and of two whose names are no paths.
    fn list(&self) -> String {
        let entry = |name: &str, bytes: u64| {
            format!(
                "<Contents><Key>in/{name}</Key><LastModified>2026-11-27T00:00:00.000Z</LastModified><Size>{bytes}</Size></Contents>"
            )
        };
        let of_file = |found: fs::DirEntry| entry(found.file_name().to_str().unwrap(), found.metadata().unwrap().len());
        let files = fs::read_dir(self.folder.join("in")).unwrap().map(|found| of_file(found.unwrap()));
        let entries: String = files.chain([entry("../secret.obj", 1), entry("&#46;/b.obj", 1)]).collect();
        format!("<?xml version=\"1.0\"?><ListBucketResult><IsTruncated>false</IsTruncated>{entries}</ListBucketResult>")
    }
}

/// An address at which nobody answers.
fn nowhere() -> SocketAddr {
    ([127, 0, 0, 1], 9).into()
}

fn run(store: SocketAddr, folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_insula-server"))
        .current_dir(folder)
        .args(args)
        .env("AWS_ENDPOINT", format!("http://{store}"))
        .env("AWS_ACCESS_KEY_ID", "test")
        .env("AWS_SECRET_ACCESS_KEY", "test")
        .env("AWS_REGION", "us-east-1")
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

/// A file of a house whose south-west corner is so many degrees east.
fn write_house(folder: &Path, name: &str, east: f64) {
    let (west, east) = (139.7 + east, 139.7002 + east);
    let text = format!(
        r#"{{"type":"Feature","id":"{name}","properties":{{"height":9}},"geometry":{{"type":"Polygon","coordinates":
        [[[{west},35.2],[{east},35.2],[{east},35.2001],[{west},35.2001],[{west},35.2]]]}}}}"#
    );
    fs::write(folder.join(name), text.replace('\n', "") + "\n").unwrap();
}

#[test]
fn a_bucket_gives_the_city_of_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::create_dir_all(path.join("in")).unwrap();
    write_house(&path.join("in"), "a.geojsonl", 0.0);
    write_house(&path.join("in"), "b.geojsonl", 0.001);
    let store = FakeBucket::start(path, nowhere());
    let baked = |input: &str, out: &str| {
        let output = run(store, path, &["bake", input, "--out", &format!("{out}/city"), "--cell", "4"]);
        assert!(output.status.success(), "{input}: {output:?}");
        let text = String::from_utf8_lossy(&output.stderr);
        let warning = "s3://town/in/../secret.obj: 2 names of objects that are no paths: not read";
        assert_eq!(text.contains(warning), input.starts_with("s3:"), "{text}");
        fs::read(path.join(out).join("city/blockmaps.pmtiles")).unwrap()
    };
    fs::create_dir_all(path.join("plain")).unwrap();
    let plain = baked("in", "plain");
    for (input, out) in [("s3://town/in", "folder"), ("s3://town/in/*.geojsonl", "pattern")] {
        fs::create_dir_all(path.join(out)).unwrap();
        assert!(baked(input, out) == plain, "{input}");
    }
    let output = run(store, path, &["inspect", "s3://town/in/a.geojsonl", "--json"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("s3://town/in/a.geojsonl"), "{output:?}");
    let output = run(store, path, &["bake", "s3://town/in/none.gml", "--out", "none"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && text.contains("s3://town/in/none.gml") && !path.join("none").exists(),
        "{text}"
    );
}

#[test]
fn a_store_cannot_redirect_to_another_host() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let store = FakeBucket::start(folder.path(), listener.local_addr().unwrap());
    write_house(folder.path(), "a.geojsonl", 0.0);
    for args in [
        &["bake", "s3://town/moved.geojsonl", "--out", "city"][..],
        &["bake", "s3://town/moved", "--out", "city"],
        &["bake", "plan", "--inputs", "a.geojsonl", "--work", "s3://town/moved"],
    ] {
        let output = run(store, folder.path(), args);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains("redirects to another host"), "{args:?}: {text}");
    }
    assert!(listener.accept().is_err(), "the other host was asked");
}
