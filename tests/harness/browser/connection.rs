//! Messages of the DevTools protocol: JSON texts with a zero byte after each. A thread reads them.
//!
//! Replies go to the calls that wait for them, events to the log of the page that they concern.

use super::page_log::PageLog;
use anyhow::{Context, Result, bail, ensure};
use serde_json::{Value, json};
use std::collections::{HashMap, HashSet};
use std::io::{BufRead, BufReader, Write};
use std::process::{ChildStdin, ChildStdout};
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait for a reply. Software drivers compile pipelines for seconds.
pub(super) const PATIENCE: Duration = Duration::from_secs(120);

#[derive(Debug)]
pub(super) struct Connection {
    input: Mutex<ChildStdin>,
    state: Mutex<State>,
    changed: Condvar,
    next_id: AtomicU64,
}

#[derive(Debug, Default)]
struct State {
    /// Calls that wait for a reply.
    waiting: HashSet<u64>,
    replies: HashMap<u64, Value>,
    /// Logs by the page's session.
    pages: HashMap<String, PageLog>,
    /// The page's session of each session of a worker.
    pages_of_workers: HashMap<String, String>,
    has_ended: bool,
}

impl State {
    fn page(&mut self, session: &str) -> Option<&mut PageLog> {
        let session = self.pages_of_workers.get(session).map_or(session, String::as_str);
        self.pages.get_mut(session)
    }
}

impl Connection {
    /// Reads until the browser ends.
    pub(super) fn start(input: ChildStdin, output: ChildStdout) -> Arc<Self> {
        let connection = Arc::new(Self {
            input: Mutex::new(input),
            state: Mutex::default(),
            changed: Condvar::new(),
            next_id: AtomicU64::new(1),
        });
        let shared = connection.clone();
        std::thread::spawn(move || shared.read(BufReader::new(output)));
        connection
    }

    fn read(&self, mut output: BufReader<ChildStdout>) {
        let mut message = Vec::new();
        while matches!(output.read_until(0, &mut message), Ok(1..)) {
            message.pop();
            if let Ok(message) = serde_json::from_slice(&message) {
                self.receive(message);
            }
            message.clear();
        }
        self.lock().has_ended = true;
        self.changed.notify_all();
    }

    fn receive(&self, mut message: Value) {
        let mut state = self.lock();
        if let Some(id) = message["id"].as_u64() {
            if state.waiting.remove(&id) {
                state.replies.insert(id, message);
            }
        } else {
            let session = message["sessionId"].as_str().unwrap_or_default().to_owned();
            let (method, params) = (message["method"].take(), message["params"].take());
            if method == "Target.attachedToTarget" {
                self.attach(&mut state, &session, &params);
            } else if let (Some(page), Some(method)) = (state.page(&session), method.as_str()) {
                page.record(method, &params);
            }
        }
        drop(state);
        self.changed.notify_all();
    }

    /// A worker of a page started, and waits until it may run: its messages and requests belong to the page.
    fn attach(&self, state: &mut State, parent: &str, params: &Value) {
        let Some(session) = params["sessionId"].as_str() else { return };
        let page = state.pages_of_workers.get(parent).map_or(parent, String::as_str).to_owned();
        let Some(log) = state.pages.get_mut(&page) else { return };
        let settings = log.settings_of_workers(session);
        state.pages_of_workers.insert(session.to_owned(), page);
        for (method, params) in settings {
            // A worker that has ended already needs no settings.
            let _ = self.send(session, method, params);
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends a call whose reply is not needed. An empty session is the browser itself.
    pub(super) fn send(&self, session: &str, method: &str, params: Value) -> Result<()> {
        self.write(self.next_id.fetch_add(1, Relaxed), session, method, params)
    }

    fn write(&self, id: u64, session: &str, method: &str, params: Value) -> Result<()> {
        let mut message = json!({ "id": id, "method": method, "params": params });
        if !session.is_empty() {
            message["sessionId"] = session.into();
        }
        let mut bytes = serde_json::to_vec(&message)?;
        bytes.push(0);
        let mut input = self.input.lock().unwrap_or_else(PoisonError::into_inner);
        input.write_all(&bytes).context("the browser has ended")?;
        Ok(input.flush()?)
    }

    /// Sends a call and waits for its result.
    pub(super) fn call(&self, session: &str, method: &str, params: Value) -> Result<Value> {
        self.call_within(PATIENCE, session, method, params)
    }

    /// The same with a time limit.
    pub(super) fn call_within(&self, limit: Duration, session: &str, method: &str, params: Value) -> Result<Value> {
        let id = self.next_id.fetch_add(1, Relaxed);
        self.lock().waiting.insert(id);
        self.write(id, session, method, params)?;
        let reply = self.wait(limit, |state| state.replies.remove(&id));
        self.lock().waiting.remove(&id);
        let mut reply = reply.with_context(|| method.to_owned())?;
        ensure!(reply["error"].is_null(), "{method}: {}", reply["error"]);
        Ok(reply["result"].take())
    }

    fn wait<T>(&self, limit: Duration, mut find: impl FnMut(&mut State) -> Option<T>) -> Result<T> {
        let deadline = Instant::now() + limit;
        let mut state = self.lock();
        loop {
            if let Some(found) = find(&mut state) {
                return Ok(found);
            }
            let rest = deadline.saturating_duration_since(Instant::now());
            if state.has_ended || rest.is_zero() {
                bail!(
                    "{}",
                    if state.has_ended { "the browser has ended".into() } else { format!("not within {limit:?}") }
                );
            }
            state = self.changed.wait_timeout(state, rest).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Begins to log a page.
    pub(super) fn add_page(&self, session: &str) {
        self.lock().pages.insert(session.to_owned(), PageLog::new(session));
    }

    /// Reads or changes the log of a page.
    pub(super) fn with_log<T>(&self, session: &str, act: impl FnOnce(&mut PageLog) -> T) -> Result<T> {
        self.lock().page(session).map(act).context("the page is closed")
    }

    /// Waits until the log of a page has something.
    pub(super) fn wait_for_log<T>(
        &self,
        limit: Duration,
        session: &str,
        find: impl Fn(&PageLog) -> Option<T>,
    ) -> Result<T> {
        self.wait(limit, |state| state.page(session).and_then(|log| find(log)))
    }
}
