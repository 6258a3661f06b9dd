//! An S3 bucket of cities, by moto (`pip install 'moto[server]'`). With `INSULA_TEST_STORE=s3`, tests that start a server
//! serve the city from there.

use crate::http;
use anyhow::{Context, Result, ensure};
use std::fs;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

#[derive(Debug)]
pub struct BucketCity {
    /// `s3://BUCKET/PATH`, for `insula-server serve`.
    pub url: String,
    /// Environment of the server: the bucket's address and credentials.
    pub environment: [(&'static str, String); 5],
}

/// Uploads a city if `INSULA_TEST_STORE` asks for it.
pub fn upload_if_requested(city: &Path) -> Result<Option<BucketCity>> {
    match std::env::var("INSULA_TEST_STORE") {
        Err(_) => return Ok(None),
        Ok(store) => ensure!(store == "s3", "INSULA_TEST_STORE is {store:?}, only \"s3\" is supported"),
    }
    upload(city).map(Some)
}

/// Uploads a city to a path of its own. Starts moto at the first call; fails if it is not installed.
pub fn upload(city: &Path) -> Result<BucketCity> {
    upload_beside(&[city])?.pop().context("no city was uploaded")
}

/// The same with cities beside one another, as those that share tiles are.
pub fn upload_beside(cities: &[&Path]) -> Result<Vec<BucketCity>> {
    static CITIES: AtomicU32 = AtomicU32::new(0);
    static MOTO: OnceLock<std::result::Result<Moto, String>> = OnceLock::new();
    let moto = MOTO.get_or_init(|| Moto::start().map_err(|error| format!("{error:#}")));
    let moto = moto.as_ref().map_err(|error| anyhow::anyhow!("{error}"))?;
    let number = CITIES.fetch_add(1, Ordering::Relaxed);
    cities.iter().map(|city| upload_to(moto, number, city)).collect()
}

fn upload_to(moto: &Moto, number: u32, city: &Path) -> Result<BucketCity> {
    let name = city.file_name().and_then(|name| name.to_str()).context("the city's folder has no name")?;
    let path = format!("{number}/{name}");
    for entry in fs::read_dir(city)? {
        let entry = entry?;
        moto.put(&format!("insula/{path}/{}", entry.file_name().display()), &fs::read(entry.path())?)?;
    }
    let variable = |name, value: &str| (name, value.to_owned());
    Ok(BucketCity {
        url: format!("s3://insula/{path}"),
        environment: [
            ("AWS_ENDPOINT", format!("http://127.0.0.1:{}", moto.port)),
            variable("AWS_ACCESS_KEY_ID", "test"),
            variable("AWS_SECRET_ACCESS_KEY", "test"),
            variable("AWS_REGION", "us-east-1"),
            variable("AWS_EC2_METADATA_DISABLED", "true"),
        ],
    })
}

struct Moto {
    port: u16,
    /// A shell that kills moto when its input ends, which is when this process ends.
    _shell: Child,
}

impl Moto {
    fn start() -> Result<Self> {
        let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let shell = Command::new("sh")
            .args(["-c", "moto_server -p \"$0\" & read -r _; kill $!", &port.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let moto = Self { port, _shell: shell };
        let deadline = Instant::now() + Duration::from_secs(60);
        while let Err(error) = moto.put("insula", b"") {
            ensure!(Instant::now() < deadline, "moto_server does not respond, is it installed? {error:#}");
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(moto)
    }

    /// Moto does not check signatures.
    fn put(&self, path: &str, bytes: &[u8]) -> Result<()> {
        let (port, length) = (self.port, bytes.len());
        let head = format!(
            "PUT /{path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
        );
        let response = http::exchange(([127, 0, 0, 1], port).into(), &[head.as_bytes(), bytes].concat())?;
        let response = String::from_utf8_lossy(&response);
        ensure!(response.starts_with("HTTP/1.1 200"), "{path}: {response}");
        Ok(())
    }
}
