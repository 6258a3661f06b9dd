//! One page: navigation, scripts, pictures, and what it reported.

use super::connection::{Connection, PATIENCE};
use super::page_log::{Message, PageLog, Request, auto_attach};
use anyhow::{Context, Result, bail, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::{Duration, Instant};

const POLL: Duration = Duration::from_millis(50);

/// A page with a browsing context of its own; closed when dropped.
#[derive(Debug)]
pub struct Page {
    connection: Arc<Connection>,
    session: String,
    context: String,
    /// When the page was clicked last, in milliseconds since 1970.
    pub(super) clicked_ms: AtomicU64,
}

impl Page {
    pub(super) fn open(connection: &Arc<Connection>) -> Result<Self> {
        let context = connection.call("", "Target.createBrowserContext", json!({}))?;
        let context = context["browserContextId"].as_str().context("no context")?.to_owned();
        let new = json!({ "url": "about:blank", "browserContextId": context });
        let target = connection.call("", "Target.createTarget", new)?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = connection.call("", "Target.attachToTarget", attach)?;
        let session = session["sessionId"].as_str().context("no session")?.to_owned();
        connection.add_page(&session);
        let page = Self { connection: connection.clone(), session, context, clicked_ms: AtomicU64::new(0) };
        for domain in ["Page", "Runtime", "Network", "Log", "Audits"] {
            page.call(&format!("{domain}.enable"), json!({}))?;
        }
        page.call("Target.setAutoAttach", auto_attach())?;
        Ok(page)
    }

    pub fn call(&self, method: &str, params: Value) -> Result<Value> {
        self.connection.call(&self.session, method, params)
    }

    /// Calls it for the page and all its workers, of which some may have ended.
    pub(super) fn call_everywhere(&self, method: &str, params: &Value) -> Result<()> {
        for session in self.log(|log| log.sessions[1..].to_vec())? {
            let _ = self.connection.call(&session, method, params.clone());
        }
        self.call(method, params.clone()).map(drop)
    }

    pub(super) fn log<T>(&self, act: impl FnOnce(&mut PageLog) -> T) -> Result<T> {
        self.connection.with_log(&self.session, act)
    }

    /// Runs a script before those of each document that is opened from now on.
    pub fn prepare(&self, script: &str) -> Result<()> {
        self.call("Page.addScriptToEvaluateOnNewDocument", json!({ "source": script })).map(drop)
    }

    /// Opens an address and waits for the document's `load` event.
    pub fn navigate(&self, url: &str) -> Result<()> {
        let before = self.log(|log| log.loads)?;
        self.begin_navigation(url)?;
        let loaded = |log: &PageLog| (log.loads > before).then_some(());
        self.connection.wait_for_log(PATIENCE, &self.session, loaded).with_context(|| format!("loading {url}"))
    }

    /// Opens an address. Fails if there is no response.
    pub fn begin_navigation(&self, url: &str) -> Result<()> {
        let reply = self.call("Page.navigate", json!({ "url": url }))?;
        ensure!(reply["errorText"].is_null(), "{url}: {}", reply["errorText"]);
        Ok(())
    }

    /// Value of an expression, which may be a promise. Fails with the exception that it throws.
    pub fn evaluate(&self, expression: &str) -> Result<Value> {
        self.evaluate_within(PATIENCE, expression)
    }

    /// The same with a time limit.
    pub fn evaluate_within(&self, limit: Duration, expression: &str) -> Result<Value> {
        let params = json!({
            "expression": expression, "awaitPromise": true, "returnByValue": true, "userGesture": true,
        });
        let mut reply = self.connection.call_within(limit, &self.session, "Runtime.evaluate", params)?;
        let thrown = &reply["exceptionDetails"];
        if !thrown.is_null() {
            let what = thrown["exception"]["description"].as_str().map(str::to_owned);
            bail!("{}: {expression}", what.unwrap_or_else(|| thrown.to_string()));
        }
        Ok(reply["result"]["value"].take())
    }

    /// Polls an expression, which may be a promise, until it is true. An exception counts as false.
    pub fn wait_for(&self, expression: &str, limit: Duration) -> Result<()> {
        let (begin, is_true) = (Instant::now(), format!("(async () => Boolean(await ({expression})))()"));
        loop {
            let rest = limit.saturating_sub(begin.elapsed());
            let last = self.evaluate_within(rest.max(POLL), &is_true);
            if matches!(last, Ok(Value::Bool(true))) {
                return Ok(());
            }
            if rest.is_zero() {
                let why = last.err().map(|error| format!("; {error:#}")).unwrap_or_default();
                bail!("not within {limit:?}: {expression}{why}; the page reported {:?}", self.problems()?);
            }
            std::thread::sleep(POLL);
        }
    }

    /// The visible part of the page as PNG.
    pub fn screenshot_png(&self) -> Result<Vec<u8>> {
        let reply = self.call("Page.captureScreenshot", json!({ "format": "png" }))?;
        STANDARD.decode(reply["data"].as_str().context("no picture")?).ok().context("a picture that is no base64")
    }

    /// The bytes of an expression whose value is a promise of a `Blob`.
    pub fn blob(&self, expression: &str) -> Result<Vec<u8>> {
        let script = format!(
            "(async () => {{ const blob = await ({expression});
                return await new Promise((done, failed) => {{
                    const reader = new FileReader();
                    reader.onload = () => done(reader.result);
                    reader.onerror = () => failed(reader.error);
                    reader.readAsDataURL(blob);
                }});
            }})()"
        );
        let url = self.evaluate(&script)?;
        let (_, data) = url.as_str().and_then(|url| url.split_once(',')).context("no data URL")?;
        STANDARD.decode(data).ok().context("a data URL that is no base64")
    }

    /// Everything that was reported so far.
    pub fn console_messages(&self) -> Result<Vec<Message>> {
        self.log(|log| log.messages.clone())
    }

    /// Errors: uncaught exceptions, `console.error`, violations of the content security policy, failed requests.
    pub fn problems(&self) -> Result<Vec<Message>> {
        let is_problem = |message: &Message| ["error", "assert"].contains(&message.level.as_str());
        Ok(self.console_messages()?.into_iter().filter(is_problem).collect())
    }

    /// Waits for a message of a source that has these words.
    pub fn wait_for_message(&self, source: &str, words: &str) -> Result<()> {
        let is_there = |log: &PageLog| {
            log.messages.iter().any(|message| message.source == source && message.text.contains(words)).then_some(())
        };
        let found = self.connection.wait_for_log(PATIENCE, &self.session, is_there);
        found.with_context(|| format!("no message of {source} says {words:?}"))
    }

    /// Requests so far, those of workers included.
    pub fn requests(&self) -> Result<Vec<Request>> {
        self.log(|log| log.requests.clone())
    }

    /// Waits until a request has ended that a condition is true of.
    pub fn ended_request(&self, condition: impl Fn(&Request) -> bool) -> Result<Request> {
        let is_it = |request: &&Request| request.end_s.is_some() && condition(request);
        let found =
            self.connection.wait_for_log(PATIENCE, &self.session, |log| log.requests.iter().find(is_it).cloned());
        found.context("no such request ended")
    }

    /// Bytes that were transferred until a time in seconds since 1970.
    pub fn bytes_until(&self, time_s: f64) -> Result<u64> {
        self.log(|log| log.transfers.iter().filter(|(at_s, _)| *at_s <= time_s).map(|(_, bytes)| bytes).sum())
    }

    /// Bytes that were transferred so far.
    pub fn bytes(&self) -> Result<u64> {
        self.bytes_until(f64::INFINITY)
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        let close = json!({ "browserContextId": self.context });
        let _ = self.connection.send("", "Target.disposeBrowserContext", close);
    }
}
