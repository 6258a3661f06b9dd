//! `bake` of files on web servers: where redirects may lead, and what becomes of secrets in addresses.

use insula_test_support::http::{self, Request};
use std::fs;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex};

const HOUSE: &str = r#"{"type":"FeatureCollection","features":[{"type":"Feature","properties":{"height":9},"geometry":
    {"type":"Polygon","coordinates":[[[139.7,35.2],[139.7002,35.2],[139.7002,35.2001],[139.7,35.2001],[139.7,35.2]]]}}]}"#;

/// A web server with one file, which notes requests with their headers.
struct WebServer {
    address: SocketAddr,
    requests: Arc<Mutex<Vec<String>>>,
}

impl WebServer {
    /// Requests of `/moved.geojson` are redirected to `elsewhere`.
    fn start(elsewhere: &str) -> Self {
        let requests = Arc::new(Mutex::new(Vec::new()));
        let (notes, elsewhere) = (Arc::clone(&requests), elsewhere.to_owned());
        let address = http::serve(move |request, stream| {
            notes.lock().unwrap().push(request.head.join("\n"));
            answer(request, stream, &elsewhere)?;
            // Each response ends its connection.
            None
        });
        Self { address, requests }
    }

    fn requests(&self) -> String {
        self.requests.lock().unwrap().join("\n")
    }
}

fn answer(request: &Request, stream: &mut TcpStream, elsewhere: &str) -> Option<()> {
    let (head, body) = match request.target().split('?').next()? {
        "/moved.geojson" => (format!("302 Found\r\nLocation: {elsewhere}"), ""),
        "/part.geojson" => ("206 Partial Content\r\nContent-Range: bytes 5-9/100000".to_owned(), HOUSE),
        "/cached.geojson" => ("304 Not Modified".to_owned(), ""),
        _ => ("200 OK".to_owned(), HOUSE),
    };
    let length = body.len();
    write!(stream, "HTTP/1.1 {head}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}").ok()
}

fn bake(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_insula-server"))
        .current_dir(folder)
        .arg("bake")
        .args(args)
        .args(["--out", "out/city", "--cell", "4", "--report", "report.json"])
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn redirects_lead_to_other_hosts_only_if_they_are_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let target = WebServer::start("");
    let public = WebServer::start(&format!("http://{}/a.geojson?token=hidden", target.address));
    let input = format!("http://{}/moved.geojson?key=secret", public.address);
    let refused = bake(folder.path(), &[&input]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && error.contains(&format!("--allow-host {}", target.address)), "{error}");
    assert!(!error.contains("secret") && !error.contains("hidden"), "{error}");
    assert_eq!(target.requests(), "", "nothing was asked there");
    let allowed = bake(folder.path(), &[&input, "--allow-host", &target.address.to_string()]);
    assert!(allowed.status.success(), "{allowed:?}");
    let asked = target.requests().to_ascii_lowercase();
    assert!(asked.contains("token=hidden") && !asked.contains("referer") && !asked.contains("key=secret"), "{asked}");
}

#[test]
fn parts_of_files_and_other_schemes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let server = WebServer::start("file:///etc/passwd");
    for (file, reason) in [
        ("part.geojson", "answers 206"),
        ("cached.geojson", "answers 304"),
        ("moved.geojson", "another host: give the address of the file itself"),
    ] {
        let output = bake(folder.path(), &[&format!("http://{}/{file}", server.address)]);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(reason), "{error}");
    }
}

#[test]
fn secrets_of_an_address_are_sent_and_never_shown() {
    let folder = tempfile::tempdir().unwrap();
    let server = WebServer::start("");
    let input = format!("http://me:secret1@{}/a.geojson?signature=secret2", server.address);
    let output = bake(folder.path(), &[&input]);
    assert!(output.status.success(), "{output:?}");
    let asked = server.requests();
    assert!(asked.contains("/a.geojson?signature=secret2"), "{asked}");
    assert!(asked.to_ascii_lowercase().contains("authorization: basic "), "{asked}");
    let mut texts = vec![output.stdout, output.stderr, fs::read(folder.path().join("report.json")).unwrap()];
    for entry in fs::read_dir(folder.path().join("out/city")).unwrap() {
        texts.push(fs::read(entry.unwrap().path()).unwrap());
    }
    for text in texts {
        let text = String::from_utf8_lossy(&text);
        assert!(!text.contains("secret"), "{text}");
    }
}
