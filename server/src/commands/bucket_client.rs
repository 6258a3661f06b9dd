//! The HTTP client of buckets. A store may be hostile: a redirect leads to the same host only, a list ends, and names that are no paths
//! do not end a list.
//!
//! `object_store` refuses a whole page of a list because of one key such as `a/../b`. So keys that it refuses are taken out of the
//! pages before it reads them, and kept for those who report them.

use crate::store::SameHostConnector;
use futures_util::future::BoxFuture;
use futures_util::{Stream, StreamExt, TryStreamExt};
use hyper::header::CONTENT_LENGTH;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpResponse, HttpService,
};
use object_store::path::Path as ObjectPath;
use object_store::{ClientOptions, Result};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use std::{io, mem};

/// Time limit of a request with its response: a part of 32 MiB, or a page of a list.
const REQUEST_TIME: Duration = Duration::from_secs(30);
/// A list of objects or uploads has at most 1000 in a page, of some hundred bytes each.
pub(super) const MAX_PAGE_BYTES: usize = 16 << 20;
/// Most objects below a folder of a bucket: all are in memory.
pub(super) const MAX_OBJECTS: usize = 4_000_000;
/// So many pages without an object that can be read may follow one another: a list could go on without end.
const MAX_EMPTY_PAGES: usize = 1000;
/// Most refused keys that are kept; others are left out of reports.
const MAX_REFUSED: usize = 1000;

/// Keys of lists that are no paths, of one or several buckets.
#[derive(Debug, Clone, Default)]
pub(super) struct RefusedKeys(Arc<Mutex<Vec<String>>>);

impl RefusedKeys {
    /// The keys since the last call.
    pub(super) fn take(&self) -> Vec<String> {
        mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn add(&self, keys: Vec<String>) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let room = MAX_REFUSED.saturating_sub(known.len());
        known.extend(keys.into_iter().take(room));
    }
}

/// Makes the clients of buckets.
#[derive(Debug, Default)]
pub(super) struct BucketConnector {
    /// Gets the keys that are taken out of lists.
    pub(super) refused: RefusedKeys,
}

impl HttpConnector for BucketConnector {
    fn connect(&self, options: &ClientOptions) -> Result<HttpClient> {
        let client = SameHostConnector { timeout: REQUEST_TIME }.connect(options)?;
        Ok(HttpClient::new(BucketClient { client, refused: self.refused.clone(), empty_pages: AtomicUsize::new(0) }))
    }
}

#[derive(Debug)]
struct BucketClient {
    client: HttpClient,
    refused: RefusedKeys,
    /// That followed one another.
    empty_pages: AtomicUsize,
}

impl BucketClient {
    async fn answer(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let query = request.uri().query().unwrap_or_default();
        let is_list = query.split('&').any(|word| word == "list-type=2");
        let response = self.client.execute(request).await?;
        if !is_list || !response.status().is_success() {
            return Ok(response);
        }
        let (mut head, body) = response.into_parts();
        let page = read_page(HttpResponse::new(body)).await?;
        let (page, refused) = without_refused(&page);
        let pages = if page.contains(CONTENTS[0]) { 0 } else { self.empty_pages.load(Ordering::Relaxed) + 1 };
        self.empty_pages.store(pages, Ordering::Relaxed);
        if pages > MAX_EMPTY_PAGES {
            return Err(damaged(format!("the list has more than {MAX_EMPTY_PAGES} pages without an object")));
        }
        self.refused.add(refused);
        head.headers.remove(CONTENT_LENGTH);
        Ok(HttpResponse::from_parts(head, page.into()))
    }
}

