//! A bucket for cities: moto's (`pip install 'moto[server]'`). Where `INSULA_TEST_STORE=s3` says so, tests that start a server
//! have it serve from there.

use anyhow::{Context, Result, ensure};
use std::{
    fs,
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{
        OnceLock,
        atomic::{AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

/// What `serve` is told instead of a folder, and in its environment.
#[derive(Debug)]
pub struct Place {
    /// `s3://BUCKET/PATH`.
    pub url: String,
    /// Where the bucket is, and who asks.
    pub environment: [(&'static str, String); 5],
}

/// Puts a city into the bucket, if tests are to be served from one.
pub fn place(city: &Path) -> Result<Option<Place>> {
    match std::env::var("INSULA_TEST_STORE") {
        Err(_) => return Ok(None),
        Ok(store) => ensure!(store == "s3", "INSULA_TEST_STORE is {store:?}, only \"s3\" is known"),
    }
    put(city).map(Some)
}

/// Puts a city into the bucket, beside those before it. Starts moto, once.
pub fn put(city: &Path) -> Result<Place> {
    /// Cities so far: each has a path of its own.
    static CITIES: AtomicU32 = AtomicU32::new(0);
    static MOTO: OnceLock<std::result::Result<Moto, String>> = OnceLock::new();
    let moto = MOTO.get_or_init(|| Moto::start().map_err(|error| format!("{error:#}")));
    let moto = moto.as_ref().map_err(|error| anyhow::anyhow!("{error}"))?;
    let name = city.file_name().and_then(|name| name.to_str()).context("a city's folder has no name")?;
    let path = format!("{}/{name}", CITIES.fetch_add(1, Ordering::Relaxed));
    for entry in fs::read_dir(city)? {
        let file = entry?.path();
        let name = file.file_name().and_then(|name| name.to_str()).context("a file without a name")?;
        moto.put(&format!("insula/{path}/{name}"), &fs::read(&file)?)?;
    }
    let access = |name, value: &str| (name, value.to_owned());
    Ok(Place {
        url: format!("s3://insula/{path}"),
        environment: [
            ("AWS_ENDPOINT", format!("http://127.0.0.1:{}", moto.port)),
            access("AWS_ACCESS_KEY_ID", "test"),
            access("AWS_SECRET_ACCESS_KEY", "test"),
            access("AWS_REGION", "us-east-1"),
            access("AWS_EC2_METADATA_DISABLED", "true"),
        ],
    })
}

struct Moto {
    port: u16,
    /// Ends moto when this process ends and its input with it.
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
            ensure!(Instant::now() < deadline, "moto_server does not answer, is it installed? {error:#}");
            std::thread::sleep(Duration::from_millis(100));
        }
        Ok(moto)
    }

    /// moto asks for no signature.
    fn put(&self, path: &str, bytes: &[u8]) -> Result<()> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port))?;
        write!(
            stream,
            "PUT /{path} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
            self.port,
            bytes.len()
        )?;
        stream.write_all(bytes)?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        ensure!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer}");
        Ok(())
    }
}
