//! The objects of a city for the page: attributes, search, and styles by rules.

use futures_util::lock::Mutex;
use insula_archive::city::parse_manifest;
use insula_objects::color::ColorBy;
use insula_viewer::objects::{CityObjects, ObjectStyles, RulesError, StyledObjects};
use insula_viewer::source::server::ServerSource;
use insula_viewer::source::{FetchError, ObjectSource, Transport, WITHOUT_OBJECTS, web_folder};
use insula_web_host::commands::ColorRules;
use insula_web_host::console;
use insula_web_host::host::{Host, to_js};
use insula_web_host::messages::{ColorsMessage, ObjectMessage, SchemaMessage, json};
use insula_web_host::transport::BrowserTransport;
use js_sys::{JSON, Promise, Reflect};
use std::rc::Rc;
use std::sync::Arc;
use wasm_bindgen::prelude::*;
use wasm_bindgen_futures::future_to_promise;

const MAX_HITS: usize = 100;
/// The viewer's requests, which the same host makes, have lower numbers.
const LAST_REQUEST: u32 = 1 << 31;

/// Runs once in each worker.
#[wasm_bindgen(start)]
pub fn start() {
    console::start();
}

/// Reads the objects of a city. It is apart from the viewer, which goes on drawing meanwhile.
///
/// Errors have a `fault`, because pages say in words of their own what is wrong: a `code`; `at` and `why` of a filter, or the `name` of
/// what is unknown.
#[wasm_bindgen]
#[derive(Clone)]
pub struct ObjectReader {
    source: Arc<dyn ObjectSource>,
    origin: [f64; 3],
    /// `None` until the first use.
    opened: Rc<Mutex<Option<Rc<CityObjects>>>>,
}

/// Styles that were made from rules, and what explains them.
#[wasm_bindgen]
pub struct MadeStyles {
    styles: ObjectStyles,
    message: String,
}

#[wasm_bindgen]
impl MadeStyles {
    /// The message about the styles (JSON, see `ColorsMessage`).
    pub fn message(&self) -> String {
        self.message.clone()
    }

    /// The styles, for `CityViewer::set_styles`: a word for each object.
    pub fn words(&self) -> Vec<u32> {
        self.styles.rules().to_vec()
    }
}

#[wasm_bindgen]
impl ObjectReader {
    /// What reads the objects of a city: `manifest` is its text, and the others say where it is, as in `ViewerOptions`. Nothing is
    /// fetched before the first question. Fails if the manifest is invalid.
    #[wasm_bindgen(constructor)]
    pub fn new(host: Host, manifest: &str, base: &str, is_folder: bool, query: &str) -> Result<Self, JsError> {
        let manifest = parse_manifest(manifest.as_bytes()).map_err(to_js)?;
        let transport: Arc<dyn Transport> = Arc::new(BrowserTransport::new(host, LAST_REQUEST));
        let source: Arc<dyn ObjectSource> = if is_folder {
            Arc::new(web_folder::open(base, &manifest, &transport))
        } else {
            Arc::new(ServerSource::new(transport, base, query, &manifest))
        };
        Ok(Self { source, origin: manifest.origin, opened: Rc::default() })
    }

    /// What is known of an object: resolves to JSON (see `ObjectMessage`), or to `undefined` if there is none of this number. Rejects
    /// with the reason if it cannot be fetched.
    pub fn describe(&self, id: u32) -> Promise {
        let reader = self.clone();
        future_to_promise(async move {
            let described = reader.open().await?.describe_with_parent(id).await.map_err(|error| of_fetch(&error))?;
            Ok(described.map_or(JsValue::UNDEFINED, |object| json(&ObjectMessage::from(object)).into()))
        })
    }

    /// Resolves to the objects whose texts match (JSON, a list of `text`, `object` and `typos`), the best first, or to `undefined` if
    /// the city has no search. Rejects with the reason if it cannot be searched.
    pub fn search(&self, text: String, limit: u32) -> Promise {
        let source = self.source.clone();
        future_to_promise(async move {
            let hits = source.search(&text, (limit as usize).clamp(1, MAX_HITS)).await;
            let hits = hits.map_err(|error| of_fetch(&error))?;
            Ok(hits.map_or(JsValue::UNDEFINED, |hits| json(&hits).into()))
        })
    }

    /// Resolves to the attributes by which objects can be coloured, and the palettes (JSON, see `SchemaMessage`). Rejects with the
    /// reason if the city has no objects, or if they cannot be fetched.
    pub fn schema(&self) -> Promise {
        let reader = self.clone();
        future_to_promise(async move {
            let objects = reader.open().await?;
            let schema = objects.schema();
            let message = SchemaMessage {
                objects: schema.objects,
                color_by: schema.names_to_color_by(),
                palettes: ColorBy::palettes().collect(),
                attributes: serde_json::to_value(&schema.attributes).map_err(to_js)?,
                labels: serde_json::to_value(&schema.labels).map_err(to_js)?,
            };
            Ok(json(&message).into())
        })
    }

    /// Makes styles from rules (JSON, see `ColorRules`): resolves to `MadeStyles`. Rejects with the reason if the rules are invalid, or
    /// if objects cannot be fetched.
    pub fn styles(&self, rules: &str) -> Promise {
        let (reader, rules) = (self.clone(), serde_json::from_str::<ColorRules>(rules));
        future_to_promise(async move {
            let rules = rules.map_err(to_js)?.into();
            let styled = reader.open().await?.styles(&rules).await;
            let StyledObjects { styles, legend, passing } = styled.map_err(|error| of_rules(&error))?;
            let legend = serde_json::to_value(&legend).map_err(to_js)?;
            Ok(MadeStyles { styles, message: json(&ColorsMessage { legend, passing }) }.into())
        })
    }
}

/// Why rules have no styles.
fn of_rules(error: &RulesError) -> JsValue {
    let fault = match error {
        RulesError::Filter { why, .. } => {
            serde_json::json!({ "code": why.fault.code(), "at": why.at, "why": why.message })
        }
        RulesError::Color { why, .. } => {
            let (code, name) = why.code();
            serde_json::json!({ "code": code, "name": name })
        }
        RulesError::Fetch(error) => serde_json::json!({ "code": error.code() }),
    };
    with_fault(&error.to_string(), &fault)
}

fn of_fetch(error: &FetchError) -> JsValue {
    with_fault(&error.to_string(), &serde_json::json!({ "code": error.code() }))
}

fn with_fault(message: &str, fault: &serde_json::Value) -> JsValue {
    let shown = js_sys::Error::new(message);
    // Without it, pages show the text.
    let _ = JSON::parse(&fault.to_string()).and_then(|fault| Reflect::set(&shown, &"fault".into(), &fault));
    shown.into()
}

impl ObjectReader {
    async fn open(&self) -> Result<Rc<CityObjects>, JsValue> {
        let mut opened = self.opened.lock().await;
        if let Some(objects) = &*opened {
            return Ok(objects.clone());
        }
        let found = CityObjects::open(self.source.clone(), self.origin).await.map_err(|error| of_fetch(&error))?;
        let (code, reason) = match self.source.opens_objects() {
            true => ("objects", "the city has no objects: bake it again"),
            false => ("area", WITHOUT_OBJECTS),
        };
        let objects = found.ok_or_else(|| with_fault(reason, &serde_json::json!({ "code": code })))?;
        Ok(opened.insert(Rc::new(objects)).clone())
    }
}
