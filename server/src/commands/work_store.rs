//! Work stores of bakes in steps: folders, and buckets of object stores (`s3://BUCKET/PATH`).

use super::bucket_client::{BucketConnector, MAX_OBJECTS, RefusedKeys, list_of, read_page, text_of};
use super::error::CommandError;
use futures_util::StreamExt;
use hyper::{Method, Request};
use insula_bake::{WorkFolder, WorkStore};
use insula_command_line::http::cause_of;
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::client::{HttpClient, HttpConnector as _, HttpRequestBody};
use object_store::multipart::{MultipartStore, PartId};
use object_store::path::Path as ObjectPath;
use object_store::signer::{SignedUrlOptions, Signer};
use object_store::{ClientOptions, ObjectStore, ObjectStoreExt as _, PutPayload, RetryConfig, WriteMultipart};
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tokio::runtime::Runtime;

/// Larger objects are uploaded in parts of this size: of at most 10,000 parts, an object may have 320 GB.
const PART_BYTES: usize = 32 << 20;
/// The signature of a request for a list is valid for so long.
const LIST_TIME: Duration = Duration::from_secs(300);
/// Parts of an object that are under way at once.
const PARTS_AT_ONCE: usize = 4;

/// The store of an address. Fails if the address is of no known kind.
pub(super) fn open(address: &str) -> Result<Box<dyn WorkStore>, CommandError> {
    match address.split_once("://") {
        None => Ok(Box::new(WorkFolder::new(Path::new(address)))),
        Some(("s3", rest)) => {
            let bucket =
                WorkBucket::new(address, rest).map_err(|cause| CommandError::Bake(format!("{address}: {cause}")))?;
            Ok(Box::new(bucket))
        }
        Some(_) => Err(CommandError::Usage(format!("{address}: expected a folder or s3://BUCKET/PATH"))),
    }
}

/// Objects of a bucket below a path.
struct WorkBucket {
    address: String,
    store: AmazonS3,
    /// For requests that the store does not have.
    client: HttpClient,
    folder: ObjectPath,
    /// One request at a time: a step computes, and hardly waits.
    runtime: Mutex<Runtime>,
}

pub(super) fn io_error(error: object_store::Error) -> io::Error {
    let kind = match error {
        object_store::Error::NotFound { .. } => io::ErrorKind::NotFound,
        object_store::Error::PermissionDenied { .. } | object_store::Error::Unauthenticated { .. } => {
            io::ErrorKind::PermissionDenied
        }
        _ => io::ErrorKind::Other,
    };
    let (text, cause) = (error.to_string(), cause_of(&error));
    io::Error::new(kind, if text.contains(&cause) { text } else { format!("{text}: {cause}") })
}

/// A bucket with the credentials of the environment, whose lists give `refused` what they leave out. Fails if the credentials are
/// incomplete.
pub(super) fn open_bucket(bucket: &str, refused: RefusedKeys) -> io::Result<AmazonS3> {
    let options = ClientOptions::new().with_allow_http(true);
    let builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_client_options(options);
    let builder = builder.with_http_connector(BucketConnector { refused });
    builder.with_retry(RetryConfig::default()).build().map_err(io_error)
}

impl WorkBucket {
    fn new(address: &str, rest: &str) -> io::Result<Self> {
        let (bucket, folder) = rest.split_once('/').unwrap_or((rest, ""));
        let client = BucketConnector::default().connect(&ClientOptions::new()).map_err(io_error)?;
        let store = open_bucket(bucket, RefusedKeys::default())?;
        let folder = ObjectPath::parse(folder).map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))?;
        let runtime = Mutex::new(tokio::runtime::Builder::new_current_thread().enable_all().build()?);
        Ok(Self { address: address.trim_end_matches('/').to_owned(), store, client, folder, runtime })
    }

    fn path(&self, name: &str) -> ObjectPath {
        name.split('/').fold(self.folder.clone(), |path, word| path.join(word))
    }

    fn run<T>(&self, work: impl Future<Output = io::Result<T>>) -> io::Result<T> {
        self.runtime.lock().unwrap_or_else(PoisonError::into_inner).block_on(work)
    }

    /// Uploads what a reader has, in parts if it is long.
    async fn upload(&self, name: &str, reader: &mut dyn Read) -> io::Result<()> {
        let path = self.path(name);
        let mut first = Vec::new();
        reader.take(PART_BYTES as u64).read_to_end(&mut first)?;
        if first.len() < PART_BYTES {
            return self.store.put(&path, PutPayload::from(first)).await.map(drop).map_err(io_error);
        }
        let upload = self.store.put_multipart(&path).await.map_err(io_error)?;
        let mut writer = WriteMultipart::new_with_chunk_size(upload, PART_BYTES);
        writer.put(first.into());
        loop {
            let mut part = Vec::new();
            let read = reader.take(PART_BYTES as u64).read_to_end(&mut part);
            let ready = match read {
                Ok(_) => writer.wait_for_capacity(PARTS_AT_ONCE).await.map_err(io_error),
                Err(error) => Err(error),
            };
            if let Err(error) = ready {
                // Parts that are left cost money until the bucket's rule removes them.
                let _ = writer.abort().await;
                return Err(error);
            }
            if part.is_empty() {
                return writer.finish().await.map(drop).map_err(io_error);
            }
            writer.put(part.into());
        }
    }
}

impl WorkStore for WorkBucket {
    fn address(&self) -> String {
        self.address.clone()
    }

    fn size(&self, name: &str) -> io::Result<Option<u64>> {
        self.run(async {
            match self.store.head(&self.path(name)).await {
                Ok(meta) => Ok(Some(meta.size)),
                Err(object_store::Error::NotFound { .. }) => Ok(None),
                Err(error) => Err(io_error(error)),
            }
        })
    }

