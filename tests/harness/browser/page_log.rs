//! What the browser reports about a page and its workers: messages, errors, requests.

use serde_json::{Value, json};
use std::collections::HashMap;

/// A message of the console, an uncaught exception, or a message of the browser about the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// `console`, `exception`, `security`, `network`, ...
    pub source: String,
    /// `error`, `warning`, `info`, `log`, ...
    pub level: String,
    /// Its text, with the source's address if there is one.
    pub text: String,
}

/// A request of a page or its workers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Request {
    pub url: String,
    /// 0 before the response.
    pub status: u64,
    /// Transferred bytes: the encoded body, and at its end the head.
    pub bytes: u64,
    /// Whether the browser's cache or a service worker answered.
    pub is_cached: bool,
    /// Why it failed.
    pub failure: Option<String>,
    /// Seconds since 1970.
    pub begin_s: f64,
    /// The same of the end; `None` while it runs.
    pub end_s: Option<f64>,
}

#[derive(Debug, Default)]
pub struct PageLog {
    /// Sessions of the page, which is the first, and its workers.
    pub(super) sessions: Vec<String>,
    /// What new workers are told: the emulated network.
    pub(super) network: Option<Value>,
    pub(super) throttled: Option<Value>,
    pub(super) loads: usize,
    pub(super) messages: Vec<Message>,
    pub(super) requests: Vec<Request>,
    /// Time in seconds since 1970, and bytes that arrived then.
    pub(super) transfers: Vec<(f64, u64)>,
    /// Indices in `requests` by id.
    indices: HashMap<String, usize>,
    /// Difference of the browser's two clocks.
    epoch_s: f64,
}

impl PageLog {
    pub(super) fn new(session: &str) -> Self {
        Self { sessions: vec![session.to_owned()], ..Self::default() }
    }

    /// Adds a worker. Returns the calls that it needs before it runs.
    pub(super) fn settings_of_workers(&mut self, session: &str) -> Vec<(&'static str, Value)> {
        self.sessions.push(session.to_owned());
        let mut calls = vec![
            ("Runtime.enable", json!({})),
            ("Log.enable", json!({})),
            ("Network.enable", json!({})),
            ("Target.setAutoAttach", auto_attach()),
        ];
        calls.extend(self.network.clone().map(|params| ("Network.emulateNetworkConditions", params)));
        calls.extend(self.throttled.clone().map(|params| ("Emulation.setCPUThrottlingRate", params)));
        calls.push(("Runtime.runIfWaitingForDebugger", json!({})));
        calls
    }

    /// Takes an event.
    pub(super) fn record(&mut self, method: &str, params: &Value) {
        match method {
            "Page.loadEventFired" => self.loads += 1,
            "Runtime.consoleAPICalled" => {
                let arguments = params["args"].as_array().into_iter().flatten().map(plain);
                self.add("console", &text(&params["type"]), arguments.collect::<Vec<_>>().join(" "));
            }
            "Runtime.exceptionThrown" => {
                let details = &params["exceptionDetails"];
                let what = details["exception"]["description"].as_str().unwrap_or_default();
                self.add("exception", "error", format!("{} {what} {}", text(&details["text"]), text(&details["url"])));
            }
            "Log.entryAdded" => {
                let entry = &params["entry"];
                let words = format!("{} {}", text(&entry["text"]), text(&entry["url"]));
                self.add(&text(&entry["source"]), &text(&entry["level"]), words);
            }
            "Audits.issueAdded" if params["issue"]["code"] == "ContentSecurityPolicyIssue" => {
                self.add("security", "error", params["issue"]["details"].to_string());
            }
            "Inspector.targetCrashed" => self.add("exception", "error", "the page crashed".into()),
            _ => self.record_request(method, params),
        }
    }

    fn add(&mut self, source: &str, level: &str, text: String) {
        self.messages.push(Message { source: source.into(), level: level.into(), text });
    }

    fn record_request(&mut self, method: &str, params: &Value) {
        let now_s = params["timestamp"].as_f64().unwrap_or_default() + self.epoch_s;
        let id = text(&params["requestId"]);
        if method == "Network.requestWillBeSent" {
            self.begin(&id, params);
        }
        let Some(request) = self.indices.get(&id).and_then(|at| self.requests.get_mut(*at)) else { return };
        let bytes = params["encodedDataLength"].as_f64().unwrap_or_default().max(0.0) as u64;
        match method {
            "Network.responseReceived" => {
                let response = &params["response"];
                request.status = response["status"].as_u64().unwrap_or_default();
                request.is_cached = response["fromDiskCache"] == true || response["fromServiceWorker"] == true;
            }
            "Network.requestServedFromCache" => request.is_cached = true,
            "Network.dataReceived" => {
                request.bytes += bytes;
                self.transfers.push((now_s, bytes));
            }
            "Network.loadingFinished" => {
                request.end_s = Some(now_s);
                // The whole; of a cached response, it is what was once transferred.
                if !request.is_cached && bytes > request.bytes {
                    self.transfers.push((now_s, bytes - request.bytes));
                    request.bytes = bytes;
                }
            }
            "Network.loadingFailed" => {
                request.end_s = Some(now_s);
                request.failure = Some(text(&params["errorText"]));
            }
            _ => {}
        }
    }

    fn begin(&mut self, id: &str, params: &Value) {
        let wall_s = params["wallTime"].as_f64().unwrap_or_default();
        self.epoch_s = wall_s - params["timestamp"].as_f64().unwrap_or_default();
        self.indices.insert(id.to_owned(), self.requests.len());
        let url = text(&params["request"]["url"]);
        self.requests.push(Request { url, begin_s: wall_s, ..Request::default() });
    }
}

/// Workers are attached to the session of what starts them, and wait for their settings.
pub(super) fn auto_attach() -> Value {
    json!({ "autoAttach": true, "waitForDebuggerOnStart": true, "flatten": true })
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

/// An argument of a console message as a reader sees it.
fn plain(argument: &Value) -> String {
    match (&argument["value"], argument["description"].as_str()) {
        (Value::String(text), _) => text.clone(),
        (Value::Null, Some(description)) => description.to_owned(),
        (value, _) => value.to_string(),
    }
}