impl HttpService for BucketClient {
    fn call<'a, 'b>(&'a self, request: HttpRequest) -> BoxFuture<'b, Result<HttpResponse, HttpError>>
    where
        'a: 'b,
        Self: 'b,
    {
        Box::pin(self.answer(request))
    }
}

/// An error that is not worth another try.
fn damaged(what: String) -> HttpError {
    HttpError::new(HttpErrorKind::Decode, io::Error::new(io::ErrorKind::InvalidData, what))
}

/// What a list has. Fails if it has more than `limit` entries: it could go on without end.
pub(super) async fn list_of<T>(entries: impl Stream<Item = Result<T>>, limit: usize) -> Result<Vec<T>> {
    let found: Vec<T> = entries.take(limit.saturating_add(1)).try_collect().await?;
    if found.len() > limit {
        let what = format!("the list has more than {limit} objects; give a folder that has fewer");
        return Err(object_store::Error::Generic { store: "bucket", source: what.into() });
    }
    Ok(found)
}

/// The text of a page. Fails if it is too long, or ends early.
pub(super) async fn read_page(response: HttpResponse) -> Result<String, HttpError> {
    let (mut parts, mut bytes) = (response.into_body().bytes_stream(), Vec::new());
    while let Some(part) = parts.next().await {
        bytes.extend_from_slice(&part?);
        if bytes.len() > MAX_PAGE_BYTES {
            return Err(damaged(format!("a page of the list has more than {MAX_PAGE_BYTES} bytes")));
        }
    }
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

const CONTENTS: [&str; 2] = ["<Contents>", "</Contents>"];

/// A page of a list without the objects whose keys are no paths, and these keys.
fn without_refused(page: &str) -> (String, Vec<String>) {
    let (mut kept, mut refused) = (String::with_capacity(page.len()), Vec::new());
    let mut rest = page;
    while let Some((object, after)) = rest.find(CONTENTS[0]).and_then(|start| {
        let end = start + rest[start..].find(CONTENTS[1])? + CONTENTS[1].len();
        Some((start..end, &rest[end..]))
    }) {
        match text_of(&rest[object.clone()], "Key").filter(|key| ObjectPath::parse(key).is_err()) {
            Some(key) => {
                kept.push_str(&rest[..object.start]);
                refused.push(key);
            }
            None => kept.push_str(&rest[..object.end]),
        }
        rest = after;
    }
    kept.push_str(rest);
    (kept, refused)
}

/// The text of the first element of this name; `None` if there is none.
pub(super) fn text_of(xml: &str, name: &str) -> Option<String> {
    let (_, rest) = xml.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once(&format!("</{name}>"))?;
    Some(unescape(text))
}

/// The text with the characters that its references stand for. What is no reference stays.
fn unescape(text: &str) -> String {
    let mut pieces = text.split('&');
    let mut plain = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        match piece.split_once(';').and_then(|(name, rest)| Some((character(name)?, rest))) {
            Some((character, rest)) => {
                plain.push(character);
                plain.push_str(rest);
            }
            None => {
                plain.push('&');
                plain.push_str(piece);
            }
        }
    }
    plain
}

fn character(name: &str) -> Option<char> {
    let of_number = |digits: &str, radix| u32::from_str_radix(digits, radix).ok().and_then(char::from_u32);
    match name {
        "lt" => Some('<'),
        "gt" => Some('>'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        "amp" => Some('&'),
        name => match (name.strip_prefix("#x"), name.strip_prefix('#')) {
            (Some(digits), _) => of_number(digits, 16),
            (None, Some(digits)) => of_number(digits, 10),
            (None, None) => None,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_that_are_no_paths_are_taken_out_of_a_page() {
        let object = |key: &str| format!("<Contents><Key>{key}</Key><Size>1</Size></Contents>");
        let keys = ["in/a", "in/../b", "in/c&amp;d", "in//e", "in/./f", "in/g/", "in/&#46;&#x2e;/h"];
        let page = |keys: &[&str]| {
            let objects: String = keys.iter().map(|key| object(key)).collect();
            format!(
                "<?xml version=\"1.0\"?><ListBucketResult><KeyCount>7</KeyCount>{objects}<More/></ListBucketResult>"
            )
        };
        let (kept, refused) = without_refused(&page(&keys));
        assert_eq!(kept, page(&["in/a", "in/c&amp;d", "in/g/"]));
        assert_eq!(refused, ["in/../b", "in//e", "in/./f", "in/../h"]);
        let cut = "<ListBucketResult><Contents><Key>in/../b</Key>";
        assert_eq!(without_refused(cut), (cut.to_owned(), Vec::new()));
    }

    #[test]
    fn a_list_without_end_is_given_up() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let endless = || futures_util::stream::repeat_with(|| Ok(0_u8));
        assert_eq!(runtime.block_on(list_of(endless().take(3), 3)).unwrap(), [0; 3]);
        let error = runtime.block_on(list_of(endless(), 3)).unwrap_err().to_string();
        assert!(error.contains("more than 3 objects"), "{error}");
    }

    #[test]
    fn references_become_characters() {
        assert_eq!(
            unescape("a&amp;lt;b &lt;&gt;&quot;&apos; &#228;&#xE4; & &none; &#x110000; &"),
            "a&lt;b <>\"' ää & &none; &#x110000; &"
        );
    }
}