    fn range(&self, name: &str, start: u64, length: u64) -> io::Result<Vec<u8>> {
        if length == 0 {
            return Ok(Vec::new());
        }
        let end = start.checked_add(length).ok_or(io::ErrorKind::UnexpectedEof)?;
        self.run(async {
            let bytes = self.store.get_range(&self.path(name), start..end).await.map_err(io_error)?;
            if bytes.len() as u64 == length { Ok(bytes.into()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
        })
    }

    fn fetch(&self, name: &str, to: &Path) -> io::Result<()> {
        let mut file = File::create_new(to)?;
        self.run(async {
            let mut parts = self.store.get(&self.path(name)).await.map_err(io_error)?.into_stream();
            while let Some(part) = parts.next().await {
                file.write_all(&part.map_err(io_error)?)?;
            }
            Ok(())
        })
    }

    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        self.run(self.upload(name, &mut bytes.as_slice()))
    }

    fn put_file(&self, name: &str, from: &Path) -> io::Result<()> {
        let mut file = File::open(from)?;
        self.run(self.upload(name, &mut file))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<String>> {
        let own = if self.folder.as_ref().is_empty() { String::new() } else { format!("{}/", self.folder) };
        self.run(async {
            let found = list_of(self.store.list(Some(&self.path(folder))), MAX_OBJECTS).await.map_err(io_error)?;
            let name = |meta: object_store::ObjectMeta| Some(meta.location.as_ref().strip_prefix(&own)?.to_owned());
            let mut names: Vec<String> = found.into_iter().filter_map(name).collect();
            names.sort_unstable();
            Ok(names)
        })
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.run(async {
            match self.store.delete(&self.path(name)).await {
                Err(object_store::Error::NotFound { .. }) | Ok(()) => Ok(()),
                Err(error) => Err(io_error(error)),
            }
        })
    }

    fn begin_parts(&self, name: &str, _: u64) -> io::Result<String> {
        self.run(async { self.store.create_multipart(&self.path(name)).await.map_err(io_error) })
    }

    fn put_part(&self, name: &str, ticket: &str, number: u32, _: u64, bytes: Vec<u8>) -> io::Result<String> {
        let (path, ticket) = (self.path(name), ticket.to_owned());
        self.run(async {
            let put = self.store.put_part(&path, &ticket, number as usize, bytes.into()).await;
            put.map(|part| part.content_id).map_err(io_error)
        })
    }

    fn finish_parts(&self, name: &str, ticket: &str, receipts: Vec<String>) -> io::Result<()> {
        let (path, ticket) = (self.path(name), ticket.to_owned());
        let parts = receipts.into_iter().map(|content_id| PartId { content_id }).collect();
        self.run(async { self.store.complete_multipart(&path, &ticket, parts).await.map(drop).map_err(io_error) })
    }

    fn abort_parts(&self, name: &str, ticket: &str) -> io::Result<()> {
        let (path, ticket) = (self.path(name), ticket.to_owned());
        self.run(async {
            match self.store.abort_multipart(&path, &ticket).await {
                // It was completed, or is gone.
                Err(object_store::Error::NotFound { .. }) | Ok(()) => Ok(()),
                Err(error) => Err(io_error(error)),
            }
        })
    }

    fn begun_parts(&self) -> io::Result<Vec<(String, String)>> {
        let own = if self.folder.as_ref().is_empty() { String::new() } else { format!("{}/", self.folder) };
        let query = [("uploads", String::new()), ("prefix", own.clone())];
        let options = SignedUrlOptions::new().with_query(query);
        self.run(async {
            // `object_store` has no request for it: that of the bucket is signed, and sent by its HTTP client.
            let root = ObjectPath::default();
            let url = self.store.signed_url_opts(Method::GET, &root, LIST_TIME, &options).await.map_err(io_error)?;
            let request = Request::builder().uri(url.as_str()).body(HttpRequestBody::empty());
            let request = request.map_err(io::Error::other)?;
            let response = self.client.execute(request).await.map_err(io::Error::other)?;
            if !response.status().is_success() {
                return Err(io::Error::other(format!("uploads cannot be listed: {}", response.status())));
            }
            let page = read_page(response).await.map_err(io::Error::other)?;
            let uploads = uploads_of(&page);
            Ok(uploads.into_iter().filter_map(|(key, id)| Some((key.strip_prefix(&own)?.to_owned(), id))).collect())
        })
    }
}

/// Keys and numbers of the uploads of a `ListMultipartUploadsResult`.
fn uploads_of(xml: &str) -> Vec<(String, String)> {
    let uploads = xml.split("<Upload>").skip(1).filter_map(|rest| Some(rest.split_once("</Upload>")?.0));
    uploads.filter_map(|upload| Some((text_of(upload, "Key")?, text_of(upload, "UploadId")?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploads_of_a_list_are_found() {
        let xml = r#"<?xml version="1.0"?><ListMultipartUploadsResult><Bucket>b</Bucket><UploadIdMarker></UploadIdMarker>
            <Upload><Key>work/scan/0/a&amp;b</Key><UploadId>x&lt;1</UploadId><Owner><ID>o</ID></Owner></Upload>
            <Upload><Key>work/c</Key><UploadId>2</UploadId></Upload><Upload><Key>cut"#;
        let expected = [("work/scan/0/a&b", "x<1"), ("work/c", "2")].map(|(key, id)| (key.to_owned(), id.to_owned()));
        assert_eq!(uploads_of(xml), expected);
        assert!(uploads_of("no list").is_empty());
    }
}
